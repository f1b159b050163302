"""Profiles across both edges of one picture, fitted with pavement, painted line, lamps and ground."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.profile_kernel import best_lines, gather, line_likelihood, misfits

OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])
# half of how far, across the runway, the light of lamps reaches about their line
_LAMP_M = 0.5
_OUTLIER = 0.02  # likelihood of a block of rows that shows something else, over its best
_LEAST_BLUR = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Straightened:
    """Profiles of both lines: sums of colours (2, blocks, bins, 3), weights (2, blocks, bins).

    Besides steps (2,) px of a bin at the upper and the lower row, and of each block: bins in a metre (blocks,), sigma
    of the picture in bins (2, blocks); ``coarse`` is how many of the finest steps a bin has.
    """

    total: FloatArray
    weight: FloatArray
    steps: FloatArray
    bins_per_m: FloatArray
    blurs: FloatArray
    coarse: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beside:
    """What is expected beside the edges.

    Painted line's inner and outer side and the lamps' place, m outwards from the edge (infinite: none); the usual
    excess (2, blocks, 3) of line and lamps, and how stiffly each (2,) is held to it, in pixels.
    """

    line_m: tuple[float, float]
    lamps_m: float
    excess: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Log-likelihoods of both lines (2, trials, trials), relative to ``base``, and what the best levels are.

    ``levels`` (2, blocks, trials, 4, 3): pavement, ground, excess of line and lamps; ``misfit`` (2, blocks, trials) in
    pixels, ``freedom`` (2, blocks) how many these are; ``steps`` (2,) px between trials.
    """

    grids: FloatArray
    base: float
    levels: FloatArray
    misfit: FloatArray
    freedom: FloatArray
    steps: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likeliest:
    """Outward displacements of both lines (4,) px on the grid, and their log-likelihood, the prior's part included."""

    moved_px: FloatArray
    evidence: float


def straightened(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    px_per_m: FloatArray,
    steps: FloatArray,
    sizes: tuple[int, int],
    blur_px: float,
    coarse: float,
) -> Straightened:
    """Return the profiles about lines x (4,), of (blocks, bins) ``sizes``; ``steps`` (2,) px of a bin at both rows."""
    total, weight = np.zeros((2, *sizes, 3)), np.zeros((2, *sizes))
    gather(image, x, rows, steps, total, weight)
    step, m = _along(sizes[0], steps), _along(sizes[0], px_per_m)
    lean = np.hypot(1.0, (x[1::2] - x[::2]) / (rows[1] - rows[0]))
    blurs = np.hypot(blur_px * lean[:, None] / step, _LEAST_BLUR)
    return Straightened(total=total, weight=weight, steps=steps, bins_per_m=m / step, blurs=blurs, coarse=coarse)


def fitted(profiles: Straightened, beside: Beside, reach: int, alike: float) -> Fit:
    """Return the likelihood of displacements of ``reach`` bins to either side; so many values ``alike`` err as one."""
    blocks, trials = profiles.weight.shape[1], 2 * reach + 1
    lamps = (beside.lamps_m - _LAMP_M, beside.lamps_m + _LAMP_M)
    places = [beside.line_m] if no_lamps(beside.lamps_m) else [beside.line_m, lamps]
    bars = np.array(places)[:, None, :] * profiles.bins_per_m[None, :, None]
    misfit, levels = np.empty((2, blocks, trials)), np.zeros((2, blocks, trials, 4, 3))
    own = np.empty((blocks, trials, 2 + len(places), 3))
    grids, base = np.empty((2, trials, trials)), 0.0
    freedom = 3.0 * (profiles.weight > 0.0).sum(axis=2)
    for line in range(2):
        misfits(
            profiles.total[line], profiles.weight[line], profiles.blurs[line], bars, beside.excess, beside.stiffness,
            misfit[line], own,
        )  # fmt: skip
        levels[line, :, :, : own.shape[2]] = own
        least = misfit[line].min(axis=1)
        power = 0.5 * profiles.coarse * freedom[line] / alike
        line_likelihood((least[:, None] / misfit[line]) ** power[:, None], profiles.steps, _OUTLIER, grids[line])
        base -= float((power * np.log(least / np.maximum(freedom[line], 1.0))).sum())
    return Fit(grids=grids, base=base, levels=levels, misfit=misfit, freedom=freedom, steps=profiles.steps)


def likeliest(fit: Fit, offset_px: FloatArray, weight: FloatArray) -> Likeliest:
    """Return the likeliest displacement; the prior's mean is at ``offset_px`` (4,), its inverse covariance (4, 4)."""
    moved = np.zeros(4)
    evidence = float(best_lines(fit.grids, fit.steps, offset_px, weight, moved))
    return Likeliest(moved_px=moved, evidence=evidence + fit.base)


def likelihood_at(fit: Fit, moved_px: FloatArray) -> float:
    """Return the log-likelihood of both lines displaced outwards by (4,) px, as of the next place on the grid."""
    trials = fit.grids.shape[1]
    at = np.clip(np.round(moved_px / np.tile(fit.steps, 2)) + trials // 2, 0, trials - 1).astype(np.intp)
    return float(fit.grids[0, at[0], at[1]] + fit.grids[1, at[2], at[3]]) + fit.base


def levels_at(fit: Fit, moved_px: FloatArray) -> FloatArray:
    """Return the levels (2, blocks, 4, 3) of both lines, displaced outwards by (4,) px."""
    picked = _picked(fit, moved_px)
    return np.asarray(np.take_along_axis(fit.levels, picked[:, :, None, None, None], axis=2)[:, :, 0])


def noise_at(fit: Fit, moved_px: FloatArray) -> float:
    """Return the usual variance of a pixel about its profile, both lines displaced outwards by (4,) px."""
    own = np.take_along_axis(fit.misfit, _picked(fit, moved_px)[:, :, None], axis=2)[:, :, 0]
    return float(np.median(own / np.maximum(fit.freedom, 1.0)))


def no_lamps(lamps_m: float) -> bool:
    """Return whether a place of lamps stands for none."""
    return math.isinf(lamps_m)


def _picked(fit: Fit, moved_px: FloatArray) -> NDArray[np.intp]:
    """Return which trial (2, blocks) displaces both lines outwards by (4,) px."""
    blocks, trials = fit.misfit.shape[1:]
    at = np.stack([_along(blocks, own) for own in moved_px.reshape(2, 2)]) / _along(blocks, fit.steps) + trials // 2
    return np.asarray(np.clip(np.round(at), 0, trials - 1).astype(np.intp))


def _along(blocks: int, ends: FloatArray) -> FloatArray:
    """Return values (blocks,) between those at the upper and the lower row (2,)."""
    t = (np.arange(blocks) + 0.5) / blocks
    return np.asarray(ends[0] * (1.0 - t) + ends[1] * t)
