"""Stations drawn at random: where they stand, how their heads follow, and how wrong their calibration is."""

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
