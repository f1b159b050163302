"""Compiled steps of a picture: surroundings through the lens, the aircraft over them, and the sensor's noise.

Light is uint16 in 1/64 of a grey level; which colour a pixel has is given by ``channels`` (2, 2) for even and odd rows
and columns (0, 1, 2 for B, G, R).
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray

TILE = 16
_FRACTION = 16
_ONE = 1 << _FRACTION


@njit(cache=True, nogil=True)
def directions(rays: FloatArray, turns: FloatArray, out: FloatArray) -> None:
    """Fill azimuth and elevation (rows, columns, 2), rad, of rays (rows, columns, 3) turned by (rows, 3, 3)."""
    for i in range(rays.shape[0]):
        m = turns[i]
        for j in range(rays.shape[1]):
            a, b, c = rays[i, j, 0], rays[i, j, 1], rays[i, j, 2]
            x = m[0, 0] * a + m[0, 1] * b + m[0, 2] * c
            y = m[1, 0] * a + m[1, 1] * b + m[1, 2] * c
            z = m[2, 0] * a + m[2, 1] * b + m[2, 2] * c
            out[i, j, 0] = np.arctan2(x, y)
            out[i, j, 1] = np.arctan2(z, np.sqrt(x * x + y * y))


@njit(cache=True, nogil=True)
def _near(azimuth: float, to: float) -> float:
    """Return the same azimuth within half a turn of another."""
    return azimuth - 2.0 * np.pi * np.round((azimuth - to) / (2.0 * np.pi))


@njit(cache=True, nogil=True)
def _tile(
    corner: FloatArray, shift: FloatArray, looks: int, panorama: ImageArray, channels: np.ndarray, light: np.ndarray, y0: int, x0: int
) -> None:
    """Fill one tile from panorama pixels at its four corners (4, 2), averaged over looks along a shift (2,) px."""
    rows, columns = min(TILE, light.shape[0] - y0), min(TILE, light.shape[1] - x0)
    height, width = panorama.shape[0], panorama.shape[1]
    most_x, most_y = (width - 1) * _ONE - 1, (height - 1) * _ONE - 1
    for i in range(rows):
        b = i / TILE
        left_x, left_y = corner[0, 0] + b * (corner[2, 0] - corner[0, 0]), corner[0, 1] + b * (corner[2, 1] - corner[0, 1])
        right_x, right_y = corner[1, 0] + b * (corner[3, 0] - corner[1, 0]), corner[1, 1] + b * (corner[3, 1] - corner[1, 1])
        step_x, step_y = int((right_x - left_x) / TILE * _ONE), int((right_y - left_y) / TILE * _ONE)
        even, odd = channels[(y0 + i) & 1, x0 & 1], channels[(y0 + i) & 1, (x0 + 1) & 1]
        for n in range(looks):
            part = (n + 0.5) / looks - 0.5
            x, y = int((left_x + part * shift[0]) * _ONE), int((left_y + part * shift[1]) * _ONE)
            for j in range(columns):
                cx, cy = min(max(x, 0), most_x), min(max(y, 0), most_y)
                ix, iy = cx >> _FRACTION, cy >> _FRACTION
                fx, fy = (cx >> 8) & 255, (cy >> 8) & 255
                k = odd if j & 1 else even
                top = panorama[iy, ix, k] * (256 - fx) + panorama[iy, ix + 1, k] * fx
                low = panorama[iy + 1, ix, k] * (256 - fx) + panorama[iy + 1, ix + 1, k] * fx
                value = (top * (256 - fy) + low * fy) >> 10
                if looks == 1:
                    light[y0 + i, x0 + j] = value
                else:
                    light[y0 + i, x0 + j] = (0 if n == 0 else light[y0 + i, x0 + j]) + value // looks
                x += step_x
                y += step_y


@njit(cache=True, nogil=True)
def surroundings(
    nodes: FloatArray,
    moved: FloatArray,
    looks: int,
    fine: ImageArray,
    fine_place: FloatArray,
    coarse: ImageArray,
    coarse_place: FloatArray,
    channels: np.ndarray,
    light: np.ndarray,
) -> None:
    """Fill ``light`` (h, w) from two panoramas, tile by tile: the fine one where it covers a tile.

    ``nodes`` (rows, columns, 2) are the directions of every 16th pixel and ``moved`` so much they turn within an
    exposure, rad; a place is azimuth and elevation of pixel (0, 0), and px/rad.
    """
    corner, shift = np.empty((4, 2)), np.empty(2)
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            first = nodes[i, j, 0]
            for layer in range(2):
                place = fine_place if layer == 0 else coarse_place
                height, width = (fine.shape[0], fine.shape[1]) if layer == 0 else (coarse.shape[0], coarse.shape[1])
                inside = True
                for n in range(4):
                    node = nodes[i + (n >> 1), j + (n & 1)]
                    x = (_near(node[0], first) - place[0]) * place[2]
                    y = (place[1] - node[1]) * place[2]
                    corner[n, 0], corner[n, 1] = x, y
                    inside = inside and 0.0 <= x < width - 1 and 0.0 <= y < height - 1
                if inside or layer == 1:
                    break
            shift[0], shift[1] = moved[i, j, 0] * place[2], -moved[i, j, 1] * place[2]
            _tile(corner, shift, looks, fine if inside and layer == 0 else coarse, channels, light, i * TILE, j * TILE)


@njit(cache=True, nogil=True)
def cover(overlay: FloatArray, x0: int, y0: int, channels: np.ndarray, light: np.ndarray) -> None:
    """Lay a window (h, w, 4) of B, G, R times cover, and cover, with its corner at (x0, y0), over the light."""
    for i in range(max(-y0, 0), min(overlay.shape[0], light.shape[0] - y0)):
        for j in range(max(-x0, 0), min(overlay.shape[1], light.shape[1] - x0)):
            share = overlay[i, j, 3]
            if share > 0.0:
                y, x = y0 + i, x0 + j
                k = channels[y & 1, x & 1]
                light[y, x] = int((1.0 - share) * light[y, x] + 64.0 * overlay[i, j, k] + 0.5)


@njit(cache=True, nogil=True, fastmath=True)
def expose(light: np.ndarray, gain: float, sigmas: np.ndarray, normals: np.ndarray, starts: np.ndarray, out: ImageArray) -> None:
    """Fill a picture (h, w): light times gain, noise of ``sigmas`` (256,) by grey level, rounded and clipped.

    Row i takes its normal numbers from place ``starts[i]`` on.
    """
    factor = np.float32(gain / 64.0)
    half, low, most = np.float32(0.5), np.float32(0.0), np.float32(255.0)
    for i in range(light.shape[0]):
        start = starts[i]
        for j in range(light.shape[1]):
            value = min(light[i, j] * factor, most)
            noisy = value + sigmas[int(value)] * normals[start + j] + half
            out[i, j] = np.uint8(min(max(noisy, low), most))
