"""Where the Sun stands over a place on Earth at a time, by ephem's VSOP87 (arc seconds), in the runway frame.

Without refraction, which lifts it by at most half a degree at the horizon.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import ephem
import numpy as np

from groundstation.arrays import FloatArray

# ephem counts days from noon of 1899-12-31, UT
_UNIX_ZERO_DAYS = 25567.5
_DAY_S = 86400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SunAngles:
    """The Sun's direction: azimuth clockwise from true north and elevation, rad."""

    azimuth_rad: float
    elevation_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SunOverPlace:
    """The Sun as seen from the origin of a runway frame.

    Attributes
    ----------
    lat_deg, lon_deg, height_m : of the origin, WGS 84.
    y_axis_azimuth_deg : of the frame's +y, clockwise from true north.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    y_axis_azimuth_deg: float

    @lru_cache(maxsize=64)  # noqa: B019 - the places are few, and kept as long as the program runs
    def angles(self, utc_s: float) -> SunAngles:
        """Return where it stands at a Unix time."""
        observer = ephem.Observer()
        # a number is in radians, a text in degrees
        observer.lat, observer.lon = math.radians(self.lat_deg), math.radians(self.lon_deg)
        observer.elevation, observer.pressure = self.height_m, 0.0
        observer.date = utc_s / _DAY_S + _UNIX_ZERO_DAYS
        sun = ephem.Sun()
        sun.compute(observer)
        return SunAngles(azimuth_rad=float(sun.az), elevation_rad=float(sun.alt))

    def direction_runway(self, utc_s: float) -> FloatArray:
        """Return the unit vector (3,) towards it, runway frame."""
        at = self.angles(utc_s)
        aside = at.azimuth_rad - math.radians(self.y_axis_azimuth_deg)
        level = math.cos(at.elevation_rad)
        return np.array([level * math.sin(aside), level * math.cos(aside), math.sin(at.elevation_rad)])
