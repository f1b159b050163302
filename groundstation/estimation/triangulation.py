"""Triangulation of one 3-D point from two or more pixels of one epoch, independent of the filter.

`midpoint` is the paper's CV_T, the middle of the rays' common perpendicular; `triangulate` refines it to the
maximum-likelihood point, which weighs each ray by its own noise, and gives its covariance. Neither is fed
back into the filter, except to start it. Pixels of a rolling shutter come moved by the filter's velocity and rates.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.geometry import kernels
from groundstation.geometry.station import Ray, StationGeometry
from groundstation.messages import Triangulation

_STEPS = 8
_CONVERGED_M = 1e-6
# rays closer to parallel than this have no crossing worth the name
_MIN_RAY_ANGLE_SINE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TriangulationView:
    """One camera's share: a pixel (2,) with covariance (2, 2), and the station's angles with their sigma."""

    station: StationGeometry
    pixel: FloatArray
    covariance_px2: FloatArray
    pan_rad: float
    tilt_rad: float
    angle_sigma_rad: float


def midpoint(rays: Sequence[Ray]) -> tuple[FloatArray, float] | None:
    """Return the point (3,) nearest to all rays (least squares) and the largest distance to one doubled, in m.

    For two rays that is the middle of the common perpendicular and its length. None where they are parallel.
    """
    point = np.empty(3)
    gap = _meet(np.array([r.origin_runway_m for r in rays]), np.array([r.direction_runway for r in rays]), point)
    return None if gap < 0.0 else (point, gap)


@njit(cache=True)
def _meet(origins: FloatArray, directions: FloatArray, point: FloatArray) -> float:
    """Write the point (3,) nearest to all rays (n, 3), (n, 3); return twice the farthest's distance, −1 if parallel."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    for k in range(origins.shape[0]):
        for i in range(3):
            for j in range(3):
                across = (1.0 if i == j else 0.0) - directions[k, i] * directions[k, j]
                A[i, j] += across
                b[i] += across * origins[k, j]
    if not _solvable(A, 1.0 / _MIN_RAY_ANGLE_SINE**2):
        return -1.0
    point[:] = np.linalg.solve(A, b)
    farthest = 0.0
    for k in range(origins.shape[0]):
        along, square = 0.0, 0.0
        for i in range(3):
            to = point[i] - origins[k, i]
            along += to * directions[k, i]
            square += to * to
        farthest = max(farthest, math.sqrt(max(square - along * along, 0.0)))
    return 2.0 * farthest


def triangulate(views: Sequence[TriangulationView]) -> Triangulation | None:
    """Return the point that two or more views agree on best, or None where their rays don't meet ahead."""
    middle, point, covariance = np.empty(3), np.empty(3), np.empty((3, 3))
    gap, chi2 = _triangulate(
        np.array([v.station.packed for v in views]),
        np.array([v.pixel for v in views]),
        np.array([v.covariance_px2 for v in views]),
        np.array([(v.pan_rad, v.tilt_rad, v.angle_sigma_rad) for v in views]),
        middle,
        point,
        covariance,
    )
    if gap < 0.0 or chi2 < 0.0:
        return None
    return Triangulation(
        midpoint_runway_m=middle,
        point_runway_m=point,
        covariance_m2=covariance,
        gap_m=gap,
        residual_sigma=math.sqrt(chi2),
    )


@njit(cache=True)
def _triangulate(
    stations: FloatArray,
    pixels: FloatArray,
    covariances: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    point: FloatArray,
    covariance: FloatArray,
) -> tuple[float, float]:
    """Write the midpoint (3,) and what `_refine` makes of it; return the rays' gap and χ², −1 where there is none.

    The views' arrays are those of `_refine`.
    """
    origins, directions = np.empty((len(pixels), 3)), np.empty((len(pixels), 3))
    for n in range(len(pixels)):
        u, v = pixels[n]
        if not kernels.ray(stations[n], u, v, angles[n, 0], angles[n, 1], origins[n], directions[n]):
            return -1.0, -1.0
    gap = _meet(origins, directions, middle)
    if gap < 0.0:
        return -1.0, -1.0
    return gap, _refine(stations, pixels, covariances, angles, middle, point, covariance)


@njit(cache=True)
def _refine(
    stations: FloatArray,
    pixels: FloatArray,
    covariances: FloatArray,
    angles: FloatArray,
    start: FloatArray,
    point: FloatArray,
    covariance: FloatArray,
) -> float:
    """Write the maximum-likelihood point (3,) and its covariance (3, 3); return χ², −1 where there is no such point.

    ``stations`` (n, 36) packed, ``pixels`` (n, 2) with ``covariances`` (n, 2, 2), ``angles`` (n, 3) pan, tilt and
    their sigma; Gauss-Newton from ``start``, each view's noise taken at the newest point.
    """
    step = np.full(3, np.inf)
    point[:] = start
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    pixel, jacobian, chi2 = np.empty(2), np.empty((2, 5)), 0.0
    for k in range(_STEPS + 1):
        information[:], gradient[:], chi2 = 0.0, 0.0, 0.0
        for n in range(stations.shape[0]):
            depth = kernels.project(stations[n], point, angles[n, 0], angles[n, 1], pixel, jacobian)
            if depth < kernels.MIN_DEPTH_M:
                return -1.0
            chi2 += _add_view(information, gradient, pixels[n] - pixel, jacobian, covariances[n], angles[n, 2])
        if not _solvable(information, 1e14):
            return -1.0
        if k == _STEPS or np.abs(step).max() < _CONVERGED_M:
            break
        step = np.linalg.solve(information, gradient)
        point += step
    covariance[:] = np.linalg.inv(information)
    return float(chi2)


@njit(cache=True)
def _add_view(
    information: FloatArray,
    gradient: FloatArray,
    residual: FloatArray,
    jacobian: FloatArray,
    covariance_px2: FloatArray,
    angle_sigma_rad: float,
) -> float:
    """Add one camera's share to the normal equations in place; returns its χ²."""
    S = covariance_px2.copy()
    for a in range(2):
        for b in range(2):
            for k in range(3, 5):
                S[a, b] += angle_sigma_rad**2 * jacobian[a, k] * jacobian[b, k]
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    weight = np.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]]) / det
    chi2 = 0.0
    for a in range(2):
        for b in range(2):
            w = weight[a, b]
            chi2 += residual[a] * w * residual[b]
            for i in range(3):
                gradient[i] += jacobian[a, i] * w * residual[b]
                for j in range(3):
                    information[i, j] += jacobian[a, i] * w * jacobian[b, j]
    return chi2


@njit(cache=True)
def _solvable(A: FloatArray, most: float) -> bool:
    """Return whether a symmetric matrix (3, 3) is positive and conditioned better than ``most``."""
    values = np.linalg.eigvalsh(A)
    return bool(values[0] > 0.0 and values[-1] < most * values[0])
