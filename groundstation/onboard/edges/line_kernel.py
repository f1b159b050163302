"""Compiled arithmetic of two lines on the ground and in the picture, for `lines`, `frame_geometry` and `search_band`.

Each function is a few dozen multiplications, for which a call of numpy takes ten times as long as the arithmetic.
The equations are named where the functions are documented, in `lines`; rotation is threshold_from_camera (3, 3),
position the projection centre (3,) in the threshold frame, m.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.line_state import C, D

_CROSS_LINES = 40
_BORDER_PX = 2.0
_NEAREST_M = 0.1


@njit(cache=True, nogil=True, error_model="numpy")
def inverse_3(m: FloatArray) -> FloatArray:
    """Return the inverse of a matrix (3, 3), by its cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            r, s, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = m[r, c] * m[s, d] - m[r, d] * m[s, c]
    determinant = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for j in range(3):
            out[i, j] /= determinant
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def line_map_of(rotation: FloatArray, position: FloatArray, kappa: FloatArray) -> FloatArray:
    """Return E = (κ[r₁ r₂ t])⁻ᵀ, (3, 3); κ[r₁ r₂ t] takes ground (x, y, 1) in m to homogeneous pixels, Eq. B10."""
    ground = np.empty((3, 3))
    for i in range(3):
        ground[i, 0], ground[i, 1] = rotation[0, i], rotation[1, i]
        ground[i, 2] = -(rotation[0, i] * position[0] + rotation[1, i] * position[1] + rotation[2, i] * position[2])
    pixel = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                pixel[i, j] += kappa[i, k] * ground[k, j]
    return np.ascontiguousarray(inverse_3(pixel).T)


@njit(cache=True, nogil=True, error_model="numpy")
def project(state: FloatArray, e: FloatArray, rows: FloatArray, crossings: FloatArray, jacobian: FloatArray) -> None:
    """Fill the crossings (4,) of a state (a, b, c, d, …) with the rows (2,), and their derivative (4, 4 or more)."""
    a, b = state[0], state[1]
    for line in range(2):
        c = state[2 + line]
        l0 = e[0, 0] * a + e[0, 1] * b + e[0, 2] * c
        l1 = e[1, 0] * a + e[1, 1] * b + e[1, 2] * c
        l2 = e[2, 0] * a + e[2, 1] * b + e[2, 2] * c
        for end in range(2):
            k, v = 2 * line + end, rows[end]
            crossings[k] = -(l1 * v + l2) / l0
            for m in range(4):
                jacobian[k, m] = 0.0
            for m in range(3):
                slope = -(crossings[k] * e[0, m] + v * e[1, m] + e[2, m]) / l0
                jacobian[k, m if m < 2 else 2 + line] = slope


@njit(cache=True, nogil=True, error_model="numpy")
def move_with_pose(
    crossings: FloatArray,
    rows: FloatArray,
    rotation: FloatArray,
    position: FloatArray,
    kappa: FloatArray,
    out: FloatArray,
) -> None:
    """Fill ``out`` (4, 6) with how crossings move as the camera turns and moves by its own axes."""
    back = inverse_3(kappa)
    for k in range(4):
        line = k // 2
        slope = (crossings[2 * line + 1] - crossings[2 * line]) / (rows[1] - rows[0])
        u, v = crossings[k], rows[k % 2]
        x = back[0, 0] * u + back[0, 1] * v + back[0, 2]
        y = back[1, 0] * u + back[1, 1] * v + back[1, 2]
        z = back[2, 0] * u + back[2, 1] * v + back[2, 2]
        # a point that stands still moves in the camera by −θ × X − shift
        near = -(x * rotation[2, 0] + y * rotation[2, 1] + z * rotation[2, 2]) / position[2]
        by_x = (x * y, -(1.0 + x * x), y, -near, 0.0, x * near)
        by_y = (1.0 + y * y, -x * y, -x, 0.0, -near, y * near)
        for m in range(6):
            out[k, m] = kappa[0, 0] * by_x[m] + kappa[0, 1] * by_y[m] - slope * kappa[1, 1] * by_y[m]


@njit(cache=True, nogil=True, error_model="numpy")
def ground_of(pixels: FloatArray, rotation: FloatArray, position: FloatArray, kappa: FloatArray) -> FloatArray:
    """Return where the rays of pixels (n, 2) meet the ground, (n, 2) in m; NaN above the horizon."""
    back = inverse_3(kappa)
    out = np.empty((len(pixels), 2))
    ray, turned = np.empty(3), np.empty(3)
    for n in range(len(pixels)):
        for i in range(3):
            ray[i] = back[i, 0] * pixels[n, 0] + back[i, 1] * pixels[n, 1] + back[i, 2]
        for i in range(3):
            turned[i] = rotation[i, 0] * ray[0] + rotation[i, 1] * ray[1] + rotation[i, 2] * ray[2]
        reach = -position[2] / turned[2]
        for i in range(2):
            out[n, i] = position[i] + reach * turned[i] if reach > 0.0 else np.nan
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def state_through(ground: FloatArray) -> FloatArray:
    """Return the state (4,) of two lines through points of the ground (2, 2, 2): line, upper or lower row, x and y."""
    x, y = 0.0, 0.0
    for line in range(2):
        dx, dy = ground[line, 1, 0] - ground[line, 0, 0], ground[line, 1, 1] - ground[line, 0, 1]
        length = math.sqrt(dx * dx + dy * dy)
        x += dx / length
        y += dy / length
    length = math.sqrt(x * x + y * y)
    a, b = y / length, -x / length
    if not a >= 0.0:
        a, b = -a, -b
    out = np.empty(4)
    out[0], out[1] = a, b
    for line in range(2):
        # the lower end sees the ground more finely, and weighs more
        px = 0.3 * ground[line, 0, 0] + 0.7 * ground[line, 1, 0]
        py = 0.3 * ground[line, 0, 1] + 0.7 * ground[line, 1, 1]
        out[2 + line] = -(px * a + py * b)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def seen_rows(
    rotation: FloatArray,
    position: FloatArray,
    kappa: FloatArray,
    size: tuple[int, int],
    sides: tuple[float, float],
    ends: tuple[float, float],
    rows: FloatArray,
) -> bool:
    """Fill the rows (2,) between which both edges are in the picture of ``size`` (w, h); false where one is not.

    ``sides`` are the x of both edges, ``ends`` the y of the first and the last of a number of cross lines, dense near
    the camera.
    """
    near, far = position[1] - ends[0], position[1] - ends[1]
    rows[0], rows[1] = -np.inf, np.inf
    for side in sides:
        low, high = np.inf, -np.inf
        for k in range(_CROSS_LINES):
            x, y = side - position[0], -near * (far / near) ** (k / (_CROSS_LINES - 1))
            cx = x * rotation[0, 0] + y * rotation[1, 0] - position[2] * rotation[2, 0]
            cy = x * rotation[0, 1] + y * rotation[1, 1] - position[2] * rotation[2, 1]
            cz = x * rotation[0, 2] + y * rotation[1, 2] - position[2] * rotation[2, 2]
            if cz <= _NEAREST_M:
                continue
            down = kappa[2, 0] * cx + kappa[2, 1] * cy + kappa[2, 2] * cz
            u = (kappa[0, 0] * cx + kappa[0, 1] * cy + kappa[0, 2] * cz) / down
            v = (kappa[1, 0] * cx + kappa[1, 1] * cy + kappa[1, 2] * cz) / down
            if _BORDER_PX <= u <= size[0] - 1 - _BORDER_PX and _BORDER_PX <= v <= size[1] - 1 - _BORDER_PX:
                low, high = min(low, v), max(high, v)
        if low > high:
            return False
        rows[0], rows[1] = max(rows[0], low), min(rows[1], high)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def horizon_direction(e: FloatArray, out: FloatArray) -> None:
    """Fill the direction (2,) of the horizon in the picture, to the right."""
    length = math.hypot(e[0, 2], e[1, 2])
    sign = 1.0 if e[1, 2] <= 0.0 else -1.0
    out[0], out[1] = -sign * e[1, 2] / length, sign * e[0, 2] / length


@njit(cache=True, nogil=True, error_model="numpy")
def widths_between(
    crossings: FloatArray, other: FloatArray, rows: FloatArray, least: float, across: FloatArray, out: FloatArray
) -> None:
    """Fill how far lines appear from others, (2, 2): along ``across`` (2,), or the normals where it is zeros."""
    for line in range(2):
        slope = (crossings[2 * line + 1] - crossings[2 * line]) / (rows[1] - rows[0])
        stretch = abs(across[0] - slope * across[1])
        if across[0] == 0.0 and across[1] == 0.0:
            stretch = math.hypot(1.0, slope)
        for end in range(2):
            k = 2 * line + end
            out[line, end] = max(abs(other[k] - crossings[k]) / stretch, least)


class BandLimits(NamedTuple):
    """Width of a band on the ground, m, and the least and the most in the picture, px."""

    width_m: float
    least_px: float
    most_px: float


@njit(cache=True, nogil=True, error_model="numpy")
def band_widths_of(
    mean: FloatArray,
    e: FloatArray,
    rows: FloatArray,
    crossings: FloatArray,
    band: BandLimits,
    across: FloatArray,
    out: FloatArray,
) -> None:
    """Fill the widths ℓ (2, 2) of bands about lines (a, b, c, d, …), px; limited by ``band``."""
    apart = mean[C] - mean[D]
    wide = min(band.width_m, 0.45 * abs(apart))
    moved = mean[:4].copy()
    sign = 1.0 if mean[C] >= mean[D] else -1.0
    moved[C] += sign * wide
    moved[D] -= sign * wide
    outer, unused = np.empty(4), np.empty((4, 4))
    project(moved, e, rows, outer, unused)
    widths_between(crossings, outer, rows, band.least_px, across, out)
    for line in range(2):
        for end in range(2):
            out[line, end] = min(out[line, end], band.most_px)


@njit(cache=True, nogil=True, error_model="numpy")
def correlated_part(by_pose: FloatArray, rotation: FloatArray, out: FloatArray) -> None:
    """Fill ``out`` (4, 3) with how crossings move with (ROLL, PITCH, UP), from (4, 6)."""
    for k in range(4):
        up = 0.0
        for i in range(3):
            up += by_pose[k, 3 + i] * rotation[2, i]
        out[k, 0], out[k, 1], out[k, 2] = by_pose[k, 2], by_pose[k, 0], up


class GeometryArrays(NamedTuple):
    """What `fill_frame_geometry` fills, named and shaped as in `frame_geometry.FrameGeometry`."""

    predicted: FloatArray
    h: FloatArray
    by_pose: FloatArray
    widths: FloatArray
    across: FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def fill_frame_geometry(
    rotation: FloatArray,
    position: FloatArray,
    kappa: FloatArray,
    mean: FloatArray,
    rows: FloatArray,
    band: BandLimits,
    bands_across: bool,
    out: GeometryArrays,
) -> FloatArray:
    """Fill the arrays of `FrameGeometry` for lines (4,) or (7,) between rows (2,); returns the line map E (3, 3)."""
    e = line_map_of(rotation, position, kappa)
    project(mean, e, rows, out.predicted, out.h)
    move_with_pose(out.predicted, rows, rotation, position, kappa, out.by_pose)
    if mean.size > 4:
        correlated_part(out.by_pose, rotation, out.h[:, 4:])
    horizon_direction(e, out.across)
    band_widths_of(mean, e, rows, out.predicted, band, out.across if bands_across else np.zeros(2), out.widths)
    return e


@njit(cache=True, nogil=True, error_model="numpy")
def noise_of_pose(by_pose: FloatArray, turn: float, shift: tuple[float, float, float]) -> FloatArray:
    """Return the covariance (4, 4) px² of crossings that move by (4, 6) with a pose of these sigmas, rad and m."""
    x, y, z = shift
    variances = (turn**2, turn**2, turn**2, x**2, y**2, z**2)
    out = np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            for m in range(6):
                out[i, j] += by_pose[i, m] * variances[m] * by_pose[j, m]
    return out
