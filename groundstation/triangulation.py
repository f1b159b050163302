"""The baseline: one 3-D point from two or more pixels of one epoch, with no memory.

`midpoint` is the paper's CV_T, the middle of the rays' common perpendicular; `triangulate` refines it to the
maximum-likelihood point, which weighs each ray by its own noise, and gives its covariance. Neither is fed
back into the filter, except to start it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import LensError, Ray, StationGeometry
from groundstation.messages import Triangulation

_STEPS = 8
_CONVERGED_M = 1e-6
# rays closer to parallel than this have no crossing worth the name
_MIN_RAY_ANGLE_SINE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """One camera's share: a pixel (2,) with covariance (2, 2), and the station's angles with their sigma."""

    station: StationGeometry
    pixel: FloatArray
    covariance_px2: FloatArray
    pan_rad: float
    tilt_rad: float
    angle_sigma_rad: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Normal:
    """Normal equations of the reprojection: information (3, 3), gradient (3,), χ² and whether all is in front."""

    information: FloatArray
    gradient: FloatArray
    chi2: float
    in_front: bool


def midpoint(rays: Sequence[Ray]) -> tuple[FloatArray, float] | None:
    """Return the point (3,) nearest to all rays (least squares) and the largest distance to one doubled, in m.

    For two rays that is the middle of the common perpendicular and its length. None where they are parallel.
    """
    A, b = np.zeros((3, 3)), np.zeros(3)
    for r in rays:
        across = np.eye(3) - np.outer(r.direction_runway, r.direction_runway)
        A += across
        b += across @ r.origin_runway_m
    if np.linalg.cond(A) > 1.0 / _MIN_RAY_ANGLE_SINE**2:
        return None
    point = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
    distances = [np.linalg.norm(np.cross(point - r.origin_runway_m, r.direction_runway)) for r in rays]
    return point, 2.0 * float(max(distances))


def triangulate(views: Sequence[View]) -> Triangulation | None:
    """Return the point that two or more views agree on best, or None where their rays don't meet ahead."""
    try:
        rays = [v.station.ray(v.pixel[0], v.pixel[1], v.pan_rad, v.tilt_rad) for v in views]
    except LensError:
        return None
    start = midpoint(rays)
    if start is None:
        return None
    point, gap = start
    best = point
    normal = _normal_equations(views, best)
    for _ in range(_STEPS):
        if not normal.in_front:
            return None
        step = np.linalg.solve(normal.information, normal.gradient)
        best = best + step
        normal = _normal_equations(views, best)
        if float(np.abs(step).max()) < _CONVERGED_M:
            break
    if not normal.in_front:
        return None
    return Triangulation(
        midpoint_runway_m=point,
        point_runway_m=best,
        covariance_m2=np.asarray(np.linalg.inv(normal.information), dtype=np.float64),
        gap_m=gap,
        residual_sigma=float(np.sqrt(normal.chi2)),
    )


def pixel_covariance(view: View, jacobian: FloatArray) -> FloatArray:
    """Return pixel noise (2, 2) with the angles' noise carried into it by ∂pixel/∂(pan, tilt)."""
    J = jacobian[:, 3:]
    return view.covariance_px2 + view.angle_sigma_rad**2 * (J @ J.T)


def _normal_equations(views: Sequence[View], point: FloatArray) -> _Normal:
    """Return the Gauss-Newton equations at one point."""
    information, gradient, chi2 = np.zeros((3, 3)), np.zeros(3), 0.0
    for v in views:
        projection = v.station.project(point, v.pan_rad, v.tilt_rad)
        if projection is None:
            return _Normal(information=information, gradient=gradient, chi2=chi2, in_front=False)
        J = projection.jacobian[:, :3]
        weight = np.linalg.inv(pixel_covariance(v, projection.jacobian))
        residual = v.pixel - projection.pixel
        information += J.T @ weight @ J
        gradient += J.T @ weight @ residual
        chi2 += float(residual @ weight @ residual)
    solvable = bool(np.linalg.cond(information) < 1e14)
    return _Normal(information=information, gradient=gradient, chi2=chi2, in_front=solvable)
