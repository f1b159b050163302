"""Bringing one frame under another by a shift: textured pixels, a coarse raster, robust Gauss-Newton.

Rows of ``textured`` pixels are x, y, grey, ∂x, ∂y in full-image coordinates; a shift (sx, sy) leads from the new
image to the reference, where the box ``hidden`` is left out.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box

ImageRow = NDArray[np.uint8]
Float32Array = NDArray[np.float32]

# columns of textured pixels
_X, _Y, _GREY, _BY_X, _BY_Y = 0, 1, 2, 3, 4
_MIN_TEXTURE = 3.0  # grey levels per px: gradients below it are noise
MIN_TEXTURED = 40
_COARSE_STEP, _COARSE_REACH = 4, 10
_MIN_EDGE_PX, MAX_EDGE_PX = 0.15, 0.25  # misregistration and interpolation, as px of the local gradient
_CLIPPED = 30.0  # grey levels


@njit(cache=True, nogil=True)
def _greys(row: ImageRow, out: FloatArray) -> None:
    """Write the grey levels of a row of pixels, three bytes each."""
    for x in range(out.size):
        out[x] = 0.114 * row[3 * x] + 0.587 * row[3 * x + 1] + 0.299 * row[3 * x + 2]


@njit(cache=True, nogil=True)
def grey_of(image: ImageArray) -> Float32Array:
    """Return the grey levels (h, w) of a contiguous picture (h, w, 3) BGR, not rounded."""
    h, w = image.shape[:2]
    flat, row, grey = image.reshape(h, 3 * w), np.empty(w), np.empty((h, w), np.float32)
    for y in range(h):
        _greys(flat[y], row)
        grey[y] = row
    return grey


def textured(image: ImageArray, window: Box[int], keep_out: Box[int]) -> FloatArray:
    """Return the textured pixels of a window as rows x, y, grey, ∂x, ∂y (full-image coordinates)."""
    rows: FloatArray = _textured(np.ascontiguousarray(image), window, keep_out)
    return rows


@njit(cache=True, nogil=True)
def _textured(image: ImageArray, window: Box[int], keep_out: Box[int]) -> FloatArray:
    x0, y0, x1, y1 = window
    height, width = image.shape[:2]
    rows = np.empty((((y1 - y0 + 1) // 2) * ((x1 - x0 + 1) // 2), 5))
    flat, grey = image.reshape(height, 3 * width), np.empty((3, width))
    first, last = max(x0, 1), min(x1, width - 1)
    top = max(y0, 1)
    n = 0
    for y in range(top, min(y1, height - 1), 2):
        # the row below is the one above of the next turn
        above, row, below = grey[(y - top) % 4 // 2 * 2], grey[1], grey[2 - (y - top) % 4 // 2 * 2]
        if y == top:
            _greys(flat[y - 1], above)
        _greys(flat[y], row)
        _greys(flat[y + 1], below)
        row_of_box = keep_out.y0 <= y < keep_out.y1
        for x in range(first, last, 2):
            gx, gy = 0.5 * (row[x + 1] - row[x - 1]), 0.5 * (below[x] - above[x])
            if gx * gx + gy * gy < _MIN_TEXTURE * _MIN_TEXTURE or (row_of_box and keep_out.x0 <= x < keep_out.x1):
                continue
            rows[n, _X], rows[n, _Y], rows[n, _GREY], rows[n, _BY_X], rows[n, _BY_Y] = x, y, row[x], gx, gy
            n += 1
    return rows[:n]


@njit(cache=True, nogil=True)
def _sample(grey: Float32Array, x: float, y: float) -> float:
    """Return the grey level between pixels, or −1 outside."""
    ix, iy = math.floor(x), math.floor(y)
    if ix < 0 or iy < 0 or ix + 1 >= grey.shape[1] or iy + 1 >= grey.shape[0]:
        return -1.0
    fx, fy = x - ix, y - iy
    top = (1 - fx) * grey[iy, ix] + fx * grey[iy, ix + 1]
    return (1 - fy) * top + fy * ((1 - fx) * grey[iy + 1, ix] + fx * grey[iy + 1, ix + 1])


@njit(cache=True, nogil=True)
def mean_misfit(rows: FloatArray, reference: Float32Array, hidden: Box[int], sx: float, sy: float, every: int) -> float:
    """Return the mean clipped difference of the textured pixels at one shift."""
    total, n = 0.0, 0
    for k in range(0, rows.shape[0], every):
        x, y = rows[k, _X] + sx, rows[k, _Y] + sy
        if hidden.x0 <= x < hidden.x1 and hidden.y0 <= y < hidden.y1:
            continue
        value = _sample(reference, x, y)
        if value >= 0:
            total += min(abs(value - rows[k, _GREY]), 30.0)
            n += 1
    return total / n if 3 * n * every >= rows.shape[0] else 1e9


@njit(cache=True, nogil=True)
def coarse(rows: FloatArray, reference: Float32Array, hidden: Box[int], sx: float, sy: float) -> tuple[float, float]:
    """Return the best shift on a coarse raster around an initial value."""
    every = max(rows.shape[0] // 300, 1)
    best, bx, by = 1e9, sx, sy
    for i in range(-_COARSE_REACH, _COARSE_REACH + 1):
        for j in range(-_COARSE_REACH, _COARSE_REACH + 1):
            tx, ty = sx + j * _COARSE_STEP, sy + i * _COARSE_STEP
            value = mean_misfit(rows, reference, hidden, tx, ty, every)
            if value < best:
                best, bx, by = value, tx, ty
    return bx, by


@njit(cache=True, nogil=True)
def refine(
    rows: FloatArray, reference: Float32Array, hidden: Box[int], sx: float, sy: float
) -> tuple[float, float, float]:
    """Return the sub-pixel shift by robust Gauss-Newton, and its sigma in px (large when undetermined)."""
    sigma = 1e9
    for _ in range(10):
        hxx, hxy, hyy, bx, by, square, n = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
        for k in range(rows.shape[0]):
            x, y = rows[k, _X] + sx, rows[k, _Y] + sy
            if hidden.x0 <= x < hidden.x1 and hidden.y0 <= y < hidden.y1:
                continue
            value = _sample(reference, x, y)
            if value < 0:
                continue
            e, gx, gy = value - rows[k, _GREY], rows[k, _BY_X], rows[k, _BY_Y]
            weight = 1.0 / (1.0 + (e / 8.0) ** 2)
            hxx += weight * gx * gx
            hxy += weight * gx * gy
            hyy += weight * gy * gy
            bx += weight * gx * e
            by += weight * gy * e
            square += weight * e * e
            n += 1
        determinant = hxx * hyy - hxy * hxy
        if n < MIN_TEXTURED or determinant <= 1e-9:
            return sx, sy, 1e9
        dx, dy = (hyy * bx - hxy * by) / determinant, (hxx * by - hxy * bx) / determinant
        length = math.hypot(dx, dy)
        if length > 2.0:
            dx, dy = 2.0 * dx / length, 2.0 * dy / length
        sx -= dx
        sy -= dy
        smallest = 0.5 * (hxx + hyy) - math.sqrt(0.25 * (hxx - hyy) ** 2 + hxy * hxy)
        sigma = math.sqrt(square / n / max(smallest, 1e-9))
        if length < 0.01:
            break
    return sx, sy, sigma


@njit(cache=True, nogil=True)
def misplacement(rows: FloatArray, reference: Float32Array, hidden: Box[int], sx: float, sy: float) -> float:
    """Return the scene's misplacement after the shift, px, from the misfits' growth with the gradient."""
    n, s_g, s_e, s_gg, s_ge = 0, 0.0, 0.0, 0.0, 0.0
    for k in range(rows.shape[0]):
        x, y = rows[k, _X] + sx, rows[k, _Y] + sy
        if hidden.x0 <= x < hidden.x1 and hidden.y0 <= y < hidden.y1:
            continue
        value = _sample(reference, x, y)
        if value < 0:
            continue
        g = rows[k, _BY_X] ** 2 + rows[k, _BY_Y] ** 2
        e = min((value - rows[k, _GREY]) ** 2, _CLIPPED**2)
        n += 1
        s_g += g
        s_e += e
        s_gg += g * g
        s_ge += g * e
    spread = n * s_gg - s_g * s_g
    if spread <= 0.0:
        return MAX_EDGE_PX
    # the gradient across a misplacement is on average 1/√2 of its length
    square = 2.0 * (n * s_ge - s_g * s_e) / spread
    return min(max(math.sqrt(max(square, 0.0)), _MIN_EDGE_PX), MAX_EDGE_PX)


def warm_up() -> None:
    """Compile every kernel, those too that only a lost scene calls."""
    y, x = np.mgrid[0:40, 0:60]
    picture = np.repeat((120 + 60 * ((x // 5 + y // 4) % 2)).astype(np.uint8)[:, :, None], 3, axis=2)
    rows = textured(picture, Box(0, 0, 60, 40), Box(0, 0, 0, 0))
    nothing, grey = Box(0, 0, 0, 0), grey_of(picture)
    coarse(rows, grey, nothing, 0.0, 0.0)
    refine(rows, grey, nothing, 0.0, 0.0)
    mean_misfit(rows, grey, nothing, 0.0, 0.0, 1)
    misplacement(rows, grey, nothing, 0.0, 0.0)
