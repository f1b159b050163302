"""``STATION.toml``: which devices stand at the airstrip and how they are used. The rig file says where they are."""

import math
import os
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from groundstation.config import config_from_mapping
from groundstation.errors import ConfigError
from groundstation.live.head_device import HeadDevice
from groundstation.pointing import PointingConfig
from groundstation.search_pattern import SearchConfig
from groundstation.session.folder import GeoOrigin, parse_origin
from groundstation.toml_table import Table, load_toml, quoted

STATION_FORMAT = "groundstation-station/1"
MAX_STATIONS = 16
_TOP = frozenset(
    {
        *("format", "name", "rig", "config", "rate_hz", "target", "record", "pointing", "search", "station"),
        *("reference", "origin"),
    }
)
_REFERENCE = frozenset({"url", "baud", "clock_offset_s", "clock_sigma_s", "geoid_separation_m", "learn"})
_STATION = frozenset(
    {"name", "camera", "camera_settings", "ptu", "ptu_protocol", "ptu_settings", "ptu_options", "park_deg"}
)
_PTU_SETTINGS = frozenset(
    {
        *("pan_sign", "tilt_sign", "pan_zero_deg", "tilt_zero_deg", "pan_low_deg", "pan_high_deg"),
        *("tilt_low_deg", "tilt_high_deg", "pan_rate_deg_s", "tilt_rate_deg_s", "baud", "latency_s", "poll_hz"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class StationDevices:
    """The devices of one station of the rig; ``head`` is None for a fixed one."""

    name: str
    camera: str
    camera_settings: dict[str, Any]
    head: HeadDevice | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceDevice:
    """A reference receiver on the aircraft, whose positions (NMEA) come to the station by a radio link.

    Attributes
    ----------
    url : a serial port, ``socket://host:port``, or ``udp://:port`` to listen at.
    baud : of a serial port.
    clock_offset_s : how far its clock is ahead of this machine's; None finds out, if they are seconds apart.
    clock_sigma_s : and how well that is known; None is the tuning's.
    geoid_separation_m : ellipsoid height of sea level, for a receiver that does not tell.
    learn : whether the filter learns from it, or it is kept for comparison only.
    """

    url: str
    baud: int = 115200
    clock_offset_s: float | None = None
    clock_sigma_s: float | None = None
    geoid_separation_m: float | None = None
    learn: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class StationFile:
    """A whole set-up.

    Attributes
    ----------
    rig, config : their files; ``config`` None is the default tuning.
    rate_hz : pairs a second.
    span_m : the target's, None if unknown.
    record : where flights are recorded, None for nowhere.
    record_s : for so long the disk is to hold what is recorded, even if nothing is ever found.
    reference : the reference receiver, if there is one; then ``origin`` is where the runway frame lies on Earth.
    antenna_in_body_m : its antenna from the nose: forward, right, down; None if unknown.
    """

    path: Path
    name: str
    rig: Path
    config: Path | None
    rate_hz: float
    span_m: float | None
    record: Path | None
    pointing: PointingConfig
    search: SearchConfig
    stations: tuple[StationDevices, ...]
    reference: ReferenceDevice | None = None
    origin: GeoOrigin | None = None
    antenna_in_body_m: tuple[float, float, float] | None = None
    record_s: float = 1800.0


def load_station(path: Path) -> StationFile:
    """Read a station file; paths in it are relative to it. Raises `ConfigError`."""
    top = Table(load_toml(path, ConfigError), str(path), ConfigError)
    top.refuse_unknown(_TOP)
    top.choice("format", [STATION_FORMAT])
    target, record = top.table("target"), top.table("record")
    target.refuse_unknown({"span_m", "antenna_in_body_m"})
    record.refuse_unknown({"folder", "minutes"})
    listed = top.values.get("station", [])
    if not isinstance(listed, list) or not 2 <= len(listed) <= MAX_STATIONS:
        raise top.fail("station", quoted(listed), f"two to {MAX_STATIONS} tables [[station]]")
    stations = tuple(_station(Table(v, f"{path}: station {k + 1}", ConfigError)) for k, v in enumerate(listed))
    names = [s.name for s in stations]
    if len(set(names)) < len(names):
        raise top.fail("station", "two of one name", "names that differ, those of the rig file")
    _refuse_shared(top, stations)
    here = path.parent
    reference = _reference(top.table("reference")) if "reference" in top else None
    if reference is not None and "origin" not in top:
        raise top.fail("origin", "nothing", "a table [origin]: where the runway frame lies on Earth, for [reference]")
    antenna = target.vector("antenna_in_body_m", 3) if "antenna_in_body_m" in target else None
    return StationFile(
        path=path,
        name=top.text("name", path.stem),
        rig=here / top.text("rig", "rig.toml"),
        config=here / top.text("config") if "config" in top else None,
        rate_hz=top.number("rate_hz", 30.0, above=0.0, maximum=1000.0),
        span_m=target.number("span_m", above=0.0, maximum=200.0) if "span_m" in target else None,
        record=here / record.text("folder") if "folder" in record else None,
        record_s=60.0 * record.number("minutes", 30.0, above=0.0, maximum=1e5),
        pointing=config_from_mapping(PointingConfig, top.table("pointing").values, f"{path}: pointing"),
        search=config_from_mapping(SearchConfig, top.table("search").values, f"{path}: search"),
        stations=stations,
        reference=reference,
        origin=parse_origin(top.table("origin"), "runway") if "origin" in top else None,
        antenna_in_body_m=None if antenna is None else (float(antenna[0]), float(antenna[1]), float(antenna[2])),
    )


def _refuse_shared(top: Table, stations: tuple[StationDevices, ...]) -> None:
    """Raise `ConfigError` where two stations name one device: each would take what the other has asked for."""
    for one, other in combinations(stations, 2):
        whose = f"of {one.name} and of {other.name}"
        if one.head is not None and other.head is not None and _one_line(one.head, other.head):
            raise top.fail("station", f"{other.head.url} as the PTU {whose}", "a line of its own for each")
        if one.camera == other.camera and not one.camera.startswith("file:"):
            raise top.fail("station", f"{one.camera} as the camera {whose}", "one for each")


def _one_line(one: HeadDevice, other: HeadDevice) -> bool:
    """Return whether two heads would open the same line; a server in a network may lead to several addresses."""
    if "://" in one.url and one.options != other.options:
        return False
    return os.path.realpath(one.url) == os.path.realpath(other.url)


def _reference(table: Table) -> ReferenceDevice:
    table.refuse_unknown(_REFERENCE)

    def known(key: str, **bounds: float) -> float | None:
        return table.number(key, **bounds) if key in table else None

    learn = table.values.get("learn", True)
    if not isinstance(learn, bool):
        raise table.fail("learn", quoted(learn), "true or false")
    return ReferenceDevice(
        url=table.text("url"),
        baud=int(table.number("baud", 115200.0, minimum=300.0, maximum=4e6)),
        clock_offset_s=known("clock_offset_s", minimum=-1e6, maximum=1e6),
        clock_sigma_s=known("clock_sigma_s", above=0.0, maximum=10.0),
        geoid_separation_m=known("geoid_separation_m", minimum=-200.0, maximum=200.0),
        learn=learn,
    )


def _station(table: Table) -> StationDevices:
    table.refuse_unknown(_STATION)
    settings = table.table("camera_settings").values
    return StationDevices(
        name=table.text("name"),
        camera=table.text("camera"),
        camera_settings=dict(settings),
        head=_head(table) if "ptu" in table else None,
    )


def _head(table: Table) -> HeadDevice:
    settings = table.table("ptu_settings")
    settings.refuse_unknown(_PTU_SETTINGS)
    park = table.vector("park_deg", 2, (0.0, 0.0))

    def both(what: str, default: float, **bounds: float) -> tuple[float, float]:
        pan, tilt = (math.radians(settings.number(f"{a}_{what}", default, **bounds)) for a in ("pan", "tilt"))
        return pan, tilt

    def limits(which: str, open_end: float) -> tuple[float, float]:
        pan, tilt = (
            math.radians(settings.number(f"{a}_{which}_deg")) if f"{a}_{which}_deg" in settings else open_end
            for a in ("pan", "tilt")
        )
        return pan, tilt

    return HeadDevice(
        url=table.text("ptu"),
        protocol=table.text("ptu_protocol", "flir"),
        options=dict(table.table("ptu_options").values),
        signs=(_sign(settings, "pan_sign"), _sign(settings, "tilt_sign")),
        zeros_rad=both("zero_deg", 0.0),
        lows_rad=limits("low", -math.inf),
        highs_rad=limits("high", math.inf),
        rates_rad_s=_rates(settings),
        baud=int(settings.number("baud", 0.0, minimum=0.0, maximum=4e6)),
        latency_s=settings.number("latency_s", minimum=0.0, maximum=1.0) if "latency_s" in settings else None,
        poll_s=1.0 / settings.number("poll_hz", 100.0, above=0.0, maximum=1000.0),
        park_rad=(math.radians(park[0]), math.radians(park[1])),
    )


def _sign(settings: Table, key: str) -> int:
    value = settings.number(key, 1.0)
    if value not in (1.0, -1.0):
        raise settings.fail(key, quoted(value), "1 or -1")
    return int(value)


def _rates(settings: Table) -> tuple[float, float]:
    pan, tilt = (
        math.radians(settings.number(f"{a}_rate_deg_s", above=0.0)) if f"{a}_rate_deg_s" in settings else math.inf
        for a in ("pan", "tilt")
    )
    return pan, tilt
