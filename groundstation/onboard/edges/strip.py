"""The energy of every small displacement of an edge at once, and the edge to a fraction of a pixel with its sigma.

Going down the energy ends in the nearest minimum: a painted stripe is one. A strip about the predicted edge,
straightened, holds u − v of each place and each displacement along the row; the energy of an edge displaced by α at
the upper and β at the lower row is a sum over it, so that a whole grid of (α, β) costs little. Two departures from
|u − v|²: neighbouring places are averaged before they are squared (at night the noise of one row is more than the
contrast), and the sum is of S / (S + κ), which no lamp or crossing taxiway carries alone. Not in the paper.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.sampling import add_colour, inside

_FIT_ROUNDS = 8
_MAX_PROFILE = 400
_SAMPLE_PX = 0.5
_LEAST_SIGMA_PX = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class StripConfig:
    """Tuning of the strip.

    Attributes
    ----------
    places : along an edge.
    step_px : between displacements, up to ``fine_px`` of them; farther searches have wider steps, as many.
    fine_px, most_px : displacement up to which steps are not wider, and the largest looked at.
    window_px : how far off the common edge a single place may find its own.
    floor_px : sigma that no edge goes below: what a straight line between two colours is not.
    block : neighbouring places that are averaged before they are squared; so many err alike.
    least_contrast : mean of |u − v| (0 to 1, over the colours) below which there is no edge.
    """

    places: int = 40
    step_px: float = 0.5
    fine_px: float = 20.0
    most_px: float = 60.0
    window_px: float = 2.5
    floor_px: float = 0.25
    block: int = 5
    least_contrast: float = 0.008


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundEdges:
    """Crossings (4,) px, covariance (4, 4) px², the contrast (2,) across both edges, and how alike it is, −1 to 1.

    The ``agreement`` is 1 where inside differs from outside by the same colours at both edges, all along them.
    """

    crossings_px: FloatArray
    covariance_px2: FloatArray
    contrast: FloatArray
    agreement: float


@njit(cache=True, nogil=True)
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

    Displacements run along the row, to the right; bands lie along ``across`` (2,), ``widths`` (2, 2) are theirs.
    """
    n_t, n_o = out.shape[1], out.shape[2]
    height = rows[1] - rows[0]
    reach = step * (n_o // 2)
    prefix = np.zeros((_MAX_PROFILE + 1, 3))
    seen = np.zeros(_MAX_PROFILE + 1)
    for line in range(2):
        w = x[2 * line + 1] - x[2 * line]
        nx, ny = across
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
                prefix[m + 1] = prefix[m]
                seen[m + 1] = seen[m]
                if inside(image, cx + r * nx, cy + r * ny):
                    add_colour(image, cx + r * nx, cy + r * ny, 1.0, prefix[m + 1])
                    seen[m + 1] += 1.0
            for o in range(n_o):
                place = (step * (o - n_o // 2) * meets + half) / d
                low, high = place - ell / d, min(place + ell / d, float(n))
                low = max(low, 0.0)
                i, j, g = int(place), int(low), int(high)
                fi, fj, fg = place - i, low - j, high - g
                at_i = seen[i] + (fi * (seen[i + 1] - seen[i]) if i < n else 0.0)
                at_j = seen[j] + (fj * (seen[j + 1] - seen[j]) if j < n else 0.0)
                at_g = seen[g] + (fg * (seen[g + 1] - seen[g]) if g < n else 0.0)
                if at_i - at_j < place - low - 0.01 or at_g - at_i < high - place - 0.01:
                    out[line, k, o, 0] = np.nan
                    continue
                for c in range(3):
                    p_i = prefix[i, c] + (fi * (prefix[i + 1, c] - prefix[i, c]) if i < n else 0.0)
                    p_j = prefix[j, c] + (fj * (prefix[j + 1, c] - prefix[j, c]) if j < n else 0.0)
                    p_g = prefix[g, c] + (fg * (prefix[g + 1, c] - prefix[g, c]) if g < n else 0.0)
                    out[line, k, o, c] = (p_i - p_j) / (place - low) - (p_g - p_i) / (high - place)


@njit(cache=True, nogil=True)
def displacement_scores(strip: FloatArray, block: int, kappa: float, out: FloatArray) -> None:
    """Fill ``out`` (displacements, displacements), at the upper and the lower row, with the mean of S / (S + κ).

    S is |u − v|² of a block of places together; −1 where most of the strip lies outside the picture.
    """
    n_t, n_o = strip.shape[:2]
    for a in range(n_o):
        for b in range(n_o):
            total, blocks = 0.0, 0
            for first in range(0, n_t - block + 1, block):
                r, g, h = 0.0, 0.0, 0.0
                for k in range(first, first + block):
                    o = int(a + (b - a) * (k + 0.5) / n_t + 0.5)
                    r += strip[k, o, 0]
                    g += strip[k, o, 1]
                    h += strip[k, o, 2]
                score = (r * r + g * g + h * h) / (block * block)
                if score >= 0.0:
                    total += score / (score + kappa)
                    blocks += 1
            out[a, b] = -1.0 if 4 * blocks * block < n_t else total / blocks


@njit(cache=True, nogil=True)
def best_displacements(scores: FloatArray, weight: FloatArray, alone: FloatArray, step: float, out: FloatArray) -> bool:
    """Fill ``out`` (4,) with the displacements (px) of both lines that score best, less what they cost.

    ``scores`` (2, displacements, displacements) as of `displacement_scores`; ``weight`` (4, 4) is the prior's inverse
    covariance over the number of places, so that dᵀ weight d / 2 is in units of the score, ``alone`` (2, 2, 2) that of
    each line whatever the other does. Turned by gusts, both lines move together, and a line alone does not jump to
    its neighbour. Line by line, each given the other, from either one's own best; false where a line has no score.
    """
    n_o = scores.shape[1]
    middle = n_o // 2
    highest = -np.inf
    d = np.zeros(4)
    for first in range(2):
        d[:] = 0.0
        total = 0.0
        for turn in range(4):
            line = (first + turn) % 2
            i, j = 2 * line, 2 - 2 * line
            w = alone[line] if turn == 0 else weight[i : i + 2, i : i + 2]
            pull0, pull1 = 0.0, 0.0
            if turn > 0:
                pull0 = weight[i, j] * d[j] + weight[i, j + 1] * d[j + 1]
                pull1 = weight[i + 1, j] * d[j] + weight[i + 1, j + 1] * d[j + 1]
            best, at, bt = -np.inf, -1, -1
            for a in range(n_o):
                x = step * (a - middle)
                for b in range(n_o):
                    if scores[line, a, b] < 0.0:
                        continue
                    y = step * (b - middle)
                    cost = 0.5 * (w[0, 0] * x * x + 2.0 * w[0, 1] * x * y + w[1, 1] * y * y) + pull0 * x + pull1 * y
                    if scores[line, a, b] - cost > best:
                        best, at, bt = scores[line, a, b] - cost, a, b
            if at < 0:
                return False
            d[i], d[i + 1] = step * (at - middle), step * (bt - middle)
            if turn == 2:
                total = scores[line, at, bt]
            elif turn == 3:
                total += scores[line, at, bt]
        for i in range(4):
            for j in range(4):
                total -= 0.5 * d[i] * weight[i, j] * d[j]
        if total > highest:
            highest = total
            out[:] = d
    return True


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

    ``ends`` holds the first guess; ``covariance`` (2, 2) is filled for independent places. Negative where there are
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


def find_edges(
    image: ImageArray,
    guess_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    across: FloatArray,
    prior_px2: FloatArray,
    config: StripConfig,
) -> FoundEdges | None:
    """Search both edges about a guess (4,), wide first, and settle; None where one of them is not seen."""
    crossings = search_edges(image, guess_px, rows_px, widths_px, across, prior_px2, config)
    return None if crossings is None else settle(image, crossings, rows_px, widths_px, across, config)


def search_edges(
    image: ImageArray,
    guess_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    across: FloatArray,
    prior_px2: FloatArray,
    config: StripConfig,
) -> FloatArray | None:
    """Return where both edges are (4,), to a step, about a guess (4,) of covariance (4, 4); None: not seen.

    ``widths_px`` (2, 2) and ``across`` (2,) as for `descent.descend`.
    """
    prior = prior_px2 + _LEAST_SIGMA_PX**2 * np.eye(4)
    reach = float(np.clip(3.0 * np.sqrt(prior.diagonal().max()) + 1.0, 3.0, config.most_px))
    step = config.step_px * max(1.0, reach / config.fine_px)
    strip = _strip(image, guess_px, rows_px, widths_px, across, reach, step, config.places)
    scores = np.empty((2, strip.shape[2], strip.shape[2]))
    for line in range(2):
        displacement_scores(strip[line], config.block, _kappa(strip[line], config.block), scores[line])
    alone = np.stack([np.linalg.inv(prior[:2, :2]), np.linalg.inv(prior[2:, 2:])]) / config.places
    displaced = np.zeros(4)
    if not best_displacements(scores, np.linalg.inv(prior) / config.places, alone, step, displaced):
        return None
    return guess_px + displaced


def settle(
    image: ImageArray,
    crossings_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    across: FloatArray,
    config: StripConfig,
) -> FoundEdges | None:
    """Return the edges next to crossings (4,) to a fraction of a pixel; None where one is too faint or too short."""
    strip = _strip(
        image, crossings_px, rows_px, widths_px, across, config.window_px + 1.0, config.step_px, config.places
    )
    found, covariance, contrast = crossings_px.copy(), np.zeros((4, 4)), np.zeros(2)
    offsets, weights = np.zeros(config.places), np.zeros(config.places)
    for line in range(2):
        own = slice(2 * line, 2 * line + 2)
        ends, block = np.zeros(2), np.empty((2, 2))
        kappa = _kappa(strip[line], config.block)
        own_places(strip[line], config.step_px, config.block, config.window_px, kappa, offsets, weights)
        spread = float(robust_line(offsets, weights, ends, block))
        if spread < 0.0 or np.abs(ends).max() > 2.0 * config.window_px:
            return None
        middle = _scores(strip[line], config.block)[:, strip.shape[2] // 2]
        contrast[line] = np.sqrt(np.nanmedian(middle) / 3.0) if np.isfinite(middle).any() else 0.0
        found[own] += ends
        covariance[own, own] = config.block * spread**2 * block + config.floor_px**2 * np.eye(2)
    if contrast.min() < config.least_contrast:
        return None
    return FoundEdges(
        crossings_px=found, covariance_px2=covariance, contrast=contrast, agreement=_agreement(strip, config.block)
    )


def _strip(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    widths: FloatArray,
    across: FloatArray,
    reach: float,
    step: float,
    places: int,
) -> FloatArray:
    strip = np.zeros((2, places, 2 * int(np.ceil(reach / step)) + 1, 3))
    fill_strip(image, x, rows, widths, across, step, strip)
    return strip


def _scores(strip: FloatArray, block: int) -> FloatArray:
    """Return |u − v|² of each whole block of places (blocks, displacements) of a strip (places, displacements, 3)."""
    blocks = strip.shape[0] // block
    means = strip[: blocks * block].reshape(blocks, block, *strip.shape[1:]).mean(axis=1)
    return np.asarray((means**2).sum(axis=2))


def _agreement(strip: FloatArray, block: int) -> float:
    """Return the correlation of inside − outside at both edges, over blocks of places of a strip (2, …)."""
    blocks, middle = strip.shape[1] // block, strip.shape[2] // 2
    own = strip[:, : blocks * block, middle].reshape(2, blocks, block, 3).mean(axis=2)
    own = own[:, np.isfinite(own).all(axis=(0, 2))]
    # left less right: at the left edge that is outside less inside
    together = -float((own[0] * own[1]).sum())
    return together / max(float(np.sqrt((own[0] ** 2).sum() * (own[1] ** 2).sum())), 1e-9)


def _kappa(strip: FloatArray, block: int) -> float:
    """Return half the usual best |u − v|² of a block of places."""
    scores = _scores(strip, block)
    best = np.where(np.isfinite(scores), scores, 0.0).max(axis=1)
    best = best[best > 0.0]
    return max(0.5 * float(np.median(best)), 1e-6) if best.size else 1e-6
