"""The spatial background of a window: a large median that keeps edges, at a small part of its price.

The median is taken over means of square blocks, five by five of them to the window. Where it varies little it is
interpolated; where it has an edge (the horizon, a tree line) each pixel takes the one of the nearest blocks that
it resembles most, so that both sides of the edge come out flat and only what neither side explains remains.
"""

import math
from typing import NamedTuple, cast

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.detection.bilinear import places_between, widen

Float32Array = NDArray[np.float32]
Plane = NDArray[np.uint8] | NDArray[np.float32]
Planes = tuple[Plane, Plane, Plane]
Row = NDArray[np.generic]
IntRow = NDArray[np.int32]
Float32Row = NDArray[np.float32]

_BLOCKS = 5  # across the median's window
_ALIKE = 12  # squared grey levels over three channels: not worth looking at the neighbours
_FLAT = 6  # grey levels between neighbouring blocks that interpolation bridges


class _BlockRoom(NamedTuple):
    """Buffers for the n pixels of a block: colours (3, n), least squared differences (n,), nearest colours (n,)."""

    pixels: Float32Array
    least: Float32Row
    best: IntRow


@njit(cache=True, nogil=True, fastmath=True)
def _block_means(colour: Planes, step: int) -> ImageArray:
    """Return the (⌈h/step⌉, ⌈w/step⌉, 3) means of square blocks of three planes; the last ones repeat their edge."""
    h, w = colour[0].shape
    rows, columns = (h + step - 1) // step, (w + step - 1) // step
    means = np.empty((rows, columns, 3), np.uint8)
    gain = np.float32(1.0 / (step * step))
    sums = np.empty(columns * step, np.int32)
    for c in range(3):
        plane = colour[c]
        for a in range(rows):
            sums[:] = 0
            for k in range(step):
                line = plane[min(a * step + k, h - 1)]
                for j in range(w):
                    sums[j] += np.int32(line[j])
            sums[w:] = sums[w - 1]
            for b in range(columns):
                total = np.int32(0)
                for k in range(step):
                    total += sums[b * step + k]
                means[a, b, c] = np.uint8(np.rint(np.float32(total) * gain))
    return means


@njit(cache=True, nogil=True)
def _edges(median: ImageArray, edges: NDArray[np.bool_]) -> bool:
    """Write which blocks have an edge in their neighbourhood; return whether any has."""
    rows, columns = edges.shape
    low, high = np.empty((rows, 3 * columns), np.uint8), np.empty((rows, 3 * columns), np.uint8)
    flat = median.reshape(rows, 3 * columns)
    for a in range(rows):
        above, row, below = flat[max(a - 1, 0)], flat[a], flat[min(a + 1, rows - 1)]
        for k in range(3 * columns):
            low[a, k] = min(above[k], row[k], below[k])
            high[a, k] = max(above[k], row[k], below[k])
    found = False
    for a in range(rows):
        for b in range(columns):
            left, right = 3 * max(b - 1, 0), 3 * min(b + 1, columns - 1)
            steepest = np.int32(0)
            for c in range(3):
                least = min(low[a, left + c], low[a, 3 * b + c], low[a, right + c])
                most = max(high[a, left + c], high[a, 3 * b + c], high[a, right + c])
                steepest = max(steepest, np.int32(most) - np.int32(least))
            edges[a, b] = steepest > _FLAT
            if steepest > _FLAT:
                found = True
    return found


@njit(cache=True, nogil=True, fastmath=True)
def _less_median(colour: Planes, median: ImageArray, step: int, out: Float32Array) -> None:
    """Write the opponents of a colour less the block medians (rows, columns, 3), taken between the blocks' middles."""
    h, w = out.shape[1], out.shape[2]
    rows, columns = median.shape[:2]
    half, one = np.float32(0.5), np.float32(1)
    # each row of blocks as wide as the image
    across = places_between(w, columns, 1.0 / step)
    wide, cells = np.empty((3, rows, w), np.float32), np.empty(columns, np.float32)
    for c in range(3):
        for a in range(rows):
            for b in range(columns):
                cells[b] = median[a, b, c]
            widen(cells, across, wide[c, a])
    above, below, share = places_between(h, rows, 1.0 / step)
    for i in range(h):
        upper, lower, down = above[i], below[i], share[i]
        up = one - down
        blue, green, red = colour[0][i], colour[1][i], colour[2][i]
        b0, g0, r0 = wide[0, upper], wide[1, upper], wide[2, upper]
        b1, g1, r1 = wide[0, lower], wide[1, lower], wide[2, lower]
        grey, blue_red, magenta = out[0, i], out[1, i], out[2, i]
        for j in range(w):
            b = np.float32(blue[j]) - (up * b0[j] + down * b1[j])
            g = np.float32(green[j]) - (up * g0[j] + down * g1[j])
            r = np.float32(red[j]) - (up * r0[j] + down * r1[j])
            grey[j] = np.float32(0.114) * b + np.float32(0.587) * g + np.float32(0.299) * r
            blue_red[j] = half * (b - r)
            magenta[j] = half * g - half * half * (b + r)


@njit(cache=True, nogil=True)
def _keep_edges(colour: Planes, median: ImageArray, edges: NDArray[np.bool_], step: int, out: Float32Array) -> None:
    """Where a block has an edge in its neighbourhood, assign to each pixel the block that it resembles most.

    Each row of blocks is processed twice: block by block for the colours that its pixels resemble, which are the
    block's own choice, then pixel row by pixel row for the remainder, which is one run over many blocks.
    """
    h, w = colour[0].shape
    size = step * step
    room = _BlockRoom(np.empty((3, size), np.float32), np.empty(size, np.float32), np.empty(size, np.int32))
    near, resembled = np.empty((9, 3), np.float32), np.empty((step, w), np.int32)
    for row in range(edges.shape[0]):
        top, bottom = row * step, min((row + 1) * step, h)
        for column in range(edges.shape[1]):
            if edges[row, column]:
                count = _neighbours(median, row, column, near)
                left, right = column * step, min((column + 1) * step, w)
                _resemble_block(colour, (left, top, right, bottom), near[:count], room, resembled)
        first = 0
        while first < edges.shape[1]:
            last = first
            while last < edges.shape[1] and edges[row, last]:
                last += 1
            if last > first:
                _less_run(colour, resembled, top, bottom, slice(first * step, min(last * step, w)), out)
            first = last + 1


@njit(cache=True, nogil=True)
def _resemble_block(
    colour: Planes,
    block: tuple[int, int, int, int],
    near: Float32Array,
    room: _BlockRoom,
    resembled: NDArray[np.int32],
) -> None:
    """Write for each pixel of a block x0, y0, x1, y1 the colour of those ``near`` that it resembles most.

    They go into the block's columns of ``resembled`` (rows of the block, w).
    """
    left, top, right, bottom = block
    wide = right - left
    n = (bottom - top) * wide
    pixels, least, best = room.pixels, room.least[:n], room.best[:n]
    for c in range(3):
        for i in range(top, bottom):
            line, own = colour[c][i, left:right], pixels[c, (i - top) * wide : (i - top + 1) * wide]
            for j in range(wide):
                own[j] = line[j]
    _resemble(pixels[0, :n], pixels[1, :n], pixels[2, :n], near, least, best)
    for i in range(bottom - top):
        resembled[i, left:right] = best[i * wide : (i + 1) * wide]


@njit(cache=True, nogil=True)
def _less_run(
    colour: Planes, resembled: NDArray[np.int32], top: int, bottom: int, part: slice, out: Float32Array
) -> None:
    """Write the opponents of some columns of the rows from top to bottom, less the colours that they resemble."""
    for i in range(top, bottom):
        blue, green, red = colour[0][i, part], colour[1][i, part], colour[2][i, part]
        _less_resembled(blue, green, red, resembled[i - top, part], out[0, i, part], out[1, i, part], out[2, i, part])


@njit(cache=True, nogil=True)
def _neighbours(median: ImageArray, a: int, b: int, near: Float32Array) -> int:
    """Fill in the colours of a block and of those around it, its own first and none twice; return their count."""
    count = 0
    for k in range(9):
        p, q = a + (k + 4) % 9 // 3 - 1, b + (k + 4) % 9 % 3 - 1
        if 0 <= p < median.shape[0] and 0 <= q < median.shape[1]:
            blue, green, red = np.float32(median[p, q, 0]), np.float32(median[p, q, 1]), np.float32(median[p, q, 2])
            known = False
            for m in range(count):
                known |= near[m, 0] == blue and near[m, 1] == green and near[m, 2] == red
            if not known:
                near[count, 0], near[count, 1], near[count, 2] = blue, green, red
                count += 1
    return count


@njit(cache=True, nogil=True, fastmath=True)
def _resemble(
    blue: Float32Row, green: Float32Row, red: Float32Row, near: Float32Array, least: Float32Row, best: IntRow
) -> None:
    """Write for each of some pixels (n,) the colour of those ``near`` (k, 3) that it resembles most, as one number.

    The first of nearly equal ones is used. ``least`` (n,) is a buffer for the squared differences. All are whole
    numbers, which single precision represents exactly and multiplies faster than integers.
    """
    alike = np.float32(_ALIKE)
    least[:] = np.float32(1e9)
    for k in range(near.shape[0]):
        b0, g0, r0 = near[k, 0], near[k, 1], near[k, 2]
        packed = np.int32(b0 + np.float32(256) * g0 + np.float32(65536) * r0)
        for m in range(blue.size):
            b, g, r = blue[m] - b0, green[m] - g0, red[m] - r0
            misfit = b * b + g * g + r * r
            better = (misfit < least[m]) & (least[m] > alike)
            least[m] = misfit if better else least[m]
            best[m] = packed if better else best[m]


@njit(cache=True, nogil=True)
def _less_resembled(
    blue: Row, green: Row, red: Row, resembled: IntRow, grey: Float32Row, blue_red: Float32Row, magenta: Float32Row
) -> None:
    """Write the opponents (n,) of a row's colours less the colours, each one number, that they resemble."""
    # one plane at a time: of more arrays than these the compiler does not see that none overlaps another
    for j in range(resembled.size):
        b = np.int32(blue[j]) - (resembled[j] & 255)
        g = np.int32(green[j]) - ((resembled[j] >> 8) & 255)
        r = np.int32(red[j]) - (resembled[j] >> 16)
        grey[j] = 0.114 * b + 0.587 * g + 0.299 * r
    for j in range(resembled.size):
        b, r = np.int32(blue[j]) - (resembled[j] & 255), np.int32(red[j]) - (resembled[j] >> 16)
        blue_red[j] = 0.5 * (b - r)
    for j in range(resembled.size):
        b = np.int32(blue[j]) - (resembled[j] & 255)
        g = np.int32(green[j]) - ((resembled[j] >> 8) & 255)
        r = np.int32(red[j]) - (resembled[j] >> 16)
        magenta[j] = 0.5 * g - 0.25 * (b + r)


@njit(cache=True, nogil=True)
def _less_background(colour: Planes, median: ImageArray, step: int, out: Float32Array) -> None:
    """Write the opponents of a colour less its background, interpolated and, where there are edges, resembled."""
    _less_median(colour, median, step, out)
    edges = np.empty(median.shape[:2], np.bool_)
    if _edges(median, edges):
        _keep_edges(colour, median, edges, step, out)


def planes(image: NDArray[np.generic]) -> Planes:
    """Return blue, green and red of an image (h, w, 3), each (h, w) and contiguous."""
    parts = np.empty((3, *image.shape[:2]), image.dtype)
    # OpenCV takes a window of a larger image apart in four times the time that copying it first takes, and arrays of
    # its own cost it more than the taking apart
    blue, green, red = cv2.split(np.ascontiguousarray(image), list(parts))
    return cast(Planes, (blue, green, red))


def flatten(image: ImageArray, window: float) -> Float32Array:
    """Return the image less its background.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR.
    window : width of the median in px; structures much smaller than it stay in the difference.

    Returns
    -------
    (3, h, w) float32: grey, blue minus red and green minus magenta, in grey levels.
    """
    image = np.ascontiguousarray(image)
    step = max(math.floor(window / _BLOCKS + 0.5), 1)
    # plane by plane: pixels of three bytes would keep the compiler from working on many at a time
    colour = planes(image)
    median = np.asarray(cv2.medianBlur(_block_means(colour, step), _BLOCKS), np.uint8)
    out = np.empty((3, *image.shape[:2]), np.float32)
    _less_background(colour, median, step, out)
    return out
