"""The runway-pose paper on simulated corners: range by four methods, and the inertial filter on single approaches."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.experiments.experiment import Findings
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_y, rotation_z
from groundstation.onboard.edges.pose import intrinsic_matrix
from groundstation.onboard.pose.coplanarity_solver import FOUR_SIDES, SIX_PAIRS, solve_coplanarity
from groundstation.onboard.pose.corner_labelling import ROUNDING_SIGMA_PX
from groundstation.onboard.pose.inertial_filter import ATTITUDE, POSITION, UpdateOutcome, rotation_vector
from groundstation.onboard.pose.pose_solver import PointCorrespondences, solve_pose
from groundstation.onboard.pose.runway_navigator import RunwayNavigator
from groundstation.onboard.pose.simulated_approach import (
    RUNWAY_FROM_LEVEL_BODY,
    ApproachSetup,
    SimulatedApproach,
    default_setup,
    fly,
    see_runway,
)

_SEED = 41
_BINS_M = ((150, 500), (500, 1000), (1000, 1800))
_METHODS = ("ours", "paper's, six pairs", "paper's, four sides", "OpenCV")
_PICTURES, _FLIGHTS = 600, 10
# of a shorter part of the recording, few flights: enough to try it
_MANY_BEYOND_S = 15.0
SETTLED_S, EVERY = 5.0, 10
_POSE = np.r_[POSITION, ATTITUDE]
DIFFERENCES = (
    "The paper flies FlightGear by hand and takes SUSAN corners; here corners are exact ones of a simulated small "
    "UAV's approach with noise, so that truth is exact.",
    "The paper prints curves and no table; there are no numbers of its own to compare with ours.",
)


def pose_range(recorded: TruthSession) -> Findings:
    """Range from whole-pixel corners: this solver, the paper's cost over six pairs and over four sides, and OpenCV."""
    wanted = max(round(_PICTURES * recorded.at_most_s(5.0) / 5.0), 60)
    setup = default_setup(0.0)
    rng = np.random.default_rng(_SEED)
    rows: list[list[float]] = []
    while len(rows) < wanted:
        position, body = _somewhere(rng)
        seen = see_runway(setup, position, body, rng)
        if seen is None:
            continue
        seen = PointCorrespondences(
            points_m=seen.points_m,
            pixels=np.round(seen.pixels),
            covariance_px2=np.broadcast_to(ROUNDING_SIGMA_PX**2 * np.eye(2), (4, 2, 2)),
            lens=setup.lens,
        )
        true_m = float(np.linalg.norm(position + body @ setup.mount.camera_in_body_m))
        rows.append([true_m, *(value - true_m for value in _ranges(seen))])
    table = np.array(rows)
    cells: list[list[Cell]] = []
    for low, high in _BINS_M:
        part = table[(table[:, 0] >= low) & (table[:, 0] < high), 1:]
        rms = np.sqrt(np.nanmean(part**2, axis=0)) if len(part) else np.zeros(len(_METHODS))
        cells.append([f"{low}–{high} m", len(part), *(float(value) for value in rms)])
    return Findings(
        tables=(
            ResultTable(
                name="pose_range",
                title="Root mean square error of range in m, corners in whole pixels",
                columns=("range", "pictures", *_METHODS),
                rows=cells,
                notes=("Runway 900 m by 30 m, camera of 1280 × 960 px; OpenCV: solvePnP, then Levenberg-Marquardt.",),
            ),
        ),
        differences=DIFFERENCES,
    )


def _somewhere(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return a place (3,) and runway_from_body (3, 3) on a sloppy approach."""
    away, glide = rng.uniform(_BINS_M[0][0], _BINS_M[-1][1]), np.radians(rng.uniform(2.5, 6.0))
    position = np.array([rng.normal(0, 0.02) * away, away * np.cos(glide), away * np.sin(glide)])
    yaw, pitch, roll = np.radians([rng.normal(0, 3), rng.normal(0, 2), rng.normal(0, 8)])
    return position, RUNWAY_FROM_LEVEL_BODY @ rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def _ranges(seen: PointCorrespondences) -> list[float]:
    found = [solve_pose(seen), solve_coplanarity(seen, SIX_PAIRS), solve_coplanarity(seen, FOUR_SIDES)]
    ranges = [np.nan if pose is None else float(np.linalg.norm(pose.position_m)) for pose in found]
    return [*ranges, opencv_range(seen)]


def opencv_range(seen: PointCorrespondences) -> float:
    """Return the range in m by OpenCV's solvePnP and its Levenberg-Marquardt, the better of two starts."""
    K, best, range_m = intrinsic_matrix(seen.lens), np.inf, np.nan
    for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_EPNP):
        good, r, t = cv2.solvePnP(seen.points_m, seen.pixels, K, None, flags=method)
        if not good:
            continue
        r, t = cv2.solvePnPRefineLM(seen.points_m, seen.pixels, K, None, r, t, (3, 200, 1e-12))
        again, _ = cv2.projectPoints(seen.points_m, r, t, K, None)
        cost = float(((again[:, 0] - seen.pixels) ** 2).sum())
        if cost < best:
            best, range_m = cost, float(np.linalg.norm(t))
    return range_m


# ------------------------------------------------------------------------------------- inertial filter
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightErrors:
    """One flight: times (n,), errors and sigmas (n, 15), NEES of the pose (n,), and innovations (m, 7) with time."""

    approach: SimulatedApproach
    t_s: FloatArray
    error: FloatArray
    sigma: FloatArray
    nees: FloatArray
    estimate_m: FloatArray
    innovations: FloatArray
    innovation_sigmas: FloatArray
    steps: FloatArray


def inertial(recorded: TruthSession) -> Findings:
    """Approaches with 20 s without runway: shares inside ±2σ, NEES, drift."""
    flights = _FLIGHTS if recorded.at_most_s(_MANY_BEYOND_S) == _MANY_BEYOND_S else 2
    setup = default_setup(0.5)
    done = [follow(setup, fly(setup, np.random.default_rng([_SEED, k]))) for k in range(flights)]
    rows: list[list[Cell]] = []
    band = chi_square_quantile([0.025, 0.975], 6 * flights) / flights
    lost = setup.lost_s
    for name, low, high in (
        ("seen", SETTLED_S, lost[0]),
        ("first half of the loss", lost[0], sum(lost) / 2),
        ("second half", sum(lost) / 2, lost[1]),
        ("seen again", lost[1] + 0.5, setup.duration_s),
    ):
        used = (done[0].t_s >= low) & (done[0].t_s < high)
        error = np.array([one.error[used] for one in done])
        inside = np.abs(error) < 2.0 * np.array([one.sigma[used] for one in done])
        rms = np.sqrt((error**2).mean(axis=(0, 1)))
        rows.append(
            [name, *(float(v) for v in rms[POSITION]), float(np.degrees(rms[ATTITUDE]).max()),
             100.0 * float(inside[..., POSITION].mean()), 100.0 * float(inside[..., ATTITUDE].mean()),
             float(np.mean([one.nees[used].mean() for one in done]))]
        )  # fmt: skip
    table = ResultTable(
        name="inertial_filter",
        title="Position and attitude through 20 s without runway",
        columns=("phase", "x m", "y m", "z m", "attitude °", "position in ±2σ %", "attitude in ±2σ %", "NEES (6)"),
        rows=rows,
        notes=(f"{flights} flights; 95 % band of the NEES of one epoch's mean: {band[0]:.2f} to {band[1]:.2f}.",),
    )
    return Findings(tables=(table,), differences=DIFFERENCES)


def follow(setup: ApproachSetup, approach: SimulatedApproach) -> FlightErrors:
    """Run the filter over a flight."""
    navigator = RunwayNavigator(setup.config, setup.mount)
    rows, innovations, steps = [], [], []
    for k, sample in enumerate(approach.samples):
        navigator.process_imu(sample)
        if k in approach.seen:
            seen = approach.seen[k]
            innovation = navigator.update(sample.t_s, seen).innovation
            if k % (5 * EVERY) == 0 and (paper := solve_coplanarity(seen, SIX_PAIRS)) is not None:
                steps.append((sample.t_s, paper.steps))
            if innovation is not None and innovation.outcome is UpdateOutcome.USED:
                innovations.append((sample.t_s, innovation.value, np.sqrt(np.diag(innovation.covariance))))
        if k % EVERY == 0 and sample.t_s >= SETTLED_S:
            now = navigator.navigation
            turn = rotation_vector(approach.runway_from_body[k] @ matrix_from_wxyz(now.runway_from_body_wxyz).T)
            error = np.concatenate(
                [approach.position_m[k] - now.position_m, approach.velocity_m_s[k] - now.velocity_m_s, turn,
                 approach.force_bias[k] - now.force_bias_m_s2, approach.rate_bias[k] - now.rate_bias_rad_s]
            )  # fmt: skip
            nees = error[_POSE] @ np.linalg.solve(now.P[np.ix_(_POSE, _POSE)], error[_POSE])
            rows.append((sample.t_s, error, np.sqrt(np.diag(now.P)), nees, now.position_m))
    t, error, sigma, nees, estimate = (np.array(column) for column in zip(*rows, strict=True))
    it, values, sigmas = (np.array(column) for column in zip(*innovations, strict=True))
    return FlightErrors(
        approach=approach, t_s=t, error=error, sigma=sigma, nees=nees, estimate_m=estimate,
        innovations=np.column_stack([it, values]), innovation_sigmas=sigmas,
        steps=np.array(steps, dtype=np.float64).reshape(-1, 2),
    )  # fmt: skip
