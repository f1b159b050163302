"""Range from whole-pixel corners of real runways: ours, the paper's cost and OpenCV; with attitude; from any start."""

import csv
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.experiments.onboard_pose import opencv_range
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.onboard.pose.coplanarity_solver import FOUR_SIDES, SIX_PAIRS, solve_coplanarity
from groundstation.onboard.pose.corner_labelling import ROUNDING_SIGMA_PX, solve_corners
from groundstation.onboard.pose.pose_files import Runways, read_corners
from groundstation.onboard.pose.pose_solver import KnownAttitude, PointCorrespondences, RunwayPose, solve_pose

FOCAL = 3401.6
CENTRE = np.array([1224.0, 1324.0])
LENS = Lens(
    image_size_px=(2448, 2648), focal_px=np.array([FOCAL, FOCAL]), principal_point_px=CENTRE, distortion=np.zeros(5)
)
BINS = ((0, 500), (500, 1000), (1000, 2000), (2000, 4000), (4000, 10000))
# the true ranges stand in steps of 0.01 nautical miles
STEP_M = 18.52


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Case:
    """One picture: its corners, the pose from them, the true range."""

    seen: PointCorrespondences
    pose: RunwayPose
    true_m: float


def load(folder: Path) -> list[Case]:
    runways = Runways(folder / "runways_database.json")
    with (folder / "corners.csv").open() as stream:
        truth = [1000 * float(row["slant_distance"]) for row in csv.DictReader(stream)]
    cases = []
    for row, true in zip(read_corners(folder / "corners.csv"), truth, strict=True):
        runway = runways.find(row.airport, row.runway)
        found = solve_corners(runway, row.pixels, LENS, ROUNDING_SIGMA_PX)
        cases.append(Case(seen=view(runway.corners_m, row.pixels[found.order]), pose=found.pose, true_m=true))
    return cases


def view(corners_m: np.ndarray, pixels: np.ndarray) -> PointCorrespondences:
    covariance = np.broadcast_to(ROUNDING_SIGMA_PX**2 * np.eye(2), (4, 2, 2))
    return PointCorrespondences(points_m=corners_m, pixels=pixels, covariance_px2=covariance, lens=LENS)


def by_bin(true: np.ndarray, error: np.ndarray) -> dict[str, float]:
    """RMSE in each bin."""
    out = {}
    for low, high in BINS:
        used = (true >= low) & (true < high)
        out[f"{low}-{high}"] = round(float(np.sqrt(np.mean(error[used] ** 2))), 3)
    return out


def corner_study(folder: Path) -> dict[str, object]:
    """RMSE of range by bin for each method, the consistency of this solver, and the time of a solve."""
    cases = load(folder)
    true = np.array([case.true_m for case in cases])
    ranges: dict[str, list[float]] = {"ours": [], "six pairs": [], "four sides": [], "opencv": []}
    sigma, took, steps = [], [], []
    for case in cases:
        start = time.perf_counter()
        pose = solve_pose(case.seen)
        took.append(time.perf_counter() - start)
        ranges["ours"].append(pose.range_m)
        for name, pairs in (("six pairs", SIX_PAIRS), ("four sides", FOUR_SIDES)):
            paper = solve_coplanarity(case.seen, pairs)
            ranges[name].append(float(np.linalg.norm(paper.position_m)))
            if name == "six pairs":
                steps.append(paper.steps)
        ranges["opencv"].append(opencv_range(case.seen))
        along = pose.position_m / pose.range_m
        sigma.append(float(np.sqrt(along @ pose.covariance[:3, :3] @ along)))
    tables = {name: by_bin(true, np.array(values) - true) for name, values in ranges.items()}
    stated = np.sqrt(np.array(sigma) ** 2 + STEP_M**2 / 12)
    return {
        "images": len(cases),
        "rmse_m": tables,
        "normalised_rms": by_bin(true, (np.array(ranges["ours"]) - true) / stated),
        "solve_ms": {
            "median": round(1e3 * float(np.median(took)), 3),
            "p95": round(1e3 * float(np.quantile(took, 0.95)), 3),
        },
        "steps_of_the_papers_cost": {"median": float(np.median(steps)), "p95": float(np.quantile(steps, 0.95))},
    }


def attitude_study(folder: Path) -> dict[str, object]:
    """The same geometry with exact truth, corners rounded to whole pixels again, and an attitude of the given accuracy.

    The recorded table has no attitude; so each estimated pose, rotated slightly, is the truth of a similar picture.
    Without the turn, its corners would fall on the whole pixels that they came from.
    """
    cases = load(folder)
    rng = np.random.default_rng(9)
    true = np.array([case.pose.range_m for case in cases])
    known_to = {"nothing": None}
    for degrees in (0.01, 0.05, 0.2):
        sigma = float(np.radians(degrees))
        known_to[f"horizon {degrees} deg"] = np.array([sigma, sigma, np.inf])
        known_to[f"attitude {degrees} deg"] = np.array([sigma, sigma, sigma])
    errors: dict[str, list[float]] = {name: [] for name in known_to}
    opencv = []
    for case in cases:
        R = matrix_from_wxyz(case.pose.runway_from_camera_wxyz) @ rotation_from_vector(0.01 * rng.standard_normal(3))
        x = (case.seen.points_m - case.pose.position_m) @ R
        pixels = np.round(FOCAL * x[:, :2] / x[:, 2:] + CENTRE)
        seen = view(case.seen.points_m, pixels)
        opencv.append(opencv_range(seen) - case.pose.range_m)
        noise = rng.standard_normal(3)
        for name, sigma in known_to.items():
            known = None
            if sigma is not None:
                turn = np.where(np.isfinite(sigma), sigma, 0.1) * noise
                measured = wxyz_from_matrix(rotation_from_vector(turn) @ R)
                known = KnownAttitude(runway_from_camera_wxyz=measured, sigma_rad=sigma)
            errors[name].append(solve_pose(seen, known).range_m - case.pose.range_m)
    table = {name: by_bin(true, np.array(values)) for name, values in errors.items()}
    return {"rmse_m": {"opencv": by_bin(true, np.array(opencv)), **table}}


def start_study(folder: Path) -> dict[str, object]:
    """How often an arbitrary start ends in the best pose known: as shipped, and the paper's cost alone."""
    cases = load(folder)
    rng = np.random.default_rng(5)
    count, ours, paper = 0, 0, 0
    for case in cases:
        for _ in range(10):
            q = rng.standard_normal(4)
            start = (q / np.linalg.norm(q), rng.uniform(-5000, 5000, 3))
            count += 1
            pose = solve_pose(case.seen, start=start)
            ours += pose is not None and pose.chi_square <= case.pose.chi_square + 1e-6
            alone = solve_coplanarity(case.seen, start=start)
            off = np.inf if alone is None else float(np.linalg.norm(alone.position_m - case.pose.position_m))
            paper += off < 0.1 * case.pose.range_m
    return {
        "starts": count,
        "shipped": ours / count,
        "paper's cost alone, within 10 % of range": round(paper / count, 4),
    }
