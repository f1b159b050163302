"""Lines of sight from the stations to the aircraft and near it: aim of traffic that is to cross its picture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_positive
from groundstation.simulation.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SightLine:
    """From a station's eye (3,) m along a unit vector (3,), runway frame, at a time in s.

    ``target_m`` is how far the aircraft is from that eye then.
    """

    t_s: float
    eye_m: FloatArray
    towards: FloatArray
    target_m: float

    def at(self, away_m: float) -> FloatArray:
        """Return the point (3,) m that is so far away on it."""
        return np.asarray(self.eye_m + away_m * self.towards)


class SightLines:
    """Draws lines of sight of a flight.

    Parameters
    ----------
    generator : of all draws.
    flown : the aircraft's nose.
    eyes_m : of the stations, each (3,) m, runway frame.
    duration_s : of the session, from time 0.
    """

    def __init__(
        self, generator: np.random.Generator, flown: Trajectory, eyes_m: Sequence[FloatArray], duration_s: float
    ) -> None:
        require(len(eyes_m) > 0, "SightLines: eyes_m", got="none", wanted="one or more")
        require_positive("SightLines: duration_s", duration_s)
        self._generator, self._flown = generator, flown
        self.eyes_m, self.duration_s = tuple(eyes_m), duration_s

    def draw(self, within_rad: float) -> SightLine:
        """Return a line to within an angle of the aircraft, at a random time; small angles are as likely as large."""
        t_s = float(self._generator.uniform(0.0, self.duration_s))
        eye = self.eyes_m[int(self._generator.integers(len(self.eyes_m)))]
        line = self._flown.position(np.array([t_s]))[0] - eye
        away = float(np.linalg.norm(line))
        ahead = line / away
        right = np.array([ahead[1], -ahead[0], 0.0]) / max(math.hypot(ahead[0], ahead[1]), 1e-9)
        off, turn = float(self._generator.uniform(0.0, within_rad)), float(self._generator.uniform(0.0, math.tau))
        aside = math.cos(turn) * right + math.sin(turn) * np.cross(right, ahead)
        towards = math.cos(off) * ahead + math.sin(off) * aside
        return SightLine(t_s=t_s, eye_m=eye, towards=np.asarray(towards), target_m=away)

    def least_distance_m(self, points_m: FloatArray) -> float:
        """Return how near points (n, 3) m come to any station."""
        return min(float(np.linalg.norm(points_m - eye, axis=1).min()) for eye in self.eyes_m)
