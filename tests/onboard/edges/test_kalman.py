"""The norm-constrained filter: its constraint, its optimality, its consistency; and the model in the picture."""

import numpy as np
from scipy.stats import chi2

from groundstation.onboard.edges.kalman import (
    LineState,
    constrained_gain,
    picture_crossings,
    picture_state,
    predict,
    predict_picture,
    update_crossings,
    update_lines,
    update_picture,
)
from groundstation.onboard.edges.lines import line_map, lines_from_crossings, measurement_matrix, project_lines
from tests.onboard.edges.seen import KAPPA, ROWS, RUNWAY, approach

PRIOR = np.diag([1e-6, 1e-3, 4.0, 4.0])


def test_the_constrained_gain_keeps_the_norm_and_costs_the_least_trace(rng: np.random.Generator) -> None:
    mean = np.array([0.8, 0.6, -5.0, 9.0])
    h = rng.normal(size=(4, 4))
    noise = 0.3 * np.eye(4)
    p = np.diag([0.02, 0.03, 1.0, 2.0])
    s = h @ p @ h.T + noise
    optimum = np.linalg.solve(s, h @ p).T
    innovation = rng.normal(size=4)
    gain = constrained_gain(optimum, innovation, s, mean)
    assert (
        np.hypot(*(mean + gain @ innovation)[:2]) == 1.0 or abs(np.hypot(*(mean + gain @ innovation)[:2]) - 1) < 1e-12
    )

    def trace(k):
        kept = np.eye(4) - k @ h
        return np.trace(kept @ p @ kept.T + k @ noise @ k.T)

    np.testing.assert_allclose(gain[2:], optimum[2:])
    for _ in range(200):
        # any other gain that ends at the same (a, b), which is the nearest one of length 1
        other = gain.copy()
        change = 0.05 * rng.normal(size=(2, 4))
        other[:2] += change - np.outer(change @ innovation, innovation) / (innovation @ innovation)
        assert trace(other) >= trace(gain) - 1e-12


def test_the_papers_update_brings_lines_together_and_a_stays_positive() -> None:
    pose = approach()
    truth, _ = project_lines(RUNWAY, line_map(pose, KAPPA), ROWS)
    turned = np.array([np.cos(0.05), np.sin(0.05), -6.0, 12.0])
    state = LineState(mean=turned, covariance=np.diag([1e-3, 1e-2, 9.0, 9.0]))
    for _ in range(5):
        state = predict(state, 1e-4 * np.eye(4))
        update = update_lines(
            state, measurement_matrix(pose, KAPPA), lines_from_crossings(truth, ROWS), np.diag([1e-6, 1e-6, 0.1] * 2)
        )
        state = update.state
        assert abs(np.hypot(*state.mean[:2]) - 1.0) < 1e-12
        assert state.mean[0] > 0.0
        assert np.linalg.eigvalsh(state.covariance).min() > -1e-12
    before, after = (project_lines(mean, line_map(pose, KAPPA), ROWS)[0] for mean in (turned, state.mean))
    assert np.abs(after - truth).max() < 0.1 * np.abs(before - truth).max()


def test_errors_of_the_filter_are_consistent_with_its_covariance(rng: np.random.Generator) -> None:
    """NEES of (turn, c, d) over runs inside the two-sided 99.8 % bounds of χ², and the innovations' too."""
    runs, steps = 120, 8
    poses = [approach(y=200.0 - 12.0 * k, z=18.0 - 1.0 * k, x=3.0 - 0.3 * k) for k in range(steps)]
    nees, nis = 0.0, 0.0
    for _ in range(runs):
        turn, c, d = rng.normal(size=3) * [0.02, 1.0, 1.0]
        truth = np.array([np.cos(turn), np.sin(turn), -9.0 + c, 9.0 + d])
        prior = np.diag([0.0, 0.02**2, 1.0, 1.0])
        state = LineState(mean=RUNWAY.copy(), covariance=prior)
        for pose in poses:
            e = line_map(pose, KAPPA)
            predicted, h = project_lines(state.mean, e, ROWS)
            measured = project_lines(truth, e, ROWS)[0] + rng.normal(size=4)
            update = update_crossings(state, predicted, h, measured, np.eye(4))
            state, nis = update.state, nis + update.nis
        across = np.array([-state.mean[1], state.mean[0]])
        basis = np.zeros((3, 4))
        basis[0, :2], basis[1, 2], basis[2, 3] = across, 1.0, 1.0
        error = basis @ (truth - state.mean)
        nees += error @ np.linalg.solve(basis @ state.covariance @ basis.T, error)
    for value, freedom in ((nees, 3 * runs), (nis, 4 * runs * steps)):
        low, high = chi2.ppf([0.001, 0.999], freedom)
        assert low < value < high


def test_constant_velocity_in_the_picture_is_exact_for_constant_velocity() -> None:
    start = np.array([300.0, 280.0, 340.0, 365.0])
    rate = np.array([2.0, -3.0, 1.0, 4.0])
    state = picture_state(start, ROWS, 240.0, np.array([50.0, 1.0]))
    for k in range(1, 30):
        state = predict_picture(state, 0.1, np.array([1e-3, 1e-6]))
        if k < 20:
            state = update_picture(state, start + 0.1 * k * rate, ROWS, 1e-4 * np.eye(4))
    np.testing.assert_allclose(picture_crossings(state, ROWS), start + 2.9 * rate, atol=0.05)
