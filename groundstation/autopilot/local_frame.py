"""The runway frame on Earth: rotation to north, east, down, and geodetic coordinates of positions."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.geodesy import ecef_from_enu, enu_from_geodetic, geodetic_from_ecef, runway_axes
from groundstation.session.folder import GeoOrigin

_NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class GeodeticPosition:
    """A position on Earth, WGS 84: degrees, height above the ellipsoid and above mean sea level, m."""

    lat_deg: float
    lon_deg: float
    height_ellipsoid_m: float
    height_amsl_m: float


class LocalFrame:
    """North, east, down about the origin of the runway frame.

    Parameters
    ----------
    origin : of the runway frame on Earth.
    geoid_separation_m : height of the geoid above the ellipsoid there: ellipsoid height = AMSL height + separation.
    """

    def __init__(self, origin: GeoOrigin, geoid_separation_m: float) -> None:
        self.origin = GeodeticPosition(
            lat_deg=origin.lat_deg,
            lon_deg=origin.lon_deg,
            height_ellipsoid_m=origin.height_m,
            height_amsl_m=origin.height_m - geoid_separation_m,
        )
        self._separation_m = geoid_separation_m
        self._origin_deg_m = (origin.lat_deg, origin.lon_deg, origin.height_m)
        self.ned_from_runway: FloatArray = _NED_FROM_ENU @ runway_axes(origin.y_axis_azimuth_deg).T

    def geodetic(self, position_ned_m: FloatArray) -> GeodeticPosition:
        """Return where a position (3,), north, east, down of the origin, is on Earth."""
        lat, lon, height = geodetic_from_ecef(ecef_from_enu(_NED_FROM_ENU.T @ position_ned_m, self._origin_deg_m))
        return GeodeticPosition(
            lat_deg=float(lat),
            lon_deg=float(lon),
            height_ellipsoid_m=float(height),
            height_amsl_m=float(height) - self._separation_m,
        )

    def about(self, position: GeodeticPosition, origin: tuple[float, float, float]) -> FloatArray:
        """Return a position as (3,) north, east, down of another origin: latitude, longitude, AMSL height."""
        lat_deg, lon_deg, height_m = origin
        place = (np.array(position.lat_deg), np.array(position.lon_deg), np.array(position.height_ellipsoid_m))
        enu = enu_from_geodetic(*place, (lat_deg, lon_deg, height_m + self._separation_m))
        return np.asarray(_NED_FROM_ENU @ enu)

    def runway_position(self, lat_deg: float, lon_deg: float, height_amsl_m: float) -> FloatArray:
        """Return a place on Earth as (3,) m in the runway frame."""
        place = (np.array(lat_deg), np.array(lon_deg), np.array(height_amsl_m + self._separation_m))
        return np.asarray(self.ned_from_runway.T @ _NED_FROM_ENU @ enu_from_geodetic(*place, self._origin_deg_m))
