"""Trajectories: velocity is the derivative of position, and each flies its stated path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from groundstation.errors import ScenarioError
from groundstation.simulation.approach import Flare, GlideApproach, bound_glide, weaving_approach
from groundstation.simulation.path_deviation import GustModel, drawn_deviation
from groundstation.simulation.take_off import TakeOff, take_off
from groundstation.simulation.trajectory import LateralWeave, SampledTrajectory, SuperposedTrajectory, Trajectory

SMOOTH_FLARE = Flare.meeting(110.0, 60.0, np.radians(3.5))
DRAWN = drawn_deviation(np.random.default_rng(1), span_s=(0.0, 20.0), acceleration_psd_m2_s3=(0.05, 0.1, 0.05))
TRAJECTORIES: dict[str, Trajectory] = {
    "bound": bound_glide(),
    "weaving": weaving_approach(),
    "smooth flare": GlideApproach(start_y_m=300.0, end_y_m=70.0, flare=SMOOTH_FLARE),
    "drawn": SuperposedTrajectory(nominal=bound_glide(), deviation=DRAWN),
    "gusts": SuperposedTrajectory(
        nominal=bound_glide(), deviation=GustModel().draw(np.random.default_rng(2), (0.0, 21.6))
    ),
    "take-off": take_off(),
}
# where the predictors' track has its kinks: start of the flare, and its floor
KINKS_S = {"weaving": (13.6, 16.851)}


@pytest.mark.parametrize("name", TRAJECTORIES)
@given(share=st.floats(-0.05, 1.05))
def test_velocity_is_the_derivative_of_position(name: str, share: float) -> None:
    trajectory = TRAJECTORIES[name]
    start, end = trajectory.span_s
    t, h = start + share * (end - start), 1e-5
    if any(abs(t - kink) < 0.01 for kink in KINKS_S.get(name, ())):
        return
    before, after = trajectory.position(np.array([t - h, t + h]))
    assert (after - before) / (2 * h) == pytest.approx(trajectory.velocity(np.array([t]))[0], abs=2e-4)


def test_the_predictors_track() -> None:
    """Its three formulas, at times in each of its parts."""
    track = weaving_approach(end_y_m=20.0)
    x, y, z = track.position(np.array([2.0, 14.0, 17.0])).T
    assert x == pytest.approx(1.5 * np.sin(2 * np.pi * np.array([2.0, 14.0, 17.0]) / 8))
    assert y == pytest.approx([400.0, 100.0, 25.0])
    assert z == pytest.approx([np.tan(np.radians(3.5)) * 340.0, 3.06 * np.exp(-10.0 / 35.0), 0.3])


def test_the_bounds_glide() -> None:
    track = bound_glide()
    assert track.span_s == pytest.approx((0.0, 21.6))
    assert track.position(np.array([0.0, 21.6])) == pytest.approx(np.array([[0, 600, 33.0275], [0, 60, 0]]), abs=1e-3)
    assert track.velocity(np.array([5.0]))[0] == pytest.approx([0.0, -25.0, -25.0 * np.tan(np.radians(3.5))])


def test_a_flare_can_meet_its_glide_path() -> None:
    glide = GlideApproach(start_y_m=300.0, end_y_m=70.0, flare=SMOOTH_FLARE)
    t = (300.0 - 110.0) / 25.0 + np.array([-1e-6, 1e-6])
    assert np.ptp(glide.position(t)[:, 2]) < 1e-5
    assert np.ptp(glide.velocity(t)[:, 2]) < 1e-5


def test_a_take_off_has_its_phases() -> None:
    plan = TakeOff(stand_s=2.0, acceleration_m_s2=4.0, rotate_speed_m_s=14.0, climb_speed_m_s=20.0)
    flight = take_off(plan)
    stands, rolls, climbs = flight.velocity(np.array([1.9, 4.0, 9.0]))
    assert stands == pytest.approx(np.zeros(3))
    assert rolls == pytest.approx([0.0, -8.0, 0.0])
    assert np.linalg.norm(climbs) == pytest.approx(20.0)
    assert np.arctan2(climbs[2], -climbs[1]) == pytest.approx(plan.climb_rad)
    assert flight.position(np.array([4.0]))[0] == pytest.approx([0.0, 300.0 - 0.5 * 4.0 * 2.0**2, 0.4], abs=1e-5)
    last = flight.position(np.array(flight.span_s))[1]
    assert last[1] == pytest.approx(plan.end_y_m, abs=0.11)


def test_drawn_tracks_have_the_models_psd(rng: np.random.Generator) -> None:
    """Steps of velocity and of position less its straight part: variance and correlation of the motion model."""
    psd, dt = np.array([0.05, 0.1, 0.4]), 0.5
    deviation = drawn_deviation(rng, span_s=(0.0, 2000.0), acceleration_psd_m2_s3=tuple(psd), step_s=0.1)
    t = np.arange(0.0, 2000.0 + dt / 2, dt)
    p, v = deviation.position(t), deviation.velocity(t)
    kick, slip = np.diff(v, axis=0), np.diff(p, axis=0) - dt * v[:-1]
    for axis in range(3):
        Q = psd[axis] * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        w = np.stack([slip[:, axis], kick[:, axis]])
        nees = np.einsum("in,ij,jn->", w, np.linalg.inv(Q), w)
        low, high = chi2.ppf([0.001, 0.999], 2 * w.shape[1])
        assert low < nees < high
        low, high = chi2.ppf([0.001, 0.999], w.shape[1]) / w.shape[1]
        assert low < np.mean(w[1] ** 2) / Q[1, 1] < high
        assert low < np.mean(w[0] ** 2) / Q[0, 0] < high


def test_drawn_tracks_may_start_off_the_nominal() -> None:
    starts = []
    for seed in range(300):
        deviation = drawn_deviation(
            np.random.default_rng(seed),
            span_s=(0.0, 1.0),
            acceleration_psd_m2_s3=(0.0, 0.0, 0.0),
            position_sigma_m=10.0,
            velocity_sigma_m_s=5.0,
            step_s=1.0,
        )
        starts.append([deviation.position(np.zeros(1))[0] / 10.0, deviation.velocity(np.zeros(1))[0] / 5.0])
    squares = np.square(starts)
    low, high = chi2.ppf([0.001, 0.999], squares[:, 0].size) / squares[:, 0].size
    assert low < squares[:, 0].mean() < high
    assert low < squares[:, 1].mean() < high


def test_gusts_are_stationary() -> None:
    """Deviation and its rate, one value of each of many draws, at the start and at the end."""
    gusts = GustModel(sigma_m_s2=(0.6, 0.0, 0.3))
    draws = [gusts.draw(np.random.default_rng(seed), (0.0, 4.0), step_s=0.1) for seed in range(250)]
    for moment in (0.0, 4.0):
        d = np.array([draw.position(np.array([moment]))[0] for draw in draws])
        v = np.array([draw.velocity(np.array([moment]))[0] for draw in draws])
        assert np.all(d[:, 1] == 0)
        low, high = chi2.ppf([0.0005, 0.9995], len(draws)) / len(draws)
        for axis, sigma in ((0, 0.6), (2, 0.3)):
            expected = sigma**2 * np.diag(gusts.stationary_covariance)
            assert low < np.mean(d[:, axis] ** 2) / expected[0] < high
            assert low < np.mean(v[:, axis] ** 2) / expected[1] < high


def test_beyond_its_samples_a_track_is_straight() -> None:
    ends = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    track = SampledTrajectory(t_s=np.array([0.0, 1.0]), position_m=ends, velocity_m_s=np.ones((2, 3)))
    assert track.position(np.array([-2.0, 3.0])) == pytest.approx(np.array([[-2.0] * 3, [3.0, 4.0, 5.0]]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: GlideApproach(speed_m_s=0.0), "Glide: speed_m_s: got 0.0; wanted a finite number > 0"),
        (lambda: GlideApproach(start_y_m=50.0), "Glide: end_y_m: got 60.0; wanted below 50 m"),
        (lambda: LateralWeave(period_s=-1.0), "Weave: period_s"),
        (lambda: GustModel(sigma_m_s2=(0.1, -0.1, 0.1)), "Gusts: sigma_m_s2"),
        (lambda: GustModel().draw(np.random.default_rng(), (1.0, 0.0)), "GustModel: span_s"),
        (lambda: take_off(TakeOff(climb_speed_m_s=10.0)), "at least rotate_speed_m_s = 14"),
        (
            lambda: SampledTrajectory(
                t_s=np.array([0.0, 1.0, 1.0]), position_m=np.zeros((3, 3)), velocity_m_s=np.zeros((3, 3))
            ),
            r"t_s\[2\]: got 1; wanted later than 1",
        ),
        (
            lambda: SampledTrajectory(
                t_s=np.array([0.0, 1.0]), position_m=np.zeros((3, 3)), velocity_m_s=np.zeros((2, 3))
            ),
            r"position_m: got shape \(3, 3\); wanted shape \(2, 3\)",
        ),
    ],
)
def test_what_makes_no_flight_is_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ScenarioError, match=message):
        make()
