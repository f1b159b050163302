"""Trajectories: position and velocity of the target point at any time, runway frame.

A trajectory has a span, the interval of the flight. It can be evaluated beyond it, where readings lead in
and out: it is then extrapolated.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require_finite, require_positive, require_rising, require_shape


class Trajectory(Protocol):
    """A flight, or a deviation to be added to one; times are true session time in s, the frame is ``runway``."""

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time of the flight, s; infinite if unbounded."""

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""


@runtime_checkable
class OrientedTrajectory(Trajectory, Protocol):
    """A flight with its own attitude; that of others is derived from the track (`simulation.attitude`)."""

    def attitude(self, t_s: float) -> FloatArray:
        """Return ``runway_from_body`` (3, 3) at a time, s; body: x forward, y right, z down."""


class SampledTrajectory:
    """A trajectory through samples of position and velocity: piecewise cubic Hermite, C¹.

    Between two samples of a motion that is driven by white acceleration, the cubic is the mean of what can
    have been flown. Beyond the samples it is straight.

    Parameters
    ----------
    t_s : (n,) rising, s.
    position_m, velocity_m_s : (n, 3), runway frame.
    """

    __slots__ = ("_position", "_t", "_velocity", "span_s")

    def __init__(self, *, t_s: FloatArray, position_m: FloatArray, velocity_m_s: FloatArray) -> None:
        require_rising("Sampled: t_s", t_s)
        require_shape("Sampled: position_m", position_m, (t_s.size, 3))
        require_shape("Sampled: velocity_m_s", velocity_m_s, (t_s.size, 3))
        self._t, self._position, self._velocity = t_s.copy(), position_m.copy(), velocity_m_s.copy()
        self.span_s = (float(t_s[0]), float(t_s[-1]))

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""
        k, span, s, outside = self._place(t_s)
        h01 = s * s * (3.0 - 2.0 * s)
        h10, h11 = s * (1.0 - s) ** 2, s * s * (s - 1.0)
        p, v = self._position, self._velocity
        inside = p[k] + h01 * (p[k + 1] - p[k]) + span * (h10 * v[k] + h11 * v[k + 1])
        return np.asarray(inside + outside * np.where(outside < 0, v[0], v[-1]))

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,): the derivative of `position`."""
        k, span, s, _ = self._place(t_s)
        p, v = self._position, self._velocity
        slope = 6.0 * s * (1.0 - s) / span * (p[k + 1] - p[k])
        return np.asarray(slope + (1.0 - s) * (1.0 - 3.0 * s) * v[k] + s * (3.0 * s - 2.0) * v[k + 1])

    def _place(self, t_s: FloatArray) -> tuple[np.ndarray, FloatArray, FloatArray, FloatArray]:
        """Return interval numbers (n,), their lengths (n, 1), places in them 0…1 (n, 1), seconds outside (n, 1)."""
        t = np.asarray(t_s, dtype=np.float64)
        clipped = np.clip(t, *self.span_s)
        k = np.clip(np.searchsorted(self._t, clipped, side="right") - 1, 0, self._t.size - 2)
        span = (self._t[k + 1] - self._t[k])[:, None]
        return k, span, (clipped - self._t[k])[:, None] / span, (t - clipped)[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class SuperposedTrajectory:
    """A nominal flight with a deviation added; the span is the nominal's."""

    nominal: Trajectory
    deviation: Trajectory

    @property
    def span_s(self) -> tuple[float, float]:
        """The nominal flight's span, s."""
        return self.nominal.span_s

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""
        return self.nominal.position(t_s) + self.deviation.position(t_s)

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        return self.nominal.velocity(t_s) + self.deviation.velocity(t_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralWeave:
    """A deviation: a sine across the runway, x = amplitude · sin(2π t / period); metres and seconds."""

    amplitude_m: float = 1.5
    period_s: float = 8.0

    def __post_init__(self) -> None:
        require_finite("Weave: amplitude_m", self.amplitude_m)
        require_positive("Weave: period_s", self.period_s)

    @property
    def span_s(self) -> tuple[float, float]:
        """All of time."""
        return (-np.inf, np.inf)

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return deviations (n, 3) in m at times (n,)."""
        return self._across(self.amplitude_m * np.sin(2.0 * np.pi * np.asarray(t_s) / self.period_s))

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return their rates (n, 3) in m/s at times (n,)."""
        rate = 2.0 * np.pi / self.period_s
        return self._across(self.amplitude_m * rate * np.cos(rate * np.asarray(t_s)))

    def _across(self, x: FloatArray) -> FloatArray:
        return np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
