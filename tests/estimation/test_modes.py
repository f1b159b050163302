"""Two ways of flying in one filter: weights follow the flight, one mode alone is the plain filter."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.compiled_filter import CompiledKalmanFilter
from groundstation.estimation.modes import ModeBank

F = np.array([[1.0, 0.1], [0.0, 1.0]])
H, R = np.array([[1.0, 0.0]]), np.array([[0.04]])
ALL = np.ones(2, np.bool_)


def noise(psd: float, dt: float = 0.1) -> np.ndarray:
    return psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])


def started(stay_s: tuple[float, ...]) -> ModeBank:
    bank = ModeBank(2, stay_s)
    bank.place(slice(0, 2), np.zeros(2), np.diag([1.0, 4.0]))
    return bank


def test_one_mode_is_the_plain_filter(rng: np.random.Generator) -> None:
    bank, plain = started((5.0,)), CompiledKalmanFilter(dim_x=2, dim_z=1)
    plain.x, plain.P = np.zeros(2), np.diag([1.0, 4.0])
    for _ in range(30):
        bank.predict(F, [noise(0.3)], 0.1)
        plain.F, plain.Q = F, noise(0.3)
        plain.predict()
        residual = rng.normal(size=1)
        bank.correct(residual, H, R, ALL, telling=True)
        plain.correct(residual, H, R)
    np.testing.assert_array_equal(bank.x, plain.x)
    np.testing.assert_array_equal(bank.P, plain.P)


def fly(bank: ModeBank, modes: list[np.ndarray], acceleration: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return per step: error squared in sigmas (2 dof), position error and the second mode's weight."""
    truth, out = np.zeros(2), []
    for a in acceleration:
        truth = F @ truth + a
        bank.predict(F, modes, 0.1)
        z = truth[:1] + rng.normal(0, 0.2, 1)
        bank.correct(z - bank.x[:1], H, R, ALL, telling=True)
        e = truth - bank.x
        weight = float(bank.weights[-1]) if len(modes) > 1 else 0.0
        out.append((float(e @ np.linalg.solve(bank.P, e)), float(e[0]), weight))
    return np.array(out)


def test_a_glide_is_as_quiet_and_a_flare_as_quick_as_with_the_right_filter(rng: np.random.Generator) -> None:
    modes = [noise(0.02), noise(20.0)]
    calm_rms, jump_rms, weights = {"both": [], "calm": []}, {"both": [], "quick": []}, []
    squares = []
    for _ in range(60):
        # white acceleration of the calm kind, then two seconds of hard braking
        steps = rng.multivariate_normal(np.zeros(2), modes[0], 120)
        steps[80:100] += np.array([0.5 * 0.1**2, 0.1]) * 6.0
        seed = int(rng.integers(2**31))
        runs = {
            name: fly(started(stay), chosen, steps, np.random.default_rng(seed))
            for name, stay, chosen in (
                ("both", (20.0, 2.0), modes),
                ("calm", (1.0,), modes[:1]),
                ("quick", (1.0,), modes[1:]),
            )
        }
        for name, kept in calm_rms.items():
            kept.append(runs[name][30:80, 1] ** 2)
        for name, kept in jump_rms.items():
            # from half a second after: a manoeuvre has to be seen before it can be followed
            kept.append(runs[name][85:100, 1] ** 2)
        weights.append(runs["both"][:, 2])
        squares += list(runs["both"][30:80:10, 0])
    rms = {name: np.sqrt(np.mean(kept)) for name, kept in calm_rms.items()}
    assert rms["both"] < 1.1 * rms["calm"]
    rms = {name: np.sqrt(np.mean(kept)) for name, kept in jump_rms.items()}
    assert rms["both"] < 1.15 * rms["quick"]
    weight = np.mean(weights, axis=0)
    assert weight[30:80].mean() < 0.2
    assert weight[85:100].mean() > 0.6
    # on the calm part the truth is drawn from the calm mode, so that the mixture may only be too careful
    assert np.mean(squares) < chi2.ppf(0.995, 2 * len(squares)) / len(squares)


def test_a_snapshot_brings_everything_back(rng: np.random.Generator) -> None:
    bank, modes = started((10.0, 2.0)), [noise(0.02), noise(20.0)]
    fly(bank, modes, rng.normal(0, 0.1, (10, 2)), rng)
    saved = bank.snapshot()
    before = (bank.x.copy(), bank.P.copy(), bank.weights.copy())
    fly(bank, modes, rng.normal(0, 0.1, (10, 2)), rng)
    bank.restore(saved)
    for a, b in zip(before, (bank.x, bank.P, bank.weights), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("stay_s", [(5.0,), (10.0, 2.0)])
def test_doubt_adds_to_variances_and_leaves_a_snapshot_alone(
    rng: np.random.Generator, stay_s: tuple[float, ...]
) -> None:
    bank, modes = started(stay_s), [noise(0.02), noise(20.0)][: len(stay_s)]
    fly(bank, modes, rng.normal(0, 0.1, (10, 2)), rng)
    saved, x, P = bank.snapshot(), bank.x.copy(), bank.P.copy()
    bank.doubt(slice(1, 2), np.array([3.0]))
    np.testing.assert_allclose(bank.x, x)
    np.testing.assert_allclose(bank.P, P + np.diag([0.0, 3.0]))
    # and it is what the next step starts from
    bank.predict(np.eye(2), [np.zeros((2, 2))] * len(stay_s), 1e-9)
    np.testing.assert_allclose(bank.P, P + np.diag([0.0, 3.0]), rtol=1e-6)
    bank.restore(saved)
    np.testing.assert_array_equal(bank.P, P)
