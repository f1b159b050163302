"""Rendering steps that need no camera: a grid of rays, kernels of blur, windows that overlap, the crop of a mask."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import Float32Array, FloatArray, MaskArray
from groundstation.geometry import kernels
from groundstation.simulation import render_kernels


def ray_grid(packed: FloatArray, size_px: tuple[int, int]) -> FloatArray:
    """Return the rays (rows, columns, 3), camera frame, of every 16th pixel, to beyond the last."""
    columns, rows = (math.ceil(n / render_kernels.TILE) + 1 for n in size_px)
    rays = np.ones((rows, columns, 3))
    point = np.empty(2)
    for i in range(rows):
        for j in range(columns):
            x = (render_kernels.TILE * j - packed[26]) / packed[24]
            y = (render_kernels.TILE * i - packed[27]) / packed[25]
            # where the lens has no inverse there is no picture either; the pinhole's ray will do
            good = kernels.undistort(packed[28:34], x, y, point)
            rays[i, j, :2] = point if good else (x, y)
    return rays


def motion_blur_kernel(motion: FloatArray) -> NDArray[np.float32]:
    """Return the kernel of a straight motion (2,) px: its length sampled finely, each sample shared by four pixels."""
    reach = int(0.5 * np.abs(motion).max()) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    count = 4 * reach + 5
    for part in (np.arange(count) + 0.5) / count - 0.5:
        x, y = reach + part * motion[0], reach + part * motion[1]
        ix, iy = min(int(x), 2 * reach - 1), min(int(y), 2 * reach - 1)
        fx, fy = x - ix, y - iy
        kernel[iy, ix] += (1 - fx) * (1 - fy)
        kernel[iy, ix + 1] += fx * (1 - fy)
        kernel[iy + 1, ix] += (1 - fx) * fy
        kernel[iy + 1, ix + 1] += fx * fy
    return kernel / kernel.sum()


def crop_mask(mask: MaskArray, corner: tuple[int, int], size_px: tuple[int, int]) -> tuple[MaskArray, tuple[int, int]]:
    """Return a mask cropped to the picture and to its set pixels, with its corner."""
    x0, y0 = max(corner[0], 0), max(corner[1], 0)
    cut = mask[y0 - corner[1] : size_px[1] - corner[1], x0 - corner[0] : size_px[0] - corner[0]]
    rows, columns = np.flatnonzero(cut.any(axis=1)), np.flatnonzero(cut.any(axis=0))
    if rows.size == 0:
        return np.zeros((0, 0), dtype=bool), (0, 0)
    part = cut[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return part.copy(), (x0 + int(columns[0]), y0 + int(rows[0]))


_Slices = tuple[slice, slice]


def overlap(
    first: NDArray[np.generic],
    first_corner: tuple[int, int],
    second: NDArray[np.generic],
    second_corner: tuple[int, int],
) -> tuple[_Slices, _Slices] | None:
    """Return the common part of two windows (h, w, …) with their corners x, y, in each one's rows and columns."""
    spans = []
    for axis, (a, b) in enumerate(zip(reversed(first_corner), reversed(second_corner), strict=True)):
        low, high = max(a, b), min(a + first.shape[axis], b + second.shape[axis])
        if low >= high:
            return None
        spans.append((slice(low - a, high - a), slice(low - b, high - b)))
    rows, columns = spans
    return (rows[0], columns[0]), (rows[1], columns[1])


def merged(windows: list[tuple[Float32Array, tuple[int, int]]], count: int) -> tuple[Float32Array, tuple[int, int]]:
    """Return the mean of ``count`` windows (h, w, 4) with their corners, those not given being empty."""
    if len(windows) == count == 1:
        return windows[0]
    x0, y0 = min(c[0] for _, c in windows), min(c[1] for _, c in windows)
    x1, y1 = max(c[0] + w.shape[1] for w, c in windows), max(c[1] + w.shape[0] for w, c in windows)
    total = np.zeros((y1 - y0, x1 - x0, 4), np.float32)
    for window, corner in windows:
        rows, columns = window.shape[:2]
        total[corner[1] - y0 : corner[1] - y0 + rows, corner[0] - x0 : corner[0] - x0 + columns] += window
    total *= np.float32(1.0 / count)
    return total, (x0, y0)


def smooth_mosaic(light: NDArray[np.uint16], sigma_px: float, *, coloured: bool) -> None:
    """Blur light (h, w) in place by a Gaussian of so many px; of a colour mosaic each of the four planes separately."""
    step = 2 if coloured else 1
    sigma = sigma_px / step
    size = 2 * math.ceil(3.0 * sigma) + 1
    for row in range(step):
        for column in range(step):
            plane = np.ascontiguousarray(light[row::step, column::step])
            light[row::step, column::step] = cv2.GaussianBlur(
                plane, (size, size), sigma, borderType=cv2.BORDER_REPLICATE
            )
