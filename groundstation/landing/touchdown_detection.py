"""When and where the wheels met the runway, from the track; a go-around and a low pass are no landing.

An aircraft has landed once its wheels, having been in the air, stay near the surface for a while without sinking. When
they met it is then estimated by least squares over the seconds around: a sink that changes evenly until the touchdown
t₀, and a constant height from then on, h(t) = h₀ + w·(t₀ − t)₊ + q·(t₀ − t)₊². So the height of the nose above the
wheels need be known to decimetres only.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.landing.threshold_state import ALONG, ALONG_RATE, RIGHT, UP, UP_RATE, ThresholdState

# height of the wheels, m, above which an aircraft flies, and below which it may roll; both grow with the height's sigma
_FLYING_M, _LOW_M, _LOW_SIGMAS, _MOST_SIGMA_M = 1.2, 0.3, 2.0, 0.3
# it has landed after so long, s, in which the mean vertical speed was less, m/s; low for less is a touch or a pass
_STAYED_S, _LEVEL_S, _LEVEL_M_S = 2.0, 1.0, 0.3
# where a track ends on the runway, so long is enough
_ENDED_S = 0.5
# part of the track for the least squares, and steps and reach of t₀ about the first low estimate, s
_BEFORE_S, _KEPT_S, _STEP_S, _REACH_S = 2.0, 8.0, 0.02, (-1.0, 1.5)
# estimates in a row that share the filter's error: that of a constant-velocity filter lasts some tenths of a second
_ALIKE_S = 0.4
_FEWEST = 6


class Contact(StrEnum):
    """What became of wheels that were near the surface."""

    LANDED = "landed"
    CLIMBED_AWAY = "climbed away"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touchdown:
    """A touchdown that the track shows.

    Attributes
    ----------
    t_s, sigma_t_s : session time and one sigma.
    point_m, sigma_m : (2,) of the wheels, past the threshold and right of the centre line, and one sigma each.
    sink_m_s, sigma_sink_m_s : vertical speed at the touchdown, positive downwards.
    ground_speed_m_s : along the landing direction.
    """

    t_s: float
    sigma_t_s: float
    point_m: FloatArray
    sigma_m: FloatArray
    sink_m_s: float
    sigma_sink_m_s: float
    ground_speed_m_s: float


class TouchdownDetector:
    """Watches the height of the wheels, estimate after estimate.

    ``below_nose_m`` and ``behind_nose_m`` are where the wheels are from the target point.
    """

    def __init__(self, below_nose_m: float, behind_nose_m: float) -> None:
        self._below_m, self._behind_m = below_nose_m, behind_nose_m
        self._kept: deque[ThresholdState] = deque()
        self._flying = False
        self._low_since_s: float | None = None
        self.touchdown: Touchdown | None = None

    def forget(self) -> None:
        """Forget the track: what follows is another one."""
        self._kept.clear()
        self._flying, self._low_since_s = False, None

    def add(self, state: ThresholdState) -> Contact | None:
        """Add an estimate, in order of time; on `Contact.LANDED`, ``touchdown`` is the newest one."""
        self._kept.append(state)
        while self._kept[0].t_s < state.t_s - _KEPT_S:
            self._kept.popleft()
        height = float(state.mean[UP]) - self._below_m
        margin = _margin_m(state)
        if height > _FLYING_M + margin:
            was_low, self._low_since_s = self._low_since_s is not None, None
            self._flying = True
            return Contact.CLIMBED_AWAY if was_low else None
        if self._flying and self._low_since_s is None and height <= _LOW_M + margin:
            self._low_since_s = state.t_s
        low_since_s = self._low_since_s
        if low_since_s is None or state.t_s - low_since_s < _STAYED_S:
            return None
        if not self._stays_low(_LEVEL_S):
            # it floats along above the runway
            self._low_since_s = None
            return Contact.CLIMBED_AWAY
        return self._land(low_since_s) if self._is_level(state.t_s) else None

    def finish(self) -> Contact | None:
        """Return `Contact.LANDED` where the track has ended on the runway."""
        since = self._low_since_s
        if since is None or not self._kept or self._kept[-1].t_s - since < _ENDED_S:
            return None
        if not self._stays_low(_ENDED_S):
            return None
        return self._land(since)

    def _is_level(self, t_s: float) -> bool:
        rates = [float(s.mean[UP_RATE]) for s in self._kept if s.t_s >= t_s - _LEVEL_S]
        return abs(float(np.mean(rates))) <= _LEVEL_M_S

    def _stays_low(self, over_s: float) -> bool:
        """Return whether the wheels were near the surface in the mean of so long before the newest estimate."""
        last = [s for s in self._kept if s.t_s >= self._kept[-1].t_s - over_s]
        height = float(np.mean([s.mean[UP] for s in last])) - self._below_m
        return height <= _LOW_M + float(np.mean([_margin_m(s) for s in last]))

    def _land(self, low_since_s: float) -> Contact:
        around = [s for s in self._kept if s.t_s >= low_since_s - _BEFORE_S]
        self.touchdown = touchdown_of(around, low_since_s, self._behind_m)
        self._flying, self._low_since_s = False, None
        return Contact.LANDED


def _margin_m(state: ThresholdState) -> float:
    """Return by how much a height counts as uncertain, m."""
    return _LOW_SIGMAS * min(math.sqrt(max(float(state.covariance[UP, UP]), 0.0)), _MOST_SIGMA_M)


def touchdown_of(states: Sequence[ThresholdState], first_low_s: float, behind_nose_m: float) -> Touchdown:
    """Return the touchdown in a part of a track, by least squares; ``first_low_s`` is about when it was."""
    t = np.array([s.t_s for s in states])
    x = np.array([s.mean for s in states])
    spacing_s = float(np.median(np.diff(t))) if t.size > 1 else _ALIKE_S
    alike = max(_ALIKE_S / max(spacing_s, 1e-3), 1.0)
    tried = np.arange(first_low_s + _REACH_S[0], first_low_s + _REACH_S[1], _STEP_S)
    tried = tried[(tried > t[0]) & (tried <= t[-1])] if t.size >= _FEWEST else tried[:0]
    if tried.size == 0:
        tried = np.array([min(max(first_low_s, float(t[0])), float(t[-1]))])
    fits = [_bent_line(t - at, x[:, UP]) for at in tried]
    squares = np.array([f.squares for f in fits])
    variance = max(float(squares.min()) / max(t.size - 4, 1), 1e-6)
    weights = np.exp(-0.5 * (squares - squares.min()) / (variance * alike))
    weights /= weights.sum()
    t_s = float(weights @ tried)
    sigma_t_s = math.hypot(math.sqrt(float(weights @ (tried - t_s) ** 2)), _STEP_S / math.sqrt(12.0))
    sinks = np.array([f.sink_m_s for f in fits])
    sink = float(weights @ sinks)
    of_fit = float(weights @ np.array([f.sink_variance for f in fits])) * variance * alike
    sigma_sink = math.sqrt(float(weights @ (sinks - sink) ** 2) + of_fit)
    nearest = states[int(np.argmin(np.abs(t - t_s)))]
    speed = float(nearest.mean[ALONG_RATE])
    point = np.array([np.interp(t_s, t, x[:, ALONG]) - behind_nose_m, np.interp(t_s, t, x[:, RIGHT])])
    own = np.sqrt(np.maximum(np.diag(nearest.covariance)[[ALONG, RIGHT]], 0.0))
    return Touchdown(
        t_s=t_s,
        sigma_t_s=sigma_t_s,
        point_m=point,
        sigma_m=np.array([math.hypot(float(own[0]), speed * sigma_t_s), float(own[1])]),
        sink_m_s=sink,
        sigma_sink_m_s=sigma_sink,
        ground_speed_m_s=speed,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _BentLine:
    """Sum of squared residuals, m², sink at the bend, and that sink's variance for unit variance of a height."""

    squares: float
    sink_m_s: float
    sink_variance: float


def _bent_line(after_s: FloatArray, height_m: FloatArray) -> _BentLine:
    before = np.maximum(-after_s, 0.0)
    design = np.column_stack([np.ones_like(before), before, before**2])
    # a column of zeros, where nothing is before the bend, has no part in the solution
    found = np.linalg.pinv(design.T @ design)
    solved = found @ design.T @ height_m
    return _BentLine(
        squares=float(np.sum((height_m - design @ solved) ** 2)),
        sink_m_s=float(solved[1]),
        sink_variance=float(found[1, 1]),
    )
