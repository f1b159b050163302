"""Positions of the edges by the profile across them: pavement, a painted line, the ground, lamps.

The energies compare two bands that move with the trial line. Where a painted line is half a metre inside the edge,
or lamps a metre outside, such bands have their optimum next to the edge: on the inner side of the paint (haze), or
where the lamps were removed (night). Here the pixels are the same for every trial: a window about the line. Each
block of rows is straightened to a profile, in steps that grow with the perspective; for each displacement its levels
(inside, outside, excess of paint and lamps) follow by least squares, through the picture's blur. The residual
gives the block's likelihood, profiled over its noise; a line through all blocks has their product, each
block with a probability of an outlier. The prior selects among the likely positions; mean and covariance are the
likelihood's own: where the far end is dark it is wide, and near rows and filter constrain it. Not in the paper.

Positions and brightness of line and lamps are accumulated and tested in `markings`.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.edge_measurement import EdgeMeasurement
from groundstation.onboard.edges.hidden_paint import PaintSight, whiteness
from groundstation.onboard.edges.layout_evidence import is_bright, seen_at_all
from groundstation.onboard.edges.line_shape import shaped
from groundstation.onboard.edges.markings import (
    OVER_GROUND,
    Change,
    Markings,
    compared,
    expected_excess,
    initial_markings,
    layout_at,
    unsettled_m2,
)
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import (
    OUTWARDS,
    EdgeProfiles,
    ProfileFit,
    ProfileView,
    best_displacement,
    edge_profiles,
    fit_layouts,
    levels_at,
    noise_at,
)
from groundstation.onboard.edges.profile_kernel import moments

# usual colour about the edges, 0 to 1, below which lamps are assumed on until layouts have been compared: as in
# `paint` 95 of 255 grey levels, well above night (60 to 80) and below day (from 125 on); dusk is on either side
_DARK_COLOUR = 0.37
# how much surer it is that ground as white as paint hides a line; how much of that is not the same at all ends
_SURER, _UNLIKE = 3.0, 0.25
# lamps that are seen where they stand, any width
_PLAIN = ProfileView()


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
    markings: Markings | None,
    config: ProfileConfig,
    *,
    layouts: int,
    view: ProfileView = _PLAIN,
) -> EdgeMeasurement:
    """Return the edges about initial crossings (4,) by the profiles of a picture (h, w, 3) with its paint.

    ``px_per_m`` (2,) across the runway at the upper and the lower row. The prior, crossings (4,) of covariance (4, 4),
    selects among likely positions and is not part of the result. ``markings`` of the picture before, None without.
    ``layouts``: how many other layouts are compared, with other lines; 0 for neither. ``view``: how the runway is seen.
    """
    weight = np.asarray(np.linalg.inv(prior_px2 * np.outer(OUTWARDS, OUTWARDS)), np.float64)
    offset = OUTWARDS * (predicted_px - guess_px)
    if markings is not None and markings.blur_px:
        config = replace(config, blur_px=markings.blur_px)
    wide = _profiles(image, guess_px, rows_px, px_per_m, view, (2.0, config.wide), config)
    if markings is None:
        dark = float(np.median(wide.total.sum(axis=3) / np.maximum(3.0 * wide.weight, 1e-9))) < _DARK_COLOUR
        markings = initial_markings(config, dark=dark)
    fit = _fitted(wide, markings, config.wide, config)
    moved, change = best_displacement(fit, offset, weight).moved_px, Change.NONE
    if layouts > 0 and markings.frames > 0:
        comparison = compared(markings, wide, moved, px_per_m, layouts, config)
        markings, moved, change = comparison.markings, comparison.moved_px, comparison.change
        if change is Change.NONE:
            markings = shaped(markings, wide, moved, px_per_m, config)
        else:
            fit = _fitted(wide, markings, config.wide, config)
    if markings.frames == 0:
        markings = _first_guess(markings, fit, moved, config)
    seen = seen_at_all(wide, fit, moved, config.values_as_one)
    crossings, light = guess_px + OUTWARDS * moved, _excess(fit, moved)[1]
    fine = _profiles(image, crossings, rows_px, px_per_m, view, (1.0, config.fine), config)
    fit = _fitted(fine, markings, config.fine, config)
    width_m = float(((crossings[2:] - crossings[:2]) / px_per_m).mean())
    sight = PaintSight(image=image, rows_px=rows_px, width_m=width_m)
    found = _result(fit, crossings, px_per_m, markings, light, config, sight, change=change)
    return replace(found, evidence=seen)


def _fitted(profiles: EdgeProfiles, markings: Markings, reach: int, config: ProfileConfig) -> ProfileFit:
    return fit_layouts(
        profiles,
        [layout_at(markings.places, config, markings)],
        expected_excess(markings, config),
        reach,
        config.values_as_one,
    )[0]


def _result(
    fit: ProfileFit,
    crossings: FloatArray,
    px_per_m: FloatArray,
    markings: Markings,
    light: FloatArray,
    config: ProfileConfig,
    sight: PaintSight,
    *,
    change: Change,
) -> EdgeMeasurement:
    """Return mean and covariance of the last fit, about crossings (4,), and the observations with it.

    Except for the ``light`` (blocks, 3) of lamps: near by the fine window, 2 m to either side, does not include them.
    """
    spreads, moved = np.zeros((4, 4)), np.zeros(4)
    for line in range(2):
        own, spread = slice(2 * line, 2 * line + 2), np.empty((2, 2))
        moments(fit.grids[line], fit.steps, moved[own], spread)
        spreads[own, own] = spread
    levels = levels_at(fit, moved)
    between = levels[:, :, 1] - levels[:, :, 0]
    lengths = np.sqrt((between**2).sum(axis=(1, 2)))
    excess = _excess(fit, moved)
    excess[1] = light
    markings = _remembered(markings, excess, noise_at(fit, moved), config)
    scale = OUTWARDS * np.tile(px_per_m, 2)
    merged_m2 = _merged_m2(markings, levels, sight, crossings, config) * (1.0 - _UNLIKE + _UNLIKE * np.eye(4))
    return EdgeMeasurement(
        crossings_px=crossings + OUTWARDS * moved,
        covariance_px2=spreads + config.floor_px**2 * np.eye(4),
        stated_px2=spreads + config.stated_floor_px**2 * np.eye(4),
        contrast=np.sqrt(np.median((between**2).mean(axis=2), axis=1)),
        agreement=float((between[0] * between[1]).sum()) / max(float(lengths[0] * lengths[1]), 1e-9),
        markings=markings,
        unsettled_px2=(unsettled_m2(markings, config) + merged_m2) * np.outer(scale, scale),
        change=change,
    )


def _merged_m2(
    markings: Markings, levels: FloatArray, sight: PaintSight, crossings: FloatArray, config: ProfileConfig
) -> float:
    """Return the second moment, m², of a side line that is as bright as the ground, or of ground taken for one.

    Where the ground is brighter than the pavement, as snow is, paint may not be told from it: the edge is farther out
    by a line that is not held, and farther in, as far as its inner side, by one that is held and looks like the ground.
    ``levels`` (2, blocks, 4, 3).
    """
    between = (levels[:, :, 1] - levels[:, :, 0]).mean(axis=2)
    if not is_bright(between):
        return 0.0
    # ground as white as paint, snow by day, hides a line for sure
    white = whiteness(levels[:, :, :2].mean(axis=(0, 1)), sight.level(crossings))
    share = min(config.merged_share * (1.0 + _SURER * white), 1.0)
    line_m = layout_at(markings.places, config, markings).line_m
    if line_m is None:
        return share * (config.line_width_m + config.merged_m) ** 2
    seen = is_bright((1.0 - OVER_GROUND) * levels[:, :, 2].mean(axis=2) - between)
    return 0.0 if seen else share * line_m[0] ** 2


def _steps(px_per_m: FloatArray, config: ProfileConfig) -> FloatArray:
    return np.asarray(np.maximum(config.least_step_px, config.step_m * px_per_m))


def _profiles(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    px_per_m: FloatArray,
    view: ProfileView,
    scale_reach: tuple[float, int],
    config: ProfileConfig,
) -> EdgeProfiles:
    scale, reach = scale_reach
    sizes = (config.blocks, 2 * (reach + config.beside) + 1)
    steps = scale * _steps(px_per_m, config)
    return edge_profiles(image, x, rows, px_per_m, steps, sizes, config.blur_px, scale, view)


def _excess(fit: ProfileFit, moved: FloatArray) -> FloatArray:
    """Return the excess (2, blocks, 3) of line and lamps, the mean of both edges, as far as paint and light go."""
    return np.asarray(np.clip(levels_at(fit, moved)[:, :, 2:].mean(axis=0).transpose(1, 0, 2), 0.0, 1.0))


def _remembered(markings: Markings, own: FloatArray, noise: float, config: ProfileConfig) -> Markings:
    """Return markings after a picture with the excess ``own`` (2, blocks, 3)."""
    part = 1.0 / min(markings.frames + 1, config.mark_frames)
    return replace(
        markings, excess=markings.excess + part * (own - markings.excess), noise=noise, frames=markings.frames + 1
    )


def _first_guess(markings: Markings, fit: ProfileFit, moved: FloatArray, config: ProfileConfig) -> Markings:
    """Return markings of a picture's wide fit, for its fine one: the paint is taken to be that of the near half."""
    own = _excess(fit, moved)
    own[0] = np.clip(np.median(levels_at(fit, moved)[:, config.blocks // 2 :, 2], axis=(0, 1)), 0.0, 1.0)
    return replace(markings, excess=own, noise=noise_at(fit, moved))
