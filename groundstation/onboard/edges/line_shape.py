"""How wide the painted side line is, where exactly it lies, and how sharp the picture is, for the layout that is held.

Layouts are compared on a grid of places, with a line as wide as usual. Near by a line a quarter of a metre aside, or
wider by half, puts the edge several px off. In each picture the held line is compared with two others: some way in and
out, narrower and wider, or, whatever the layout, with a picture that is sharper and less sharp; gains are summed as
those of layouts are, and a better one takes its place. With too much blur lamps two metres outside the edge fit a
camera's sharp line as well as paint does.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.layout_evidence import limited, same_row_prior, weighed_layouts
from groundstation.onboard.edges.markings import Markings, layout_at
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import (
    LEAST_BLUR,
    EdgeProfiles,
    fit_layouts,
    picked_blocks,
    refined_displacement,
)

# steps of the place, m, and of the width, a factor; limits of both
_STEP_M, _FACTOR = 0.1, 1.25
_MOST_OFF_M, _LEAST_WIDTH_M, _MOST_WIDTH_M = 0.3, 0.15, 1.2
_FORGET = 0.9
# which of the three pairs is the blur's; its limits, px, and the most that a block of rows tells of it
_BLUR, _LEAST_BLUR_PX, _MOST_BLUR_PX, _MOST_BLOCK = 2, 0.3, 2.0, 2.0


def shaped(
    markings: Markings, profiles: EdgeProfiles, moved_px: FloatArray, px_per_m: FloatArray, config: ProfileConfig
) -> Markings:
    """Return markings whose line is wider, narrower or elsewhere by a step where pictures have shown it."""
    turn = markings.frames % 3
    if turn == _BLUR:
        variants = _blurs(markings, config)
        worth = _sharpness(markings, variants, profiles, moved_px, config)
    else:
        if config.lines_m[markings.places[0]] is None:
            return markings
        variants = _lines(markings, config)[2 * turn : 2 * turn + 2]
        worth = _places(markings, variants, profiles, moved_px, px_per_m, config)
    gains = markings.shape_gains.copy()
    for k, variant in enumerate(variants):
        gains[2 * turn + k] = _FORGET * gains[2 * turn + k] + limited(worth[k], config)
        if variant is markings:
            gains[2 * turn + k] = 0.0
    best = int(gains.argmax()) - 2 * turn
    if best in (0, 1) and gains[2 * turn + best] > config.shape_margin:
        gains[2 * turn : 2 * turn + 2] = 0.0
        return replace(variants[best], shape_gains=gains)
    return replace(markings, shape_gains=gains)


def _places(
    markings: Markings,
    variants: list[Markings],
    profiles: EdgeProfiles,
    moved_px: FloatArray,
    px_per_m: FloatArray,
    config: ProfileConfig,
) -> list[float]:
    """Return the log-likelihood gain of other lines, the edges being free to move with them."""
    prior = same_row_prior(np.tile(px_per_m, 2), config)
    layouts = [layout_at(markings.places, config, one) for one in (markings, *variants)]
    held, *others = [
        refined_displacement(fit, moved_px, prior).evidence
        for fit in weighed_layouts(profiles, layouts, moved_px, prior, config)
    ]
    return [other - held for other in others]


def _sharpness(
    markings: Markings,
    variants: list[Markings],
    profiles: EdgeProfiles,
    moved_px: FloatArray,
    config: ProfileConfig,
) -> list[float]:
    """Return the log-likelihood gain of other blurs, the edges where they are; a block of rows has a share at most."""
    layout, found = layout_at(markings.places, config, markings), list[FloatArray]()
    usual = markings.blur_px or config.blur_px
    for one in (markings, *variants):
        optics = np.sqrt(np.maximum(profiles.blurs**2 - LEAST_BLUR**2, 0.0)) * ((one.blur_px or usual) / usual)
        blurred = replace(profiles, blurs=np.hypot(optics, LEAST_BLUR))
        fit = fit_layouts(blurred, [layout], None, config.wide, config.values_as_one)[0]
        picked = picked_blocks(fit, moved_px)
        misfit = np.take_along_axis(fit.misfit, picked[:, :, None], axis=2)[:, :, 0]
        found.append(-0.5 * profiles.coarse * fit.freedom / config.values_as_one * np.log(misfit))
    return [float(np.clip(other - found[0], -_MOST_BLOCK, _MOST_BLOCK).sum()) for other in found[1:]]


def _blurs(markings: Markings, config: ProfileConfig) -> list[Markings]:
    """Return markings of a sharper picture and a less sharp one; the same ones at a limit."""
    found = []
    for factor in (1.0 / _FACTOR, _FACTOR):
        blur_px = (markings.blur_px or config.blur_px) * factor
        allowed = _LEAST_BLUR_PX <= blur_px <= _MOST_BLUR_PX
        found.append(replace(markings, blur_px=blur_px) if allowed else markings)
    return found


def _lines(markings: Markings, config: ProfileConfig) -> list[Markings]:
    """Return markings with the line farther in, farther out, narrower and wider; the same ones at a limit.

    A wider line is so on both sides.
    """
    own = markings.line_width_m or config.line_width_m
    found = []
    for off_m, width_m in (
        (-_STEP_M, own),
        (_STEP_M, own),
        (0.5 * (own / _FACTOR - own), own / _FACTOR),
        (0.5 * (own * _FACTOR - own), own * _FACTOR),
    ):
        new = markings.line_off_m + off_m
        allowed = abs(new) <= _MOST_OFF_M and _LEAST_WIDTH_M <= width_m <= _MOST_WIDTH_M
        found.append(replace(markings, line_off_m=new, line_width_m=width_m) if allowed else markings)
    return found
