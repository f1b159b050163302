"""What is known of a runway's width before any picture, and what follows for a pair of lines of another width.

A width is announced, mostly well. A pair that is wider or narrower is the runway, announced wrong; or another pair:
the outer borders of paved shoulders, an edge and the border of a field or of an apron, rubber or paint between the
edges. Both are possible, so that the covariance of such a pair includes the edges of the announced runway.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray

# share of runways whose announced width is right, and by how much these and others are wrong (sigma, of the width)
_RIGHT, _RIGHT_BY, _WRONG_BY = 0.7, 0.02, 0.2
# chosen: share of pairs that are not the runway's edges though all else is like them, and the most factor between
# their width and the runway's, in the logarithm of which any is as likely
_OTHERS, _OTHERS_FACTOR = 0.1, 2.5
# of those another width is at both edges alike in as many as it is at either of them alone
_BOTH = 0.5
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)


@dataclass(frozen=True, slots=True, kw_only=True)
class WidthPrior:
    """What is known of a runway's width before any picture: m.

    Attributes
    ----------
    announced_m : the width that was announced.
    scale_sigma : of a width in a picture, as a share of it, by the height that may be wrong.
    """

    announced_m: float
    scale_sigma: float


def width_density(width_m: float, prior: WidthPrior) -> float:
    """Return the logarithm of how likely a runway's width is against the announced one, 0 for that."""
    return math.log(max(_runways(width_m, prior), 1e-300) / _runways(prior.announced_m, prior))


def other_pair_probability(width_m: float, prior: WidthPrior) -> float:
    """Return how likely a pair of this width is not the runway's edges, by its width alone."""
    factor = max(width_m, 1e-3) / prior.announced_m
    if max(factor, 1.0 / factor) > _OTHERS_FACTOR:
        return 1.0
    others = _OTHERS / (2.0 * math.log(_OTHERS_FACTOR) * width_m)
    return others / (others + (1.0 - _OTHERS) * _runways(width_m, prior))


def other_pair_m2(width_m: float, prior: WidthPrior) -> FloatArray:
    """Return the second moment (2, 2) m², outwards, of the runway's edges about those of a pair of this width.

    With the pair's probability of not being the runway, which is as wide as announced then: half of the difference at
    both edges, or all of it at one of them.
    """
    off_m = width_m - prior.announced_m
    moved = _BOTH * 0.25 * np.ones((2, 2)) + (1.0 - _BOTH) * 0.5 * np.eye(2)
    return np.asarray(other_pair_probability(width_m, prior) * off_m**2 * moved)


def _runways(width_m: float, prior: WidthPrior) -> float:
    """Return the density 1/m of runways that are as wide, of those with this announced width."""
    density = 0.0
    for share, by in ((_RIGHT, _RIGHT_BY), (1.0 - _RIGHT, _WRONG_BY)):
        sigma = prior.announced_m * math.hypot(by, prior.scale_sigma)
        density += share * math.exp(-0.5 * ((width_m - prior.announced_m) / sigma) ** 2) / (sigma * _ROOT_TWO_PI)
    return density
