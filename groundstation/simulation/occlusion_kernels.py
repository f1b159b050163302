"""Compiled occlusion: which pixels of a window a body at some distance is seen at, past the panorama's objects."""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import Float32Array, FloatArray
from groundstation.simulation.render_kernels import TILE, tile_corners

DEPTH_STEP_M = 0.25  # of a panorama's object depth
NO_OBJECT = 65535


class ObjectDepth(NamedTuple):
    """Distance (h, w) of a panorama's objects from the camera: uint16, steps of `DEPTH_STEP_M`, `NO_OBJECT` where none.

    ``place`` is the panorama's.
    """

    depth: np.ndarray
    place: FloatArray


@njit(cache=True, nogil=True)
def _free(depth: np.ndarray, x: float, y: float, limit: int) -> float:
    """Return the bilinear share of the four panorama pixels around a point that hold nothing nearer than ``limit``."""
    ix, iy = int(x), int(y)
    fx, fy = x - ix, y - iy
    top = (1.0 - fx) * (depth[iy, ix] >= limit) + fx * (depth[iy, ix + 1] >= limit)
    low = (1.0 - fx) * (depth[iy + 1, ix] >= limit) + fx * (depth[iy + 1, ix + 1] >= limit)
    return (1.0 - fy) * top + fy * low


@njit(cache=True, nogil=True)
def unhidden(
    nodes: FloatArray,
    moved: FloatArray,
    samples: int,
    fine: ObjectDepth,
    coarse: ObjectDepth,
    distance_m: float,
    corner_px: FloatArray,
    out: Float32Array,
) -> bool:
    """Fill a window (h, w), corner (2,) px, with the share of each pixel without a nearer object.

    ``nodes`` and ``moved`` are `render_kernels.surroundings`'s, and so is the choice between the panoramas. Returns
    whether anything is hidden.
    """
    limit = min(int(distance_m / DEPTH_STEP_M), NO_OBJECT)
    corner, shift = np.empty((4, 2)), np.empty(2)
    hidden = False
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    x0, y0 = int(corner_px[0]), int(corner_px[1])
    first_row, last_row = min(max(y0 // TILE, 0), rows - 1), min(max((y0 + out.shape[0] - 1) // TILE, 0), rows - 1)
    first_column = min(max(x0 // TILE, 0), columns - 1)
    last_column = min(max((x0 + out.shape[1] - 1) // TILE, 0), columns - 1)
    for i in range(first_row, last_row + 1):
        # the outermost tile is extended beyond the picture
        low = 0 if i == first_row else i * TILE - y0
        high = out.shape[0] if i == last_row else (i + 1) * TILE - y0
        for j in range(first_column, last_column + 1):
            left = 0 if j == first_column else j * TILE - x0
            right = out.shape[1] if j == last_column else (j + 1) * TILE - x0
            layer = 0
            for layer in range(2):
                panorama = fine if layer == 0 else coarse
                height, width = panorama.depth.shape
                if tile_corners(nodes, moved, i, j, panorama.place, width, height, corner, shift):
                    break
            panorama = fine if layer == 0 else coarse
            if _all_free(panorama.depth, corner, shift, limit):
                out[low:high, left:right] = 1.0
                continue
            hidden = True
            for y in range(low, high):
                b = min(max((y0 + y - i * TILE) / TILE, 0.0), 1.0)
                for x in range(left, right):
                    a = min(max((x0 + x - j * TILE) / TILE, 0.0), 1.0)
                    u = (1.0 - b) * ((1.0 - a) * corner[0, 0] + a * corner[1, 0])
                    u += b * ((1.0 - a) * corner[2, 0] + a * corner[3, 0])
                    v = (1.0 - b) * ((1.0 - a) * corner[0, 1] + a * corner[1, 1])
                    v += b * ((1.0 - a) * corner[2, 1] + a * corner[3, 1])
                    total = 0.0
                    for n in range(samples):
                        part = (n + 0.5) / samples - 0.5
                        total += _free(panorama.depth, u + part * shift[0], v + part * shift[1], limit)
                    out[y, x] = total / samples
    return hidden


@njit(cache=True, nogil=True)
def _all_free(depth: np.ndarray, corner: FloatArray, shift: FloatArray, limit: int) -> bool:
    """Return whether a tile with these corners (4, 2) in the panorama, over its motion, contains no nearer object."""
    reach_x, reach_y = 0.5 * abs(shift[0]), 0.5 * abs(shift[1])
    x0, x1 = int(corner[:, 0].min() - reach_x), int(corner[:, 0].max() + reach_x) + 1
    y0, y1 = int(corner[:, 1].min() - reach_y), int(corner[:, 1].max() + reach_y) + 1
    for y in range(max(y0, 0), min(y1 + 1, depth.shape[0])):
        for x in range(max(x0, 0), min(x1 + 1, depth.shape[1])):
            if depth[y, x] < limit:
                return False
    return True
