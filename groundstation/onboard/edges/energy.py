"""The energies whose minimum is the runway, with their gradients, compiled.

With spatially variant means (Eqs. 1 and 3)::

    E(d) = −½ Σ_lines ∫ |u(t) − v(t)|² ds,  u(t) = 1/ℓ ∫₀^ℓ I(C(t) − sN) ds,  v(t) the same outwards

with C(t) = ((1−t)·x_top + t·x_bottom, y) and ℓ(t) constant while the lines move. The gradient is derived from these
two equations: through I at the samples, through N and through ds; it is exact for the bilinear picture. The paper's
(Eqs. 6 to 9, corrected: −t for t in 7 and 9) is `spatially_variant_as_printed`.

With non-variant means (Eqs. 2, A2, A3) the regions end at fixed far sides, and E = −½ |u − v|² · 2 L₂ over both bands
together, so that both energies have the same unit.

The bands of one place are at one distance only if they are along the image of a line across the runway; along
the normals of lines inclined by 45° and more one side is much farther away than the other, and light and haze that
change with distance bias the lines. Hence ``across``, which is not in the paper.

Crossings x (4,): line 1 at the upper and lower row, line 2 at both rows; line 1 is the left one. Colours are 0 to 1.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.sampling import add_colour, inside, sample


class _BandNormal(NamedTuple):
    """Direction (x, y) of a line's band, outwards, and its derivative by the line's width w = x_bottom − x_top."""

    x: float
    y: float
    x_by_w: float
    y_by_w: float


class _BandSums(NamedTuple):
    """Sums over the samples of one place: colours inside ``u`` (3,) and outside ``v`` (3,), and by the two crossings.

    ``du`` and ``dv`` (2, 3); ``colour`` (9,) is one sample with its derivatives.
    """

    u: FloatArray
    v: FloatArray
    du: FloatArray
    dv: FloatArray
    colour: FloatArray


@njit(cache=True, nogil=True)
def _sum_band(
    image: ImageArray, cx: float, cy: float, normal: _BandNormal, ell: float, t: float, n_s: int, sums: _BandSums
) -> None:
    """Fill the sums over ``n_s`` samples on either side of a line's place (cx, cy), at share ``t`` of its height."""
    u, v, du, dv, colour = sums.u, sums.v, sums.du, sums.dv, sums.colour
    u[:] = 0.0
    v[:] = 0.0
    du[:] = 0.0
    dv[:] = 0.0
    for m in range(n_s):
        s = (m + 0.5) * ell / n_s
        for way in range(2):
            r = -s if way == 0 else s
            sample(image, cx + r * normal.x, cy + r * normal.y, colour)
            for c in range(3):
                gx, gy = colour[3 + c], colour[6 + c]
                turn = r * (gx * normal.x_by_w + gy * normal.y_by_w)
                if way == 0:
                    u[c] += colour[c]
                    du[0, c] += gx * (1.0 - t) - turn
                    du[1, c] += gx * t + turn
                else:
                    v[c] += colour[c]
                    dv[0, c] += gx * (1.0 - t) - turn
                    dv[1, c] += gx * t + turn


@njit(cache=True, nogil=True)
def spatially_variant(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    widths: FloatArray,
    across: FloatArray,
    counts: tuple[int, int],
    grad: FloatArray,
) -> float:
    """Return E and fill its gradient (4,).

    ``rows`` (2,) upper and lower row, px; ``widths`` (2, 2) ℓ at upper and lower row of both lines, px along N;
    ``across`` (2,) the unit vector, to the right, that takes N's place, or zeros for the normals of the lines;
    ``counts`` places along a line, samples on either side. Places whose band leaves the picture count nothing.
    """
    n_t, n_s = counts
    height = rows[1] - rows[0]
    grad[:] = 0.0
    energy = 0.0
    sums = _BandSums(u=np.empty(3), v=np.empty(3), du=np.empty((2, 3)), dv=np.empty((2, 3)), colour=np.empty(9))
    for line in range(2):
        side = -1.0 if line == 0 else 1.0
        top, bottom = x[2 * line], x[2 * line + 1]
        w = bottom - top
        length = np.sqrt(w * w + height * height)
        nx, ny = side * height / length, -side * w / length
        # ∂N/∂w
        cube = length**3
        ax, ay = -side * height * w / cube, side * (w * w / cube - 1.0 / length)
        if across[0] != 0.0:
            nx, ny, ax, ay = side * across[0], side * across[1], 0.0, 0.0
        normal = _BandNormal(nx, ny, ax, ay)
        sum_squares = 0.0
        for k in range(n_t):
            t = (k + 0.5) / n_t
            cx, cy = top + w * t, rows[0] + height * t
            ell = widths[line, 0] + (widths[line, 1] - widths[line, 0]) * t
            if not (inside(image, cx - ell * nx, cy - ell * ny) and inside(image, cx + ell * nx, cy + ell * ny)):
                continue
            _sum_band(image, cx, cy, normal, ell, t, n_s, sums)
            scale = 1.0 / n_s
            for c in range(3):
                difference = (sums.u[c] - sums.v[c]) * scale
                sum_squares += difference * difference
                for end in range(2):
                    grad[2 * line + end] -= length / n_t * difference * (sums.du[end, c] - sums.dv[end, c]) * scale
        energy -= 0.5 * length / n_t * sum_squares
        stretch = -0.5 * (w / length) / n_t * sum_squares
        grad[2 * line] -= stretch
        grad[2 * line + 1] += stretch
    return energy


@njit(cache=True, nogil=True)
def spatially_variant_as_printed(
    image: ImageArray, x: FloatArray, rows: FloatArray, widths: FloatArray, counts: tuple[int, int], grad: FloatArray
) -> float:
    """Return E as above, but fill the paper's gradient: Eqs. 6 to 9 with u and v of each place."""
    n_t, n_s = counts
    height = rows[1] - rows[0]
    grad[:] = 0.0
    energy = 0.0
    # of u, of v, and on the edge
    seen = np.empty((3, 3))
    for line in range(2):
        side = -1.0 if line == 0 else 1.0
        top, bottom = x[2 * line], x[2 * line + 1]
        w = bottom - top
        length = np.sqrt(w * w + height * height)
        nx, ny = side * height / length, -side * w / length
        for k in range(n_t):
            t = (k + 0.5) / n_t
            cx, cy = top + w * t, rows[0] + height * t
            ell = widths[line, 0] + (widths[line, 1] - widths[line, 0]) * t
            if not (inside(image, cx - ell * nx, cy - ell * ny) and inside(image, cx + ell * nx, cy + ell * ny)):
                continue
            seen[:] = 0.0
            for m in range(n_s):
                s = (m + 0.5) * ell / n_s
                add_colour(image, cx - s * nx, cy - s * ny, 1.0 / n_s, seen, 0)
                add_colour(image, cx + s * nx, cy + s * ny, 1.0 / n_s, seen, 1)
            add_colour(image, cx, cy, 1.0, seen, 2)
            squares, pull = 0.0, 0.0
            for c in range(3):
                between = seen[0, c] - seen[1, c]
                squares += between**2
                pull += between * (2.0 * seen[2, c] - seen[0, c] - seen[1, c])
            energy -= 0.5 * length / n_t * squares
            # h·N ds of Eq. A9
            push = -pull / ell * nx * length / n_t
            grad[2 * line] += push * (1.0 - t)
            grad[2 * line + 1] += push * t
    return energy


@njit(cache=True, nogil=True, inline="always")
def _add_span(image: ImageArray, row: int, start: float, end: float, out: FloatArray) -> float:
    """Add colours of a row between two places, each pixel a box, to ``out`` (3,); returns the length inside."""
    start, end = max(start, -0.5), min(end, image.shape[1] - 0.5)
    if end <= start:
        return 0.0
    first, last = int(np.floor(start + 0.5)), int(np.floor(end + 0.5))
    for j in range(first, min(last, image.shape[1] - 1) + 1):
        part = min(end, j + 0.5) - max(start, j - 0.5)
        for c in range(3):
            out[c] += part * image[row, j, c] / 255.0
    return end - start


@njit(cache=True, nogil=True)
def non_variant(image: ImageArray, x: FloatArray, rows: FloatArray, far: FloatArray, grad: FloatArray) -> float:
    """Return E of one mean inside and one outside, and fill its gradient (4,).

    ``far`` (2, 2, 2) holds the crossings of the fixed far sides: line, inner or outer, upper or lower row.
    """
    height = rows[1] - rows[0]
    grad[:] = 0.0
    first, last = int(np.ceil(rows[0])), int(np.floor(rows[1]))
    total_u, total_v = np.zeros(3), np.zeros(3)
    edges = np.zeros((4, 3))
    weights = np.zeros(4)
    area_u, area_v = 0.0, 0.0
    for row in range(max(first, 0), min(last, image.shape[0] - 1) + 1):
        t = (row - rows[0]) / height
        for line in range(2):
            edge = x[2 * line] * (1.0 - t) + x[2 * line + 1] * t
            inner = far[line, 0, 0] * (1.0 - t) + far[line, 0, 1] * t
            outer = far[line, 1, 0] * (1.0 - t) + far[line, 1, 1] * t
            if line == 0:
                area_u += _add_span(image, row, edge, inner, total_u)
                area_v += _add_span(image, row, outer, edge, total_v)
                within = outer < edge < inner
            else:
                area_u += _add_span(image, row, inner, edge, total_u)
                area_v += _add_span(image, row, edge, outer, total_v)
                within = inner < edge < outer
            if within and -0.5 < edge < image.shape[1] - 0.5:
                sign = -1.0 if line == 0 else 1.0
                j = min(int(np.floor(edge + 0.5)), image.shape[1] - 1)
                for end in range(2):
                    weight = sign * ((1.0 - t) if end == 0 else t)
                    weights[2 * line + end] += weight
                    for c in range(3):
                        edges[2 * line + end, c] += weight * image[row, j, c] / 255.0
    if area_u < 1.0 or area_v < 1.0:
        return 0.0
    energy = 0.0
    for c in range(3):
        u, v = total_u[c] / area_u, total_v[c] / area_v
        energy -= height * (u - v) ** 2
        for k in range(4):
            # Eq. A3
            rise = (edges[k, c] - u * weights[k]) / area_u + (edges[k, c] - v * weights[k]) / area_v
            grad[k] -= 2.0 * height * (u - v) * rise
    return energy
