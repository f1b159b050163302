"""Places on Earth as a local frame: WGS 84 latitude, longitude and height to east, north, up."""

import numpy as np

from groundstation.arrays import FloatArray

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563


def ecef_from_geodetic(lat_deg: FloatArray, lon_deg: FloatArray, height_m: FloatArray) -> FloatArray:
    """Return earth-centred earth-fixed positions (n, 3) in m of places (n,) each; height above the ellipsoid."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    squared_eccentricity = FLATTENING * (2.0 - FLATTENING)
    normal = SEMI_MAJOR_M / np.sqrt(1.0 - squared_eccentricity * np.sin(lat) ** 2)
    level = (normal + height_m) * np.cos(lat)
    up = (normal * (1.0 - squared_eccentricity) + height_m) * np.sin(lat)
    return np.stack([level * np.cos(lon), level * np.sin(lon), up], axis=-1)


def enu_from_geodetic(
    lat_deg: FloatArray, lon_deg: FloatArray, height_m: FloatArray, origin_deg_m: tuple[float, float, float]
) -> FloatArray:
    """Return positions (n, 3) in m, east, north and up of an origin given as latitude, longitude and height."""
    lat0, lon0 = np.radians(origin_deg_m[:2])
    s_lat, c_lat, s_lon, c_lon = np.sin(lat0), np.cos(lat0), np.sin(lon0), np.cos(lon0)
    enu_from_ecef = np.array(
        [[-s_lon, c_lon, 0.0], [-s_lat * c_lon, -s_lat * s_lon, c_lat], [c_lat * c_lon, c_lat * s_lon, s_lat]]
    )
    origin = ecef_from_geodetic(*(np.array(value) for value in origin_deg_m))
    return np.asarray((ecef_from_geodetic(lat_deg, lon_deg, height_m) - origin) @ enu_from_ecef.T)
