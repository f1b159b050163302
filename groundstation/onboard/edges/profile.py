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
from groundstation.onboard.edges.profile_kernel import gather, line_likelihood, misfits


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileConfig:
    """Tuning of the profile.

    Attributes
    ----------
    blocks : of rows along an edge.
    bins, trials : of a profile, and displacements of the line; odd, a step apart, both about the line.
    least_step_px, step_m : a step at a row is the larger of the two.
    line_m : inner and outer side of a painted side line, inside the edge.
    blur_px : sigma of the picture across a line.
    paint_sigma : what the paint's excess (0 to 1) may differ by from block to block.
    alike : neighbouring bins and colours that err alike.
    outlier : likelihood of a block that shows something else, over its best.
    """

    blocks: int = 8
    bins: int = 41
    trials: int = 21
    least_step_px: float = 0.5
    step_m: float = 0.12
    line_m: tuple[float, float] = (-0.95, -0.5)
    lamps_m: tuple[float, float] = (0.7, 1.7)
    blur_px: float = 0.8
    paint_sigma: float = 0.04
    alike: float = 4.0
    outlier: float = 0.02
    floor_px: float = 0.4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProfiledEdges:
    """Crossings (4,) px, and their covariance (4, 4) px²."""

    crossings_px: FloatArray
    covariance_px2: FloatArray


def edges_by_profile(
    image: ImageArray,
    crossings_px: FloatArray,
    rows_px: FloatArray,
    px_per_m: FloatArray,
    config: ProfileConfig,
) -> ProfiledEdges:
    """Return the edges next to crossings (4,) by the profiles of a picture (h, w, 3) with its paint.

    ``px_per_m`` (2,) across the runway at the upper and the lower row.
    """
    steps = np.maximum(config.least_step_px, config.step_m * px_per_m)
    total = np.zeros((2, config.blocks, config.bins, 3))
    weight = np.zeros((2, config.blocks, config.bins))
    gather(image, crossings_px, rows_px, steps, total, weight)
    t = (np.arange(config.blocks) + 0.5) / config.blocks
    step = steps[0] * (1.0 - t) + steps[1] * t
    bins_per_m = (px_per_m[0] * (1.0 - t) + px_per_m[1] * t) / step
    places = np.array([config.line_m, config.lamps_m])
    bars = places[:, None, :] * bins_per_m[None, :, None]
    found, covariance = crossings_px.copy(), config.floor_px**2 * np.eye(4)
    for line in range(2):
        own = slice(2 * line, 2 * line + 2)
        lean = float(np.hypot(1.0, (crossings_px[own][1] - crossings_px[own][0]) / (rows_px[1] - rows_px[0])))
        blurs = np.hypot(config.blur_px * lean / step, 0.5)
        mean, spread = _line(total[line], weight[line], blurs, bars, steps, config)
        found[own] += (-1.0 if line == 0 else 1.0) * mean
        covariance[own, own] += spread
    return ProfiledEdges(crossings_px=found, covariance_px2=covariance)


def _line(
    total: FloatArray, weight: FloatArray, blurs: FloatArray, bars: FloatArray, steps: FloatArray, config: ProfileConfig
) -> tuple[FloatArray, FloatArray]:
    """Return how far outwards a line lies (2,) px, and its covariance (2, 2)."""
    blocks, trials = config.blocks, config.trials
    count = bars.shape[0]
    misfit, bright = np.empty((blocks, trials)), np.empty((blocks, trials, count, 3))
    curves, grid = np.empty((blocks, trials)), np.empty((trials, trials))
    mean, spread = np.zeros(2), np.zeros((2, 2))
    usual, stiffness = np.zeros((count, 3)), np.zeros(count)
    freedom = 3.0 * (weight > 0.0).sum(axis=1) / config.alike
    for turn in range(2):
        misfits(total, weight, blurs, bars, usual, stiffness, misfit, bright)
        curves[:] = -0.5 * freedom[:, None] * np.log(misfit / misfit.min(axis=1, keepdims=True))
        line_likelihood(curves, steps, config.outlier, grid, mean, spread)
        if turn == 0:
            t = (np.arange(blocks) + 0.5) / blocks
            at = (mean[0] * (1.0 - t) + mean[1] * t) / (steps[0] * (1.0 - t) + steps[1] * t) + trials // 2
            at = np.clip(np.round(at), 0, trials - 1).astype(int)
            usual[0] = np.median(bright[np.arange(blocks), at, 0][blocks // 2 :], axis=0)
            noise = float(np.median(misfit[np.arange(blocks), at] / np.maximum(3.0 * (weight > 0.0).sum(axis=1), 1.0)))
            stiffness[0] = noise / config.paint_sigma**2
    return mean, spread
