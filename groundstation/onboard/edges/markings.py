"""Markings next to the edges, accumulated over pictures: positions and brightness of paint and lamps.

In one picture paint half a metre inside one edge may be lamps a metre outside another, and a bright bar
fits something anywhere. The positions of a side line and of lamps (a layout) are therefore hypotheses: others are
fitted in turn next to the current one, all with any paint and light; each mark has to justify its degrees of freedom,
and have a plausible colour. A wrong layout moves both edges outwards or inwards, and other lines may have the same
layout. The log-likelihood gain of another one is summed over pictures; above a margin it replaces the current one.
Until then edges are reported with the ambiguity of the layouts: the second moment of the lines by the others.
"""

import math
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges import layout_evidence as evidence
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import (
    EdgeProfiles,
    ExpectedExcess,
    Layout,
    ProfileFit,
    best_displacement,
    levels_at,
    likelihood_at,
    refined_displacement,
)

# share of a layout's earlier gain that is kept in a new comparison, and the limit of a picture's gain
_FORGET, _MOST = 0.9, 300.0
# a layout that is worse by so many nats waits so many pictures longer for its turn
_HOPELESS, _SELDOM = 150.0, 12.0
# pictures over which it is taken where another layout puts the lines
_MEMORY = 4.0
# least excess of paint over the ground, as a share of its excess over pavement
OVER_GROUND = 0.2
# a layout that will take the place of the one that is held, in a picture or two, is stated as e² times as likely
_DOUBLE = 2.0
# pictures in which every layout is compared first, in the dark: as many as are needed to take another
_SURVEYS = 2
# line and lamps of two layouts are as far apart to half a step of the lamps' places
_AS_FAR_M = 0.3

# which of the configuration's places a line and lamps have
Places = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Markings:
    """Markings next to the edges.

    Attributes
    ----------
    excess : usual excess (2, blocks, 3) of painted line and lamps, 0 to 1, equal at both edges.
    noise : variance of a pixel about its profile.
    frames : number of pictures.
    surveyed : number of pictures in which every layout was compared; not repeated after a change.
    places : indices of the line and the lamps in the configuration's positions.
    gains : log-likelihood gain (lines, lamps) of each layout, recent; of the current one: other lines with it.
    moved_m : (lines, lamps, 4) outwards, displacement of the crossings by each against the current one.
    tried, times : (lines, lamps) picture of the last comparison of each, −1 for never, and their number.
    priors : (lines, lamps) log-probability of each before any picture, with its runway's width as last compared; NaN
        before that.
    line_off_m, line_width_m : how much farther out the line is than its place, and its width; 0 for the usual one.
    blur_px : sigma of the picture across a line; 0 for the usual one.
    shape_gains : (6,) log-likelihood gain of a line farther in, farther out, narrower, wider; of less and more blur.
    """

    excess: FloatArray
    noise: float
    frames: int
    surveyed: int
    places: Places
    gains: FloatArray
    moved_m: FloatArray
    tried: FloatArray
    times: FloatArray
    priors: FloatArray
    line_off_m: float = 0.0
    line_width_m: float = 0.0
    blur_px: float = 0.0
    shape_gains: FloatArray = field(default_factory=lambda: np.zeros(6))


class Change(Enum):
    """Change by a picture: none; positions of line and lamps, and the lines with them; the lines alone."""

    NONE = "none"
    LAYOUT = "layout"
    LINES = "lines"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkingComparison:
    """Markings after it, the confirmed change, and the resulting displacement of the lines, (4,) px."""

    markings: Markings
    change: Change
    moved_px: FloatArray


def initial_markings(config: ProfileConfig, *, dark: bool) -> Markings:
    """Return markings without observations; in the dark, lamps until another layout is confirmed."""
    lamps = next((k for k, at in enumerate(config.lamps_m) if (at is None) != dark), 0)
    shape = len(config.lines_m), len(config.lamps_m)
    return Markings(
        excess=np.zeros((2, config.blocks, 3)),
        noise=0.0,
        frames=0,
        # by day the little light of lamps is not worth the time
        surveyed=0 if dark else _SURVEYS,
        places=(0, lamps),
        gains=np.zeros(shape),
        moved_m=_apart_m((0, lamps), config),
        tried=np.full(shape, -1.0),
        times=np.zeros(shape),
        priors=np.full(shape, np.nan),
    )


def layout_at(places: Places, config: ProfileConfig, markings: Markings | None = None) -> Layout:
    """Return the layout of places of the configuration; of markings' own places with their line as it was found."""
    line, lamps, width_m = config.lines_m[places[0]], config.lamps_m[places[1]], config.line_width_m
    if markings is not None and line is not None:
        width_m = markings.line_width_m or width_m
        line += markings.line_off_m if places == markings.places else 0.0
    return Layout(line_m=None if line is None else (line - width_m, line), lamps_m=lamps)


def expected_excess(markings: Markings, config: ProfileConfig) -> ExpectedExcess:
    """Return the expected markings next to the edges: for the first picture's wide fit the paint alone, else both."""
    held = markings.noise / config.mark_sigma**2
    stiffness = np.array([held, held if markings.frames > 0 else 0.0])
    return ExpectedExcess(excess=markings.excess, stiffness=stiffness)


def unsettled_m2(markings: Markings, config: ProfileConfig) -> FloatArray:
    """Return the second moment (4, 4) m², outwards, of where layouts put the lines against the one that is held."""
    open_to = markings.times >= 1.0
    for places in _others(markings, config):
        open_to[places] = True
    open_to[markings.places] = False
    odds = markings.gains / config.layout_alike_stated + _prior_odds(markings)
    weights = np.where(open_to, np.exp(np.minimum(odds, _DOUBLE)), 0.0)
    # the one that is held counts once: with the lines that are held or, its own entry, with others that are likelier
    stray = math.exp(min(float(markings.gains[markings.places]) / config.layout_alike_stated, _DOUBLE))
    whole = max(1.0, stray) + float(weights.sum())
    weights[markings.places] = stray
    moved_m = markings.moved_m.reshape(-1, 4)
    return np.asarray((weights.reshape(-1, 1) * moved_m).T @ moved_m / whole)


def _prior_odds(markings: Markings) -> FloatArray:
    """Return how much likelier (lines, lamps) each layout is than the held one before any picture, logarithms."""
    odds = markings.priors - markings.priors[markings.places]
    return np.where(np.isfinite(odds), odds, 0.0)


def layout_odds(markings: Markings, config: ProfileConfig) -> FloatArray:
    """Return the logarithm of how much likelier (lines, lamps) layouts are than the held one; −inf: not compared."""
    odds = markings.gains / config.layout_alike_stated + _prior_odds(markings)
    odds = np.where(markings.times >= 1.0, odds, -np.inf)
    # its own gain is that of other lines
    odds[markings.places] = 0.0
    return odds


def compared(
    markings: Markings,
    profiles: EdgeProfiles,
    moved_px: FloatArray,
    px_per_m: FloatArray,
    count: int,
    config: ProfileConfig,
) -> MarkingComparison:
    """Compare so many other layouts, those first that have waited longest, with lines held at (4,) px outwards.

    Nothing changes before each has been tried; a layout has to be better in two pictures at least. In the dark all are
    compared in the first two: from lamps a metre out to others, with another line, no step is better than none.
    """
    survey = markings.surveyed < _SURVEYS
    count = markings.gains.size if survey else count
    scale, turn = np.tile(px_per_m, 2), _turn(markings, config)
    gains, moved_m, tried, times, priors = (
        a.copy() for a in (markings.gains, markings.moved_m, markings.tried, markings.times, markings.priors)
    )
    there = dict[Places, FloatArray]()
    for rival in _rivals(markings, profiles, moved_px, scale, turn[:count], config):
        at = rival.places
        gains[at] = _FORGET * gains[at] + float(np.clip(rival.better, -_MOST, _MOST))
        moved_m[at] += ((rival.moved_px - moved_px) / scale - moved_m[at]) / min(times[at] + 1.0, _MEMORY)
        tried[at], there[at] = markings.frames, rival.moved_px
        times[at] += 1.0
        priors[at] = rival.prior
    after = replace(
        markings,
        surveyed=markings.surveyed + int(survey),
        gains=gains,
        moved_m=moved_m,
        tried=tried,
        times=times,
        priors=priors,
    )
    ahead = gains + config.layout_alike * _prior_odds(after)
    new = max([markings.places, *turn], key=lambda places: ahead[places] if times[places] > 1.0 else -math.inf)
    untried = any(times[places] < 1.0 for places in turn)
    if untried or times[new] < 2.0 or ahead[new] <= config.layout_margin:
        return MarkingComparison(markings=after, change=Change.NONE, moved_px=moved_px)
    change = Change.LINES if new == markings.places else Change.LAYOUT
    moved_px = there.get(new, moved_px + scale * moved_m[new])
    return MarkingComparison(markings=_anew(after, new, config), change=change, moved_px=moved_px)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LayoutHypothesis:
    """A layout fitted to a picture: the resulting displacement of the lines, (4,) px outwards, its gain and prior."""

    places: Places
    moved_px: FloatArray
    better: float
    prior: float = 0.0


def _rivals(
    markings: Markings,
    profiles: EdgeProfiles,
    moved_px: FloatArray,
    scale: FloatArray,
    others: list[Places],
    config: ProfileConfig,
) -> list[_LayoutHypothesis]:
    """Return other layouts, and other lines with the current one, against it; all with any paint and light.

    A wrong layout has both edges too far out or in: others are searched for there. Other lines may be anywhere.
    """
    alike = evidence.same_row_prior(scale, config)
    layouts = [layout_at(places, config, markings) for places in (markings.places, *others)]
    own, *fits = evidence.weighed_layouts(profiles, layouts, moved_px, alike, config)
    loose = np.diag(1.0 / (config.stray_steps * np.tile(profiles.steps, 2)) ** 2)
    stray = best_displacement(own, np.zeros(4), loose)
    held = _worth(own, layouts[0], likelihood_at(own, moved_px), moved_px, config)
    held += config.stray_cost - 0.5 * float(moved_px @ loose @ moved_px)
    better = _worth(own, layouts[0], stray.evidence, stray.moved_px, config) - held
    # the width was announced once, and not in each picture
    once = config.layout_alike * (1.0 - _FORGET)
    better += once * (
        evidence.width_likelihood(profiles, stray.moved_px, scale)
        - evidence.width_likelihood(profiles, moved_px, scale)
    )
    found = [
        _LayoutHypothesis(places=markings.places, moved_px=stray.moved_px, better=evidence.limited(better, config)),
    ]
    best = refined_displacement(own, moved_px, alike)
    held = best.evidence
    found = [replace(found[0], prior=_prior(profiles, own, layouts[0], best.moved_px, scale, config))]
    for places, layout, fit in zip(others, layouts[1:], fits, strict=True):
        best = refined_displacement(fit, moved_px, alike)
        prior = _prior(profiles, fit, layout, best.moved_px, scale, config)
        better = evidence.limited(best.evidence - held, config)
        found.append(_LayoutHypothesis(places=places, moved_px=best.moved_px, better=better, prior=prior))
    return found


def _prior(
    profiles: EdgeProfiles,
    fit: ProfileFit,
    layout: Layout,
    moved_px: FloatArray,
    scale: FloatArray,
    config: ProfileConfig,
) -> float:
    """Return a layout's log-probability before any picture: of its marks as they look, and of the edges' width."""
    marks = config.lamps_alone if layout.line_m is None and layout.lamps_m is not None else 0.0
    return marks + _worth(fit, layout, 0.0, moved_px, config) + evidence.width_likelihood(profiles, moved_px, scale)


def _turn(markings: Markings, config: ProfileConfig) -> list[Places]:
    """Return the other layouts in the order in which they are compared: untried ones first, hopeless ones seldom."""
    waited = markings.tried + np.clip(-markings.gains / _HOPELESS, 0.0, 1.0) * _SELDOM
    waited = np.where(markings.times < 1.0, -math.inf, waited)
    return sorted(_others(markings, config), key=lambda places: waited[places])


def _anew(markings: Markings, places: Places, config: ProfileConfig) -> Markings:
    """Return markings with another layout, with unknown paint and light; observations of others are kept."""
    tried = markings.times >= 1.0
    # where only the lines are others, layouts are against them what they were
    gains = np.where(tried, markings.gains - (markings.gains[places] if places != markings.places else 0.0), 0.0)
    gains[places] = 0.0
    moved_m = np.where(tried[..., None], markings.moved_m - markings.moved_m[places], _apart_m(places, config))
    if places != markings.places:
        gains[markings.places] = -markings.gains[places]
        moved_m[markings.places] = -markings.moved_m[places]
    return replace(
        markings,
        excess=np.zeros_like(markings.excess),
        noise=0.0,
        frames=0,
        places=places,
        gains=gains,
        moved_m=moved_m,
        tried=np.minimum(markings.tried, 0.0),
        times=np.minimum(markings.times, 1.0),
        line_off_m=markings.line_off_m if places == markings.places else 0.0,
        shape_gains=np.zeros(6),
    )


def _apart_m(held: Places, config: ProfileConfig) -> FloatArray:
    """Return where layouts may put the crossings (lines, lamps, 4) against those of one, m outwards, before a picture.

    Lamps that stand farther out are the same light with both edges as much farther in, and so is a line.
    """
    apart_m = np.full((len(config.lines_m), len(config.lamps_m), 4), config.untried_m)
    held_line, held_lamps = config.lines_m[held[0]], config.lamps_m[held[1]]
    for k, line in enumerate(config.lines_m):
        for j, lamps in enumerate(config.lamps_m):
            if lamps is not None and held_lamps is not None and lamps != held_lamps:
                apart_m[k, j] = held_lamps - lamps
            elif line is not None and held_line is not None and lamps == held_lamps:
                apart_m[k, j] = held_line - line
    return apart_m


def _others(markings: Markings, config: ProfileConfig) -> list[Places]:
    """Return the layouts that are compared with the current one.

    Another position of line or lamps; only one of them, anywhere; both equally far apart, farther out or in: these
    differ only in where the ground begins. All of them during a survey.
    """
    (line, lamps), (lines, places) = markings.places, markings.gains.shape
    if markings.surveyed < _SURVEYS:
        return [other for other in np.ndindex(lines, places) if other != markings.places]
    near = [(k, lamps) for k in range(lines)] + [(line, k) for k in range(places)]
    for k in range(lines):
        near += [(k, j) for j in range(places) if (config.lines_m[k] is None) != (config.lamps_m[j] is None)]
    held_line, held_lamps = config.lines_m[line], config.lamps_m[lamps]
    for k, outer in enumerate(config.lines_m):
        for j, out in enumerate(config.lamps_m):
            if outer is None or out is None or held_line is None or held_lamps is None:
                continue
            if abs(out - outer - (held_lamps - held_line)) < _AS_FAR_M:
                near.append((k, j))
    return [other for other in dict.fromkeys(near) if other != markings.places]


def _worth(fit: ProfileFit, layout: Layout, likelihood: float, moved_px: FloatArray, config: ProfileConfig) -> float:
    """Return a log-likelihood less the cost of markings, which can fit anything, and of an unlikely appearance."""
    levels = levels_at(fit, moved_px).mean(axis=3)
    if layout.line_m is not None:
        # paint is brighter than the surface under it, and by a share of that than the ground
        paint, ground = levels[:, :, 2], levels[:, :, 1] - levels[:, :, 0]
        seen = evidence.is_bright(paint) and evidence.is_bright((1.0 - OVER_GROUND) * paint - ground)
        likelihood -= config.line_cost + config.dim_cost * float(not seen)
    if layout.lamps_m is not None:
        likelihood -= config.lamps_cost + config.dim_cost * float(not evidence.is_lit(levels[:, :, 3]))
    return likelihood
