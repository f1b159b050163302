"""Profiles across both edges of one picture, fitted with pavement, painted line, lamps and ground."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.coordinate_ascent import best_displacements
from groundstation.onboard.edges.gather_kernel import gather
from groundstation.onboard.edges.judging_kernel import usual_noise
from groundstation.onboard.edges.layout_kernel import refine_displacement
from groundstation.onboard.edges.profile_kernel import (
    ExcessPrior,
    line_likelihood,
    misfits,
    picked_levels,
    picked_trials,
)
from groundstation.onboard.edges.width_prior import WidthPrior

OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])
# half of how far, across the runway, the light of lamps reaches about their line
_LAMP_M = 0.5
# orthonormal: grey, blue against red, both against green
GREY_AND_TINTS = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, -1.0], [1.0, -2.0, 1.0]])
GREY_AND_TINTS /= np.linalg.norm(GREY_AND_TINTS, axis=1)[:, None]
OUTLIER = 0.02  # likelihood of an outlier block of rows, over its best
LEAST_BLUR = 0.5
# weight of what is known before a picture, that the ground next to an edge is as bright farther out, in pixels
_LEVEL = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LampParallax:
    """Displacement of lamps, which are higher than the ground, in their projection onto it.

    Outwards from the edge: ``scale`` times the distance, plus ``shift_m`` of the left and of the right line.
    """

    scale: float = 1.0
    shift_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileView:
    """How the runway is seen: where lamps are, its width, and metres along it in a row, upper and lower one.

    ``width`` and ``along_m`` are None where they are not known.
    """

    lamps: LampParallax = LampParallax()
    width: WidthPrior | None = None
    along_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeProfiles:
    """Profiles across both edges, straightened along them.

    Attributes
    ----------
    total, weight : sums of colours (2, blocks, bins, 3), and weights (2, blocks, bins).
    steps : (2,) px of a bin at the upper and the lower row.
    bins_per_m : (blocks,).
    blurs : (2, blocks) sigma of the picture's blur, in bins.
    coarse : how many of the finest steps a bin has.
    view : of the runway.
    squares : (2, blocks, bins) sums of the squares of a pixel's grey; (2, 0, 0) where nothing asks for them.
    width_m : of the runway between the lines about which they are taken.
    """

    total: FloatArray
    weight: FloatArray
    steps: FloatArray
    bins_per_m: FloatArray
    blurs: FloatArray
    coarse: float
    view: ProfileView
    squares: FloatArray
    width_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """A side line's inner and outer side and the lamps' place, m outwards from the edge; None for none."""

    line_m: tuple[float, float] | None
    lamps_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedExcess:
    """Expected excess (2, blocks, 3) of line and lamps, and the weight (2,) of this prior, in pixels."""

    excess: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JudgedMisfits:
    """Misfits (2, blocks, trials) with all that a layout is free to fit, the least, and their powers, (2, blocks)."""

    misfit: FloatArray
    least: FloatArray
    power: FloatArray
    outlier: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProfileFit:
    """Log-likelihoods of both lines (2, trials, trials), relative to ``base``, and the best levels.

    ``levels`` (2, blocks, trials, 4, 3): pavement, ground, excess of line and lamps; ``misfit`` (2, blocks, trials) in
    pixels, ``freedom`` (2, blocks) how many these are; ``steps`` (2,) px between trials. ``judged`` is what the
    log-likelihoods are of, where they are looked at between trials. ``tinted``: levels are of grey and two tints.
    """

    grids: FloatArray
    base: float
    levels: FloatArray
    misfit: FloatArray
    freedom: FloatArray
    steps: FloatArray
    judged: JudgedMisfits | None = None
    tinted: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BestDisplacement:
    """Outward displacements of both lines (4,) px on the grid, and their log-likelihood, the prior's part included."""

    moved_px: FloatArray
    evidence: float


def edge_profiles(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    px_per_m: FloatArray,
    steps: FloatArray,
    sizes: tuple[int, int],
    blur_px: float,
    coarse: float,
    view: ProfileView,
) -> EdgeProfiles:
    """Return the profiles about lines x (4,), of (blocks, bins) ``sizes``; ``steps`` (2,) px of a bin at both rows."""
    total, weight = np.zeros((2, *sizes, 3)), np.zeros((2, *sizes))
    squares = np.zeros((2, *sizes) if view.along_m is not None and coarse > 1.0 else (2, 0, 0))
    gather(image, x, rows, steps, total, weight, squares)
    step, m = _along(sizes[0], steps), _along(sizes[0], px_per_m)
    lean = np.hypot(1.0, (x[1::2] - x[::2]) / (rows[1] - rows[0]))
    blurs = np.hypot(blur_px * lean[:, None] / step, LEAST_BLUR)
    return EdgeProfiles(
        total=total,
        weight=weight,
        steps=steps,
        bins_per_m=m / step,
        blurs=blurs,
        coarse=coarse,
        view=view,
        squares=squares,
        width_m=float(np.mean((x[2:] - x[:2]) / px_per_m)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LayoutLevels:
    """Least squares of several layouts.

    ``misfit`` (2, layouts, blocks, trials) in pixels, ``levels`` (2, layouts, blocks, trials, 4, 3) of grey and two
    tints, ``freedom`` (2, blocks), and ``bars`` (2, layouts, 2, blocks, 2): the sides of line and lamps, in bins.
    """

    misfit: FloatArray
    levels: FloatArray
    freedom: FloatArray
    bars: FloatArray


def fit_layouts(
    profiles: EdgeProfiles, layouts: list[Layout], usual: ExpectedExcess | None, reach: int, values_as_one: float
) -> list[ProfileFit]:
    """Return of each layout the likelihood of displacements of ``reach`` bins to either side.

    So many values count as one. ``usual`` is the excess of the first layout; None: any paint and light.
    """
    found = layout_levels(profiles, layouts, usual, reach)
    least = found.misfit.min(axis=3)
    return layout_likelihoods(profiles, found, found.misfit, least, values_as_one, OUTLIER)


def layout_levels(
    profiles: EdgeProfiles, layouts: list[Layout], usual: ExpectedExcess | None, reach: int
) -> LayoutLevels:
    """Return the levels of least squares of each layout; the arguments are those of `fit_layouts`."""
    blocks, trials, count = profiles.weight.shape[1], 2 * reach + 1, len(layouts)
    sides_m = np.array([[_sides(layout, profiles.view.lamps, line) for layout in layouts] for line in range(2)])
    bars = sides_m[:, :, :, None, :] * profiles.bins_per_m[:, None]
    there = bars[0, 0, :, 0, 0] < bars[0, 0, :, 0, 1]
    misfit, levels = np.empty((2, count, blocks, trials)), np.zeros((2, count, blocks, trials, 4, 3))
    excess, stiffness = np.zeros((2, blocks, 3)), np.zeros(2)
    if usual is not None:
        excess, stiffness = usual.excess * there[:, None, None], usual.stiffness
    prior = ExcessPrior(excess=np.ascontiguousarray(excess @ GREY_AND_TINTS.T), stiffness=stiffness)
    for line in range(2):
        total = np.ascontiguousarray(profiles.total[line] @ GREY_AND_TINTS.T)
        weight, blurs = profiles.weight[line], profiles.blurs[line]
        misfits(total, weight, blurs, bars[line], prior, misfit[line], levels[line], True, _LEVEL)
    freedom = 3.0 * (profiles.weight > 0.0).sum(axis=2)
    return LayoutLevels(misfit=misfit, levels=levels, freedom=freedom, bars=bars)


def layout_likelihoods(
    profiles: EdgeProfiles,
    found: LayoutLevels,
    misfit: FloatArray,
    least: FloatArray,
    values_as_one: float,
    outlier: float,
) -> list[ProfileFit]:
    """Return the likelihoods of layouts by their misfits (2, layouts, blocks, trials).

    A block of rows is an outlier with so much of the likelihood of the ``least`` misfits (2, layouts, blocks). Where
    these are those of all layouts a layout is not worth what blocks alone would fit with it, elsewhere.
    """
    count, trials = misfit.shape[1], misfit.shape[3]
    grids, bases = np.empty((count, 2, trials, trials)), np.zeros(count)
    powers = 0.5 * profiles.coarse * found.freedom / values_as_one
    for line in range(2):
        power = powers[line]
        curves = (least[line][:, :, None] / misfit[line]) ** power[:, None]
        for k in range(count):
            line_likelihood(curves[k], profiles.steps, outlier, grids[k, line])
        bases -= (power * np.log(least[line] / np.maximum(found.freedom[line], 1.0))).sum(axis=1)
    return [
        ProfileFit(
            grids=grids[k],
            base=float(bases[k]),
            levels=found.levels[:, k],
            misfit=found.misfit[:, k],
            freedom=found.freedom,
            steps=profiles.steps,
            tinted=True,
            judged=JudgedMisfits(misfit=misfit[:, k], least=least[:, k], power=powers, outlier=outlier),
        )
        for k in range(count)
    ]


def _sides(layout: Layout, lamp_parallax: LampParallax, line: int) -> list[tuple[float, float]]:
    """Return inner and outer side of line and lamps, m outwards on the ground; of zero width if absent."""
    sides = [layout.line_m or (0.0, 0.0), (0.0, 0.0)]
    if layout.lamps_m is not None:
        seen_m = lamp_parallax.scale * layout.lamps_m + lamp_parallax.shift_m[line]
        sides[1] = (seen_m - _LAMP_M, seen_m + _LAMP_M)
    return sides


def best_displacement(fit: ProfileFit, offset_px: FloatArray, weight: FloatArray) -> BestDisplacement:
    """Return the likeliest displacement; the prior's mean is at ``offset_px`` (4,), its inverse covariance (4, 4)."""
    moved = np.zeros(4)
    evidence = float(best_displacements(fit.grids, -np.inf, fit.steps, offset_px, weight, moved))
    return BestDisplacement(moved_px=moved, evidence=evidence + fit.base)


def refined_displacement(fit: ProfileFit, offset_px: FloatArray, weight: FloatArray) -> BestDisplacement:
    """Return the likeliest displacement between the trials of the grid; arguments as of `best_displacement`.

    Layouts differ by less than a trial's step: a mark that is half a step off fits badly, and its layout with it.
    """
    best, judged = best_displacement(fit, offset_px, weight), fit.judged
    if judged is None:
        return best
    moved = best.moved_px.copy()
    evidence = refine_displacement(
        np.ascontiguousarray(judged.misfit), np.ascontiguousarray(judged.least), judged.power, judged.outlier,
        fit.steps, offset_px, weight, moved,
    )  # fmt: skip
    return BestDisplacement(moved_px=moved, evidence=float(evidence) + fit.base)


def likelihood_at(fit: ProfileFit, moved_px: FloatArray) -> float:
    """Return the log-likelihood of both lines displaced outwards by (4,) px, as of the nearest place on the grid."""
    trials = fit.grids.shape[1]
    at = np.clip(np.round(moved_px / np.tile(fit.steps, 2)) + trials // 2, 0, trials - 1).astype(np.intp)
    return float(fit.grids[0, at[0], at[1]] + fit.grids[1, at[2], at[3]]) + fit.base


def levels_at(fit: ProfileFit, moved_px: FloatArray) -> FloatArray:
    """Return the levels (2, blocks, 4, 3) of both lines, displaced outwards by (4,) px."""
    out = np.empty((*fit.misfit.shape[:2], 4, 3))
    picked_levels(fit.levels, fit.steps, moved_px, out)
    return out @ GREY_AND_TINTS if fit.tinted else out


def picked_blocks(fit: ProfileFit, moved_px: FloatArray) -> NDArray[np.int64]:
    """Return which trial (2, blocks) displaces each block of both lines, moved outwards by (4,) px."""
    picked = np.empty(fit.misfit.shape[:2], np.int64)
    picked_trials(fit.misfit.shape[2], fit.steps, moved_px, picked)
    return picked


def noise_at(fit: ProfileFit, moved_px: FloatArray) -> float:
    """Return the usual variance of a pixel about its profile, both lines displaced outwards by (4,) px."""
    return float(usual_noise(np.ascontiguousarray(fit.misfit), fit.freedom, picked_blocks(fit, moved_px)))


def _along(blocks: int, ends: FloatArray) -> FloatArray:
    """Return values (blocks,) between those at the upper and the lower row (2,)."""
    t = (np.arange(blocks) + 0.5) / blocks
    return np.asarray(ends[0] * (1.0 - t) + ends[1] * t)
