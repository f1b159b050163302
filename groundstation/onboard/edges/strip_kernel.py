"""Compiled arithmetic of the strip: filling it, scoring displacements, the edge of each place, a line through them."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray, IntArray
from groundstation.onboard.edges.sampling import add_colour, inside

_FIT_ROUNDS = 8
_MAX_PROFILE = 400
_SAMPLE_PX = 0.5


@njit(cache=True, nogil=True, error_model="numpy")
def fill_strip(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    widths: FloatArray,
    across: FloatArray,
    step: float,
    out: FloatArray,
) -> None:
    """Fill ``out`` (2, places, displacements, 3) with u − v; the middle displacement is 0; NaN outside the picture.

    Displacements are along the row, to the right; bands are along ``across`` (2,), ``widths`` (2, 2) are theirs.
    """
    n_t, n_o = out.shape[1], out.shape[2]
    height = rows[1] - rows[0]
    reach = step * (n_o // 2)
    # one more than there can be samples: the sum does not grow beyond the last one
    prefix, seen = np.zeros((_MAX_PROFILE + 2, 3)), np.zeros(_MAX_PROFILE + 2)
    nx, ny = across
    for line in range(2):
        w = x[2 * line + 1] - x[2 * line]
        # how far along `across` a line is met that was displaced by 1 px along the row
        meets = 1.0 / (nx - w / height * ny)
        for k in range(n_t):
            t = (k + 0.5) / n_t
            cx, cy = x[2 * line] + w * t, rows[0] + height * t
            ell = widths[line, 0] + (widths[line, 1] - widths[line, 0]) * t
            half = reach * meets + ell
            n = min(max(int(np.ceil(2.0 * half / _SAMPLE_PX)), 8), _MAX_PROFILE)
            d = 2.0 * half / n
            for m in range(n):
                r = -half + (m + 0.5) * d
                # no slice of `prefix`: making one costs more than the addition here
                for c in range(3):
                    prefix[m + 1, c] = prefix[m, c]
                seen[m + 1] = seen[m]
                if inside(image, cx + r * nx, cy + r * ny):
                    add_colour(image, cx + r * nx, cy + r * ny, 1.0, prefix, m + 1)
                    seen[m + 1] += 1.0
            for c in range(3):
                prefix[n + 1, c] = prefix[n, c]
            seen[n + 1] = seen[n]
            for o in range(n_o):
                place = (step * (o - n_o // 2) * meets + half) / d
                low, high = max(place - ell / d, 0.0), min(place + ell / d, float(n))
                i, j, g = int(place), int(low), int(high)
                fi, fj, fg = place - i, low - j, high - g
                if seen[n] < n:
                    at_i = seen[i] + fi * (seen[i + 1] - seen[i])
                    left = at_i - seen[j] - fj * (seen[j + 1] - seen[j])
                    right = seen[g] + fg * (seen[g + 1] - seen[g]) - at_i
                    if left < place - low - 0.01 or right < high - place - 0.01:
                        out[line, k, o, 0] = np.nan
                        continue
                left, right = 1.0 / (place - low), 1.0 / (high - place)
                for c in range(3):
                    p_i = prefix[i, c] + fi * (prefix[i + 1, c] - prefix[i, c])
                    p_j = prefix[j, c] + fj * (prefix[j + 1, c] - prefix[j, c])
                    p_g = prefix[g, c] + fg * (prefix[g + 1, c] - prefix[g, c])
                    out[line, k, o, c] = (p_i - p_j) * left - (p_g - p_i) * right


@njit(cache=True, nogil=True, error_model="numpy")
def displacement_scores(strip: FloatArray, block: int, kappa: float, out: FloatArray) -> None:
    """Fill ``out`` (displacements, displacements), at the upper and the lower row, with the mean of S / (S + κ).

    S is |u − v|² of a block of places together; −1 where most of the strip is outside the picture. A line that is
    displaced by d more at its lower end meets the places of a block at a staircase of displacements. Few staircases
    differ except in their start, so each is summed once, for all starts, and then looked up.
    """
    n_t, n_o = strip.shape[:2]
    steepest = n_o // n_t + 1
    known = np.empty((2 * steepest + 1) << (block - 1), np.int64)
    # of each staircase S / (S + κ), and whether it is in the picture; of each d the sums of these from `least` on
    table, sums = np.empty((2 * n_o - 1, 2, n_o)), np.zeros((2 * n_o - 1, 2, n_o))
    stairs = np.zeros(block, np.int64)
    colours = np.empty((3, block, n_o))
    for first in range(0, n_t - block + 1, block):
        for k in range(block):
            for o in range(n_o):
                for c in range(3):
                    colours[c, k, o] = strip[first + k, o, c]
        known[:] = -1
        rows = 0
        for d in range(1 - n_o, n_o):
            # a staircase's number: how steep it is at least, and for each step whether it is one higher
            flat = int(np.floor(d / n_t))
            number = flat + steepest
            for k in range(block):
                stairs[k] = int(np.floor(d * (first + k + 0.5) / n_t + 0.5))
                if k:
                    number = 2 * number + stairs[k] - stairs[k - 1] - flat
            row = known[number]
            if row < 0:
                row = known[number] = rows
                rows += 1
                _staircase(colours, stairs, kappa, table[row])
            start, count = max(-d, 0) + stairs[0], n_o - abs(d)
            for j in range(2):
                own, into = table[row, j, start : start + count], sums[d + n_o - 1, j, :count]
                for i in range(count):
                    into[i] += own[i]
    for d in range(1 - n_o, n_o):
        least = max(-d, 0)
        for i in range(n_o - abs(d)):
            total, blocks = sums[d + n_o - 1, 0, i], sums[d + n_o - 1, 1, i]
            out[least + i, least + i + d] = -1.0 if 4.0 * blocks * block < n_t else total / blocks


@njit(cache=True, nogil=True, error_model="numpy")
def _staircase(colours: FloatArray, stairs: IntArray, kappa: float, out: FloatArray) -> None:
    """Fill ``out`` (2, displacements) with S / (S + κ) of a block met at o + stairs − stairs[0], and 1; or 0 and 0.

    ``colours`` (3, block, displacements) holds u − v.
    """
    block, n_o = colours.shape[1:]
    low, high = max(stairs[0] - stairs[block - 1], 0), n_o - max(stairs[block - 1] - stairs[0], 0)
    if high <= low:
        return
    r, g, h = np.zeros(high - low), np.zeros(high - low), np.zeros(high - low)
    for k in range(block):
        start = low + stairs[k] - stairs[0]
        red, green = colours[0, k, start : start + r.size], colours[1, k, start : start + r.size]
        blue = colours[2, k, start : start + r.size]
        for i in range(r.size):
            r[i] += red[i]
            g[i] += green[i]
            h[i] += blue[i]
    scores, seen = out[0, low:high], out[1, low:high]
    for i in range(r.size):
        score = (r[i] * r[i] + g[i] * g[i] + h[i] * h[i]) / (block * block)
        within = score >= 0.0
        scores[i] = score / (score + kappa) if within else 0.0
        seen[i] = 1.0 if within else 0.0


@njit(cache=True, nogil=True)
def block_score(strip: FloatArray, first: int, block: int, displacement: int) -> float:
    """Return |u − v|² of a block of places (places, displacements, 3) together, from the place ``first``."""
    r, g, h = 0.0, 0.0, 0.0
    for k in range(first, first + block):
        r += strip[k, displacement, 0]
        g += strip[k, displacement, 1]
        h += strip[k, displacement, 2]
    return (r * r + g * g + h * h) / (block * block)


@njit(cache=True, nogil=True)
def median_best_score(strip: FloatArray, block: int) -> float:
    """Return the median over blocks of their best |u − v|² at any displacement; 0 without one."""
    n_t, n_o = strip.shape[:2]
    best, count = np.zeros(n_t // block), 0
    for first in range(0, n_t - block + 1, block):
        top = 0.0
        for o in range(n_o):
            top = max(block_score(strip, first, block, o), top)
        if top > 0.0:
            best[count] = top
            count += 1
    return float(np.median(best[:count])) if count else 0.0


@njit(cache=True, nogil=True)
def usual_middle(strip: FloatArray, block: int) -> float:
    """Return the median over blocks of their |u − v|² at no displacement; 0 where none is in the picture."""
    n_t, n_o = strip.shape[:2]
    own, count = np.zeros(n_t // block), 0
    for first in range(0, n_t - block + 1, block):
        score = block_score(strip, first, block, n_o // 2)
        if score >= 0.0:
            own[count] = score
            count += 1
    return float(np.median(own[:count])) if count else 0.0


@njit(cache=True, nogil=True)
def own_places(
    strip: FloatArray, step: float, block: int, window: float, kappa: float, offsets: FloatArray, weights: FloatArray
) -> None:
    """Fill each place's own displacement and weight (places,) within a window, its neighbours averaged in."""
    n_t, n_o = strip.shape[:2]
    middle, reach = n_o // 2, min(int(window / step), n_o // 2 - 1)
    scores = np.empty(n_o)
    for k in range(n_t):
        first, last = max(k - block // 2, 0), min(k + block // 2, n_t - 1)
        for o in range(n_o):
            r, g, h = 0.0, 0.0, 0.0
            for m in range(first, last + 1):
                r += strip[m, o, 0]
                g += strip[m, o, 1]
                h += strip[m, o, 2]
            scores[o] = (r * r + g * g + h * h) / (last - first + 1) ** 2
        top, at = -1.0, -1
        for o in range(middle - reach, middle + reach + 1):
            if scores[o] > top and scores[o] >= scores[o - 1] and scores[o] >= scores[o + 1]:
                top, at = scores[o], o
        weights[k] = 0.0
        if at < 0:
            continue
        bend = scores[at - 1] - 2.0 * top + scores[at + 1]
        part = 0.5 * (scores[at - 1] - scores[at + 1]) / bend if bend < 0.0 else 0.0
        offsets[k] = step * (at + part - middle)
        weights[k] = top / (top + kappa)


@njit(cache=True, nogil=True)
def robust_line(offsets: FloatArray, weights: FloatArray, ends: FloatArray, covariance: FloatArray) -> float:
    """Fit ends (2,) of a line to offsets (n,) by weighted least squares with Cauchy's weights; returns its sigma, px.

    ``ends`` are the initial values; ``covariance`` (2, 2) is filled for independent places. Negative where there are
    too few.
    """
    n = offsets.size
    spread = 1.0
    own = weights.copy()
    for _turn in range(_FIT_ROUNDS):
        a00, a01, a11, b0, b1 = 1e-9, 0.0, 1e-9, 0.0, 0.0
        used = 0
        for k in range(n):
            if weights[k] <= 0.0:
                continue
            used += 1
            t = (k + 0.5) / n
            r = offsets[k] - (ends[0] * (1.0 - t) + ends[1] * t)
            own[k] = weights[k] / (1.0 + (r / (1.5 * spread)) ** 2)
            a00 += own[k] * (1.0 - t) ** 2
            a01 += own[k] * (1.0 - t) * t
            a11 += own[k] * t * t
            b0 += own[k] * (1.0 - t) * r
            b1 += own[k] * t * r
        determinant = a00 * a11 - a01 * a01
        if used < 6 or determinant < 1e-9:
            return -1.0
        ends[0] += (a11 * b0 - a01 * b1) / determinant
        ends[1] += (a00 * b1 - a01 * b0) / determinant
        square, total = 0.0, 0.0
        for k in range(n):
            if weights[k] > 0.0:
                t = (k + 0.5) / n
                r = offsets[k] - (ends[0] * (1.0 - t) + ends[1] * t)
                square += own[k] * r * r
                total += own[k]
        spread = max(np.sqrt(square / total), 0.1)
        covariance[0, 0], covariance[1, 1] = a11 / determinant, a00 / determinant
        covariance[0, 1] = covariance[1, 0] = -a01 / determinant
    return spread


@njit(cache=True, nogil=True)
def edges_agree(strip: FloatArray, block: int) -> float:
    """Return the correlation of inside − outside at both edges, over blocks of places of a strip (2, …)."""
    middle = strip.shape[2] // 2
    together, squares, own = 0.0, np.zeros(2), np.empty((2, 3))
    for first in range(0, strip.shape[1] - block + 1, block):
        own[:] = 0.0
        for line in range(2):
            for k in range(first, first + block):
                for c in range(3):
                    own[line, c] += strip[line, k, middle, c] / block
        if not np.isfinite(own).all():
            continue
        for c in range(3):
            # left less right: at the left edge that is outside less inside
            together -= own[0, c] * own[1, c]
            squares[0] += own[0, c] ** 2
            squares[1] += own[1, c] ** 2
    return together / max(np.sqrt(squares[0] * squares[1]), 1e-9)
