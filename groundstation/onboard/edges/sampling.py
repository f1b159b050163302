"""Sampling a colour picture between its pixels, with the slope: the input of the energies."""

from numba import njit

from groundstation.arrays import FloatArray, ImageArray

_WHITE = 1.0 / 255.0


@njit(cache=True, nogil=True, inline="always")
def inside(image: ImageArray, u: float, v: float) -> bool:
    """Return whether (u, v) is between four pixels."""
    return u >= 0.0 and v >= 0.0 and u < image.shape[1] - 1 and v < image.shape[0] - 1


@njit(cache=True, nogil=True, inline="always")
def sample(image: ImageArray, u: float, v: float, out: FloatArray) -> None:
    """Fill ``out`` (9,) with the bilinear colour in 0 … 1, its derivative by u, and by v."""
    j, i = int(u), int(v)
    fu, fv = u - j, v - i
    for k in range(3):
        a, b = image[i, j, k] * _WHITE, image[i, j + 1, k] * _WHITE
        c, d = image[i + 1, j, k] * _WHITE, image[i + 1, j + 1, k] * _WHITE
        top, bottom = a + fu * (b - a), c + fu * (d - c)
        out[k] = top + fv * (bottom - top)
        out[3 + k] = (1.0 - fv) * (b - a) + fv * (d - c)
        out[6 + k] = bottom - top


@njit(cache=True, nogil=True, inline="always")
def add_colour(image: ImageArray, u: float, v: float, weight: float, out: FloatArray, row: int) -> None:
    """Add the weighted bilinear colour to a row of ``out`` (n, 3)."""
    j, i = int(u), int(v)
    fu, fv = u - j, v - i
    wa, wb = (1.0 - fu) * (1.0 - fv), fu * (1.0 - fv)
    wc, wd = (1.0 - fu) * fv, fu * fv
    scale = weight * _WHITE
    for k in range(3):
        mixed = wa * image[i, j, k] + wb * image[i, j + 1, k] + wc * image[i + 1, j, k] + wd * image[i + 1, j + 1, k]
        out[row, k] += scale * mixed
