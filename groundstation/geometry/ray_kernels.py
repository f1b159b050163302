"""Compiled loops over many pixels of one station: their rays, and how far a turn of the head moves a distant point."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.geometry import kernels
from groundstation.geometry.station_layout import CX, CY


@njit(cache=True)
def fill_rays(s: FloatArray, pixels: FloatArray, angles: FloatArray, origins: FloatArray, rays: FloatArray) -> None:
    """Fill origins and directions (n, 3) of the rays of pixels (n, 2) at angles (n, 2).

    A ray that has no finite pixel and angles stays as it is; a direction that the lens model does not give is not a
    number.
    """
    for k in range(len(pixels)):
        u, v, pan, tilt = pixels[k, 0], pixels[k, 1], angles[k, 0], angles[k, 1]
        if not np.isfinite(u + v + pan + tilt):
            continue
        if not kernels.ray(s, u, v, pan, tilt, origins[k], rays[k]):
            rays[k] = np.nan


@njit(cache=True)
def fill_centre_shifts(s: FloatArray, first: FloatArray, second: FloatArray, far_m: float, shifts: FloatArray) -> None:
    """Fill the shifts (n, 2) px of a point ``far_m`` away in the principal point, as the head turns.

    ``first`` and ``second`` (n, 2) are pan and tilt. Not a number without both of them, infinite behind the camera.
    """
    origin, direction, pixel, jacobian = np.empty(3), np.empty(3), np.empty(2), np.empty((2, 5))
    for k in range(len(first)):
        if not np.isfinite(first[k, 0] + first[k, 1] + second[k, 0] + second[k, 1]):
            shifts[k] = np.nan
            continue
        kernels.ray(s, s[CX], s[CY], first[k, 0], first[k, 1], origin, direction)
        point = origin + far_m * direction
        depth = kernels.project(s, point, second[k, 0], second[k, 1], pixel, jacobian)
        if depth < kernels.MIN_DEPTH_M:
            shifts[k] = np.inf
        else:
            shifts[k, 0], shifts[k, 1] = pixel[0] - s[CX], pixel[1] - s[CY]


def warm_up(packed: FloatArray) -> None:
    """Compile the kernels, for a station's packed model."""
    ones = np.zeros((1, 2))
    fill_rays(packed, ones, ones, np.empty((1, 3)), np.empty((1, 3)))
    fill_centre_shifts(packed, ones, ones, 1.0, np.empty((1, 2)))
