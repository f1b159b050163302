"""Apparent directions of stars, Sun and Moon over a site, in the runway frame, by Skyfield and JPL's DE421.

Precession, nutation, aberration, light deflection and refraction are Skyfield's; the catalogue's positions are those of
its stars in the pictures' year (proper motion applied). Refraction is Bennett's for the site's air (0.07′ at worst,
G. G. Bennett, Journal of Navigation 35, 1982).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import MissingExtraError
from groundstation.geometry.geodesy import runway_axes

# what DE421 covers, apart from its ends
FIRST_UTC_S, LAST_UTC_S = -2_000_000_000.0, 2_500_000_000.0
# of the international standard atmosphere
SEA_LEVEL_HPA, SCALE_HEIGHT_M = 1013.25, 8434.0
STANDARD_AIR_C, LAPSE_C_PER_M = 15.0, 0.0065
_MOON_RADIUS_KM = 1737.4
_KEPT_TIMES = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservingSite:
    """The origin of the runway frame on Earth, and its air.

    Attributes
    ----------
    lat_deg, lon_deg, height_m : WGS 84, height above the ellipsoid.
    y_axis_azimuth_deg : of the runway's +y, clockwise from true north.
    pressure_hpa, air_c : pressure at the site (not reduced to sea level) and temperature; None: standard atmosphere.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    y_axis_azimuth_deg: float
    pressure_hpa: float | None = None
    air_c: float | None = None

    @property
    def pressure(self) -> float:
        """Pressure at the site, hPa."""
        if self.pressure_hpa is not None:
            return self.pressure_hpa
        return SEA_LEVEL_HPA * math.exp(-self.height_m / SCALE_HEIGHT_M)

    @property
    def temperature(self) -> float:
        """Temperature of the air, °C."""
        return STANDARD_AIR_C - LAPSE_C_PER_M * self.height_m if self.air_c is None else self.air_c


class SkyOverSite:
    """Directions of celestial bodies over one site.

    Raises `MissingExtraError` where Skyfield or its ephemeris is not installed.
    """

    def __init__(self, site: ObservingSite) -> None:
        self.site = site
        loaded = _load_skyfield()
        self._skyfield, self._planets, self._scale = loaded
        place = self._skyfield.wgs84.latlon(site.lat_deg, site.lon_deg, elevation_m=site.height_m)
        observer = self._planets["earth"] + place
        self._place = place
        # directions of several things at one time share what is computed of the time: nutation, the observer's place
        self._observed_at = lru_cache(maxsize=_KEPT_TIMES)(lambda utc_s: observer.at(self._at(utc_s)))
        self._body_at = lru_cache(maxsize=_KEPT_TIMES)(self._direction_of_body)

    def stars(self, ra_rad: FloatArray, dec_rad: FloatArray, utc_s: float) -> FloatArray:
        """Return apparent directions (n, 3), refraction included, of catalogue places (n,) in ICRS at a Unix time."""
        stars = self._skyfield.Star(ra_hours=np.asarray(ra_rad) * 12.0 / np.pi, dec_degrees=np.degrees(dec_rad))
        return self._directions(stars, utc_s)

    def body(self, name: str, utc_s: float) -> FloatArray:
        """Return the apparent direction (3,) of "sun" or "moon", refraction included, at a Unix time."""
        return self._body_at(name, utc_s).copy()

    def moon_radius_rad(self, utc_s: float) -> float:
        """Return the Moon's radius as seen from the site at a Unix time, rad."""
        away = self._observed_at(utc_s).observe(self._planets["moon"]).apparent().distance()
        return math.asin(_MOON_RADIUS_KM / float(away.km))

    def pole(self) -> FloatArray:
        """Return the direction (3,) of the celestial north pole, without refraction."""
        lat = math.radians(self.site.lat_deg)
        return runway_axes(self.site.y_axis_azimuth_deg) @ np.array([0.0, math.cos(lat), math.sin(lat)])

    def icrs_from_runway(self, utc_s: float) -> FloatArray:
        """Return the rotation (3, 3) from the runway frame to ICRS at a Unix time; no aberration, no refraction."""
        north_east_up = np.asarray(self._place.rotation_at(self._observed_at(utc_s).t))
        east_north_up = north_east_up[[1, 0, 2]]
        return np.asarray(east_north_up.T @ runway_axes(self.site.y_axis_azimuth_deg).T)

    def _direction_of_body(self, name: str, utc_s: float) -> FloatArray:
        return self._directions(self._planets[name], utc_s)

    def _at(self, utc_s: float) -> Any:
        return self._scale.from_datetime(datetime.fromtimestamp(utc_s, UTC))

    def _directions(self, body: object, utc_s: float) -> FloatArray:
        apparent = self._observed_at(utc_s).observe(body).apparent()
        altitude, azimuth, _ = apparent.altaz(temperature_C=self.site.temperature, pressure_mbar=self.site.pressure)
        aside = np.asarray(azimuth.radians) - math.radians(self.site.y_axis_azimuth_deg)
        up = np.asarray(altitude.radians)
        return np.stack([np.cos(up) * np.sin(aside), np.cos(up) * np.cos(aside), np.sin(up)], axis=-1)


@cache
def _load_skyfield() -> tuple[Any, Mapping[str, Any], Any]:
    """Return Skyfield's interface, the bodies of DE421 and the scale of time; from installed files alone."""
    try:
        from skyfield import api

        data = files("skyfield_data") / "data"
    except ImportError as fault:
        raise MissingExtraError("the places of stars", "stars") from fault
    # DE421 alone is of use: Skyfield has a table of UT1 of its own, and that of skyfield-data warns once it is old
    load = api.Loader(str(data), verbose=False)
    return api, load("de421.bsp"), load.timescale(builtin=True)


def separation_rad(units: FloatArray, unit: FloatArray) -> FloatArray:
    """Return the angles (n,) between unit vectors (n, 3) and one (3,), rad."""
    return np.asarray(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(units - unit, axis=-1), 0.0, 1.0)))


def utc_text(utc_s: float) -> str:
    """Return a Unix time as ISO 8601, to the second."""
    return datetime.fromtimestamp(utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def decimal_year(times_s: Sequence[float]) -> float:
    """Return the Julian year of the middle of Unix times."""
    middle = 0.5 * (min(times_s) + max(times_s))
    return 2000.0 + (middle - 946_728_000.0) / (365.25 * 86400.0)
