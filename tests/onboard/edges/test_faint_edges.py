"""No answer is an answer: edges that noise hides, poses that are noisier than stated, and what a file states."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.onboard.edges.camera_file import CameraFileError, PoseNoise, load_nose_camera
from groundstation.onboard.edges.config import TrackerConfig, with_noise, without_log
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.report import EdgeMiss, EdgeStatus
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.tracker import EdgeTracker
from tests.complaints import complaint
from tests.onboard.edges.seen import KAPPA, RUNWAY, SIZE, approach, painted_runway

CONFIG = TrackerConfig(guess=RunwayGuess(width_m=18.0, length_m=500.0))
LENS = "image_size_px = [640, 480]\nfocal_px = [620.0, 610.0]\nprincipal_point_px = [319.5, 239.5]\n"


def started() -> EdgeTracker:
    tracker = EdgeTracker(KAPPA, SIZE, CONFIG)
    covariance = np.diag([1e-6, 1e-6, 0.01, 0.01, *[1e-6] * 3])
    tracker.start(LineState(mean=np.concatenate([RUNWAY, np.zeros(3)]), covariance=covariance))
    return tracker


@pytest.mark.parametrize(("contrast", "seen"), [(1, False), (40, True)])
def test_edges_that_noise_hides_are_missed_and_less_sure_from_frame_to_frame(contrast: int, seen: bool) -> None:
    tracker, pose, ground = started(), approach(), (100, 110, 105)
    inside = (100 + contrast, 110 + contrast, 105 + contrast)
    reports = [
        tracker.step(painted_runway(pose, inside=inside, outside=ground, noise=12.0, seed=k), pose) for k in range(4)
    ]
    sigmas = [float(np.trace(report.edges.covariance_px2)) for report in reports if report.edges is not None]
    if seen:
        assert all(report.status is EdgeStatus.TRACKING for report in reports)
        return
    assert all((report.status, report.miss) == (EdgeStatus.COASTING, EdgeMiss.FAINT) for report in reports)
    assert sigmas == sorted(sigmas)


@pytest.mark.parametrize(("left", "right"), [(1.0, 0.3), (0.3, 1.0), (0.3, 0.3)])
def test_an_edge_that_loses_its_contrast_alone_is_not_tracked(left: float, right: float) -> None:
    """Where the ground becomes like the pavement on one side, the line may be another; on both, the light is."""
    tracker, pose, inside, outside = started(), approach(), np.array([90, 90, 95]), np.array([50, 110, 80])
    middle = project_lines(np.array([1.0, 0.0, 0.0, 0.0]), line_map(pose, KAPPA), np.array([245.0, 479.0]))[0]
    side = np.arange(640)[None, :] > np.interp(np.arange(480), [245.0, 479.0], middle[:2])[:, None]
    for k in range(8):
        grounds = [inside + share * (outside - inside) for share in ((left, right) if k == 6 else (1.0, 1.0))]
        pictures = [painted_runway(pose, outside=tuple(ground.astype(int)), seed=k) for ground in grounds]
        report = tracker.step(np.where(side[:, :, None], pictures[1], pictures[0]), pose)
        assert report.miss is EdgeMiss.NONE
        assert (report.status is EdgeStatus.TRACKING) == (k != 6 or left == right)


def test_a_pose_that_is_noisier_than_configured_is_found_to_be_so() -> None:
    """A degree of white noise where a quarter is taken: the edges are kept, and within what is stated."""
    tracker, rng, off = started(), np.random.default_rng(3), []
    truth = approach()
    for k in range(40):
        roll, pitch, yaw = np.array([0.03, -0.03, 0.04]) + math.radians(1.0) * rng.standard_normal(3)
        report = tracker.step(painted_runway(truth, seed=k), approach(roll=roll, pitch=pitch, yaw=yaw))
        if k >= 20 and report.status is EdgeStatus.TRACKING and report.edges is not None:
            wanted = project_lines(RUNWAY, line_map(truth, KAPPA), report.edges.rows_px)[0]
            off.append(np.abs(report.edges.crossings_px - wanted) / np.sqrt(np.diag(report.edges.covariance_px2)))
    assert len(off) > 15
    assert max(one.max() for one in off) < 3.0


def test_noise_is_what_the_file_states_and_estimated_where_it_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "nose.toml"
    path.write_text(LENS)
    assert load_nose_camera(path).noise == PoseNoise()
    assert with_noise(CONFIG, PoseNoise()) == CONFIG
    path.write_text(
        f"{LENS}[pose_noise]\nattitude_deg = 0.05\nposition_m = 0.02\nlasting_height_m = 0.5\nlasting_yaw_deg = 1.5\n"
    )
    noise = load_nose_camera(path).noise
    stated = with_noise(CONFIG, noise)
    assert stated.attitude_sigma_rad == pytest.approx(math.radians(0.05))
    assert stated.position_sigma_m == (0.02,) * 3
    assert stated.lasting_height_m == 0.5
    assert stated.lasting_yaw_rad == pytest.approx(math.radians(1.5))
    assert stated.lasting_across_m is None
    assert stated.lasting_attitude_rad == CONFIG.lasting_attitude_rad
    assert CONFIG.estimate_noise
    assert not stated.estimate_noise
    for wrong in ("attitude_deg = -1.0", "position_m = 1e9", "roll_deg = 1.0"):
        path.write_text(f"{LENS}[pose_noise]\n{wrong}\n")
        assert "pose_noise" in complaint(CameraFileError, lambda: load_nose_camera(path))


def test_poses_without_a_log_are_less_sure_from_frame_to_frame() -> None:
    own = without_log(CONFIG)
    assert own.turn_sigma_rad > CONFIG.turn_sigma_rad
    assert own.shift_sigma_m > CONFIG.shift_sigma_m
    assert replace(own, estimate_noise=True) != CONFIG
