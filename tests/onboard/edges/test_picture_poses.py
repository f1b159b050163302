"""Poses of pictures: where they come from, what they are wrong by, and what the tracker makes of it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.onboard.edges.camera_file import NoseCamera, load_nose_camera
from groundstation.onboard.edges.config import TrackerConfig, without_log
from groundstation.onboard.edges.imu_file import PoseLog
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.picture_poses import PicturePose, PicturePoses
from groundstation.onboard.edges.pose import Attitude
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift, with_drift
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.edges.visual_odometry import motion_between, turn_of
from groundstation.onboard.scenes.nose_flight import attitude_of
from groundstation.onboard.scenes.sequences import SEQUENCES, NoseFrame, Renderer
from groundstation.onboard.video import EdgesResult, format_edges_summary
from tests.onboard.edges.seen import KAPPA, RUNWAY, SIZE, approach, painted_runway

STATE = LineState(mean=np.concatenate([RUNWAY, np.zeros(3)]), covariance=np.diag([1e-6, 1e-6, 0.01, 0.01, *[1e-6] * 3]))
LENS = "image_size_px = [640, 480]\nfocal_px = [620.0, 620.0]\nprincipal_point_px = [319.5, 239.5]\n"


@pytest.fixture(scope="module")
def frames() -> list[NoseFrame]:
    """Five pictures of an approach, 0.1 s apart."""
    sequence = SEQUENCES[0]
    return list(Renderer(replace(sequence, approach=replace(sequence.approach, frames=5))).frames())


@pytest.fixture
def camera(tmp_path: Path, frames: list[NoseFrame]) -> NoseCamera:
    """A camera that starts where the first picture was taken."""
    (tmp_path / "nose.toml").write_text(LENS)
    return replace(load_nose_camera(tmp_path / "nose.toml"), start=frames[0].truth)


def test_a_motion_that_no_picture_shows_is_told_and_makes_the_edges_less_sure(
    camera: NoseCamera, frames: list[NoseFrame]
) -> None:
    """Expected: for a blank picture the last motion, its own size as what is new, and a line of the summary."""
    poses = PicturePoses(KAPPA, camera, None)
    found = [poses.of(frame.t_s, frame.image) for frame in frames[:3]]
    assert all(one is not None and one.drift == NO_DRIFT and not one.logged for one in found)
    assert poses.lines() == ()
    lost = poses.of(frames[3].t_s, np.full_like(frames[3].image, 128))
    assert lost is not None
    travelled_m = float(np.linalg.norm(frames[3].truth.camera_threshold_m - frames[2].truth.camera_threshold_m))
    assert lost.drift.new_shift_m == pytest.approx(travelled_m, abs=0.3)
    assert lost.drift.shift_m == 0.0
    result = EdgesResult(
        statuses={"tracking": 4}, misses={}, files=(), fault=None, damage=None, pose_lines=poses.lines()
    )
    summary = format_edges_summary(result)
    words = "without motion from the picture before, the last motion goes on: 1 (1 too few points of the ground match)"
    assert words in summary


def logged(t_s: list[float], frames: list[NoseFrame]) -> PoseLog:
    """Return a log of rows at these times: the exact poses, between pictures linearly, at rest before and after."""
    own_s = [frame.t_s for frame in frames]
    body_from_camera = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turns = [frame.truth.threshold_from_camera @ body_from_camera.T for frame in frames]
    numbers = np.array(
        [
            [*frame.truth.camera_threshold_m, *attitude_of(wxyz_from_matrix(turn))]
            for frame, turn in zip(frames, turns, strict=True)
        ]
    )
    inside = np.array([[np.interp(t, own_s, column) for column in numbers.T] for t in t_s])
    return PoseLog(np.array(t_s), inside[:, :3], inside[:, 3:], Attitude())


def off(found: PicturePose | None, frame: NoseFrame) -> tuple[float, float]:
    """Return how far a pose is from the truth, m and rad."""
    assert found is not None
    apart = motion_between(frame.truth, found.pose)
    return float(np.linalg.norm(apart.second_in_first_m)), turn_of(apart)


def test_in_a_logs_gap_the_motion_between_pictures_goes_on_from_its_last_row(
    camera: NoseCamera, frames: list[NoseFrame]
) -> None:
    """Expected: a row of the first picture alone, poses of all; each motion adds what `without_log` has for one."""
    first_s = frames[0].t_s
    log = logged([first_s, first_s + 0.9], frames)
    assert log.has_gaps
    poses = PicturePoses(KAPPA, camera, log)
    found = [poses.of(frame.t_s, frame.image) for frame in frames]
    assert found[0] is not None
    assert found[0].logged
    assert found[0].drift == NO_DRIFT
    for k, (one, frame) in enumerate(zip(found[1:], frames[1:], strict=True), start=1):
        assert one is not None
        assert not one.logged
        metres, turn_rad = off(one, frame)
        assert metres < 1.0
        assert turn_rad < math.radians(0.5)
        assert one.drift.shift_m == pytest.approx(math.sqrt(k) * 1.2)
        assert one.drift.turn_rad == pytest.approx(math.sqrt(k) * math.radians(0.4))
    assert poses.lines() == ("poses: 1 of the table, 4 in its gaps by the motion between pictures",)
    assert poses.of(first_s + 5.0, frames[-1].image) is None


def test_a_row_between_two_pictures_takes_over_by_its_share_of_their_motion(
    camera: NoseCamera, frames: list[NoseFrame]
) -> None:
    """Expected: the first picture lies between rows; then half a motion after the row, as exact as the row."""
    first_s = frames[0].t_s
    log = logged([first_s - 0.45, first_s + 0.25, first_s + 0.95], frames)
    poses = PicturePoses(KAPPA, camera, log)
    found = [poses.of(frame.t_s, frame.image) for frame in frames]
    nearest = log.pose(first_s + 0.25)
    assert found[0] is not None
    assert nearest is not None
    away_m = float(np.linalg.norm(found[0].pose.camera_threshold_m - nearest.camera_threshold_m))
    assert found[0].drift.shift_m == pytest.approx(away_m)
    third = found[3]
    assert third is not None
    assert third.drift.shift_m == pytest.approx(math.sqrt(0.5) * 1.2)
    assert off(third, frames[3])[0] < 0.3
    lost = poses.of(first_s + 0.45, np.full_like(frames[0].image, 128))
    assert lost is not None
    assert lost.drift.shift_m > 1.2
    assert "(1 too few points of the ground match)" in poses.lines()[-1]


def test_far_from_any_row_no_first_pose_is_made_up(camera: NoseCamera, frames: list[NoseFrame]) -> None:
    log = logged([frames[0].t_s - 2.0, frames[0].t_s + 2.0], frames)
    assert PicturePoses(KAPPA, camera, log).of(frames[0].t_s, frames[0].image) is None


def test_what_a_pose_is_wrong_by_goes_into_the_picture_that_has_it_alone() -> None:
    """Expected: what comes and lasts makes the lines less sure, by as much; a picture without is tracked as before."""
    config, pose = without_log(TrackerConfig(guess=RunwayGuess(width_m=18.0))), approach()

    def sigmas(drift: PoseDrift) -> np.ndarray:
        tracker = EdgeTracker(KAPPA, SIZE, config)
        tracker.start(STATE)
        blank = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
        missed = tracker.step(blank, pose, drift).edges
        after = tracker.step(blank, pose).edges
        assert missed is not None
        assert after is not None
        return np.sqrt([np.diag(one.state.covariance)[2:4] for one in (missed, after)])

    usual, lasting = sigmas(NO_DRIFT), sigmas(PoseDrift(new_shift_m=3.0, new_turn_rad=0.01))
    np.testing.assert_allclose(lasting**2 - usual**2, 9.0, rtol=1e-6)
    passing = sigmas(PoseDrift(shift_m=3.0, turn_rad=0.01))
    np.testing.assert_allclose(passing, usual)
    assert with_drift(config, NO_DRIFT) is config


def test_a_pose_that_has_drifted_leaves_lines_as_they_are_known() -> None:
    """Expected: edges seen by a pose that may be 3 m off tell little of where the lines are by the others."""
    pose = approach()

    def place_sigma(drift: PoseDrift) -> float:
        tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=RunwayGuess(width_m=18.0)))
        tracker.start(replace(STATE, covariance=100.0 * STATE.covariance))
        edges = tracker.step(painted_runway(pose, seed=1), pose, drift).edges
        assert edges is not None
        assert edges.measured_px is not None
        both = edges.state.covariance[2:4, 2:4]
        return float(np.sqrt(np.ones(2) @ both @ np.ones(2))) / 2.0

    # of the middle between lines of 1 m each
    prior_m = 0.5**0.5
    assert place_sigma(PoseDrift(shift_m=3.0, turn_rad=0.02)) == pytest.approx(prior_m, rel=0.05)
    assert place_sigma(NO_DRIFT) < 0.75 * prior_m
