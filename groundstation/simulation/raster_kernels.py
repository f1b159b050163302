"""Compiled drawing of shaded triangles into a small window, several samples to a pixel, nearest first."""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import Float32Array, FloatArray
from groundstation.geometry.kernels import MIN_DEPTH_M, project


class SampleGrid(NamedTuple):
    """Room to draw a window in: ``scale``² samples a pixel, its corner at (x0, y0) px.

    ``near`` and ``owner`` (h · scale, w · scale) are 1/depth and number of the nearest opaque triangle of a sample;
    ``veil_near`` and ``veil_owner`` those of the nearest translucent one, (0, 0) where no triangle is translucent.
    """

    x0: int
    y0: int
    scale: int
    near: Float32Array
    owner: np.ndarray
    veil_near: Float32Array
    veil_owner: np.ndarray


@njit(cache=True, nogil=True)
def project_corners(s: FloatArray, points: FloatArray, pan: float, tilt: float, out: FloatArray) -> bool:
    """Fill (n, 3) with u, v in px and 1/depth of points (n, 3); False where one of them is not in front."""
    pixel = np.empty(2)
    jacobian = np.empty((2, 5))
    for k in range(len(points)):
        depth = project(s, points[k], pan, tilt, pixel, jacobian)
        if depth < MIN_DEPTH_M:
            return False
        out[k, 0], out[k, 1], out[k, 2] = pixel[0], pixel[1], 1.0 / depth
    return True


@njit(cache=True, nogil=True)
def _fill(t: FloatArray, x0: int, y0: int, scale: int, number: int, near: Float32Array, owner: np.ndarray) -> None:
    """Draw one triangle (3, 3) of u, v, 1/depth; sample (i, j) is at x0 − ½ + (j + ½)/scale and likewise down."""
    ax, ay = (t[0, 0] - x0 + 0.5) * scale - 0.5, (t[0, 1] - y0 + 0.5) * scale - 0.5
    bx, by = (t[1, 0] - x0 + 0.5) * scale - 0.5, (t[1, 1] - y0 + 0.5) * scale - 0.5
    cx, cy = (t[2, 0] - x0 + 0.5) * scale - 0.5, (t[2, 1] - y0 + 0.5) * scale - 0.5
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return
    rows, columns = near.shape
    top, bottom = max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), rows - 1)
    # 1/depth is a plane over the picture
    d1, d2 = t[1, 2] - t[0, 2], t[2, 2] - t[0, 2]
    slope_x = (d1 * (cy - ay) - d2 * (by - ay)) / area
    slope_y = (d2 * (bx - ax) - d1 * (cx - ax)) / area
    for row in range(top, bottom + 1):
        low, high = np.inf, -np.inf
        for edge in range(3):
            if edge == 0:
                px, py, qx, qy = ax, ay, bx, by
            elif edge == 1:
                px, py, qx, qy = bx, by, cx, cy
            else:
                px, py, qx, qy = cx, cy, ax, ay
            if py == qy or row < min(py, qy) or row > max(py, qy):
                continue
            x = px + (row - py) * (qx - px) / (qy - py)
            low, high = min(low, x), max(high, x)
        if low > high:
            continue
        left, right = max(int(np.ceil(low)), 0), min(int(np.floor(high)), columns - 1)
        depth = t[0, 2] + (left - ax) * slope_x + (row - ay) * slope_y
        for column in range(left, right + 1):
            if depth > near[row, column]:
                near[row, column] = depth
                owner[row, column] = number
            depth += slope_x


@njit(cache=True, nogil=True)
def draw(corners: FloatArray, colours: FloatArray, opacity: FloatArray, grid: SampleGrid, out: Float32Array) -> None:
    """Draw triangles (n, 3, 3) of u, v, 1/depth; fill the window (h, w, 4): B, G, R times cover, and cover 0 to 1.

    What stood in the grid is forgotten. Of translucent triangles (``opacity`` (n,) below 1) only the nearest counts.
    """
    x0, y0, scale, near, owner = grid.x0, grid.y0, grid.scale, grid.near, grid.owner
    near[:] = 0.0
    owner[:] = -1
    for k in range(len(corners)):
        if opacity[k] >= 1.0:
            _fill(corners[k], x0, y0, scale, k, near, owner)
    share = 1.0 / (scale * scale)
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            b, g, r, cover = 0.0, 0.0, 0.0, 0
            for i in range(row * scale, (row + 1) * scale):
                for j in range(column * scale, (column + 1) * scale):
                    k = owner[i, j]
                    if k >= 0:
                        cover += 1
                        b += colours[k, 0]
                        g += colours[k, 1]
                        r += colours[k, 2]
            out[row, column, 0], out[row, column, 1] = b * share, g * share
            out[row, column, 2], out[row, column, 3] = r * share, cover * share
    if grid.veil_owner.size:
        _draw_veils(corners, colours, opacity, grid, out)


@njit(cache=True, nogil=True)
def _draw_veils(
    corners: FloatArray, colours: FloatArray, opacity: FloatArray, grid: SampleGrid, out: Float32Array
) -> None:
    """Blend the nearest translucent triangle of each sample with its background."""
    scale, near, owner = grid.scale, grid.near, grid.owner
    veil_near, veil_owner = grid.veil_near, grid.veil_owner
    veil_near[:] = 0.0
    veil_owner[:] = -1
    for k in range(len(corners)):
        if opacity[k] < 1.0:
            _fill(corners[k], grid.x0, grid.y0, scale, k, veil_near, veil_owner)
    share = 1.0 / (scale * scale)
    for i in range(veil_owner.shape[0]):
        for j in range(veil_owner.shape[1]):
            veil = veil_owner[i, j]
            if veil < 0 or veil_near[i, j] <= near[i, j]:
                continue
            part = opacity[veil] * share
            behind = owner[i, j]
            pixel = out[i // scale, j // scale]
            for c in range(3):
                hidden = colours[behind, c] if behind >= 0 else 0.0
                pixel[c] += part * (colours[veil, c] - hidden)
            if behind < 0:
                pixel[3] += part
