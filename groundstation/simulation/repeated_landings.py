"""Repeated simulated landings of one aircraft, calm or in wind: the flight of `groundstation live --simulate`."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.simulation.airframes.trainer import REST_HEIGHT_PER_SPAN
from groundstation.simulation.flights import FlightModelKind, TruncatedTrajectory, in_wind
from groundstation.simulation.trajectory import Trajectory

SPAN_M = 2.3
_SPEED_M_S = 20.0
# start: the aircraft is small in the picture; end: heads without a target have begun to search
_START_M, _END_M = 560.0, -500.0
_APPROACH_ENDS_M = 90.0
_GLIDE_RAD = math.radians(3.5)
_LEVEL_FROM_M, _LEVEL_M, _ROUNDED_M = 110.0, 5.0, 1.0
# number of different laps in wind, which then repeat
_WINDY_LAPS = 8
_LAP_ENDS_S = 1e-6


class RepeatedLandings:
    """Repeated approaches: 20 m/s down a 3.5° glide path to 5 m above the runway, then level over the stations.

    Each lap ends out of the cameras' view, so that the target never disappears inside a picture.

    Parameters
    ----------
    seconds : duration.
    laps : trajectories flown in turn instead of that path; times from the start of the lap, s.
    """

    def __init__(self, seconds: float, laps: Sequence[Trajectory] = ()) -> None:
        self._lap_s = (_START_M - _END_M) / _SPEED_M_S
        self._laps = tuple(laps)
        self.span_s = (0.0, seconds)

    def approaching(self, t_s: FloatArray) -> MaskArray:
        """Return at which of the times (n,) the aircraft approaches the runway."""
        t = np.asarray(t_s, dtype=np.float64)
        return np.asarray((t >= 0.0) & (self._y(t) >= _APPROACH_ENDS_M))

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) in m at times (n,); before time 0 the aircraft is on its way from far out."""
        t = np.asarray(t_s, dtype=np.float64)
        y = np.where(t >= 0.0, self._y(t), _START_M - _SPEED_M_S * t)
        there = np.column_stack([np.zeros_like(y), y, self._height(y)])
        for lap, flown in self._windy(t):
            there[lap] = flown.position(t[lap] % self._lap_s)
        return there

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3) in m/s at times (n,)."""
        t, step = np.asarray(t_s, dtype=np.float64), 1e-3
        y = np.where(t >= 0.0, self._y(t), _START_M - _SPEED_M_S * t)
        sink = (self._height(y - step) - self._height(y + step)) / (2.0 * step) * _SPEED_M_S
        speeds = np.column_stack([np.zeros_like(y), np.full_like(y, -_SPEED_M_S), sink])
        for lap, flown in self._windy(t):
            speeds[lap] = flown.velocity(t[lap] % self._lap_s)
        return speeds

    def _windy(self, t_s: FloatArray) -> Iterator[tuple[MaskArray, Trajectory]]:
        """Yield the mask of the times (n,) in each lap with a trajectory of its own, and that trajectory."""
        numbers = np.where(t_s >= 0.0, t_s // self._lap_s, -1)
        for number, flown in enumerate(self._laps):
            yield (numbers >= 0) & (numbers % len(self._laps) == number), flown

    def _y(self, t_s: FloatArray) -> FloatArray:
        return np.asarray(_START_M - _SPEED_M_S * (t_s % self._lap_s))

    @staticmethod
    def _height(y_m: FloatArray) -> FloatArray:
        """Return the height: a glide path with a smooth transition to level flight (softplus)."""
        above = math.tan(_GLIDE_RAD) * (y_m - _LEVEL_FROM_M)
        return np.asarray(_LEVEL_M + _ROUNDED_M * np.logaddexp(0.0, above / _ROUNDED_M))


def landings(seconds: float, *, seed: int, wind_m_s: float, aircraft: FlightModelKind) -> RepeatedLandings:
    """Return landings in wind; the first eight differ, then they repeat.

    Raises `NoFlightModelError` if the aircraft is JSBSim's and JSBSim is not installed.
    """
    if aircraft is FlightModelKind.WAVES and wind_m_s == 0.0:
        return RepeatedLandings(seconds)
    lap = RepeatedLandings((_START_M - _END_M) / _SPEED_M_S)
    count = min(_WINDY_LAPS, math.ceil(seconds / lap.span_s[1]))
    rest_m = REST_HEIGHT_PER_SPAN * SPAN_M
    # a lap ends just before the next one starts
    once = TruncatedTrajectory(whole=lap, duration_s=lap.span_s[1] - _LAP_ENDS_S)
    return RepeatedLandings(
        seconds,
        [
            in_wind(once, rest_m, seed=seed * _WINDY_LAPS + number + 1, wind_m_s=wind_m_s, aircraft=aircraft)
            for number in range(count)
        ],
    )
