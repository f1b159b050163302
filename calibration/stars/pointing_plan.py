"""Where a head looks in a calibration by stars: all over its range, clear of horizon and Moon, from both sides."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.stars.sky import separation_rad
from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.rig.rig import Station

# refraction is uncertain, trees and mist begin below
LEAST_ALTITUDE_DEG = 10.0
# the Moon's light hides stars around it; the Sun is checked by its own rule
MOON_DEG = 15.0
# before each pointing the head comes from so far away
APPROACH_DEG = 1.5
# the plastic number's powers: successive points fill a rectangle evenly (M. Roberts, 2018)
_STEPS = np.array([0.7548776662466927, 0.5698402909980532])
_MOST_TRIED = 4000
_WAYS = ((1, 1), (-1, 1), (1, -1), (-1, -1))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadRange:
    """The readings between which a head is turned, degrees."""

    pan_deg: tuple[float, float]
    tilt_deg: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pointing:
    """One pointing: readings, degrees, and the direction of motion of each axis that leads to it, 1 or −1."""

    pan_deg: float
    tilt_deg: float
    pan_from: int
    tilt_from: int

    @property
    def before_deg(self) -> tuple[float, float]:
        """Where the head is turned to before."""
        return self.pan_deg - APPROACH_DEG * self.pan_from, self.tilt_deg - APPROACH_DEG * self.tilt_from


def plan_pointings(
    station: Station, within: HeadRange, count: int, moon: FloatArray | None, sun_altitude_deg: float = -90.0
) -> tuple[Pointing, ...]:
    """Return ``count`` pointings in the order in which they are visited.

    ``moon`` (3,) is its direction, runway frame, None below the horizon. The station's orientation is the rig's; a head
    that is not oriented yet is taken to stand level along the runway. Raises `InputError` where the range leaves too
    little sky, or in daylight.
    """
    if sun_altitude_deg > -6.0:
        got = f"the Sun at {sun_altitude_deg:.0f} deg"
        raise InputError("calibration by stars", got=got, wanted="night: the Sun 6 deg below the horizon or more")
    low = np.array([within.pan_deg[0], within.tilt_deg[0]]) + APPROACH_DEG
    high = np.array([within.pan_deg[1], within.tilt_deg[1]]) - APPROACH_DEG
    if np.any(high <= low):
        got = (
            f"pan {within.pan_deg[0]:g} to {within.pan_deg[1]:g}, tilt {within.tilt_deg[0]:g} to {within.tilt_deg[1]:g}"
        )
        raise InputError(f"station {station.name}", got=got, wanted="a range of 10 deg or more in pan and in tilt")
    chosen: list[FloatArray] = []
    for k in range(_MOST_TRIED):
        # evenly: denser towards the ends tells the axes better, but not the angles of operation
        reading = low + (0.5 + (k + 1) * _STEPS) % 1.0 * (high - low)
        if _is_clear(station, reading, moon):
            chosen.append(reading)
        if len(chosen) == count:
            return _in_order(chosen)
    got = f"{len(chosen)} of {count} pointings in the head's range"
    wanted = f"sky {LEAST_ALTITUDE_DEG:g} deg above the horizon and {MOON_DEG:g} deg from the Moon"
    raise InputError(f"station {station.name}", got=got, wanted=wanted)


def _is_clear(station: Station, reading_deg: FloatArray, moon: FloatArray | None) -> bool:
    pan, tilt = np.radians(reading_deg).tolist()
    angles = station.ptu_axes.angles(pan, tilt, 0.0, 0.0)
    axis = station.geometry().camera_pose(*angles).runway_from_camera[:, 2]
    if axis[2] < np.sin(np.radians(LEAST_ALTITUDE_DEG)):
        return False
    return moon is None or float(separation_rad(moon[None], axis)[0]) > np.radians(MOON_DEG)


def _in_order(readings: Sequence[FloatArray]) -> tuple[Pointing, ...]:
    """Return the pointings along the pan axis, there at low tilts and back at high ones; the four ways in turn."""
    middle = float(np.median([reading[1] for reading in readings]))
    lower = sorted((r for r in readings if r[1] <= middle), key=lambda r: float(r[0]))
    upper = sorted((r for r in readings if r[1] > middle), key=lambda r: -float(r[0]))
    return tuple(
        Pointing(
            pan_deg=round(float(r[0]), 3),
            tilt_deg=round(float(r[1]), 3),
            pan_from=ways_of(k)[0],
            tilt_from=ways_of(k)[1],
        )
        for k, r in enumerate([*lower, *upper])
    )


def ways_of(number: int) -> tuple[int, int]:
    """Return from which sides of pan and tilt a pointing is come to: the four combinations in turn."""
    return _WAYS[number % len(_WAYS)]
