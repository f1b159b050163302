"""``STATION.toml``: which devices stand at the airstrip and how they are used. The rig file states their poses."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

from groundstation.autopilot.settings import AutopilotSettings, parse_autopilot
from groundstation.errors import ConfigError, InputError
from groundstation.files.text_file import absence
from groundstation.files.toml_table import TomlTable, load_toml, quoted
from groundstation.live.head_device import HeadDevice
from groundstation.live.reference_device import Network, ReferenceDevice, sender_networks
from groundstation.pointing.keep_out import Sector
from groundstation.pointing.pointing_law import PointingConfig
from groundstation.pointing.search_pattern import SearchConfig
from groundstation.rig.rig import Rig, load_rig
from groundstation.session.folder import GeoOrigin, parse_origin
from groundstation.session.site_air import SiteAir, parse_air
from groundstation.sources.cameras.open_camera import CameraUrlError, parse_camera_url
from groundstation.sources.panorama_file import read_panoramas
from groundstation.tracking.config import config_from_mapping
from groundstation.tracking.registered_heads import AnglesFromPicture, RegisteredHeads
from ptu_drivers.settings import SLOWEST_BAUD

STATION_FORMAT = "groundstation-station/1"
MAX_STATIONS = 16
# a search takes 60 ms of a processor, a registration without one 7 ms
_SEARCH_EVERY = 8
_TOP = frozenset(
    {
        *("format", "name", "rig", "config", "rate_hz", "target", "record", "pointing", "search", "station"),
        *("reference", "origin", "safety", "park_s", "autopilot", "landing_site", "panorama"),
        *("stars", "air"),
    }
)
_REFERENCE = frozenset({"url", "baud", "clock_offset_s", "clock_sigma_s", "geoid_separation_m", "learn", "senders"})
_STATION = frozenset(
    {"name", "camera", "camera_settings", "ptu", "ptu_protocol", "ptu_settings", "ptu_options", "park_deg", "sectors"}
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
    sun_angle_rad : how far from the Sun each lens is kept; 0 does not avoid it, None goes by the field of view.
    antenna_in_body_m : its antenna from the nose: forward, right, down; None if unknown.
    autopilot : the vehicle that the position is sent to, None for none; it needs ``origin``.
    geoid_separation_m : height of the geoid above the ellipsoid, None if no table states it.
    landing_site : file of runway, plan and alert limits; None for none.
    panorama : file of `calibrate panorama`, by which frames tell the heads' angles; None for the encoders' alone.
    stars : whether frames tell them by the stars, where the panorama does not; it needs ``origin``.
    air : at the site, for refraction.
    park_s : what heads may take to park in the end, on top of the time for the rest; None parks within that time.
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
    sun_angle_rad: float | None = None
    record_s: float = 1800.0
    park_s: float | None = None
    autopilot: AutopilotSettings | None = None
    landing_site: Path | None = None
    panorama: Path | None = None
    stars: bool = False
    air: SiteAir = field(default_factory=SiteAir)
    geoid_separation_m: float | None = None

    def load_rig(self) -> Rig:
        """Read the rig; raises `ConfigError` with the station file's key where a file that it names is missing."""
        for key in ("rig", "config", "landing_site"):
            self._require_file(key)
        return load_rig(self.rig)

    def _require_file(self, key: str) -> None:
        """Raise `ConfigError` where a file that a key names is missing."""
        path: Path | None = getattr(self, key)
        if path is not None and not path.is_file():
            raise ConfigError(
                f"{self.path}: {key}",
                got=f"{path} ({absence(path)})",
                wanted="a file, its path seen from the station file's folder",
            )

    def registered_heads(
        self, rig: Rig, stars: Mapping[str, AnglesFromPicture] | None = None, stars_every: int = 1
    ) -> RegisteredHeads:
        """Return what takes angles from pictures by the panorama, where there is one, and by ``stars`` of stations.

        Raises `ConfigError`, which names this file's key, the panorama's file, and the key in it, for one that is
        missing, damaged or not of this rig.
        """
        if self.panorama is None:
            return RegisteredHeads(rig, {}, stars=stars, stars_every=stars_every)
        self._require_file("panorama")
        try:
            panoramas = read_panoramas(self.panorama)
            where = str(self.panorama)
            return RegisteredHeads(rig, panoramas, _SEARCH_EVERY, where, stars, stars_every)
        except InputError as fault:
            # it does not know which key names its file
            where = f"{self.path}: panorama: {fault.where}"
            raise ConfigError(where, got=fault.got, wanted=fault.wanted) from fault


def load_station(path: Path, *, opens_cameras: bool = True) -> StationFile:
    """Read a station file; paths in it are relative to it. Raises `ConfigError`.

    Without ``opens_cameras`` their addresses may be anything, as where pictures have been taken.
    """
    top = TomlTable(load_toml(path, ConfigError), str(path), ConfigError)
    top.refuse_unknown(_TOP)
    top.choice("format", [STATION_FORMAT])
    target, record = top.table("target"), top.table("record")
    target.refuse_unknown({"span_m", "antenna_in_body_m"})
    record.refuse_unknown({"folder", "minutes"})
    listed = top.values.get("station", [])
    if not isinstance(listed, list) or not 2 <= len(listed) <= MAX_STATIONS:
        raise top.fail("station", quoted(listed), f"two to {MAX_STATIONS} tables [[station]]")
    tables = [TomlTable(value, f"{path}: station {k + 1}", ConfigError) for k, value in enumerate(listed)]
    stations = tuple(_station(table, opens_cameras) for table in tables)
    _refuse_shared(top, stations)
    here = path.parent
    reference = _reference(top.table("reference")) if "reference" in top else None
    if reference is not None and "origin" not in top:
        raise top.fail("origin", "nothing", "a table [origin]: where the runway frame lies on Earth, for [reference]")
    safety = top.table("safety")
    safety.refuse_unknown({"sun_angle_deg"})
    sun_angle_deg = safety.number("sun_angle_deg", minimum=0.0, maximum=90.0) if "sun_angle_deg" in safety else None
    if sun_angle_deg and "origin" not in top:
        raise top.fail(
            "origin", "nothing", "a table [origin]: where the station is on Earth, for [safety] sun_angle_deg"
        )
    autopilot = parse_autopilot(top.table("autopilot"), here) if "autopilot" in top else None
    if autopilot is not None and "origin" not in top:
        raise top.fail("origin", "nothing", "a table [origin]: where the runway frame lies on Earth, for [autopilot]")
    stars = top.flag("stars", default=False)
    if stars and "origin" not in top:
        raise top.fail("origin", "nothing", "a table [origin]: where the runway frame lies on Earth, for stars")
    antenna = target.vector("antenna_in_body_m", 3) if "antenna_in_body_m" in target else None
    return StationFile(
        path=path,
        name=top.text("name", path.stem),
        rig=here / top.text("rig", "rig.toml"),
        config=here / top.text("config") if "config" in top else None,
        rate_hz=top.number("rate_hz", 30.0, above=0.0, maximum=1000.0),
        span_m=target.number("span_m", above=0.0, maximum=200.0) if "span_m" in target else None,
        record=here / record.text("folder") if "folder" in record else None,
        sun_angle_rad=None if sun_angle_deg is None else math.radians(sun_angle_deg),
        record_s=60.0 * record.number("minutes", 30.0, above=0.0, maximum=1e5),
        pointing=config_from_mapping(PointingConfig, top.table("pointing").values, f"{path}: pointing"),
        search=config_from_mapping(SearchConfig, top.table("search").values, f"{path}: search"),
        stations=stations,
        reference=reference,
        origin=parse_origin(top.table("origin"), "runway") if "origin" in top else None,
        park_s=top.number("park_s", minimum=0.0, maximum=120.0) if "park_s" in top else None,
        autopilot=autopilot,
        geoid_separation_m=None if reference is None else reference.geoid_separation_m,
        landing_site=here / top.text("landing_site") if "landing_site" in top else None,
        panorama=here / top.text("panorama") if "panorama" in top else None,
        stars=stars,
        air=parse_air(top.table("air")),
        antenna_in_body_m=None if antenna is None else (float(antenna[0]), float(antenna[1]), float(antenna[2])),
    )


def _refuse_shared(top: TomlTable, stations: tuple[StationDevices, ...]) -> None:
    """Raise `ConfigError` where two stations share a name or a device: each would take what the other has asked for."""
    if len({s.name for s in stations}) < len(stations):
        raise top.fail("station", "two of one name", "names that differ, those of the rig file")
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


def _reference(table: TomlTable) -> ReferenceDevice:
    table.refuse_unknown(_REFERENCE)
    learn = table.values.get("learn", True)
    if not isinstance(learn, bool):
        raise table.fail("learn", quoted(learn), "true or false")
    senders = table.values.get("senders", [])
    if not isinstance(senders, list):
        raise table.fail("senders", quoted(senders), "a list of IPv4 addresses or networks")
    url = table.text("url")
    try:
        return _reference_at(url, table, learn, sender_networks(senders, "senders"))
    except ConfigError as fault:
        # it does not know of which file it is
        raise ConfigError(f"{table.where}: {fault.where}", got=fault.got, wanted=fault.wanted) from fault


def _reference_at(url: str, table: TomlTable, learn: bool, senders: tuple[Network, ...]) -> ReferenceDevice:
    def known(key: str, **bounds: float) -> float | None:
        return table.number(key, **bounds) if key in table else None

    return ReferenceDevice(
        url=url,
        baud=int(table.number("baud", 115200.0, minimum=300.0, maximum=4e6)),
        clock_offset_s=known("clock_offset_s", minimum=-1e6, maximum=1e6),
        clock_sigma_s=known("clock_sigma_s", above=0.0, maximum=10.0),
        geoid_separation_m=known("geoid_separation_m", minimum=-200.0, maximum=200.0),
        learn=learn,
        senders=senders,
    )


def _station(table: TomlTable, opens_camera: bool) -> StationDevices:
    table.refuse_unknown(_STATION)
    settings = table.table("camera_settings").values
    camera = table.text("camera")
    try:
        if opens_camera:
            parse_camera_url(camera)
    except CameraUrlError as fault:
        raise table.fail("camera", fault.got, fault.wanted) from fault
    return StationDevices(
        name=table.text("name"),
        camera=camera,
        camera_settings=dict(settings),
        head=_head(table) if "ptu" in table else None,
    )


def _head(table: TomlTable) -> HeadDevice:
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

    lows, highs = limits("low", -math.inf), limits("high", math.inf)
    for axis, at, low, high in zip(("pan", "tilt"), map(math.radians, park), lows, highs, strict=True):
        ends = f"{math.degrees(low):g} and {axis}_high_deg {math.degrees(high):g}"
        if not low < high:
            raise settings.fail(f"{axis}_low_deg", ends, "low below high")
        if "park_deg" in table and not low <= at <= high:
            raise table.fail("park_deg", f"{axis} {math.degrees(at):g}", f"between {axis}_low_deg {ends}")
    return HeadDevice(
        url=table.text("ptu"),
        protocol=table.text("ptu_protocol", "flir"),
        options=dict(table.table("ptu_options").values),
        signs=(_sign(settings, "pan_sign"), _sign(settings, "tilt_sign")),
        zeros_rad=both("zero_deg", 0.0),
        lows_rad=lows,
        highs_rad=highs,
        rates_rad_s=_rates(settings),
        baud=_baud(settings),
        latency_s=settings.number("latency_s", minimum=0.0, maximum=1.0) if "latency_s" in settings else None,
        poll_s=1.0 / settings.number("poll_hz", 100.0, above=0.0, maximum=1000.0),
        park_rad=(math.radians(park[0]), math.radians(park[1])),
        sectors=_sectors(table),
    )


def _baud(settings: TomlTable) -> int:
    """Return a line's speed, bit/s; 0 keeps the present one."""
    baud = int(settings.number("baud", 0.0, minimum=0.0, maximum=4e6))
    if 0 < baud < SLOWEST_BAUD:
        raise settings.fail("baud", f"{baud}", f"0, or {SLOWEST_BAUD} and more")
    return baud


def _sectors(table: TomlTable) -> tuple[Sector, ...]:
    """Return what is closed to a head."""
    listed = table.values.get("sectors", [])
    if not isinstance(listed, list):
        raise table.fail("sectors", quoted(listed), "a list as [{ pan_deg = [-30, 10], tilt_deg = [-5, 5] }]")
    found = []
    for n, one in enumerate(listed):
        sector = TomlTable(one, f"{table.where}: sectors {n + 1}", ConfigError)
        sector.refuse_unknown({"pan_deg", "tilt_deg"})
        ends = {}
        for axis in ("pan", "tilt"):
            low, high = (float(v) for v in sector.vector(f"{axis}_deg", 2))
            if not 0.0 < high - low <= 360.0:
                raise sector.fail(f"{axis}_deg", f"[{low:g}, {high:g}]", "low, high, at most a turn apart")
            ends[axis] = (math.radians(low), math.radians(high))
        found.append(Sector(pan_rad=ends["pan"], tilt_rad=ends["tilt"]))
    return tuple(found)


def _sign(settings: TomlTable, key: str) -> int:
    value = settings.number(key, 1.0)
    if value not in (1.0, -1.0):
        raise settings.fail(key, quoted(value), "1 or -1")
    return int(value)


def _rates(settings: TomlTable) -> tuple[float, float]:
    pan, tilt = (
        math.radians(settings.number(f"{a}_rate_deg_s", above=0.0)) if f"{a}_rate_deg_s" in settings else math.inf
        for a in ("pan", "tilt")
    )
    return pan, tilt
