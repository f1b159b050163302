"""Stations drawn at random: positions, dynamics of their heads, and errors of their calibration."""

from groundstation.simulation.drawn_stations.build import BuiltStations, StationCamera, build_stations
from groundstation.simulation.drawn_stations.station_draw import draw_stations
from groundstation.simulation.drawn_stations.station_spec import (
    CalibrationSpec,
    ClockSpec,
    DgpsQuality,
    DgpsSpec,
    HeadSpec,
    StationSpec,
    StationsSpec,
    TimeSpan,
)

__all__ = [
    "BuiltStations",
    "CalibrationSpec",
    "ClockSpec",
    "DgpsQuality",
    "DgpsSpec",
    "HeadSpec",
    "StationCamera",
    "StationSpec",
    "StationsSpec",
    "TimeSpan",
    "build_stations",
    "draw_stations",
]
