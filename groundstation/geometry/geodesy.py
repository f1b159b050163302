"""Places on Earth as a local frame: WGS 84 latitude, longitude and height to east, north, up.

Not taken from pymap3d: its latitude of an earth-centred position is off by up to 1.3 µm, this one by 2.4 nm, and for
one position, as live operation converts them, it needs 2.5 times as long, for a thousand half as long
(`benchmarks/library_costs.py`). The tests compare the two.
"""

import numpy as np

from groundstation.arrays import FloatArray

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_BOWRING_ROUNDS = 4


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
    origin = ecef_from_geodetic(*(np.array(value) for value in origin_deg_m))
    return np.asarray((ecef_from_geodetic(lat_deg, lon_deg, height_m) - origin) @ enu_axes(origin_deg_m).T)


def ecef_from_enu(enu_m: FloatArray, origin_deg_m: tuple[float, float, float]) -> FloatArray:
    """Return earth-centred earth-fixed positions (…, 3) of places (…, 3) in m, east, north and up of an origin."""
    origin = ecef_from_geodetic(*(np.array(value) for value in origin_deg_m))
    return np.asarray(origin + enu_m @ enu_axes(origin_deg_m))


def geodetic_from_ecef(ecef_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return latitude and longitude in degrees and ellipsoid height in m of (…, 3), to far below a millimetre.

    Bowring's parametric latitude, repeated until it stands (B. R. Bowring, Survey Review 23, 1976); from 1000 km
    below the surface on outwards.
    """
    x, y, z = np.moveaxis(np.asarray(ecef_m, dtype=np.float64), -1, 0)
    level = np.hypot(x, y)
    minor_m = SEMI_MAJOR_M * (1.0 - FLATTENING)
    squared_eccentricity = FLATTENING * (2.0 - FLATTENING)
    second_eccentricity = squared_eccentricity / (1.0 - squared_eccentricity)
    reduced = np.arctan2(z, (1.0 - FLATTENING) * level)
    lat = reduced
    for _ in range(_BOWRING_ROUNDS):
        lat = np.arctan2(
            z + second_eccentricity * minor_m * np.sin(reduced) ** 3,
            level - squared_eccentricity * SEMI_MAJOR_M * np.cos(reduced) ** 3,
        )
        reduced = np.arctan2((1.0 - FLATTENING) * np.sin(lat), np.cos(lat))
    normal = SEMI_MAJOR_M / np.sqrt(1.0 - squared_eccentricity * np.sin(lat) ** 2)
    # stable at the equator and at the poles
    height = level * np.cos(lat) + z * np.sin(lat) - SEMI_MAJOR_M**2 / normal
    return np.degrees(lat), np.degrees(np.arctan2(y, x)), height


def enu_axes(origin_deg_m: tuple[float, float, float]) -> FloatArray:
    """Return the rotation (3, 3) from earth-fixed axes to east, north, up at a place of latitude, longitude, height."""
    lat0, lon0 = np.radians(origin_deg_m[:2])
    s_lat, c_lat, s_lon, c_lon = np.sin(lat0), np.cos(lat0), np.sin(lon0), np.cos(lon0)
    return np.array(
        [[-s_lon, c_lon, 0.0], [-s_lat * c_lon, -s_lat * s_lon, c_lat], [c_lat * c_lon, c_lat * s_lon, s_lat]]
    )


def runway_axes(y_axis_azimuth_deg: float) -> FloatArray:
    """Return the rotation (3, 3) from east, north, up to a frame whose +y points so, clockwise from true north."""
    azimuth = np.radians(y_axis_azimuth_deg)
    s, c = np.sin(azimuth), np.cos(azimuth)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
