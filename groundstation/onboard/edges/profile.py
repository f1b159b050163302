"""Where the edges lie by the profile across them: pavement, a painted line, the ground, lamps.

The energies compare two bands that move with the trial line. Where a painted line runs half a metre inside the edge,
or lamps a metre outside, such bands have their optimum beside the edge: on the inner side of the paint (haze), or in
what replaced the lamps (night). Here the pixels are the same for every trial: all within a window about the line. Each
block of rows is straightened to a profile, in steps that grow with the perspective; for each displacement its levels
(inside, outside, what paint and lamps add) follow by least squares, through the picture's blur. What is left over
gives the block's likelihood, profiled over its noise; a line through all blocks is weighed by their product, each
block perhaps one of something else. The prior chooses among the likely places; mean and covariance are the
likelihood's own: where darkness hides the far end it is wide, and near rows and filter hold it. Not in the paper.

Paint half a metre inside one place of the edge may be lamps a metre outside another, in one picture; over some it is
not. What both usually look like is remembered (`Marks`). By turns it is asked whether other lines do better without
that memory, and another place of the lamps, or none, is tried: in each picture at first, then in every other.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.profile_fit import (
    OUTWARDS,
    Beside,
    Fit,
    Straightened,
    fitted,
    levels_at,
    likeliest,
    likelihood_at,
    no_lamps,
    noise_at,
    straightened,
)
from groundstation.onboard.edges.profile_kernel import moments

_FORGET = 0.9
# what one picture may say for or against a place of the lamps
_MOST = 100.0
# by how many of its sigmas the light of lamps has to be more than none
_BRIGHT = 3.0
# usual colour of a dark picture, 0 to 1: there lamps are looked for from the first
_DARK = 0.37


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileConfig:
    """Tuning of the profile.

    Attributes
    ----------
    blocks : of rows along an edge.
    wide, fine : displacements of the line to either side that are tried, first with steps of twice the size.
    beside : steps at either side of the trials that the profile goes on.
    least_step_px, step_m : a step at a row is the larger of the two.
    line_m : inner and outer side of a painted side line, outwards from the edge; told, not learned, as rendered: by
        ICAO's Annex 14 (5.2.7) it is 0.45 m wide on runways narrower than 30 m, its outer side about on the edge.
    lamps_m : places where lamps may stand, outwards from the edge, the likeliest first; infinite for none.
    lamps_cost, lamps_margin : log-likelihood that lamps have to be worth, and another place of them in all.
    stray_steps, stray_cost, stray_margin : how far off other lines are, in wide steps, what they have to be likelier
        by in a picture, and over that in all.
    blur_px : sigma of the picture across a line.
    mark_sigma, mark_frames : what the excess (0 to 1) of paint and lamps may differ by from what is usual, and over
        how many frames that is taken.
    check_frames : with so many seen, lines and lamps are doubted once in this many frames.
    alike : neighbouring bins and colours that err alike.
    floor_px : sigma that no end goes below.
    """

    blocks: int = 8
    wide: int = 12
    fine: int = 6
    beside: int = 11
    least_step_px: float = 0.5
    step_m: float = 0.12
    line_m: tuple[float, float] = (-0.95, -0.5)
    lamps_m: tuple[float, ...] = (math.inf, 1.0, 1.5, 2.0, 2.5, 3.0)
    lamps_cost: float = 25.0
    lamps_margin: float = 20.0
    stray_steps: float = 4.0
    stray_cost: float = 5.0
    stray_margin: float = 10.0
    blur_px: float = 0.8
    mark_sigma: float = 0.04
    mark_frames: int = 10
    check_frames: int = 2
    alike: float = 4.0
    floor_px: float = 0.4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marks:
    """What is beside the edges: usual excess (2, blocks, 3) of painted line and lamps, 0 to 1, alike at both edges.

    ``noise`` is the variance of a pixel about its profile; ``frames`` of how many it is; ``lamps`` which place of the
    configuration's they have, ``gains`` what each place (places,) was better by of late, and ``strayed`` what other
    lines than those followed were.
    """

    excess: FloatArray
    noise: float
    frames: int
    lamps: int
    gains: FloatArray
    strayed: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProfiledEdges:
    """Crossings (4,) px, covariance (4, 4) px², contrast (2,) across both edges, agreement as of `strip.FoundEdges`.

    With ``strayed`` they are other lines than those that were followed, and the prior was not heeded.
    """

    crossings_px: FloatArray
    covariance_px2: FloatArray
    contrast: FloatArray
    agreement: float
    marks: Marks
    strayed: bool


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
    *,
    checks: bool = True,
) -> ProfiledEdges:
    """Return the edges about a guess (4,) by the profiles of a picture (h, w, 3) with its paint.

    ``px_per_m`` (2,) across the runway at the upper and the lower row. The prior, crossings (4,) of covariance (4, 4),
    chooses among likely places and is no part of the result. ``marks`` of the picture before, None of a first one.
    Without ``checks`` neither other lines nor other places of the lamps are tried.
    """
    weight = np.asarray(np.linalg.inv(prior_px2 * np.outer(OUTWARDS, OUTWARDS)), np.float64)
    offset = OUTWARDS * (predicted_px - guess_px)
    wide = _profiles(image, guess_px, rows_px, px_per_m, (2.0, config.wide), config)
    if marks is None:
        dark = float(np.median(wide.total.sum(axis=3) / np.maximum(3.0 * wide.weight, 1e-9))) < _DARK
        marks = _blank(config, next((k for k, at in enumerate(config.lamps_m) if no_lamps(at) != dark), 0))
    strayed = False
    fit = fitted(wide, _beside(marks, config), config.wide, config.alike)
    moved = likeliest(fit, offset, weight).moved_px
    turn, between = divmod(marks.frames, 1 if marks.frames <= config.mark_frames else config.check_frames)
    checks = checks and marks.frames > 1 and between == 0
    if checks and turn % 2 == 0:
        marks, other = _doubted(marks, wide, moved, config)
        strayed = marks.frames == 0
        moved = other if strayed else moved
    elif checks:
        marks = _with_lamps(marks, turn // 2, wide, (offset, weight), config)
    if marks.frames == 0:
        marks = _seen(marks, fit, moved, config, near=True)
    crossings = guess_px + OUTWARDS * moved
    fine = _profiles(image, crossings, rows_px, px_per_m, (1.0, config.fine), config)
    fit = fitted(fine, _beside(marks, config), config.fine, config.alike)
    return _result(fit, crossings, marks, config, strayed=strayed)


def _result(fit: Fit, crossings: FloatArray, marks: Marks, config: ProfileConfig, *, strayed: bool) -> ProfiledEdges:
    """Return mean and covariance of the last fit, about crossings (4,), and what was seen with it."""
    covariance, moved = config.floor_px**2 * np.eye(4), np.zeros(4)
    for line in range(2):
        own, spread = slice(2 * line, 2 * line + 2), np.empty((2, 2))
        moments(fit.grids[line], fit.steps, moved[own], spread)
        covariance[own, own] += spread
    levels = levels_at(fit, moved)
    between = levels[:, :, 1] - levels[:, :, 0]
    lengths = np.sqrt((between**2).sum(axis=(1, 2)))
    return ProfiledEdges(
        crossings_px=crossings + OUTWARDS * moved,
        covariance_px2=covariance,
        contrast=np.sqrt(np.median((between**2).mean(axis=2), axis=1)),
        agreement=float((between[0] * between[1]).sum()) / max(float(lengths[0] * lengths[1]), 1e-9),
        marks=_seen(marks, fit, moved, config),
        strayed=strayed,
    )


def _steps(px_per_m: FloatArray, config: ProfileConfig) -> FloatArray:
    return np.asarray(np.maximum(config.least_step_px, config.step_m * px_per_m))


def _profiles(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    px_per_m: FloatArray,
    scale_reach: tuple[float, int],
    config: ProfileConfig,
) -> Straightened:
    scale, reach = scale_reach
    sizes = (config.blocks, 2 * (reach + config.beside) + 1)
    return straightened(image, x, rows, px_per_m, scale * _steps(px_per_m, config), sizes, config.blur_px, scale)


def _beside(marks: Marks, config: ProfileConfig) -> Beside:
    """Return what is expected beside the edges; of a single picture, the lamps' light is no measure for the next."""
    held = marks.noise / config.mark_sigma**2
    stiffness = np.array([held if marks.frames > 0 else 0.0, held if marks.frames > 1 else 0.0])
    return Beside(line_m=config.line_m, lamps_m=config.lamps_m[marks.lamps], excess=marks.excess, stiffness=stiffness)


def _seen(marks: Marks, fit: Fit, moved: FloatArray, config: ProfileConfig, *, near: bool = False) -> Marks:
    """Return marks after a fit; with ``near``, a first guess: the paint is taken to be that of the near half."""
    own = levels_at(fit, moved)[:, :, 2:].mean(axis=0).transpose(1, 0, 2)
    if near:
        own[0] = np.median(levels_at(fit, moved)[:, config.blocks // 2 :, 2], axis=(0, 1))
    part = 1.0 / min(marks.frames + 1, config.mark_frames)
    return Marks(
        excess=marks.excess + part * (own - marks.excess),
        noise=noise_at(fit, moved),
        frames=1 if near else marks.frames + 1,
        lamps=marks.lamps,
        gains=marks.gains,
        strayed=marks.strayed,
    )


def _blank(config: ProfileConfig, lamps: int) -> Marks:
    """Return marks of which nothing is known, but where the lamps are taken to be."""
    excess, gains = np.zeros((2, config.blocks, 3)), np.zeros(len(config.lamps_m))
    return Marks(excess=excess, noise=0.0, frames=0, lamps=lamps, gains=gains, strayed=0.0)


def _doubted(
    marks: Marks, profiles: Straightened, moved: FloatArray, config: ProfileConfig
) -> tuple[Marks, FloatArray]:
    """Return marks, blank where other lines have been likelier for long than those followed; and the likeliest, (4,).

    Both with any paint, and with a prior about the lines searched for that is as wide as what is searched; those
    followed are moved by (4,) px.
    """
    expected = _beside(marks, config)
    free = fitted(profiles, replace(expected, stiffness=expected.stiffness * [0.0, 1.0]), config.wide, config.alike)
    loose = np.diag(1.0 / (config.stray_steps * np.tile(free.steps, 2)) ** 2)
    best = likeliest(free, np.zeros(4), loose)
    held = likelihood_at(free, moved) - 0.5 * float(moved @ loose @ moved)
    strayed = max(_FORGET * marks.strayed + best.evidence - held - config.stray_cost, 0.0)
    if strayed > config.stray_margin:
        return _blank(config, marks.lamps), best.moved_px
    return replace(marks, strayed=strayed), best.moved_px


def _any_light(
    marks: Marks, profiles: Straightened, lamps: int, prior: tuple[FloatArray, FloatArray], config: ProfileConfig
) -> float:
    """Return the likelihood of lamps at a place, however bright; nothing where they are no brighter than chance."""
    expected, lamps_m = _beside(marks, config), config.lamps_m[lamps]
    expected = replace(expected, lamps_m=lamps_m, stiffness=expected.stiffness * [1.0, 0.0])
    fit = fitted(profiles, expected, config.wide, config.alike)
    best = likeliest(fit, *prior)
    if not no_lamps(lamps_m):
        light = levels_at(fit, best.moved_px)[:, :, 3].mean(axis=2)
        if light.mean() < _BRIGHT * light.std() / math.sqrt(light.size):
            return -math.inf
    return best.evidence


def _with_lamps(
    marks: Marks, turn: int, profiles: Straightened, prior: tuple[FloatArray, FloatArray], config: ProfileConfig
) -> Marks:
    """Return marks with the place of the lamps that this picture and those before it speak for.

    One other place is compared, they take turns, with any light of the lamps for both.
    """
    other = turn % len(config.lamps_m)
    if other == marks.lamps:
        return marks
    own, new = (_any_light(marks, profiles, k, prior, config) for k in (marks.lamps, other))
    cost = config.lamps_cost * (float(no_lamps(config.lamps_m[marks.lamps])) - float(no_lamps(config.lamps_m[other])))
    gains = marks.gains.copy()
    gains[other] = _FORGET * gains[other] + (float(np.clip(new - own - cost, -_MOST, _MOST)) if new != own else 0.0)
    if gains[other] < config.lamps_margin:
        return replace(marks, gains=gains)
    return _blank(config, other)
