"""Stamps and readings of the devices that a rig's clocks and axes have made events of.

A folder of them goes with that rig like one that the devices have recorded: a replay, another rig and a calibration
mean the same. A reading whose backlash was corrected is not known any more: such angles stay as they are, the folder's
rig lacks the axes of their head, and session.toml says by which they were corrected.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from groundstation.rig.ptu_axes import IDEAL_AXES, PtuAxes
from groundstation.rig.rig import EQUAL_CLOCKS, ClockModel, Rig, Station
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session.applied_axes import applied_axes_to_toml, require_applied_axes

_NEIGHBOURS = 64
# the reading that gives an angle again is as near as the inverse is exact
_NEIGHBOURS_OF_READING = 8


class DeviceRecords:
    """Takes clocks and axes out of events; those of a station that is not given are in none.

    Parameters
    ----------
    stations : with the clocks and axes that are in the events.
    applied : names of stations of which no axes are to be taken out.

    ``kept`` are the axes, by station, that are in the events and cannot be taken out.
    """

    def __init__(self, stations: Iterable[Station], applied: Collection[str] = ()) -> None:
        self._ptu_clocks: dict[str, ClockModel] = {}
        self._camera_clocks: dict[str, ClockModel] = {}
        self._axes: dict[str, PtuAxes] = {}
        self.kept: dict[str, PtuAxes] = {}
        for station in stations:
            self._camera_clocks[station.name] = station.camera_clock or EQUAL_CLOCKS
            self._ptu_clocks[station.name] = station.ptu_clock
            axes = station.ptu_axes
            if station.fixed or station.name in applied or axes.is_ideal_apart_from_lean:
                continue
            backlash = axes.pan_backlash_rad != 0.0 or axes.tilt_backlash_rad != 0.0
            (self.kept if backlash else self._axes)[station.name] = axes

    def camera_stamp(self, station: str, t_s: float) -> float:
        """Return the camera's stamp, s, that reads as session time ``t_s``."""
        return _device_time(self._camera_clocks.get(station, EQUAL_CLOCKS), t_s)

    def ptu_stamp(self, station: str, t_s: float) -> float:
        """Return the head's stamp, s, that reads as session time ``t_s``."""
        return _device_time(self._ptu_clocks.get(station, EQUAL_CLOCKS), t_s)

    def readings_deg(self, station: str, pan_rad: float, tilt_rad: float) -> tuple[float, float]:
        """Return the readings, deg, that read as two angles, rad; the angles themselves where they are `kept`."""
        axes = self._axes.get(station)
        if axes is None:
            return _degrees(pan_rad), _degrees(tilt_rad)
        pan, tilt = (math.degrees(reading) for reading in axes.readings(pan_rad, tilt_rad, 0.0, 0.0))

        def is_pan(deg: float) -> bool:
            return axes.angles(math.radians(deg), 0.0, 0.0, 0.0)[0] == pan_rad

        def is_tilt(deg: float) -> bool:
            return axes.angles(0.0, math.radians(deg), 0.0, 0.0)[1] == tilt_rad

        near = _NEIGHBOURS_OF_READING
        return _near(round(pan, 9), is_pan, pan, near), _near(round(tilt, 9), is_tilt, tilt, near)


def folder_files(
    files: Mapping[str, bytes], rig: Rig, kept: Mapping[str, PtuAxes]
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Return a session's own files for a folder whose angles keep the axes ``kept``, by station, and notes.

    ``rig`` is that of ``files``. Raises `RigError` if it has other axes of these stations, whose readings are unknown.
    """
    written = dict(files)
    if not kept:
        return written, ()
    require_applied_axes(rig, kept)
    if any(name in rig.names and not rig[name].ptu_axes.is_ideal_apart_from_lean for name in kept):
        written["rig.toml"] = without_axes(rig, kept)
    written["session.toml"] = files["session.toml"].rstrip() + b"\n\n" + applied_axes_to_toml(kept).encode()
    note = (
        f"the angles of {', '.join(kept)} are corrected by ptu_axes, whose backlash hides the readings: rig.toml lacks"
    )
    return written, (f"{note} them, [ptu_axes_applied] of session.toml has them; operation needs them in its rig",)


def without_axes(rig: Rig, names: Collection[str]) -> bytes:
    """Return the rig file of a rig whose stations ``names`` have no errors of their axes but the lean."""
    stations = (
        replace(s, ptu_axes=replace(IDEAL_AXES, lean_rad=s.ptu_axes.lean_rad)) if s.name in names else s
        for s in rig.stations
    )
    return rig_to_toml(replace(rig, stations=tuple(stations))).encode()


def _device_time(clock: ClockModel, t_s: float) -> float:
    return _near(clock.device_from_session(t_s), lambda stamp: clock.session_from_device(stamp) == t_s)


def _degrees(angle_rad: float) -> float:
    """Return the angle in degrees that reads as ``angle_rad``."""
    guess = float(np.degrees(angle_rad))
    return _near(round(guess, 9), lambda deg: float(np.radians(deg)) == angle_rad, guess)


def _near(
    guess: float, good: Callable[[float], bool], otherwise: float | None = None, neighbours: int = _NEIGHBOURS
) -> float:
    """Return the number nearest to a guess that is good; the guess itself where rounding leaves none."""
    around = guess if otherwise is None else otherwise
    if good(guess):
        return guess
    below = above = around
    for _ in range(neighbours):
        for value in (below, above):
            if good(value):
                return value
        below, above = math.nextafter(below, -math.inf), math.nextafter(above, math.inf)
    return around
