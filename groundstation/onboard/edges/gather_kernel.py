"""Compiled walk over the pixels about both edges: their colours in straightened profiles."""

import math

from numba import njit

from groundstation.arrays import FloatArray, ImageArray


@njit(cache=True, nogil=True)
def gather(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    steps: FloatArray,
    total: FloatArray,
    weight: FloatArray,
    square: FloatArray,
) -> None:
    """Add the pixels about both lines to straightened profiles, each row's in its own steps.

    ``steps`` (2,) px of a bin at the upper and the lower row; ``total`` (2, blocks, bins, 3) sums of colours (0 to 1),
    ``weight`` (2, blocks, bins), and ``square`` sums of the grey's squares, as ``weight`` or empty for none; outwards
    to the right, the middle bin on the line.
    """
    blocks, bins = weight.shape[1], weight.shape[2]
    half, height, squared = bins // 2, rows[1] - rows[0], square.size > 0
    for row in range(max(math.ceil(rows[0]), 0), min(math.floor(rows[1]), image.shape[0] - 1) + 1):
        t = (row - rows[0]) / height
        k = min(int(t * blocks), blocks - 1)
        step = steps[0] * (1.0 - t) + steps[1] * t
        for line in range(2):
            outwards = (-1.0 if line == 0 else 1.0) / step
            edge = x[2 * line] * (1.0 - t) + x[2 * line + 1] * t
            # pixels beyond the other line are not this edge's pavement
            other = x[2 - 2 * line] * (1.0 - t) + x[3 - 2 * line] * t
            first = max(math.ceil(max(edge - half * step, other if line == 1 else 0.0)), 0)
            last = min(math.floor(min(edge + half * step, other if line == 0 else math.inf)), image.shape[1] - 1)
            for j in range(first, last + 1):
                place = outwards * (j - edge) + half
                i = int(place)
                if i >= bins - 1:
                    continue
                f = place - i
                for c in range(3):
                    colour = image[row, j, c] / 255.0
                    total[line, k, i, c] += (1.0 - f) * colour
                    total[line, k, i + 1, c] += f * colour
                weight[line, k, i] += 1.0 - f
                weight[line, k, i + 1] += f
                if squared:
                    grey = (float(image[row, j, 0]) + float(image[row, j, 1]) + float(image[row, j, 2])) / 765.0
                    square[line, k, i] += (1.0 - f) * grey * grey
                    square[line, k, i + 1] += f * grey * grey
