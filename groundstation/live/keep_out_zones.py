"""What the lenses of a station file are kept out of: its sectors, and the Sun where the station's place is known."""

import dataclasses
import math
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from groundstation.errors import ConfigError
from groundstation.live.devices import check_against_rig
from groundstation.live.head_device import open_head
from groundstation.live.station_file import StationDevices, StationFile, load_station
from groundstation.pointing.keep_out import KeepOut, LensAxis, SunZone
from groundstation.pointing.sun import SunOverPlace
from groundstation.rig.rig import Rig, Station
from groundstation.session.folder import GeoOrigin
from ptu_drivers.interface import PanTiltUnit

# without [safety] sun_angle_deg: the Sun's image stays off the sensor, half a degree of it, by what a mount, a clock
# (a minute is a quarter of a degree) and an azimuth may be wrong before a calibration
_BEYOND_THE_VIEW_RAD = math.radians(5.0)
# a clock that shows less was never set: this program did not exist
_FIRST_BELIEVED_S = datetime(2025, 1, 1, tzinfo=UTC).timestamp()


def with_keep_out(file: StationFile, rig: Rig, clock_s: float, utc_s: float) -> StationFile:
    """Return a station file whose heads know what their lenses are kept out of.

    ``clock_s`` is what the clock that the heads are opened with shows at the Unix time ``utc_s``. Raises `ConfigError`
    where the Sun is to be avoided by a time that cannot be right.
    """
    sun = _sun_of(file)
    turning = any(s.head is not None for s in file.stations)
    if sun is not None and turning and utc_s < _FIRST_BELIEVED_S:
        shown = datetime.fromtimestamp(utc_s, UTC).strftime("%Y-%m-%d %H:%M UTC")
        wanted = "a clock that is set, since the Sun's position is computed from it; or [safety] sun_angle_deg = 0"
        raise ConfigError(f"{file.path}: this machine's clock", got=shown, wanted=wanted)
    stations = tuple(_kept(station, rig, sun, file.sun_angle_rad, utc_s - clock_s) for station in file.stations)
    return dataclasses.replace(file, stations=stations)


def sun_text(file: StationFile, rig: Rig, utc_s: float) -> tuple[bool, str]:
    """Return whether the heads of a station file avoid the Sun, or need not, and a line that states how."""
    if file.sun_angle_rad == 0.0:
        return True, "the Sun is not avoided: [safety] sun_angle_deg = 0"
    sun = _sun_of(file)
    if sun is None:
        return False, (
            "the Sun is not avoided: no [origin] in the station file ([safety] sun_angle_deg = 0 if that is meant)"
        )
    at = sun.angles(utc_s)
    kept = ", ".join(
        f"{math.degrees(sun_angle_of(rig[s.name], file.sun_angle_rad)):.1f}° by {s.name}"
        for s in file.stations
        if s.head is not None
    )
    azimuth, elevation = math.degrees(at.azimuth_rad), math.degrees(at.elevation_rad)
    return True, f"the Sun is now at azimuth {azimuth:.1f}°, elevation {elevation:+.1f}°: kept off {kept or 'by none'}"


def _sun_of(file: StationFile) -> SunOverPlace | None:
    origin = file.origin
    if origin is None or file.sun_angle_rad == 0.0:
        return None
    return SunOverPlace(
        lat_deg=origin.lat_deg,
        lon_deg=origin.lon_deg,
        height_m=origin.height_m,
        y_axis_azimuth_deg=origin.y_axis_azimuth_deg,
    )


def sun_angle_of(station: Station, given_rad: float | None) -> float:
    """Return how far a lens is kept from the Sun, rad; ``given_rad`` is the station file's, None without."""
    if given_rad is not None:
        return given_rad
    lens = station.lens
    half = 0.5 * np.array(lens.image_size_px) / lens.focal_px
    return math.atan(float(np.hypot(*half))) + _BEYOND_THE_VIEW_RAD


def _kept(
    station: StationDevices, rig: Rig, sun: SunOverPlace | None, given_rad: float | None, utc_zero_s: float
) -> StationDevices:
    head = station.head
    if head is None:
        return station
    calibrated = rig[station.name]
    zone = None if sun is None else SunZone(sun=sun, angle_rad=sun_angle_of(calibrated, given_rad))
    lens = LensAxis.of(calibrated.geometry(), calibrated.ptu_axes)
    keep_out = KeepOut(lens=lens, sun=zone, sectors=head.sectors, utc_zero_s=utc_zero_s)
    return dataclasses.replace(station, head=dataclasses.replace(head, keep_out=keep_out))


def open_station_head(
    path: Path,
    name: str,
    clock: Callable[[], float],
    utc: Callable[[], float],
    *,
    rig: Rig | None = None,
    origin: GeoOrigin | None = None,
) -> PanTiltUnit:
    """Open the head of one station of a station file by itself, kept out of what is closed to it.

    ``clock`` is monotonic, ``utc`` Unix time; ``rig`` and ``origin`` stand for the station file's, the latter where
    that has one. Raises `ConfigError`, `RigError`, `DeviceError`.
    """
    file = load_station(path)
    if origin is not None and file.origin is not None:
        file = dataclasses.replace(file, origin=origin)
    rig = file.load_rig() if rig is None else rig
    check_against_rig(file, rig)
    heads = {s.name: s.head for s in with_keep_out(file, rig, clock(), utc()).stations}
    head = heads.get(name)
    if head is None:
        turning = ", ".join(n for n, h in heads.items() if h is not None)
        raise ConfigError(f"{path}: station", got=name, wanted=f"one with a head: {turning}")
    return open_head(name, head, clock)
