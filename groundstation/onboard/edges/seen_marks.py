"""What is next to the edges, by name: the painted side line and the lamps, with their probabilities and places."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.markings import Markings, layout_odds
from groundstation.onboard.edges.profile_config import ProfileConfig

# sigma of a place within the steps of the layouts' places
_WITHIN_M = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenMark:
    """One kind of mark along both edges: its probability, and where it is if it is there.

    ``outwards_m`` from the edge, of a side line its outer side, NaN where no layout has one; and its sigma.
    """

    probability: float
    outwards_m: float
    sigma_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenMarks:
    """The painted side line and the lamps next to the edges."""

    line: SeenMark
    lamps: SeenMark


def seen_marks(markings: Markings, config: ProfileConfig) -> SeenMarks:
    """Return what the layouts that were compared say of line and lamps, each as likely as it is."""
    odds = layout_odds(markings, config)
    odds = np.exp(odds - odds.max())
    weights = odds / odds.sum()
    lines = np.array([math.nan if at is None else at for at in config.lines_m])
    lamps = np.array([math.nan if at is None else at for at in config.lamps_m])
    own = markings.places[0]
    by_line, by_lamps = weights.sum(axis=1), weights.sum(axis=0)
    lines[own] += markings.line_off_m
    return SeenMarks(line=_mark(lines, by_line), lamps=_mark(lamps, by_lamps))


def _mark(places_m: FloatArray, weights: FloatArray) -> SeenMark:
    there = np.isfinite(places_m)
    whole = float(weights[there].sum())
    if whole < 1e-9:
        return SeenMark(probability=0.0, outwards_m=math.nan, sigma_m=math.nan)
    share = weights[there] / whole
    mean = float(share @ places_m[there])
    spread = float(share @ (places_m[there] - mean) ** 2)
    return SeenMark(probability=whole, outwards_m=mean, sigma_m=math.hypot(_WITHIN_M, math.sqrt(spread)))
