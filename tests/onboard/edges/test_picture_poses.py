"""Poses of pictures: where they come from, what they are wrong by, and what the tracker makes of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.onboard.edges.camera_file import NoseCamera, load_nose_camera
from groundstation.onboard.edges.config import TrackerConfig, without_log
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.picture_poses import PicturePoses
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift, with_drift
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.tracker import EdgeTracker
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
    assert "no motion between 1 pictures and the one before" in summary
    assert "1 too few points of the ground match" in summary


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
