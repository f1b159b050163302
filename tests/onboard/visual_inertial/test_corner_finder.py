"""From tracked edges to corners: starts, the strip's end, what lasts, and how a pose follows its pixels."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from groundstation.geometry.rotation import rotation_from_vector
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, intrinsic_matrix, nose_pose, pixels_from_points
from groundstation.onboard.edges.report import Edges
from groundstation.onboard.pose.pose_solver import PointCorrespondences, solve_pose
from groundstation.onboard.pose.runway import rectangle
from groundstation.onboard.scenes.sequences import NOSE_LENS
from groundstation.onboard.visual_inertial.config import ApproachConfig, CornerMethod
from groundstation.onboard.visual_inertial.corner_errors import (
    edge_mode_count,
    mode_count,
    systematic_modes,
    systematic_sigmas,
    tracked_modes,
)
from groundstation.onboard.visual_inertial.corner_finder import FoundCorners, NoCorners, find_corners, start_corners
from groundstation.onboard.visual_inertial.pose_sensitivity import pixel_jacobian_of_pose, pose_jacobian_of_pixels
from groundstation.onboard.visual_inertial.threshold_detection import detect_threshold

KAPPA = intrinsic_matrix(NOSE_LENS)
RUNWAY = rectangle(400.0, 20.0)
POSE = nose_pose(np.array([2.0, 160.0, 22.0]), Attitude(roll_rad=0.03, pitch_rad=-0.05, yaw_rad=0.02))
# left and right edge, upper and lower row: half a pixel in all, and the common part at both ends
LASTING_PX2 = 0.25 * np.eye(4) + np.kron(np.diag([1.0, 2.0]), np.outer([0.3, 1.0], [0.3, 1.0]))
CORNERS = pixels_from_points(POSE, KAPPA, RUNWAY.corners_m)


def edges(pose: NoseCameraPose = POSE) -> Edges:
    mean = np.array([1.0, 0.0, -10.0, 10.0, 0.0, 0.0, 0.0])
    rows = np.array([CORNERS[1:3, 1].max() + 4.0, CORNERS[[0, 3], 1].min() - 4.0])
    crossings, _ = project_lines(mean[:4], line_map(pose, KAPPA), rows)
    return Edges(
        state=LineState(mean=mean, covariance=1e-4 * np.eye(7)),
        rows_px=rows,
        crossings_px=crossings,
        covariance_px2=0.04 * np.eye(4) + LASTING_PX2,
        systematic_px2=LASTING_PX2,
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
    # SUSAN needs space and contrast: its mask is seven pixels wide
    susan = method == "susan"
    config = ApproachConfig(corners=CornerMethod(method), reach_px=(6.0, 7.0) if susan else (2.0, 3.5))
    known = np.array([1.0, 1.0])
    found = find_corners(picture(rng, 240 if susan else 150), edges(), wrong, RUNWAY, KAPPA, config, known)
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
    near = detect_threshold(image, start, 12.0, 4.0)
    assert near is not None
    np.testing.assert_allclose(near.shift_px, (CORNERS - start)[[0, 3], 1], atol=0.5)


def painted(rng: np.random.Generator, level: int, noise: float, road: bool = False) -> np.ndarray:
    """The runway with a slab at its near end that is close to the grass, bars, a blotch before it, and a road."""
    scale = 4
    big = np.full((480 * scale, 640 * scale, 3), (60, 120, 90), np.uint8)

    def paint(x0: float, x1: float, y0: float, y1: float, colour: tuple[int, int, int]) -> None:
        ground = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
        pixels = (pixels_from_points(POSE, KAPPA, ground) + 0.5) * scale
        cv2.fillPoly(big, [np.round(pixels).astype(np.int32)], colour)

    if road:
        paint(-200.0, 200.0, 22.0, 32.0, (100, 100, 100))
    paint(-8.0, -4.0, 6.0, 9.0, (25, 50, 38))
    paint(-10.0, 10.0, 0.0, -400.0, (100, 100, 100))
    paint(-10.0, 10.0, 0.0, -50.0, (level, level + 20, level + 10))
    for x in (-7.5, -4.5, 3.0, 6.0):
        paint(x, x + 1.6, -5.0, -19.0, (210, 210, 210))
    small = cv2.GaussianBlur(cv2.resize(big, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    return np.clip(small + noise * rng.standard_normal(small.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("level", "noise", "road"), [(150, 2.0, True), (100, 3.0, False), (120, 6.0, True)])
def test_neither_bars_nor_slab_nor_road_is_the_threshold(
    level: int, noise: float, road: bool, rng: np.random.Generator
) -> None:
    """Expected: from predictions up to 7 px off both thresholds are seen within their sigmas, or none is."""
    image = painted(rng, level, noise, road)
    seen = 0
    for off in np.linspace(-7.0, 7.0, 8):
        start = CORNERS.copy()
        for near, far in ((0, 1), (3, 2)):
            start[[near, far]] += off * (CORNERS[near] - CORNERS[far]) / (CORNERS[near, 1] - CORNERS[far, 1])
        for end in (False, True):
            found = detect_threshold(image, start, 9.0, 4.0 if not end else 2.0, far=end)
            if found is not None:
                seen += 1
                sigma = np.hypot(found.sigma_px, np.hypot(0.5, ApproachConfig().faint_px / found.rise))
                assert (np.abs(found.shift_px + off) < 3.0 * sigma).all()
    assert seen >= 12


def test_a_slab_on_faint_pavement_is_not_its_far_end(rng: np.random.Generator) -> None:
    """Expected: a slab that ends before the far end, on pavement hardly other than the ground, is taken for no end.

    By dusk such ends were confirmed in the place of the far threshold, 7 to 11 px below it, picture after picture.
    """
    scale = 4
    big = np.full((480 * scale, 640 * scale, 3), (60, 90, 80), np.uint8)
    for y0, y1, colour in ((0.0, -400.0, (70, 90, 85)), (-170.0, -215.0, (120, 110, 110))):
        ground = np.array([[-10.0, y0, 0.0], [10.0, y0, 0.0], [10.0, y1, 0.0], [-10.0, y1, 0.0]])
        pixels = (pixels_from_points(POSE, KAPPA, ground) + 0.5) * scale
        cv2.fillPoly(big, [np.round(pixels).astype(np.int32)], colour)
    small = cv2.GaussianBlur(cv2.resize(big, (640, 480), interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    wrong = 0
    for _ in range(20):
        image = np.clip(small + 2.0 * rng.standard_normal(small.shape), 0, 255).astype(np.uint8)
        found = detect_threshold(image, CORNERS, 12.0, 2.0, far=True)
        wrong += found is not None and abs(float(found.shift_px.mean())) > 3.0
    assert wrong <= 1


def test_grass_without_a_runway_confirms_almost_nothing(rng: np.random.Generator) -> None:
    """Expected: at most one of ten places in blotched grass has one by chance; the filter's gate is for these."""
    confirmed = 0
    for _ in range(15):
        rough = cv2.GaussianBlur(rng.standard_normal((480, 640, 3)), (0, 0), 4.0)
        image = np.clip(90.0 + 60.0 * rough + 4.0 * rng.standard_normal(rough.shape), 0, 255).astype(np.uint8)
        confirmed += sum(detect_threshold(image, CORNERS, 8.0, 3.0, far=end) is not None for end in (False, True))
    assert confirmed <= 3


def test_a_threshold_that_is_not_seen_leaves_the_edges_alone(rng: np.random.Generator) -> None:
    """Expected: with its far end in fog the corners there are open along the edges, and the pose does not need them."""
    image = picture(rng)
    cut = int(CORNERS[[1, 2], 1].mean() + 0.4 * (CORNERS[0, 1] - CORNERS[1, 1]))
    image[:cut] = np.clip(120 + 2.0 * rng.standard_normal((cut, 640, 3)), 0, 255).astype(np.uint8)
    found = find_corners(image, edges(), POSE, RUNWAY, KAPPA, ApproachConfig(), np.array([1.0, 1.0]))
    assert isinstance(found, FoundCorners)
    assert found.near_seen
    assert not found.far_seen
    along = (CORNERS[0] - CORNERS[1]) / np.linalg.norm(CORNERS[0] - CORNERS[1])
    across = np.array([-along[1], along[0]])
    assert along @ found.covariance_px2[1] @ along > 30.0**2
    assert across @ found.covariance_px2[1] @ across < 2.0**2
    pose = solve_pose(
        PointCorrespondences(
            points_m=RUNWAY.corners_m, pixels=found.pixels, covariance_px2=found.whole_covariance_px2, lens=NOSE_LENS
        )
    )
    assert pose is not None
    error = pose.position_m - POSE.camera_threshold_m
    assert error @ np.linalg.solve(pose.covariance[:3, :3], error) < 16.3
    blind = np.full_like(image, 100)
    assert find_corners(blind, edges(), POSE, RUNWAY, KAPPA, ApproachConfig(), np.ones(2)) is NoCorners.NO_THRESHOLD


def test_fainter_and_darker_edges_are_less_sure() -> None:
    config = ApproachConfig()
    clear, faint = (systematic_sigmas(config, levels, dark=False) for levels in (400.0, 75.0))
    assert clear.side_sigma_px == config.side_sigma_px
    assert faint.side_sigma_px == pytest.approx(2.0 * config.side_sigma_px)
    night = systematic_sigmas(config, 400.0, dark=True)
    assert night.side_sigma_m == config.lamp_sigma_m
    assert night.side_sigma_px == config.lamp_sigma_px


def test_no_end_no_corners(rng: np.random.Generator) -> None:
    plain = np.clip(90 + 2.0 * rng.standard_normal((480, 640, 3)), 0, 255).astype(np.uint8)
    assert isinstance(find_corners(plain, edges(), POSE, RUNWAY, KAPPA, ApproachConfig()), NoCorners)
    up = nose_pose(np.array([2.0, 160.0, 22.0]), Attitude(pitch_rad=0.6))
    assert find_corners(plain, edges(), up, RUNWAY, KAPPA, ApproachConfig()) is NoCorners.OUT_OF_PICTURE
    flat = replace(ApproachConfig(), least_height_px=200.0)
    assert find_corners(plain, edges(), POSE, RUNWAY, KAPPA, flat) is NoCorners.FLAT


def test_pixels_by_pose_against_differences() -> None:
    H = pixel_jacobian_of_pose(RUNWAY.corners_m, KAPPA, POSE.camera_threshold_m, POSE.threshold_from_camera)
    assert H is not None
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-4
        sides = []
        for sign in (1.0, -1.0):
            moved = NoseCameraPose(
                threshold_from_camera=rotation_from_vector(sign * step[3:]) @ POSE.threshold_from_camera,
                camera_threshold_m=POSE.camera_threshold_m + sign * step[:3],
            )
            sides.append(pixels_from_points(moved, KAPPA, RUNWAY.corners_m).ravel())
        np.testing.assert_allclose(H[:, k], (sides[0] - sides[1]) / 2e-4, rtol=1e-4, atol=1e-3)


def test_a_pose_follows_its_pixels_by_its_jacobian() -> None:
    """Expected: the solver's pose for slightly different pixels moves by D."""
    weights = np.array(
        [[[0.2, 0.05], [0.05, 0.4]], [[1.0, 0.0], [0.0, 2.0]], [[1.5, 0.1], [0.1, 1.0]], 0.3 * np.eye(2)]
    )
    D = pose_jacobian_of_pixels(RUNWAY.corners_m, KAPPA, POSE.camera_threshold_m, POSE.threshold_from_camera, weights)
    assert D is not None
    for column in systematic_modes(CORNERS, RUNWAY, ApproachConfig()).T:
        off = 0.01 * column
        seen = PointCorrespondences(
            points_m=RUNWAY.corners_m, pixels=CORNERS + off.reshape(4, 2), covariance_px2=weights, lens=NOSE_LENS
        )
        pose = solve_pose(seen)
        assert pose is not None
        np.testing.assert_allclose(pose.position_m - POSE.camera_threshold_m, (D @ off)[:3], rtol=0.02, atol=2e-3)


def test_what_lasts_moves_corners_along_their_own_lines() -> None:
    modes = systematic_modes(CORNERS, RUNWAY, ApproachConfig())
    assert modes.shape == (8, mode_count(CornerMethod.SIDES))
    config = ApproachConfig()
    left = modes[:, 0].reshape(4, 2)
    np.testing.assert_allclose(left[2:], 0.0)
    # the left edge wrong by 0.7 m: seen, it is the picture of a point 0.7 m to the right
    there = pixels_from_points(POSE, KAPPA, RUNWAY.corners_m - [config.side_sigma_m, 0, 0])
    np.testing.assert_allclose(left[0], there[0] - CORNERS[0], atol=0.1)
    # the near threshold's metres are those of the ground
    shift = systematic_modes(CORNERS, RUNWAY, replace(config, end_sigma_px=0.0))[:, 6].reshape(4, 2)
    deeper = pixels_from_points(POSE, KAPPA, RUNWAY.corners_m - [0, config.near_sigma_m, 0])
    np.testing.assert_allclose(shift[0], deeper[0] - CORNERS[0], rtol=0.1, atol=0.02)


@pytest.mark.parametrize(("column", "left", "right"), [(7, 0, 3), (9, 1, 2)])
def test_a_turned_threshold_moves_its_corners_as_on_the_ground(column: int, left: int, right: int) -> None:
    """Expected: a threshold turned on the ground by a small angle, its picture by differences, is the column's ends.

    In rows each end moves by the threshold's blur, to opposite sides; the other threshold stands.
    """
    # no two of the configured sigmas are equal, so that none can be exchanged for another
    config = replace(ApproachConfig(), end_sigma_px=0.8, far_end_sigma_px=1.7, near_sigma_m=4.0)
    sigma = config.end_sigma_px if column == 7 else config.far_end_sigma_px
    turned = RUNWAY.corners_m.copy()
    step_m = 1e-3
    # the near threshold's left end goes away from the aircraft, the far one's comes nearer
    towards = -1.0 if column == 7 else 1.0
    turned[[left, right], 1] += step_m * towards * np.array([1.0, -1.0])
    moved = (pixels_from_points(POSE, KAPPA, turned) - CORNERS) / step_m
    mode = systematic_modes(CORNERS, RUNWAY, config)[:, column].reshape(4, 2)
    for k in (left, right):
        # the same direction in the picture, and the blur's rows
        np.testing.assert_allclose(mode[k], sigma * moved[k] / abs(moved[k, 1]), rtol=1e-3, atol=1e-3)
    # one angle does for both ends, but for the roll of 2° in which their rows are read
    angles = np.linalg.norm(mode[[left, right]], axis=1) / np.linalg.norm(moved[[left, right]], axis=1)
    assert angles[0] == pytest.approx(angles[1], rel=0.05)
    rest = [k for k in range(4) if k not in (left, right)]
    np.testing.assert_array_equal(mode[rest], 0.0)


def test_the_far_threshold_is_shifted_by_its_own_blur() -> None:
    """Expected: `far_end_sigma_px` rows at both of its ends, along the sides, independent of the near one."""
    config = replace(ApproachConfig(), far_end_sigma_px=1.7)
    shift = systematic_modes(CORNERS, RUNWAY, config)[:, 8].reshape(4, 2)
    np.testing.assert_allclose(shift[[1, 2], 1], 1.7)
    sides = CORNERS[[0, 3]] - CORNERS[[1, 2]]
    np.testing.assert_allclose(shift[[1, 2], 0], 1.7 * sides[:, 0] / sides[:, 1])
    np.testing.assert_array_equal(shift[[0, 3]], 0.0)
    other = replace(config, end_sigma_px=3.0, near_sigma_m=9.0)
    np.testing.assert_array_equal(systematic_modes(CORNERS, RUNWAY, other)[:, 8].reshape(4, 2), shift)


def test_constant_errors_of_tracked_edges_are_the_trackers() -> None:
    """Expected: where corners lie in the rows of the crossings their covariance across is the tracker's; no more."""
    seen = edges()
    upper, lower = seen.rows_px
    left_upper, left_lower, right_upper, right_lower = seen.crossings_px
    corners = np.array([[left_lower, lower], [left_upper, upper], [right_upper, upper], [right_lower, lower]])
    modes = tracked_modes(corners, seen, RUNWAY, ApproachConfig())
    assert modes.shape == (8, mode_count(CornerMethod.EDGES))
    own = modes[[2, 0, 4, 6], : edge_mode_count(CornerMethod.EDGES)]
    np.testing.assert_allclose(own @ own.T, LASTING_PX2, atol=1e-9)
    assert not modes[1::2, : edge_mode_count(CornerMethod.EDGES)].any()
    # a little later what lasts has grown a little: each column is the same error still
    later = tracked_modes(corners, replace(seen, systematic_px2=1.1 * LASTING_PX2), RUNWAY, ApproachConfig())
    np.testing.assert_allclose(later[:, :4], np.sqrt(1.1) * modes[:, :4], atol=1e-9)


def test_what_lasts_of_edges_is_counted_once(rng: np.random.Generator) -> None:
    """Expected: each picture's own part of a corner does not grow with the tracker's constant errors."""
    image = picture(rng)
    surer = replace(edges(), covariance_px2=0.04 * np.eye(4), systematic_px2=np.zeros((4, 4)))
    one, other = (find_corners(image, seen, POSE, RUNWAY, KAPPA, ApproachConfig()) for seen in (edges(), surer))
    assert isinstance(one, FoundCorners)
    assert isinstance(other, FoundCorners)
    np.testing.assert_allclose(one.covariance_px2, other.covariance_px2, rtol=1e-9)
    assert (np.linalg.norm(one.systematic_px, axis=1)[0::2] > np.linalg.norm(other.systematic_px, axis=1)[0::2]).all()
