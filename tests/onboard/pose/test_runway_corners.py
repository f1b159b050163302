"""Corners of real runways in synthetic pictures (not part of the project): range against OpenCV's solver."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.geometry.camera import Lens
from groundstation.onboard.pose.coplanarity_solver import solve_coplanarity
from groundstation.onboard.pose.corner_labelling import ROUNDING_SIGMA_PX, solve_corners
from groundstation.onboard.pose.pose_files import Runways, read_corners
from groundstation.onboard.pose.pose_solver import PointCorrespondences, PoseStatus

FOCAL = 3401.6
STEP_M = 18.52
LENS = Lens(
    image_size_px=(2448, 2648),
    focal_px=np.array([FOCAL, FOCAL]),
    principal_point_px=np.array([1224.0, 1324.0]),
    distortion=np.zeros(5),
)
K = np.array([[FOCAL, 0, 1224.0], [0, FOCAL, 1324.0], [0, 0, 1]])
BINS = ((0, 500), (500, 1000), (1000, 2000), (2000, 4000), (4000, 10000))


def opencv_range(corners_m: np.ndarray, pixels: np.ndarray) -> float:
    """OpenCV's solvePnP, refined by its Levenberg-Marquardt: the better of two starts."""
    best, range_m = np.inf, np.nan
    for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_EPNP):
        good, r, t = cv2.solvePnP(corners_m, pixels, K, None, flags=method)
        if not good:
            continue
        r, t = cv2.solvePnPRefineLM(corners_m, pixels, K, None, r, t, (3, 200, 1e-12))
        again, _ = cv2.projectPoints(corners_m, r, t, K, None)
        cost = float(((again[:, 0] - pixels) ** 2).sum())
        if cost < best:
            best, range_m = cost, float(np.linalg.norm(t))
    return range_m


@pytest.fixture(scope="module")
def ranges(shared_data: Path) -> dict[str, np.ndarray]:
    folder = shared_data / "runway-corners"
    if not folder.is_dir():
        pytest.skip(f"no runway-corners in {shared_data}")
    runways = Runways(folder / "runways_database.json")
    with (folder / "corners.csv").open() as stream:
        truth = [1000 * float(row["slant_distance"]) for row in csv.DictReader(stream)]
    table = []
    for row, true in zip(read_corners(folder / "corners.csv"), truth, strict=True):
        assert row.pixels is not None
        runway = runways.find(row.airport, row.runway)
        found = solve_corners(runway, row.pixels, LENS, ROUNDING_SIGMA_PX)
        assert found.pose is not None
        assert found.pose.status is PoseStatus.OK
        pixels = row.pixels[found.order]
        covariance = np.broadcast_to(np.eye(2) / 12, (4, 2, 2))
        seen = PointCorrespondences(points_m=runway.corners_m, pixels=pixels, covariance_px2=covariance, lens=LENS)
        paper = solve_coplanarity(seen)
        assert paper is not None
        P = found.pose.covariance[:3, :3]
        along = found.pose.position_m / found.pose.range_m
        sigma = float(np.sqrt(along @ P @ along))
        table.append(
            [true, found.pose.range_m, np.linalg.norm(paper.position_m), opencv_range(runway.corners_m, pixels), sigma]
        )
    names = ("true", "ours", "paper", "opencv", "sigma")
    return dict(zip(names, np.array(table).T, strict=True))


def rmse(ranges: dict[str, np.ndarray], who: str, low: float, high: float) -> float:
    used = (ranges["true"] >= low) & (ranges["true"] < high)
    return float(np.sqrt(np.mean((ranges[who] - ranges["true"])[used] ** 2)))


@pytest.mark.parametrize(("low", "high"), BINS)
def test_ours_is_as_good_as_opencv_everywhere(ranges: dict[str, np.ndarray], low: float, high: float) -> None:
    assert rmse(ranges, "ours", low, high) <= 1.01 * rmse(ranges, "opencv", low, high)


@pytest.mark.parametrize(("low", "high"), BINS[:4])
def test_the_papers_cost_is_within_a_tenth_below_4_km(ranges: dict[str, np.ndarray], low: float, high: float) -> None:
    assert rmse(ranges, "paper", low, high) <= 1.10 * rmse(ranges, "opencv", low, high)


def test_the_range_is_consistent_with_its_sigma(ranges: dict[str, np.ndarray]) -> None:
    """The true ranges are given in steps of 0.01 nautical miles: that is most of the difference below 1 km."""
    steps = ranges["true"] / STEP_M
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    square = (ranges["ours"] - ranges["true"]) ** 2 / (ranges["sigma"] ** 2 + STEP_M**2 / 12.0)
    for low, high in BINS:
        used = (ranges["true"] >= low) & (ranges["true"] < high)
        assert 0.7 < square[used].mean() < 1.35
