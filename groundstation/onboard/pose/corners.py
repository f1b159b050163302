"""The runway's corners to a fraction of a pixel: its four sides fitted as lines, and their intersections.

A corner of a few pixels contains little information; each side is as long as the picture of the runway. Both edges and
both thresholds are measured along their length, and a corner has the covariance of the two lines that intersect there.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.optimize import least_squares

from groundstation.arrays import FloatArray

_STEP_PX = 0.25
_SMOOTH_PX = 1.5
_MOST_PROFILES = 64
_LEAST_PROFILES = 5
# the ends of a side are within the blur of its neighbours
_END_PX = 2.5
# what interpolation and a lens's blur leave, however little noise there is
_LEAST_SIGMA_PX = 0.05
_SOFT_PX = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corners:
    """Four corners: ``pixels`` (4, 2) as ordered, ``covariance_px2`` (4, 2, 2), the weakest side's ``contrast``."""

    pixels: FloatArray
    covariance_px2: FloatArray
    contrast: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """A fitted side: a point on it and its direction (2,); covariance (2, 2) of offset (px) and slope (rad) there."""

    point: FloatArray
    along: FloatArray
    covariance: FloatArray
    contrast: float


def corners_from_lines(left: FloatArray, right: FloatArray, near: FloatArray, far: FloatArray) -> FloatArray | None:
    """Return where tracked edges and thresholds meet, (4, 2) as `runway.CORNERS`; None where two of them do not meet.

    Lines are (3,): a u + b v + c = 0 in px.
    """
    meets = [np.cross(a, b) for a, b in ((left, near), (left, far), (right, far), (right, near))]
    if any(abs(meet[2]) < 1e-9 * np.linalg.norm(meet[:2]) or meet[2] == 0.0 for meet in meets):
        return None
    return np.array([meet[:2] / meet[2] for meet in meets])


def refine_corners(image: FloatArray, start: FloatArray, reach_px: float = 6.0) -> Corners | None:
    """Return the corners that the picture shows near ``start``.

    Parameters
    ----------
    image : (h, w) brightness.
    start : (4, 2) px, in order around the runway; no side may be off by more than ``reach_px``.

    Returns None where a side shows no edge: too short, out of the picture, or without contrast.
    """
    sides: list[Side] = []
    for k in range(4):
        side = fit_side(image, start[k], start[(k + 1) % 4], reach_px)
        if side is None:
            return None
        sides.append(side)
    pixels, covariances = np.empty((4, 2)), np.empty((4, 2, 2))
    for k in range(4):
        met = meet(sides[k - 1], sides[k])
        if met is None:
            return None
        pixels[k], covariances[k] = met
    if (np.linalg.norm(pixels - start, axis=1) > 4.0 * reach_px).any():
        return None
    return Corners(pixels=pixels, covariance_px2=covariances, contrast=min(side.contrast for side in sides))


def fit_side(image: FloatArray, start: FloatArray, end: FloatArray, reach_px: float) -> Side | None:
    """ProfileFit a line to the edge between two corners (2,) px: found coarsely, then once more along what was found.

    None where no edge of one sign is within ``reach_px`` of the line between them.
    """
    side = None
    for reach in (reach_px, 0.5 * reach_px):
        span = end - start
        length = float(np.linalg.norm(span))
        if length < 2.0 * _END_PX + 1.0:
            return None
        along = span / length
        side = _fit_once(image, 0.5 * (start + end), along, length, reach)
        if side is None:
            return None
        start = side.point + side.along * float((start - side.point) @ side.along)
        end = side.point + side.along * float((end - side.point) @ side.along)
    return side


def _fit_once(image: FloatArray, middle: FloatArray, along: FloatArray, length: float, reach: float) -> Side | None:
    """ProfileFit offset and slope of the strongest edge of one sign within ``reach`` of a line."""
    half = 0.5 * length - _END_PX
    count = int(np.clip(round(2.0 * half), _LEAST_PROFILES, _MOST_PROFILES))
    stations = np.linspace(-half, half, count)
    across = np.array([-along[1], along[0]])
    offsets = np.arange(-reach - 1.0, reach + 1.0 + 0.5 * _STEP_PX, _STEP_PX)
    points = middle + stations[:, None, None] * along + offsets[None, :, None] * across
    h, w = image.shape
    inside = ((points >= 1.0) & (points <= np.array([w - 2.0, h - 2.0]))).all(axis=(1, 2))
    if inside.sum() < _LEAST_PROFILES:
        return None
    stations, points = stations[inside], points[inside]
    profiles = map_coordinates(image, [points[..., 1], points[..., 0]], order=1)
    slopes = gaussian_filter1d(profiles, _SMOOTH_PX / _STEP_PX, axis=1, order=1) / _STEP_PX
    total = slopes.mean(axis=0)
    sign = 1.0 if total.max() > -total.min() else -1.0
    strength = sign * slopes[:, 1:-1]
    peak = np.clip(np.argmax(strength, axis=1) + 1, 1, slopes.shape[1] - 2)
    rows = np.arange(len(slopes))
    before, at, after = (sign * slopes[rows, peak + k] for k in (-1, 0, 1))
    bend = before - 2.0 * at + after
    usable = (at > 0.2 * at.max()) & (bend < 0.0)
    if at.max() < 1e-9 * max(float(np.abs(profiles).max()), 1e-9) or usable.sum() < _LEAST_PROFILES:
        return None
    place = offsets[peak[usable]] + _STEP_PX * 0.5 * (before - after)[usable] / bend[usable]
    return _line(stations[usable], place, middle, along, float(np.median(at[usable])))


def _line(x: FloatArray, place: FloatArray, middle: FloatArray, along: FloatArray, contrast: float) -> Side:
    """ProfileFit place = offset + slope · x robustly."""
    # neighbours share pixels and blur: profiles a pixel apart or closer are not independent
    independent = max(1.0, len(x) / max(1.0, float(np.ptp(x)) / (2.0 * _SMOOTH_PX)))

    def residuals(line: FloatArray) -> FloatArray:
        return np.asarray(line[0] + line[1] * x - place)

    def jacobian(_: FloatArray) -> FloatArray:
        return np.stack([np.ones_like(x), x], axis=1)

    fit = least_squares(residuals, [np.median(place), 0.0], jacobian, loss="soft_l1", f_scale=_SOFT_PX)
    left = residuals(fit.x)
    sigma = max(1.4826 * float(np.median(np.abs(left))), _LEAST_SIGMA_PX)
    kept = np.abs(left) < 4.0 * sigma
    J = jacobian(fit.x)[kept]
    covariance = np.asarray(np.linalg.inv(J.T @ J) * sigma**2 * independent, dtype=np.float64)
    across = np.array([-along[1], along[0]])
    turned = along + fit.x[1] * across
    return Side(
        point=middle + fit.x[0] * across,
        along=turned / np.linalg.norm(turned),
        covariance=covariance,
        contrast=contrast,
    )


def meet(first: Side, second: Side) -> tuple[FloatArray, FloatArray] | None:
    """Return where two sides meet (2,) and its covariance (2, 2); None where they are next to parallel."""
    normals = np.array([[-side.along[1], side.along[0]] for side in (first, second)])
    if abs(np.linalg.det(normals)) < 1e-3:
        return None
    corner = np.linalg.solve(normals, [normals[0] @ first.point, normals[1] @ second.point])
    variances = []
    for side in (first, second):
        out = np.array([1.0, float((corner - side.point) @ side.along)])
        variances.append(float(out @ side.covariance @ out))
    inverse = np.linalg.inv(normals)
    return corner, inverse @ np.diag(variances) @ inverse.T
