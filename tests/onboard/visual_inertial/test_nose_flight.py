"""Nose camera and inertial unit together, on one rendered approach: detections, reports, losses."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.experiments.onboard_flights import follow
from groundstation.geometry.rotation import (
    matrix_from_wxyz,
    rotation_from_vector,
    rotation_x,
    rotation_y,
    rotation_z,
    wxyz_from_matrix,
)
from groundstation.onboard.edges.report import EdgeReport, EdgeStatus
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.pose.agreement import compare_positions
from groundstation.onboard.pose.inertial_filter import (
    CameraMount,
    ImuSample,
    InertialConfig,
    InertialFilter,
    PoseObservation,
)
from groundstation.onboard.pose.inertial_kernel import strapdown
from groundstation.onboard.pose.pose_solver import PoseStatus, RunwayPose
from groundstation.onboard.pose.simulated_approach import RUNWAY_FROM_LEVEL_BODY
from groundstation.onboard.scenes.jsbsim_flight import jsbsim_nose_flight
from groundstation.onboard.scenes.nose_flight import NoseFlight, attitude_of, nose_flight, nose_setup
from groundstation.onboard.scenes.sequences import SEQUENCES
from groundstation.onboard.visual_inertial.config import ApproachConfig
from groundstation.onboard.visual_inertial.consider_parameters import ConsiderFilterBank
from groundstation.onboard.visual_inertial.corner_finder import FoundCorners
from groundstation.onboard.visual_inertial.nose_navigator import NoseNavigator
from groundstation.onboard.visual_inertial.nose_report import NOT_TRACKED
from tests.onboard.visual_inertial.short_flight import FRAMES, given_to, ground_series, night_flight, short_flight


@pytest.mark.parametrize("make", [nose_flight, jsbsim_nose_flight])
def test_samples_carry_the_exact_state_along(make: Callable[..., NoseFlight]) -> None:
    """Expected: without its noise and biases the inertial log is the flight: 3 s drift by less than 3 cm and 0.02°."""
    setup = replace(nose_setup(SEQUENCES[0], 3.0), config=replace(InertialConfig(), force_noise=1e-9, rate_noise=1e-9))
    flight = make(SEQUENCES[0], setup)
    motion = flight.motion
    samples = [
        ImuSample(t_s=s.t_s, force_m_s2=s.force_m_s2 - f, rate_rad_s=s.rate_rad_s - r)
        for s, f, r in zip(motion.samples, motion.force_bias, motion.rate_bias, strict=True)
    ]
    position, velocity = motion.position_m[0].copy(), motion.velocity_m_s[0].copy()
    q = wxyz_from_matrix(motion.runway_from_body[0])
    for sample in samples[:-1]:
        strapdown(position, velocity, q, sample.force_m_s2, sample.rate_rad_s, 1.0 / setup.imu_hz)
    assert np.abs(position - motion.position_m[-1]).max() < 0.03
    turn = matrix_from_wxyz(q).T @ motion.runway_from_body[-1]
    assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 0.02


def test_attitude_is_the_aviators() -> None:
    angles = np.radians([5.0, -3.0, 8.0])
    R = RUNWAY_FROM_LEVEL_BODY @ rotation_z(angles[2]) @ rotation_y(angles[1]) @ rotation_x(angles[0])
    np.testing.assert_allclose(attitude_of(wxyz_from_matrix(R)), angles, atol=1e-12)


def test_a_short_approach_is_followed_with_consistent_errors() -> None:
    """Expected: every picture after the first few is used, and the errors are consistent with the covariance.

    The edges have to be followed for six pictures, and the fourth pose is the first that gives a fix.

    One flight's errors are correlated, so its NEES of 6 is one draw, not a mean: within the 99.9 % bound of one.
    """
    flight, pictures = short_flight()
    one = follow(flight, pictures)
    assert one.outcomes.get("used", 0) >= FRAMES - 10
    assert len(one.t_s) >= FRAMES - 10
    assert (np.abs(one.error_m) < 3.0 * one.sigma_m).mean() > 0.95
    assert one.nees[-5:].max() < 22.5
    assert one.nees[-5:].min() > 0.0
    assert one.sigma_m[-1, 1] < one.sigma_m[0, 1]


def test_a_start_from_wrong_poses_is_not_given_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: two poses 40 and 80 m off start it as well as two right ones; no fix is reported until four agree."""
    solve, off = NoseNavigator._solve, iter([40.0, 80.0])

    def wrong_at_first(self: NoseNavigator, corners: FoundCorners) -> RunwayPose | None:
        pose = solve(self, corners)
        if pose is None or pose.status is not PoseStatus.OK:
            return pose
        return replace(pose, position_m=pose.position_m + np.array([0.0, next(off, 0.0), 0.0]))

    monkeypatch.setattr(NoseNavigator, "_solve", wrong_at_first)
    flight, pictures = short_flight()
    one = follow(flight, pictures)
    assert one.outcomes["started"] >= 2
    assert one.outcomes["gated"] >= ApproachConfig().give_up_after
    assert len(one.t_s) >= 3
    assert (np.abs(one.error_m) < 3.0 * one.sigma_m).all()
    assert one.nees.max() < 22.5


def test_by_night_the_covariance_covers_the_bias_of_edges_by_lamps() -> None:
    """Expected: poses are used from the seventh picture on; errors inside 3 σ, NEES inside a single draw's 99.9 %."""
    flight, pictures = night_flight()
    one = follow(flight, pictures)
    assert one.outcomes.get("used", 0) >= 4
    assert (np.abs(one.error_m) < 3.0 * one.sigma_m).all()
    assert one.nees.max() < 22.5


def test_without_pictures_it_coasts_and_reports_it() -> None:
    """Expected: blank pictures from the middle on: no pose is made up, and sigma grows."""
    flight, pictures = short_flight()
    blind = [p if k < 16 else np.full_like(p, 90) for k, p in enumerate(pictures)]
    seen, lost = follow(flight, pictures), follow(flight, blind)
    assert lost.outcomes["used"] <= 16
    assert (lost.sigma_m[-1] > seen.sigma_m[-1]).all()
    assert np.abs(lost.error_m[-1] / lost.sigma_m[-1]).max() < 3.5


def test_edges_that_the_tracker_is_not_sure_of_are_not_fused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: *acquiring* pictures go into no filter, and say so, nor do the first three that track after them."""
    step, number = EdgeTracker.step, iter(range(FRAMES))
    doubted = range(11, 15)

    def doubting(self: EdgeTracker, *given: Any) -> EdgeReport:
        report = step(self, *given)
        return replace(report, status=EdgeStatus.ACQUIRING) if next(number) in doubted else report

    monkeypatch.setattr(EdgeTracker, "step", doubting)
    flight, pictures = short_flight()
    navigator = NoseNavigator(flight.runway, flight.setup.lens, flight.setup.mount)
    reports = [navigator.update(*given) for given in given_to(navigator, flight, pictures)]
    outcomes = [report.outcome for report in reports]
    assert [outcomes[k] for k in doubted] == ["edges_alone"] * len(doubted)
    assert {reports[k].detail for k in doubted} == {NOT_TRACKED}
    assert outcomes[15:18] == ["edges_alone"] * 3
    assert outcomes[10] == outcomes[18] == "used"


def test_a_constant_error_passes_the_filter_by_its_sensitivity(rng: np.random.Generator) -> None:
    """Expected: S is what a filter that is given wrong poses does differently, to second order."""
    config = InertialConfig()
    mount = CameraMount(camera_in_body_m=np.zeros(3), body_from_camera=np.eye(3))
    modes = np.array([[0.5, 2.0, -0.3, 0.002, 0.001, -0.003]]).T
    main, wrongly_updated = InertialFilter(config, mount), InertialFilter(config, mount)
    parallel = ConsiderFilterBank(config, mount, 1)
    for k in range(200):
        sample = ImuSample(t_s=0.01 * k, force_m_s2=np.array([0.1, 0.0, 9.8]), rate_rad_s=np.zeros(3))
        for one in (main, wrongly_updated, parallel):
            one.process_imu(sample)
        if k % 10 == 0:
            place = np.array([0.0, 100.0 - 0.2 * k, 10.0]) + 0.1 * rng.standard_normal(3)
            observation = PoseObservation(
                t_s=sample.t_s, position_m=place, runway_from_camera_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
                covariance=np.diag([0.1, 1.0, 0.1, 1e-4, 1e-4, 1e-4]),
            )  # fmt: skip
            main.update(observation)
            parallel.update(observation, modes)
            wrongly_updated.update(
                replace(
                    observation,
                    position_m=place + modes[:3, 0],
                    runway_from_camera_wxyz=wxyz_from_matrix(rotation_from_vector(modes[3:, 0])),
                )
            )
    S = parallel.sensitivity(main.navigation)[:, 0]
    now, other = main.navigation, wrongly_updated.navigation
    np.testing.assert_allclose(other.position_m - now.position_m, S[:3], rtol=0.03, atol=0.01)
    np.testing.assert_allclose(other.velocity_m_s - now.velocity_m_s, S[6:], rtol=0.05, atol=0.02)


def test_a_biased_ground_track_is_found_and_a_right_one_is_not() -> None:
    """Expected: 25 m along the runway and 6 m aside are found; the truth with its own noise agrees."""
    flight, pictures = short_flight()
    fixes = ground_series(flight, pictures)
    right: FloatArray = np.array([flight.pose(k).camera_threshold_m for k in flight.frames])
    t = flight.motion.t_s[list(flight.frames)]
    noise = np.random.default_rng(3).normal(0.0, 0.3, right.shape)
    covariance = np.broadcast_to(0.09 * np.eye(3), (len(t), 3, 3))
    for bias, agrees in ((np.zeros(3), True), (np.array([6.0, 25.0, 0.0]), False)):
        both = compare_positions(
            replace(fixes, t_s=t, position_m=right + noise + bias, covariance_m2=np.asarray(covariance)), fixes
        )
        assert both is not None
        assert both.agree is agrees
        if not agrees:
            assert np.abs(both.mean_m + bias)[0] < 3.0
