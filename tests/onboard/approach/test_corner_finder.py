"""From tracked edges to corners: starts, the strip's end, what lasts, and how a pose follows its pixels."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from groundstation.geometry.rotation import rotation_from_vector
from groundstation.onboard.approach.config import ApproachConfig, CornerMethod
from groundstation.onboard.approach.corner_finder import (
    LASTING_COUNT,
    FoundCorners,
    NoCorners,
    find_corners,
    lasting_modes,
    start_corners,
)
from groundstation.onboard.approach.sensitivity import pixels_by_pose, pose_by_pixels
from groundstation.onboard.approach.strip_end import strip_end_shift
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.pose import Attitude, CameraPose, intrinsic_matrix, nose_pose, pixels_from_points
from groundstation.onboard.edges.report import Edges
from groundstation.onboard.pose.runway import rectangle
from groundstation.onboard.pose.solve import SeenPoints, solve_pose
from groundstation.onboard.scenes.sequences import NOSE_LENS

KAPPA = intrinsic_matrix(NOSE_LENS)
RUNWAY = rectangle(400.0, 20.0)
POSE = nose_pose(np.array([2.0, 160.0, 22.0]), Attitude(roll_rad=0.03, pitch_rad=-0.05, yaw_rad=0.02))
CORNERS = pixels_from_points(POSE, KAPPA, RUNWAY.corners_m)


def edges(pose: CameraPose = POSE) -> Edges:
    mean = np.array([1.0, 0.0, -10.0, 10.0, 0.0, 0.0, 0.0])
    rows = np.array([CORNERS[1:3, 1].max() + 4.0, CORNERS[[0, 3], 1].min() - 4.0])
    crossings, _ = project_lines(mean[:4], line_map(pose, KAPPA), rows)
    return Edges(
        state=LineState(mean=mean, covariance=1e-4 * np.eye(7)),
        rows_px=rows,
        crossings_px=crossings,
        covariance_px2=0.04 * np.eye(4),
        predicted_px=crossings,
        measured_px=crossings,
        nis=1.0,
    )


def picture(rng: np.random.Generator, grey: int = 150) -> np.ndarray:
    """A grey runway on green, softened, with noise."""
    scale = 8
    big = np.full((480 * scale, 640 * scale, 3), (60, 120, 90), np.uint8)
    # the corner of pixel (0, 0) lies half a pixel before its centre
    cv2.fillPoly(big, [np.round((CORNERS + 0.5) * scale).astype(np.int32)], (grey, grey, grey))
    small = cv2.GaussianBlur(cv2.resize(big, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    return np.clip(small + 2.0 * rng.standard_normal(small.shape), 0, 255).astype(np.uint8)


def test_the_exact_pose_and_edges_give_the_exact_corners() -> None:
    start = start_corners(edges(), POSE, RUNWAY, KAPPA)
    assert start is not None
    np.testing.assert_allclose(start, CORNERS, atol=1e-6)


@pytest.mark.parametrize(("method", "most_px"), [("edges", 0.3), ("sides", 0.5), ("susan", 4.0)])
def test_corners_are_measured(method: str, most_px: float, rng: np.random.Generator) -> None:
    """Expected: within the blur and noise of a drawn picture, from a start 1.5 px off; SUSAN to a few whole pixels."""
    wrong = nose_pose(np.array([2.0, 160.0, 22.0]), Attitude(roll_rad=0.03, pitch_rad=-0.0476, yaw_rad=0.02))
    # SUSAN wants room and contrast: its mask is seven pixels wide
    susan = method == "susan"
    config = ApproachConfig(corners=CornerMethod(method), reach_px=(6.0, 7.0) if susan else (2.0, 3.5))
    found = find_corners(picture(rng, 240 if susan else 150), edges(), wrong, RUNWAY, KAPPA, config, pose_fits=True)
    assert isinstance(found, FoundCorners)
    assert np.abs(found.start_px - CORNERS)[:, 1].max() > 1.2
    assert np.linalg.norm(found.pixels - CORNERS, axis=1).max() < most_px
    assert (np.linalg.eigvalsh(found.whole_covariance_px2) > 0).all()


def test_a_pose_that_is_pitched_wrong_finds_the_strips_end(rng: np.random.Generator) -> None:
    """Expected: 0.8° of pitch, 8.7 px, are found from the picture when the pose comes from outside."""
    wrong = nose_pose(np.array([2.0, 160.0, 22.0]), Attitude(roll_rad=0.03, pitch_rad=-0.05 + 0.014, yaw_rad=0.02))
    image = picture(rng)
    found = find_corners(image, edges(), wrong, RUNWAY, KAPPA, ApproachConfig())
    assert isinstance(found, FoundCorners)
    assert np.abs(found.pixels - CORNERS).max() < 0.4
    start = start_corners(edges(), wrong, RUNWAY, KAPPA)
    assert start is not None
    shift = strip_end_shift(image.astype(np.float64), start, 12.0, 4.0)
    assert shift == pytest.approx(float((CORNERS - start)[[0, 3], 1].mean()), abs=1.5)


def test_no_end_no_corners(rng: np.random.Generator) -> None:
    plain = np.clip(90 + 2.0 * rng.standard_normal((480, 640, 3)), 0, 255).astype(np.uint8)
    assert isinstance(find_corners(plain, edges(), POSE, RUNWAY, KAPPA, ApproachConfig()), NoCorners)
    up = nose_pose(np.array([2.0, 160.0, 22.0]), Attitude(pitch_rad=0.6))
    assert find_corners(plain, edges(), up, RUNWAY, KAPPA, ApproachConfig()) is NoCorners.OUT_OF_PICTURE
    flat = replace(ApproachConfig(), least_height_px=200.0)
    assert find_corners(plain, edges(), POSE, RUNWAY, KAPPA, flat) is NoCorners.FLAT


def test_pixels_by_pose_against_differences() -> None:
    H = pixels_by_pose(RUNWAY.corners_m, KAPPA, POSE.camera_threshold_m, POSE.threshold_from_camera)
    assert H is not None
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-4
        sides = []
        for sign in (1.0, -1.0):
            moved = CameraPose(
                threshold_from_camera=rotation_from_vector(sign * step[3:]) @ POSE.threshold_from_camera,
                camera_threshold_m=POSE.camera_threshold_m + sign * step[:3],
            )
            sides.append(pixels_from_points(moved, KAPPA, RUNWAY.corners_m).ravel())
        np.testing.assert_allclose(H[:, k], (sides[0] - sides[1]) / 2e-4, rtol=1e-4, atol=1e-3)


def test_a_pose_follows_its_pixels_as_said() -> None:
    """Expected: the solver, given pixels that are a little off, moves as D says."""
    weights = np.array(
        [[[0.2, 0.05], [0.05, 0.4]], [[1.0, 0.0], [0.0, 2.0]], [[1.5, 0.1], [0.1, 1.0]], 0.3 * np.eye(2)]
    )
    D = pose_by_pixels(RUNWAY.corners_m, KAPPA, POSE.camera_threshold_m, POSE.threshold_from_camera, weights)
    assert D is not None
    for column in lasting_modes(CORNERS, RUNWAY, ApproachConfig()).T:
        off = 0.01 * column
        seen = SeenPoints(
            points_m=RUNWAY.corners_m, pixels=CORNERS + off.reshape(4, 2), covariance_px2=weights, lens=NOSE_LENS
        )
        pose = solve_pose(seen)
        assert pose is not None
        np.testing.assert_allclose(pose.position_m - POSE.camera_threshold_m, (D @ off)[:3], rtol=0.02, atol=2e-3)


def test_what_lasts_moves_corners_along_their_own_lines() -> None:
    modes = lasting_modes(CORNERS, RUNWAY, ApproachConfig())
    assert modes.shape == (8, LASTING_COUNT)
    config = ApproachConfig()
    left = modes[:, 0].reshape(4, 2)
    np.testing.assert_allclose(left[2:], 0.0)
    # the left edge wrong by 0.7 m: seen, it is the picture of a point 0.7 m to the right
    there = pixels_from_points(POSE, KAPPA, RUNWAY.corners_m - [config.side_sigma_m, 0, 0])
    np.testing.assert_allclose(left[0], there[0] - CORNERS[0], atol=0.1)
    # the near threshold's metres are those of the ground
    shift = lasting_modes(CORNERS, RUNWAY, replace(config, end_sigma_px=0.0))[:, 6].reshape(4, 2)
    deeper = pixels_from_points(POSE, KAPPA, RUNWAY.corners_m - [0, config.near_sigma_m, 0])
    np.testing.assert_allclose(shift[0], deeper[0] - CORNERS[0], rtol=0.1, atol=0.02)
