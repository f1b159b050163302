"""Fixes of the track initiation: where the rays of two candidates meet, and which of several at one place count."""

from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import InitialPixel

# 0.95 quantile of chi-square with 3 degrees of freedom: fixes of two parts of one aircraft are not further apart
_SAME_GATE = 7.81
# log odds beyond which a fix is no surer to be an aircraft: what the channel gives to most of them
_SURE_ODDS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fix:
    """A plausible intersection of the rays of two candidates: position (3,) in m with covariance (3, 3).

    ``odds`` are the smaller log odds of aircraft of the two, None where the learned channel has not weighed them;
    ``pixels`` are those of the candidates, and of other cameras' candidates of the same place. ``narrow``: it is less
    wide than the target's span allows.
    """

    position_m: FloatArray
    covariance_m2: FloatArray
    score: float
    labelled: bool
    odds: float | None = None
    pixels: tuple[InitialPixel, ...] = ()
    narrow: bool = False


def without_false_pairs(fixes: list[Fix]) -> list[Fix]:
    """Return fixes without narrow ones of which a candidate is part of a likely aircraft of a plausible width.

    Two cameras' candidates of two aircraft meet as well, at another range, where they are too wide or too narrow.
    """
    wide = {
        (p.station, p.u_px, p.v_px)
        for f in fixes
        if not f.narrow and f.odds is not None and f.odds > 0.0
        for p in f.pixels
    }
    return [f for f in fixes if not (f.narrow and any((p.station, p.u_px, p.v_px) in wide for p in f.pixels))]


def without_lesser(fixes: list[Fix]) -> list[Fix]:
    """Return fixes without those that are, within their noise, where a fix is that is more likely an aircraft.

    Parts of an aircraft, and ground next to it, pair as well. Left among the fixes they begin tracks of their own, and
    the fixes of the one aircraft are shared out among several tracks.
    """
    fixes = list(fixes)
    likely = [k for k, f in enumerate(fixes) if f.odds is not None and f.odds > 0.0]
    if not likely:
        return fixes
    places, spreads = np.array([f.position_m for f in fixes]), np.array([f.covariance_m2 for f in fixes])
    # odds of most aircraft are equal, and the better fix counts
    ranks = [(min(fixes[k].odds or 0.0, _SURE_ODDS), -float(np.trace(spreads[k])), k) for k in likely]
    left = np.ones(len(fixes), dtype=np.bool_)
    for odds, _, k in sorted(ranks, reverse=True):
        if not left[k]:
            continue
        apart = places - places[k]
        squares = (apart * np.linalg.solve(spreads + spreads[k], apart[:, :, None])[:, :, 0]).sum(axis=1)
        lesser = np.array([f.odds is not None and min(f.odds, _SURE_ODDS) <= odds for f in fixes])
        same = (squares < _SAME_GATE) & lesser
        same[k] = False
        fixes[k] = _with_pixels_of([fixes[j] for j in np.flatnonzero(same & left)], fixes[k])
        left &= ~same
    return [f for f, stays in zip(fixes, left, strict=True) if stays]


def _with_pixels_of(others: list[Fix], fix: Fix) -> Fix:
    """Return a fix with the pixels of other cameras that likely fixes with one of its own pixels have."""
    pixels, own = {p.station: p for p in fix.pixels}, len(fix.pixels)
    for other in others:
        if (other.odds or 0.0) > 0.0 and any(pixels.get(p.station) == p for p in other.pixels):
            for pixel in other.pixels:
                pixels.setdefault(pixel.station, pixel)
    return fix if len(pixels) == own else replace(fix, pixels=tuple(pixels.values()))
