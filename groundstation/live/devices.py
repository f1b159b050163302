"""The devices of a station file, opened: cameras that deliver on their own threads."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from groundstation.errors import ConfigError, RigError
from groundstation.files.nearest_word import one_of
from groundstation.files.text_file import AttachedFiles
from groundstation.live.head_device import DeviceError
from groundstation.live.station_file import StationDevices, StationFile
from groundstation.recording.mcap_metadata import RIG
from groundstation.rig.rig import ClockModel, Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.rig.stations_apart import require_one_sight
from groundstation.sources.cameras.camera import (
    CameraError,
    CameraEvent,
    CameraSettings,
    CameraSupervision,
    CameraTiming,
    Clock,
)
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.sources.cameras.open_camera import open_camera
from groundstation.tracking.config import config_from_mapping

# beyond what a camera's or a PTU's answer takes: a head whose angles are known so late cannot be pointed, a frame so
# late cannot be fused; and beyond a calibration's error over a recording of minutes
_MOST_LAG_S = {"ptu_clock": 0.3, "camera_clock": 0.4}
_MOST_DRIFT_PPM = 100.0

T = TypeVar("T")
Tell = Callable[[CameraEvent], None]


def check_against_rig(file: StationFile, rig: Rig) -> None:
    """Raise `ConfigError` where station file and rig do not speak of the same stations.

    Raises `RigError` for a rig in mm, or of another recorder's clocks.
    """
    ours, theirs = tuple(s.name for s in file.stations), rig.names
    if set(ours) != set(theirs):
        raise ConfigError(
            f"{file.path}: station", got=", ".join(ours), wanted=f"the stations of {file.rig.name}: {', '.join(theirs)}"
        )
    for station in file.stations:
        fixed = rig[station.name].fixed
        if fixed and station.head is not None:
            where = f"{file.path}: station {station.name}: ptu"
            raise ConfigError(where, got=station.head.url, wanted="none: fixed in the rig")
        if not fixed and station.head is None:
            raise ConfigError(
                f"{file.path}: station {station.name}: ptu",
                got="none",
                wanted="the PTU's URL, or fixed = true in the rig",
            )
    require_one_sight(rig, file.span_m)
    _require_clocks_of_one_host(rig)


def _require_clocks_of_one_host(rig: Rig) -> None:
    """Raise `RigError` for a clock that is not of this host: of a device whose stamps the host makes it is a lag."""
    for where, name, clock in _clocks(rig):
        if abs(clock.drift_ppm) > _MOST_DRIFT_PPM:
            wanted = f"at most {_MOST_DRIFT_PPM:g}: in operation all stamps are of this host's clock"
            raise RigError(where, got=f"drift_ppm = {clock.drift_ppm:g}", wanted=wanted)
        most_s = _MOST_LAG_S[name]
        if abs(clock.offset_s) > most_s:
            wanted = f"at most {most_s:g} s: in operation an offset is a device's lag, not another clock's zero"
            raise RigError(where, got=f"offset_s = {clock.offset_s:g}", wanted=wanted)


def of_one_host(rig: Rig) -> Rig:
    """Return a rig whose clocks do not drift: in operation, stamps of one clock do not drift against each other.

    What a calibration found of a drift is its error over one recording, and would grow with each hour of another.
    """
    text = text_of_one_host(rig)
    # as a replay reads it from the recording: written and read, angles may differ in the last bit
    return rig if text is None else replace(load_rig(AttachedFiles("", {RIG: text.encode()}) / RIG), path=rig.path)


def text_of_one_host(rig: Rig) -> str | None:
    """Return the text of the rig file of `of_one_host`; None where it is the rig's own."""
    if not drift_notes(rig):
        return None
    stations = (
        replace(
            station,
            ptu_clock=replace(station.ptu_clock, drift_ppm=0.0),
            camera_clock=station.camera_clock and replace(station.camera_clock, drift_ppm=0.0),
        )
        for station in rig.stations
    )
    return rig_to_toml(replace(rig, stations=tuple(stations)))


def drift_notes(rig: Rig) -> list[str]:
    """Return a line on each drift that is left out."""
    return [
        f"{where}: drift_ppm = {clock.drift_ppm:g} is left out: stamps in operation are of this host's clock"
        for where, _, clock in _clocks(rig)
        if clock.drift_ppm != 0.0
    ]


def _clocks(rig: Rig) -> Iterator[tuple[str, str, ClockModel]]:
    """Yield the clocks that a rig states, each with its place and its name."""
    for station in rig.stations:
        for name, clock in (("ptu_clock", station.ptu_clock), ("camera_clock", station.camera_clock)):
            if clock is not None:
                yield f"{rig.path}: station {station.name}: {name}", name, clock


def camera_of(station: StationDevices, clock: Clock, tell: Tell, *, rate_hz: float) -> LiveCamera:
    """Return one camera, which opens on ``with``; raises `DeviceError`."""
    where = f"station {station.name}: camera_settings"
    settings = _part(CameraSettings, station.camera_settings, where)
    if settings.rate_hz is None and settings.trigger is None and not station.camera.startswith("file:"):
        settings = replace(settings, rate_hz=rate_hz)
    timing = _part(CameraTiming, station.camera_settings, where)
    care = _part(CameraSupervision, station.camera_settings, where)
    try:
        return open_camera(
            station.camera, settings, clock=clock, on_event=tell, timing=timing, care=care, name=station.name
        )
    except CameraError as fault:
        reported = str(fault).removeprefix("camera: ")
        raise DeviceError(f"{station.name} camera: {reported}") from fault


def _part(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    """Return those settings that one record holds; a key that none of them has is an error."""
    own = {f.name for f in fields(kind)}  # type: ignore[arg-type]
    known = {f.name for k in (CameraSettings, CameraTiming, CameraSupervision) for f in fields(k)}
    for key in values:
        if key not in known:
            raise ConfigError(f"{where}: {key}", got="an unknown key", wanted=one_of(key, known))
    return config_from_mapping(kind, {k: v for k, v in values.items() if k in own}, where)
