"""SUSAN corners, as the paper takes them: S. M. Smith and J. M. Brady, IJCV 23 (1997)."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray

# the mask of 37 pixels: how far it reaches to either side in each of its rows
_HALF_ROWS = np.array([1, 2, 3, 3, 3, 2, 1])
_AREA = 37.0
# a corner's like pixels fill at most half the mask; the centre is not counted
_GEOMETRIC = 0.5 * (_AREA - 1.0)
_LEAST_SHIFT_PX = 0.5


@njit(cache=True)
def susan_response(image: FloatArray, threshold: float, response: FloatArray) -> None:
    """Fill the corner response (h, w) of brightness (h, w): g − n where fewer than g pixels of the mask are like it.

    Similarity is exp(−(ΔI / threshold)⁶). The similar pixels' centre must be off the pixel, and all pixels on the
    way there must be similar to it: a speck is not a corner.
    """
    h, w = image.shape
    response[:] = 0.0
    for y in range(3, h - 3):
        for x in range(3, w - 3):
            n, sx, sy = 0.0, 0.0, 0.0
            for dy in range(-3, 4):
                half = _HALF_ROWS[dy + 3]
                for dx in range(-half, half + 1):
                    if dx == 0 and dy == 0:
                        continue
                    like = np.exp(-(((image[y + dy, x + dx] - image[y, x]) / threshold) ** 6))
                    n += like
                    sx += like * dx
                    sy += like * dy
            if n >= _GEOMETRIC or n < 1e-9:
                continue
            sx, sy = sx / n, sy / n
            shift = np.sqrt(sx * sx + sy * sy)
            if shift < _LEAST_SHIFT_PX:
                continue
            whole = True
            for step in range(1, 4):
                py, px = int(np.rint(y + step * sy / shift)), int(np.rint(x + step * sx / shift))
                if abs(image[py, px] - image[y, x]) > threshold:
                    whole = False
            if whole:
                response[y, x] = _GEOMETRIC - n


def susan_corner(image: FloatArray, near: FloatArray, reach_px: int, threshold: float) -> FloatArray | None:
    """Return the pixel (2,) u, v of the strongest corner within ``reach_px`` of a place (2,), or None.

    Parameters
    ----------
    image : (h, w) brightness.
    threshold : difference of brightness that still counts as similar.
    """
    h, w = image.shape
    u, v = (round(float(value)) for value in near)
    border = reach_px + 4
    left, top = max(u - border, 0), max(v - border, 0)
    window = np.ascontiguousarray(image[top : min(v + border + 1, h), left : min(u + border + 1, w)], dtype=np.float64)
    if min(window.shape, default=0) < 7:
        return None
    response = np.empty_like(window)
    susan_response(window, threshold, response)
    rows, columns = np.mgrid[0 : window.shape[0], 0 : window.shape[1]]
    response[(columns + left - near[0]) ** 2 + (rows + top - near[1]) ** 2 > reach_px**2] = 0.0
    if response.max() <= 0.0:
        return None
    row, column = np.unravel_index(int(np.argmax(response)), response.shape)
    return np.array([float(column + left), float(row + top)])
