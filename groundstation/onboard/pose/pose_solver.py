"""The pose of a camera from the corners of a runway: unit dual quaternion, weighted constraints, no start needed."""

import enum
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, IntArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.geometry.dual_quaternion import left_matrix, normalised, quaternion_conjugate
from groundstation.onboard.pose.camera_kernel import (
    dual_of,
    information_of,
    look,
    matrix_of,
    mirrored_start,
    pose_of,
    reprojection_rms,
    turned_to_front,
)
from groundstation.onboard.pose.curvature_kernel import second_order
from groundstation.onboard.pose.levenberg_marquardt import COPLANARITY, REPROJECTION, PoseCost, levenberg_marquardt
from groundstation.onboard.pose.p3p_kernel import three_point_starts

MOST_STEPS = 60
TOLERANCE = 1e-9
# the second best start costs little and settles what noise has put in the wrong order
_STARTS = 2
# a position whose sigma exceeds this share of the range is unreliable
_UNCERTAIN = 0.5
# a fit worse than this happens by chance once in a million
MISFIT_CHANCE = 1e-6
_NO_PAIRS = np.zeros((0, 2), dtype=np.int64)
_NO_ROWS = np.zeros((0, 4))
_NO_NORMALS = np.zeros((0, 3))


class PoseStatus(enum.StrEnum):
    """Outcome of a solution: it fits; it fits without information; it does not fit the noise; there is none."""

    OK = "ok"
    UNCERTAIN = "uncertain"
    RESIDUAL = "residual"
    NO_POSE = "no_pose"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCorrespondences:
    """Surveyed points and the pixels that show them.

    Attributes
    ----------
    points_m : (n, 3), runway frame, n ≥ 4, near a plane and not on one line.
    pixels : (n, 2) u, v in px.
    covariance_px2 : (n, 2, 2) of each pixel.
    lens : of the camera.
    """

    points_m: FloatArray
    pixels: FloatArray
    covariance_px2: FloatArray
    lens: Lens

    def __post_init__(self) -> None:
        n = len(self.points_m)
        shapes = (self.points_m.shape, self.pixels.shape, self.covariance_px2.shape)
        if n < 4 or shapes != ((n, 3), (n, 2), (n, 2, 2)):
            raise ValueError(f"got points, pixels and covariances of shapes {shapes}; wanted (n, 3), (n, 2), (n, 2, 2)")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownAttitude:
    """Prior knowledge of the attitude: about runway x and y a horizon, about z a heading.

    ``sigma_rad`` (3,) is about the runway's axes; an infinite one is unknown.
    """

    runway_from_camera_wxyz: FloatArray
    sigma_rad: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunwayPose:
    """A camera's pose in the runway frame.

    Attributes
    ----------
    position_m : (3,) of the camera.
    runway_from_camera_wxyz : (4,), w ≥ 0.
    covariance : (6, 6) of position (m) and rotation vector δθ (rad), R_true = exp([δθ]×) R, runway frame; to second
        order in the corners' noise.
    reprojection_px : root mean square over the corners.
    chi_square, dof : the weighted cost at the solution, and how many residuals exceed the unknowns.
    steps : of Levenberg-Marquardt, over all starts.
    """

    position_m: FloatArray
    runway_from_camera_wxyz: FloatArray
    covariance: FloatArray
    reprojection_px: float
    chi_square: float
    dof: int
    steps: int
    status: PoseStatus

    @property
    def range_m(self) -> float:
        """Return the distance from the frame's origin."""
        return float(np.linalg.norm(self.position_m))


class SolverInput:
    """The solver's inputs for one picture: rays, whitened tangents, points in a unit of their own size.

    Raises `ValueError` where a pixel has no ray through this lens.
    """

    def __init__(self, seen: PointCorrespondences) -> None:
        self.scale_m = float(np.sqrt((seen.points_m**2).sum() / len(seen.points_m)))
        self.points = np.ascontiguousarray(seen.points_m, dtype=np.float64) / self.scale_m
        self.pixels = np.ascontiguousarray(seen.pixels, dtype=np.float64)
        self.lens = packed_lens(seen.lens)
        self.rays, self.tangents = np.empty((len(self.points), 3)), np.empty((len(self.points), 2, 3))
        covariances = np.ascontiguousarray(seen.covariance_px2, dtype=np.float64)
        if not (np.isfinite(self.pixels).all() and look(self.lens, self.pixels, covariances, self.rays, self.tangents)):
            raise ValueError(f"got pixels {seen.pixels.tolist()}; wanted pixels that this lens can see")

    def dual(self, wxyz_runway_from_camera: FloatArray, position_m: FloatArray) -> FloatArray:
        """Return ``camera_from_runway`` (8,) in this view's unit of length."""
        R = matrix_of(np.asarray(wxyz_runway_from_camera, dtype=np.float64)).T
        q = np.empty(8)
        dual_of(np.ascontiguousarray(R), -R @ (position_m / self.scale_m), q)
        return q


def packed_lens(lens: Lens) -> FloatArray:
    """Return the lens as the kernels take it, (10,)."""
    return np.array([*lens.focal_px, *lens.principal_point_px, *lens.distortion, lens.radius_limit], dtype=np.float64)


def solve_pose(
    seen: PointCorrespondences,
    known: KnownAttitude | None = None,
    start: tuple[FloatArray, FloatArray] | None = None,
) -> RunwayPose | None:
    """Find the most likely pose; docs/onboard-pose.md.

    Minimises, over the eight numbers of ``camera_from_runway``, the plane constraints n·(R p + t) = 0 of each corner
    divided by depth and weighted by the corner's covariance, the ``known`` attitude, and 100 times the
    squares of the two unit constraints.

    Parameters
    ----------
    seen : points, pixels, lens.
    known : of the attitude.
    start : runway_from_camera_wxyz (4,) and position_m (3,), any; without it, or where it does not lead to a fit, the
        initial poses are those of three of the points.

    Returns None where no pose has all points in front of the camera.
    """
    view = SolverInput(seen)
    attitude = attitude_rows(known)
    dof = 2 * len(view.points) + len(attitude) - 6
    gate = misfit_gate(dof)
    best, best_cost, steps = np.empty(8), np.inf, 0
    if start is not None:
        q = view.dual(*start)
        steps += _polynomial(view, q)
        turned_to_front(view.points, view.rays, q)
        best_cost, more = _weighted(view, attitude, q)
        best, steps = q, steps + more
    if not best_cost < gate:
        for q in first_poses(view):
            cost, more = _weighted(view, attitude, q)
            steps += more
            if cost < best_cost:
                best, best_cost = q, cost
    if not np.isfinite(best_cost):
        return None
    other = np.empty(8)
    mirrored_start(view.points, best, other)
    cost, more = _weighted(view, attitude, other)
    if cost < best_cost:
        best, best_cost = other, cost
    return _result(view, known, best, best_cost, dof, steps + more)


def first_poses(view: SolverInput) -> FloatArray:
    """Return initial poses (k, 8), the best first, from triples of the points alone; none where these are collinear."""
    starts = np.empty((_STARTS, 8))
    found = three_point_starts(view.points, view.rays, view.tangents, starts)
    return starts[:found]


def pose_covariance(
    seen: PointCorrespondences, position_m: FloatArray, wxyz: FloatArray, known: KnownAttitude | None = None
) -> FloatArray:
    """Return the covariance (6, 6) that the corners of ``seen`` give a pose, as in `RunwayPose.covariance`."""
    view = SolverInput(seen)
    return _covariance(view, known, view.dual(wxyz, position_m))


def misfit_gate(dof: int) -> float:
    """Return the chi-square that a right solution exceeds once in a million."""
    return float(chi_square_limit(MISFIT_CHANCE, max(dof, 1)))


def attitude_rows(known: KnownAttitude | None) -> FloatArray:
    """Return rows (k, 4) with rows · q_r in sigmas: twice the vector part of q₀* ⊗ q_r, zero at ±q₀."""
    if known is None:
        return _NO_ROWS
    q0 = quaternion_conjugate(known.runway_from_camera_wxyz)
    q0 = q0 / np.linalg.norm(q0)
    used = np.isfinite(known.sigma_rad)
    rows = 2.0 * left_matrix(quaternion_conjugate(q0))[1:][used] / np.asarray(known.sigma_rad)[used, None]
    return np.ascontiguousarray(rows)


def pair_normals(rays: FloatArray, pairs: IntArray) -> FloatArray:
    """Return unit normals (m, 3) of the planes through the camera and each pair of corners, u_i × u_j."""
    crossed = np.cross(rays[pairs[:, 0]], rays[pairs[:, 1]])
    return np.asarray(crossed / np.linalg.norm(crossed, axis=1, keepdims=True))


def all_pairs(count: int) -> IntArray:
    """Return every pair (m, 2) of corners, each both ways round."""
    return np.array([(i, j) for i in range(count) for j in range(count) if i != j], dtype=np.int64)


def _weighted(view: SolverInput, attitude: FloatArray, q: FloatArray) -> tuple[float, int]:
    """Minimise the weighted cost from ``q`` in place; infinite where points are behind or it does not converge."""
    problem = PoseCost(
        REPROJECTION, view.points, view.rays, view.tangents, attitude, normals=_NO_NORMALS, pairs=_NO_PAIRS, metres=1.0
    )
    cost, steps, good = levenberg_marquardt(problem, q, MOST_STEPS, TOLERANCE)
    return (cost if good else np.inf), steps


def _polynomial(view: SolverInput, q: FloatArray) -> int:
    """Minimise the paper's cost, which has no depth to divide by and so may start anywhere; in place."""
    pairs = all_pairs(len(view.points))
    normals = pair_normals(view.rays, pairs)
    problem = PoseCost(
        COPLANARITY, view.points, view.rays, view.tangents, _NO_ROWS, normals=normals, pairs=pairs, metres=1.0
    )
    _, steps, _ = levenberg_marquardt(problem, q, MOST_STEPS, 1e-4)
    return int(steps)


def _covariance(view: SolverInput, known: KnownAttitude | None, q: FloatArray) -> FloatArray:
    information = information_of(view.points, view.rays, view.tangents, q)
    if known is not None:
        information[3:, 3:] += np.diag(1.0 / np.asarray(known.sigma_rad) ** 2)
    root = np.linalg.cholesky(np.linalg.inv(information))
    bent = second_order(view.points, view.rays, view.tangents, q, root)
    units = np.array([view.scale_m] * 3 + [1.0] * 3)
    covariance = root @ (np.eye(6) + bent) @ root.T * np.outer(units, units)
    return np.asarray(0.5 * (covariance + covariance.T))


def _result(
    view: SolverInput, known: KnownAttitude | None, q: FloatArray, cost: float, dof: int, steps: int
) -> RunwayPose | None:
    """Return the pose of a minimum; None where the points do not hold it."""
    unit = normalised(q)
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(unit, R, t)
    wxyz = quaternion_conjugate(unit[:4])
    position = -R.T @ t * view.scale_m
    try:
        covariance = _covariance(view, known, unit)
    except np.linalg.LinAlgError:
        return None
    variances = np.diag(covariance)
    if not (np.isfinite(covariance).all() and (variances > 0).all()):
        return None
    if cost > misfit_gate(dof):
        status = PoseStatus.RESIDUAL
    elif variances[:3].sum() > (_UNCERTAIN * np.linalg.norm(position)) ** 2:
        status = PoseStatus.UNCERTAIN
    else:
        status = PoseStatus.OK
    return RunwayPose(
        position_m=position,
        runway_from_camera_wxyz=-wxyz if wxyz[0] < 0 else wxyz,
        covariance=covariance,
        reprojection_px=float(reprojection_rms(view.lens, view.points, view.pixels, unit)),
        chi_square=float(cost),
        dof=dof,
        steps=steps,
        status=status,
    )
