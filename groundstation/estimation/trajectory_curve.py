"""Prediction of the next target position from a curve through the last ones, to place the region of interest.

Three predictors over the same knots (position and time, oldest first):

- `line`: the predecessor's straight line through the last two points.
- `curve`: the paper's Section 4.1, a quadratic segment that is C¹ at its first knot, travelled on beyond its
  end at the speed of the last step. The tangent T is taken along P(k−3) → P(k−1), which is stable; inheriting
  it from the previous segment's end, the literal reading, has an eigenvalue of −1 and lets noise ring for ever
  (`curve_inherited_tangent` keeps it for comparison).
- `hermite`: a C¹ cubic through the filtered knots whose last segment ends at the filter's own prediction.
  At the time asked for it *is* that prediction; in between it is the smooth path that is drawn.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import Predictor

_ARC_STEPS = 16
_FAR_S = 64.0
# the inherited tangent never forgets; so many knots of it are followed
_KNOTS = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Knot:
    """One located point of the track: (3,) in the runway frame at ``t_s``."""

    t_s: float
    position_m: FloatArray


def line(knots: Sequence[Knot], t_s: float) -> FloatArray | None:
    """Extrapolate the line through the last two knots to ``t_s``; None with fewer than two."""
    if len(knots) < 2:
        return None
    a, b = knots[-2], knots[-1]
    return b.position_m + (t_s - b.t_s) / (b.t_s - a.t_s) * (b.position_m - a.position_m)


def curve(knots: Sequence[Knot], t_s: float) -> FloatArray | None:
    """Return the paper's prediction at ``t_s``, with the stable tangent; None with fewer than three knots."""
    if len(knots) < 3:
        return None
    p3, p2, p1 = knots[-3:]
    before, last = p2.t_s - p3.t_s, p1.t_s - p2.t_s
    tangent = last * (p1.position_m - p3.position_m) / (last + before)
    return _beyond(p2, p1, tangent, t_s)


def curve_inherited_tangent(knots: Sequence[Knot], t_s: float) -> FloatArray | None:
    """Return the prediction of the literal reading: each segment starts along the previous one's end."""
    if len(knots) < 3:
        return None
    tangent = knots[1].position_m - knots[0].position_m
    for a, b, c in zip(knots, knots[1:], knots[2:], strict=False):
        # the end of a segment S(s) = A + T s + (B − A − T) s² points along 2(B − A) − T, per unit of s
        end = 2.0 * (b.position_m - a.position_m) - tangent
        tangent = end * (c.t_s - b.t_s) / (b.t_s - a.t_s)
    return _beyond(knots[-2], knots[-1], tangent, t_s)


def _beyond(start: Knot, end: Knot, tangent: FloatArray, t_s: float) -> FloatArray:
    """Travel on along S(s) = A + T s + (B − A − T) s² from s = 1 at the speed of the last step."""
    chord = end.position_m - start.position_m
    distance = float(np.linalg.norm(chord)) / (end.t_s - start.t_s) * (t_s - end.t_s)
    bend = chord - tangent
    s = 1.0 + _solve_arc(tangent, bend, distance)
    return start.position_m + tangent * s + bend * s * s


def _solve_arc(tangent: FloatArray, bend: FloatArray, distance: float) -> float:
    """Return Δs with arc length ``distance`` beyond s = 1, by bisection over a summed arc."""
    if distance <= 0.0:
        return 0.0

    def length(ds: float) -> float:
        s = 1.0 + ds * (np.arange(_ARC_STEPS) + 0.5) / _ARC_STEPS
        speed = np.linalg.norm(tangent[None, :] + 2.0 * s[:, None] * bend[None, :], axis=1)
        return float(speed.mean() * ds)

    low, high = 0.0, 1.0
    while length(high) < distance and high < _FAR_S:
        high *= 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if length(middle) < distance else (low, middle)
    return 0.5 * (low + high)


def hermite(
    last: Knot, last_velocity_m_s: FloatArray, predicted: Knot, predicted_velocity_m_s: FloatArray, t_s: float
) -> FloatArray:
    """Return the point at ``t_s`` of the cubic from the last filtered knot to the filter's prediction.

    Positions (3,) in m and velocities (3,) in m/s at both ends. ``t_s`` is held inside the segment: a Hermite
    cubic runs away beyond its end (measured: 7 px where the prediction itself has 1.5 px).
    """
    span = predicted.t_s - last.t_s
    if span <= 0.0:
        return predicted.position_m
    s = min(max((t_s - last.t_s) / span, 0.0), 1.0)
    h00, h10 = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2
    h01, h11 = s * s * (3 - 2 * s), s * s * (s - 1)
    return (
        h00 * last.position_m
        + h10 * span * last_velocity_m_s
        + h01 * predicted.position_m
        + h11 * span * predicted_velocity_m_s
    )


class TrajectoryPredictor:
    """The track's last knots and the chosen curve through them."""

    def __init__(self, kind: Predictor) -> None:
        self._kind = kind
        self._knots: deque[Knot] = deque(maxlen=_KNOTS)

    def reset(self) -> None:
        """Forget the knots: what comes next is another track."""
        self._knots.clear()

    def add(self, knot: Knot) -> None:
        """Take the track's newest point; knots that do not advance in time are left out."""
        if not self._knots or knot.t_s > self._knots[-1].t_s:
            self._knots.append(knot)

    def predict(self, filtered: Knot) -> FloatArray:
        """Return the point (3,) that places the region of interest, at the time of the filter's own prediction.

        The Hermite path ends at that prediction, so there the two are one; line and curve fall back to it
        while they have too few knots.
        """
        knots = list(self._knots)
        point = None
        if self._kind is Predictor.LINE:
            point = line(knots, filtered.t_s)
        elif self._kind is Predictor.CURVE:
            point = curve(knots, filtered.t_s)
        elif self._kind is Predictor.INHERITED_CURVE:
            point = curve_inherited_tangent(knots, filtered.t_s)
        return filtered.position_m if point is None else point
