"""Compiled steps of a picture: surroundings through the lens, the aircraft over them, and the sensor's noise.

Light is uint16 in 1/64 of a grey level; which colour a pixel has is given by ``channels`` (2, 2) for even and odd rows
and columns (0, 1, 2 for B, G, R).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import Float32Array, FloatArray, ImageArray, MaskArray

TILE = 16
_FRACTION = 16
_ONE = 1 << _FRACTION


class Panorama(NamedTuple):
    """An equirectangular picture (h, w, 3) BGR; ``place`` (3,): azimuth and elevation of pixel (0, 0), and px/rad.

    ``flat`` (h // 16, w // 16) is true for blocks that change evenly between their corners, as a clear sky does.
    ``depth`` (h, w) uint16 is the distance of an object that hides bodies behind it, in 0.25 m along the ray; 65535
    where there is none.
    """

    image: ImageArray
    place: FloatArray
    flat: MaskArray
    depth: np.ndarray


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
def near_azimuth(azimuth: float, to: float) -> float:
    """Return the same azimuth within half a turn of another."""
    return azimuth - 2.0 * np.pi * np.round((azimuth - to) / (2.0 * np.pi))


@njit(cache=True, nogil=True)
def _row(
    flat: np.ndarray, width: int, x: int, y: int, step_x: int, step_y: int, even: int, odd: int, out: np.ndarray
) -> None:
    """Fill a row of one tile (n,) by bilinear interpolation from (x, y) on, all inside, with 16 bits of fraction.

    ``flat`` is a panorama of this width as one row of numbers.
    """
    line = 3 * width
    # unsigned indices, so that the compiler omits the handling of negative ones
    right, under, beyond = np.uint64(3), np.uint64(line), np.uint64(line + 3)
    for j in range(len(out)):
        u, v = np.int32(x + j * step_x), np.int32(y + j * step_y)
        fx, fy = np.int32((u >> 8) & 255), np.int32((v >> 8) & 255)
        place = np.uint64((v >> 16) * line + (u >> 16) * 3 + (odd if j & 1 else even))
        a, b = np.int32(flat[place]), np.int32(flat[place + right])
        c, d = np.int32(flat[place + under]), np.int32(flat[place + beyond])
        top, low = (a << 8) + (b - a) * fx, (c << 8) + (d - c) * fx
        out[j] = np.uint16(((top << 8) + (low - top) * fy) >> 10)


@njit(cache=True, nogil=True)
def _tile(
    corner: FloatArray,
    shift: FloatArray,
    samples: int,
    panorama: ImageArray,
    channels: np.ndarray,
    light: np.ndarray,
    y0: int,
    x0: int,
) -> None:
    """Fill one tile from panorama pixels at its four corners (4, 2), averaged over samples along a shift (2,) px."""
    rows, columns = min(TILE, light.shape[0] - y0), min(TILE, light.shape[1] - x0)
    width = panorama.shape[1]
    flat = panorama.reshape(-1)
    room = np.empty(TILE, np.uint16)
    for i in range(rows):
        b = i / TILE
        left_x, left_y = (
            corner[0, 0] + b * (corner[2, 0] - corner[0, 0]),
            corner[0, 1] + b * (corner[2, 1] - corner[0, 1]),
        )
        right_x, right_y = (
            corner[1, 0] + b * (corner[3, 0] - corner[1, 0]),
            corner[1, 1] + b * (corner[3, 1] - corner[1, 1]),
        )
        step_x, step_y = int((right_x - left_x) / TILE * _ONE), int((right_y - left_y) / TILE * _ONE)
        even, odd = channels[(y0 + i) & 1, x0 & 1], channels[(y0 + i) & 1, (x0 + 1) & 1]
        line = light[y0 + i, x0 : x0 + columns]
        if samples == 1:
            _row(flat, width, int(left_x * _ONE), int(left_y * _ONE), step_x, step_y, even, odd, line)
            continue
        line[:] = 0
        for n in range(samples):
            part = (n + 0.5) / samples - 0.5
            x, y = int((left_x + part * shift[0]) * _ONE), int((left_y + part * shift[1]) * _ONE)
            _row(flat, width, x, y, step_x, step_y, even, odd, room[:columns])
            for j in range(columns):
                line[j] += room[j] // samples


@njit(cache=True, nogil=True)
def flat_blocks(panorama: ImageArray, most: float, out: MaskArray) -> None:
    """Mark the blocks of 16 × 16 panorama pixels that are bilinear in their corners within so many grey levels."""
    height, width = panorama.shape[0], panorama.shape[1]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            y0, x0 = i * TILE, j * TILE
            y1, x1 = min(y0 + TILE, height - 1), min(x0 + TILE, width - 1)
            flat = True
            for y in range(y0, y1 + 1):
                b = (y - y0) / max(y1 - y0, 1)
                for k in range(3):
                    left = (1.0 - b) * panorama[y0, x0, k] + b * panorama[y1, x0, k]
                    right = (1.0 - b) * panorama[y0, x1, k] + b * panorama[y1, x1, k]
                    for x in range(x0, x1 + 1):
                        a = (x - x0) / max(x1 - x0, 1)
                        if abs((1.0 - a) * left + a * right - panorama[y, x, k]) > most:
                            flat = False
                if not flat:
                    break
            out[i, j] = flat


@njit(cache=True, nogil=True)
def _is_flat(corner: FloatArray, flat: MaskArray) -> bool:
    """Return whether all blocks under a tile's corners (4, 2) are flat."""
    low_x, high_x = min(corner[0, 0], corner[2, 0]), max(corner[1, 0], corner[3, 0])
    low_y, high_y = min(corner[0, 1], corner[1, 1]), max(corner[2, 1], corner[3, 1])
    if high_x < low_x or high_y < low_y:
        return False
    for i in range(int(low_y) // TILE, min(int(high_y) // TILE + 1, flat.shape[0])):
        for j in range(int(low_x) // TILE, min(int(high_x) // TILE + 1, flat.shape[1])):
            if not flat[i, j]:
                return False
    return True


@njit(cache=True, nogil=True)
def _flat_tile(
    corner: FloatArray, panorama: ImageArray, channels: np.ndarray, light: np.ndarray, y0: int, x0: int
) -> None:
    """Fill one tile by the light at its four corners, between which it changes evenly."""
    rows, columns = min(TILE, light.shape[0] - y0), min(TILE, light.shape[1] - x0)
    at = np.empty((4, 3), np.float32)
    for n in range(4):
        ix, iy = int(corner[n, 0]), int(corner[n, 1])
        fx, fy = corner[n, 0] - ix, corner[n, 1] - iy
        for k in range(3):
            top = (1.0 - fx) * panorama[iy, ix, k] + fx * panorama[iy, ix + 1, k]
            low = (1.0 - fx) * panorama[iy + 1, ix, k] + fx * panorama[iy + 1, ix + 1, k]
            at[n, k] = 64.0 * ((1.0 - fy) * top + fy * low) + 0.5
    part = np.float32(1.0 / TILE)
    for i in range(rows):
        b = np.float32(i) * part
        even, odd = channels[(y0 + i) & 1, x0 & 1], channels[(y0 + i) & 1, (x0 + 1) & 1]
        for k, first in ((even, 0), (odd, 1)):
            left, right = at[0, k] + b * (at[2, k] - at[0, k]), at[1, k] + b * (at[3, k] - at[1, k])
            step = (right - left) * part
            for j in range(first, columns, 2):
                light[y0 + i, x0 + j] = np.uint16(left + np.float32(j) * step)


@njit(cache=True, nogil=True)
def kept_inside(corner: FloatArray, shift: FloatArray, width: int, height: int) -> bool:
    """Push corners (4, 2) a pixel and half the shift inside a panorama; return whether they were there."""
    inside = True
    for axis, size in ((0, width), (1, height)):
        margin = 1.0 + 0.5 * abs(shift[axis])
        for n in range(4):
            within = min(max(corner[n, axis], margin), max(size - 2.0 - margin, margin))
            inside = inside and within == corner[n, axis]
            corner[n, axis] = within
    return inside


@njit(cache=True, nogil=True)
def tile_corners(
    nodes: FloatArray,
    moved: FloatArray,
    i: int,
    j: int,
    place: FloatArray,
    width: int,
    height: int,
    corner: FloatArray,
    shift: FloatArray,
) -> bool:
    """Fill a tile's corners (4, 2) and its motion (2,), px of a panorama; return whether they are inside."""
    # a panorama may lie across the azimuth at which angles jump by a full turn
    first = near_azimuth(nodes[i, j, 0], place[0] + 0.5 * width / place[2])
    for n in range(4):
        node = nodes[i + (n >> 1), j + (n & 1)]
        corner[n, 0] = (near_azimuth(node[0], first) - place[0]) * place[2]
        corner[n, 1] = (place[1] - node[1]) * place[2]
    shift[0], shift[1] = moved[i, j, 0] * place[2], -moved[i, j, 1] * place[2]
    return kept_inside(corner, shift, width, height)


@njit(cache=True, nogil=True)
def surroundings(
    nodes: FloatArray,
    moved: FloatArray,
    samples: int,
    fine: Panorama,
    coarse: Panorama,
    channels: np.ndarray,
    light: np.ndarray,
) -> None:
    """Fill ``light`` (h, w) from two panoramas, tile by tile: the fine one where it covers a tile.

    ``nodes`` (rows, columns, 2) are the directions of every 16th pixel and ``moved`` so much they turn within an
    exposure, rad.
    """
    corner, shift = np.empty((4, 2)), np.empty(2)
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            inside = False
            for layer in range(2):
                panorama = fine if layer == 0 else coarse
                height, width = panorama.image.shape[:2]
                inside = tile_corners(nodes, moved, i, j, panorama.place, width, height, corner, shift)
                if inside:
                    break
            panorama = fine if layer == 0 else coarse
            if _is_flat(corner, panorama.flat):
                _flat_tile(corner, panorama.image, channels, light, i * TILE, j * TILE)
            else:
                _tile(corner, shift, samples, panorama.image, channels, light, i * TILE, j * TILE)


@njit(cache=True, nogil=True)
def cover(overlay: Float32Array, x0: int, y0: int, channels: np.ndarray, light: np.ndarray) -> None:
    """Lay a window (h, w, 4) of B, G, R times cover, and cover, with its corner at (x0, y0), over the light."""
    for i in range(max(-y0, 0), min(overlay.shape[0], light.shape[0] - y0)):
        for j in range(max(-x0, 0), min(overlay.shape[1], light.shape[1] - x0)):
            share = overlay[i, j, 3]
            y, x = y0 + i, x0 + j
            k = channels[y & 1, x & 1]
            # a lamp has light, but no cover
            if share > 0.0 or overlay[i, j, k] > 0.0:
                light[y, x] = min(int((1.0 - share) * light[y, x] + 64.0 * overlay[i, j, k] + 0.5), 65535)


@njit(cache=True, nogil=True, fastmath=True)
def expose(
    light: np.ndarray, gain: float, slope: float, floor: float, normals: np.ndarray, starts: np.ndarray, out: ImageArray
) -> None:
    """Fill a picture (h, w): light times gain, with noise of variance slope · level + floor, rounded and clipped.

    Row i takes its normal numbers from place ``starts[i]`` on.
    """
    factor, a, b = np.float32(gain / 64.0), np.float32(slope), np.float32(floor)
    half, low, most = np.float32(0.5), np.float32(0.0), np.float32(255.0)
    for i in range(light.shape[0]):
        start = starts[i]
        for j in range(light.shape[1]):
            value = np.float32(light[i, j]) * factor
            noisy = value + np.sqrt(a * min(value, most) + b) * normals[start + j] + half
            out[i, j] = np.uint8(np.int32(min(max(noisy, low), most)))


@njit(cache=True, nogil=True, fastmath=True)
def expose_unevenly(
    light: np.ndarray,
    kept: Float32Array,
    row_gain: Float32Array,
    slope: float,
    floor: float,
    normals: np.ndarray,
    starts: np.ndarray,
    out: ImageArray,
) -> None:
    """As `expose`, with a share (h, w) of light that each pixel keeps and a gain (h,) of each row."""
    a, b = np.float32(slope), np.float32(floor)
    half, low, most = np.float32(0.5), np.float32(0.0), np.float32(255.0)
    for i in range(light.shape[0]):
        start, factor = starts[i], row_gain[i] / np.float32(64.0)
        for j in range(light.shape[1]):
            value = np.float32(light[i, j]) * kept[i, j] * factor
            noisy = value + np.sqrt(a * min(value, most) + b) * normals[start + j] + half
            out[i, j] = np.uint8(np.int32(min(max(noisy, low), most)))
