"""Where an edge lies by the profile across it: pavement, a painted line beside the edge, the ground outside.

The energies compare two bands that move with the trial line. Where a painted line runs half a metre inside the edge,
or lamps a metre outside, such bands have their optimum beside the edge: on the inner side of the paint (haze), or in
what replaced the lamps (night). Here the pixels are the same for every trial: all within a window about the line, less
those that lamps cover. Each block of rows is straightened to a profile, in steps that grow with the perspective; for
each displacement its levels (inside, paint, outside) follow by least squares, through the picture's blur. What is left
over gives the block's likelihood, profiled over its noise; a line through all blocks is weighed by their product,
each block perhaps one of something else, and its mean and covariance are taken over the whole grid: where lamps or
darkness hide the far end it is wide, and near rows and filter hold it. Not in the paper.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.profile_kernel import best_lines, gather, line_likelihood, misfits, moments

_OUTWARDS = np.array([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileConfig:
    """Tuning of the profile.

    Attributes
    ----------
    blocks : of rows along an edge.
    wide, fine : displacements of the line to either side that are tried, first with steps of twice the size.
    beside : steps at either side of the trials that the profile goes on.
    least_step_px, step_m : a step at a row is the larger of the two.
    line_m, lamps_m : inner and outer side of a painted side line and of the lamps' light, outwards from the edge.
    blur_px : sigma of the picture across a line.
    paint_sigma : what the paint's excess (0 to 1) may differ by from block to block.
    mark_sigma, mark_frames : what the excess of either may differ by from what is usual, and over how many frames.
    alike : neighbouring bins and colours that err alike.
    outlier : likelihood of a block that shows something else, over its best.
    floor_px : sigma that no end goes below.
    """

    blocks: int = 8
    wide: int = 12
    fine: int = 6
    beside: int = 11
    least_step_px: float = 0.5
    step_m: float = 0.12
    line_m: tuple[float, float] = (-0.95, -0.5)
    lamps_m: tuple[float, float] = (0.7, 1.7)
    blur_px: float = 0.8
    paint_sigma: float = 0.04
    mark_sigma: float = 0.04
    mark_frames: int = 10
    alike: float = 4.0
    outlier: float = 0.02
    floor_px: float = 0.4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marks:
    """What excess (2, blocks, 3) painted lines and lamps usually have, 0 to 1, alike at both edges.

    ``noise`` is the variance of a pixel about its profile; ``frames`` of how many it is.

    Paint half a metre inside one place of the edge may be lamps a metre outside another, in one frame. Over some it
    is not: the paint is where it was.
    """

    excess: FloatArray
    noise: float
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProfiledEdges:
    """Crossings (4,) px, covariance (4, 4) px², contrast (2,) across both edges, agreement as of `strip.FoundEdges`."""

    crossings_px: FloatArray
    covariance_px2: FloatArray
    contrast: FloatArray
    agreement: float
    marks: Marks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fitted:
    """Of both lines: log-likelihoods (2, trials, trials), the curves' levels (2, blocks, trials, 4, 3), misfits."""

    grids: FloatArray
    levels: FloatArray
    misfit: FloatArray
    freedom: FloatArray
    steps: FloatArray


def reach_px(px_per_m: FloatArray, config: ProfileConfig) -> FloatArray:
    """Return how far off a line is found at either row (2,), px."""
    return np.asarray(2.0 * config.wide * _steps(px_per_m, config))


def edges_by_profile(
    image: ImageArray,
    guess_px: FloatArray,
    rows_px: FloatArray,
    px_per_m: FloatArray,
    predicted_px: FloatArray,
    prior_px2: FloatArray,
    marks: Marks | None,
    config: ProfileConfig,
) -> ProfiledEdges:
    """Return the edges about a guess (4,) by the profiles of a picture (h, w, 3) with its paint.

    ``px_per_m`` (2,) across the runway at the upper and the lower row. The prior, crossings (4,) of covariance (4, 4),
    chooses among likely places and is no part of the result.
    """
    weight = np.linalg.inv(prior_px2 * np.outer(_OUTWARDS, _OUTWARDS))
    found, usual, stiffness = guess_px.copy(), np.zeros((2, 2, config.blocks, 3)), np.zeros((2, 2))
    if marks is not None:
        usual[:] = marks.excess
        stiffness[:] = marks.noise / config.mark_sigma**2
    out = np.zeros(4)
    for scale, trials in ((2.0, config.wide), (1.0, config.fine)):
        fit = _fitted(image, found, rows_px, px_per_m, (scale, trials), usual, stiffness, config)
        best_lines(fit.grids, fit.steps, _OUTWARDS * (predicted_px - found), weight, out)
        if scale > 1.0:
            if marks is None:
                usual, stiffness = _usual(fit, out, config)
            found += _OUTWARDS * out
    covariance = config.floor_px**2 * np.eye(4)
    moved = np.zeros(4)
    for line in range(2):
        own = slice(2 * line, 2 * line + 2)
        spread = np.empty((2, 2))
        moments(fit.grids[line], fit.steps, moved[own], spread)
        covariance[own, own] += spread
    levels = _at(fit, moved)
    between = levels[:, :, 1] - levels[:, :, 0]
    own = levels[:, :, 2:].mean(axis=0).transpose(1, 0, 2)
    if marks is None:
        marks = Marks(excess=own, noise=_noise(fit, moved), frames=1)
    else:
        part = 1.0 / min(marks.frames + 1, config.mark_frames)
        marks = Marks(excess=marks.excess + part * (own - marks.excess), noise=_noise(fit, moved), frames=marks.frames + 1)
    lengths = np.sqrt((between**2).sum(axis=(1, 2)))
    return ProfiledEdges(
        crossings_px=found + _OUTWARDS * moved,
        covariance_px2=covariance,
        contrast=np.sqrt(np.median((between**2).mean(axis=2), axis=1)),
        agreement=float((between[0] * between[1]).sum()) / max(float(lengths[0] * lengths[1]), 1e-9),
        marks=marks,
    )


def _steps(px_per_m: FloatArray, config: ProfileConfig) -> FloatArray:
    return np.asarray(np.maximum(config.least_step_px, config.step_m * px_per_m))


def _fitted(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    px_per_m: FloatArray,
    scale_trials: tuple[float, int],
    usual: FloatArray,
    stiffness: FloatArray,
    config: ProfileConfig,
) -> _Fitted:
    """Return the likelihoods of displacements of both lines x (4,)."""
    blocks, (scale, reach) = config.blocks, scale_trials
    steps = scale * _steps(px_per_m, config)
    bins, trials = 2 * (reach + config.beside) + 1, 2 * reach + 1
    total, weight = np.zeros((2, blocks, bins, 3)), np.zeros((2, blocks, bins))
    gather(image, x, rows, steps, total, weight)
    t = (np.arange(blocks) + 0.5) / blocks
    step = steps[0] * (1.0 - t) + steps[1] * t
    bins_per_m = (px_per_m[0] * (1.0 - t) + px_per_m[1] * t) / step
    bars = np.array([config.line_m, config.lamps_m])[:, None, :] * bins_per_m[None, :, None]
    misfit, levels = np.empty((2, blocks, trials)), np.empty((2, blocks, trials, 4, 3))
    grids = np.empty((2, trials, trials))
    freedom = 3.0 * (weight > 0.0).sum(axis=2)
    for line in range(2):
        lean = float(np.hypot(1.0, (x[2 * line + 1] - x[2 * line]) / (rows[1] - rows[0])))
        blurs = np.hypot(config.blur_px * lean / step, 0.5)
        misfits(total[line], weight[line], blurs, bars, usual[line], stiffness[line], misfit[line], levels[line])
        ratio = misfit[line].min(axis=1, keepdims=True) / misfit[line]
        curves = ratio ** (0.5 * scale * freedom[line, :, None] / config.alike)
        line_likelihood(curves, steps, config.outlier, grids[line])
    return _Fitted(grids=grids, levels=levels, misfit=misfit, freedom=freedom, steps=steps)


def _at(fit: _Fitted, moved: FloatArray) -> FloatArray:
    """Return the levels (2, blocks, 4, 3) of both lines, displaced outwards by (4,) px."""
    picked = _picked(fit, moved)
    return np.asarray(np.take_along_axis(fit.levels, picked[:, :, None, None, None], axis=2)[:, :, 0])


def _picked(fit: _Fitted, moved: FloatArray) -> FloatArray:
    """Return which trial (2, blocks) displaces both lines outwards by (4,) px."""
    blocks, trials = fit.misfit.shape[1:]
    t = (np.arange(blocks) + 0.5) / blocks
    own = moved.reshape(2, 2)
    at = (own[:, :1] * (1.0 - t) + own[:, 1:] * t) / (fit.steps[0] * (1.0 - t) + fit.steps[1] * t) + trials // 2
    return np.clip(np.round(at), 0, trials - 1).astype(np.intp)


def _noise(fit: _Fitted, moved: FloatArray) -> float:
    """Return the usual variance of a pixel about its profile, both lines displaced outwards by (4,) px."""
    own = np.take_along_axis(fit.misfit, _picked(fit, moved)[:, :, None], axis=2)[:, :, 0]
    return float(np.median(own / np.maximum(fit.freedom, 1.0)))


def _usual(fit: _Fitted, moved: FloatArray, config: ProfileConfig) -> tuple[FloatArray, FloatArray]:
    """Return the usual excess (2, 2, blocks, 3) of line and lamps, and how stiffly (2, 2): the near paint's alone."""
    blocks = fit.levels.shape[1]
    usual, stiffness = np.zeros((2, 2, blocks, 3)), np.zeros((2, 2))
    usual[:, 0] = np.median(_at(fit, moved)[:, blocks // 2 :, 2], axis=1)[:, None]
    stiffness[:, 0] = _noise(fit, moved) / config.paint_sigma**2
    return usual, stiffness
