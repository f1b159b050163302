"""Paths of traffic: level arcs and lines, climbing steadily, known at all times."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require_finite, require_within


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcPath:
    """A motion at constant speed, climb and rate of turn; it is a `Trajectory`.

    Attributes
    ----------
    place_m : where it is at ``at_s``, runway frame.
    at_s : true session time.
    heading_rad : of the motion at that time, from +y towards +x.
    speed_m_s : over ground.
    climb_m_s : upwards.
    turn_rate_rad_s : of the heading; positive turns right.
    """

    place_m: tuple[float, float, float]
    at_s: float = 0.0
    heading_rad: float = 0.0
    speed_m_s: float = 12.0
    climb_m_s: float = 0.0
    turn_rate_rad_s: float = 0.0

    def __post_init__(self) -> None:
        for value in self.place_m:
            require_finite("ArcPath: place_m", value)
        require_finite("ArcPath: at_s", self.at_s)
        require_finite("ArcPath: heading_rad", self.heading_rad)
        require_within(self, {"speed_m_s": (0.0, 300.0), "climb_m_s": (-50.0, 50.0), "turn_rate_rad_s": (-6.0, 6.0)})

    @property
    def span_s(self) -> tuple[float, float]:
        """All of time."""
        return (-np.inf, np.inf)

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,)."""
        after = np.asarray(t_s, dtype=np.float64) - self.at_s
        half_turn = 0.5 * self.turn_rate_rad_s * after
        # the chord of an arc: its length is v t sin(a) / a, its direction that of the arc's middle
        chord = self.speed_m_s * after * np.sinc(half_turn / np.pi)
        middle = self.heading_rad + half_turn
        moved = np.column_stack([chord * np.sin(middle), chord * np.cos(middle), self.climb_m_s * after])
        return np.asarray(moved + np.array(self.place_m))

    def place_at(self, t_s: float) -> tuple[float, float, float]:
        """Return the position in m at one time; faster than `position` of many."""
        after = t_s - self.at_s
        half_turn = 0.5 * self.turn_rate_rad_s * after
        chord = self.speed_m_s * after * (math.sin(half_turn) / half_turn if half_turn else 1.0)
        middle = self.heading_rad + half_turn
        x, y, z = self.place_m
        return x + chord * math.sin(middle), y + chord * math.cos(middle), z + self.climb_m_s * after

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        after = np.asarray(t_s, dtype=np.float64) - self.at_s
        heading = self.heading_rad + self.turn_rate_rad_s * after
        level = self.speed_m_s
        climb = np.full_like(after, self.climb_m_s)
        return np.column_stack([level * np.sin(heading), level * np.cos(heading), climb])
