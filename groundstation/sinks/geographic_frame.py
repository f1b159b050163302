"""The session's frame on Earth, as summary.json keeps it, and positions in it as latitude, longitude and height."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.files.toml_table import shown
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef, runway_axes
from groundstation.session import Session

# what a session says that has such a frame
ORIGIN_KEYS = (
    "lat_deg, lon_deg, height_m and y_axis_azimuth_deg in [origin] of session.toml (instead of a sentence origin there)"
)
_ORIGIN = ("lat_deg", "lon_deg", "height_m", "y_axis_azimuth_deg")
_MAX_STATIONS = 1000
# within it a place on Earth can be converted
_MAX_M = 1e6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeographicFrame:
    """Where a frame lies on Earth (WGS 84), and the stations in it.

    Attributes
    ----------
    lat_deg, lon_deg, height_m : of its origin; height above the ellipsoid.
    y_axis_azimuth_deg : direction of +y, clockwise from true north.
    geoid_separation_m : ellipsoid height of sea level there; None if the session does not state it.
    stations_m : by name the position (3,) of each station in the frame.
    """

    lat_deg: float
    lon_deg: float
    height_m: float
    y_axis_azimuth_deg: float
    geoid_separation_m: float | None
    stations_m: Mapping[str, FloatArray]

    @property
    def _origin(self) -> tuple[float, float, float]:
        return self.lat_deg, self.lon_deg, self.height_m

    def places(self, position_m: FloatArray) -> FloatArray:
        """Return longitude and latitude in degrees and ellipsoid height in m, (n, 3), of positions (n, 3) in m."""
        enu = np.asarray(position_m) @ runway_axes(self.y_axis_azimuth_deg)
        lat, lon, height = geodetic_from_ecef(ecef_from_enu(enu, self._origin))
        return np.stack([lon, lat, height], axis=-1)

    def sigma_enu_m(self, covariance_m2: FloatArray) -> FloatArray:
        """Return sigmas (n, 3) east, north and up at the origin, of covariances (n, 3, 3) in the frame.

        A kilometre away these axes are turned by 0.01°, which no sigma of a track shows.
        """
        enu_from_frame = runway_axes(self.y_axis_azimuth_deg).T
        variance = np.einsum("ij,njk,ik->ni", enu_from_frame, covariance_m2, enu_from_frame)
        return np.sqrt(np.maximum(variance, 0.0))


def place_of(session: Session) -> dict[str, Any]:
    """Return a session's place for `summary.json`: its frame, ``origin`` (null where unknown), and its stations."""
    origin = None
    if session.origin is not None:
        origin = {
            **{key: float(getattr(session.origin, key)) for key in _ORIGIN},
            "geoid_separation_m": session.dgps.reading.geoid_separation_m,
        }
    stations = {s.name: s.ptu_position_m.tolist() for s in session.rig.stations}
    return {"frame": session.frame, "origin": origin, "stations_m": stations}


def geographic_frame(place: object) -> GeographicFrame | None:
    """Return the frame of a summary's ``place``; None where it has no origin, or none that is one."""
    origin = place.get("origin") if isinstance(place, Mapping) else None
    if not isinstance(place, Mapping) or not isinstance(origin, Mapping):
        return None
    values = {key: _number(origin.get(key), 90.0 if key == "lat_deg" else _MAX_M) for key in _ORIGIN}
    if any(value is None for value in values.values()):
        return None
    stations = place.get("stations_m")
    found = {}
    for name, position in list(stations.items())[:_MAX_STATIONS] if isinstance(stations, Mapping) else ():
        axes = [_number(value, _MAX_M) for value in position] if isinstance(position, list) else []
        if len(axes) == 3 and None not in axes:
            found[shown(str(name))] = np.array(axes, dtype=np.float64)
    return GeographicFrame(
        lat_deg=values["lat_deg"] or 0.0,
        lon_deg=values["lon_deg"] or 0.0,
        height_m=values["height_m"] or 0.0,
        y_axis_azimuth_deg=values["y_axis_azimuth_deg"] or 0.0,
        geoid_separation_m=_number(origin.get("geoid_separation_m"), 200.0),
        stations_m=found,
    )


def _number(value: object, most: float) -> float | None:
    """Return a finite number of at most this size; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) <= most else None
