"""The calibrated rig: the calibration of each station, read from ``rig.toml``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import RigError
from groundstation.files.image_header import MAX_PICTURE_PX
from groundstation.files.output_names import name_fault
from groundstation.files.text_file import TextFile
from groundstation.files.toml_table import TomlTable, load_toml, quoted
from groundstation.geometry.calibration import perturbed_station
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.geometry.station import StationGeometry
from groundstation.rig.covariance import READOUT, ParameterCovariance, joined, read_covariance, require_agreement
from groundstation.rig.dgps import RigReference, read_reference
from groundstation.rig.ptu_axes import IDEAL_AXES, PtuAxes, read_axes
from groundstation.rig.rig_limits import focal_wanted, read_arm, read_distortion, read_reading_deg, read_readout

RIG_FORMAT = "stereo-ptu-rig/1"
UNIT_QUATERNION_TOLERANCE = 1e-4
MAX_STATIONS = 64
# a station's name is part of file names
MAX_NAME_CHARACTERS = 64
# a hundred times the drift of a poor quartz; a larger value indicates a wrong unit
MAX_DRIFT_PPM = 10_000.0

_STATION_KEYS = frozenset(
    {
        *("name", "fixed", "known", "ptu_position_m", "runway_from_base_wxyz", "head_from_camera_wxyz"),
        *("camera_in_head_m", "image_size_px", "focal_px", "principal_point_px", "distortion"),
        *("ptu_resolution_deg", "ptu_sigma_deg", "ptu_clock", "camera_clock", "readout_s", "covariance"),
        *("ptu_axes", "readout_sigma_s"),
    }
)
# farther from the threshold than any station
_FARTHEST_M = 100_000.0
Seconds = TypeVar("Seconds", float, FloatArray)
_CLOCK_KEYS = frozenset({"offset_s", "drift_ppm", "sigma_s"})
PARTS = ("position", "orientation", "lens")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockModel:
    """Mapping of a device's clock to the session's: t_session = t_device + offset + drift · t_device.

    ``offset_s`` in s, ``drift_ppm`` in parts per million of the device's own time, ``sigma_s`` one sigma of
    the offset.
    """

    offset_s: float = 0.0
    drift_ppm: float = 0.0
    sigma_s: float = 0.0

    def session_from_device(self, t_device_s: Seconds) -> Seconds:
        """Map stamps in s of the device's clock, one or (n,), to s of the session's clock."""
        return t_device_s + self.offset_s + self.drift_ppm * 1e-6 * t_device_s

    def device_from_session(self, t_session_s: Seconds) -> Seconds:
        """Map s of the session's clock, one or (n,), to stamps in s of the device's clock."""
        return (t_session_s - self.offset_s) / (1.0 + self.drift_ppm * 1e-6)


EQUAL_CLOCKS = ClockModel()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Station:
    """One station of the rig, by FORMAT version 1 (see docs/conventions.md).

    Attributes
    ----------
    ptu_position_m : (3,) where the pan and tilt axes meet, runway frame.
    runway_from_base_wxyz, head_from_camera_wxyz : (4,) unit Hamilton quaternions.
    camera_in_head_m : (3,) lever arm of the camera's centre, head frame.
    ptu_resolution_rad, ptu_sigma_rad : encoder step, and 1 sigma of a reading besides the step.
    ptu_clock, camera_clock : device clocks; ``camera_clock`` None if not given.
    readout_s, readout_sigma_s : rolling shutter, first row to last, and one sigma of it.
    known : which of position, orientation and lens are calibrated.
    covariance_parameters, covariance : names and matrix of the station's own table, which is empty where the
        rig's table has them: `Rig.station_covariance` is what is known.
    ptu_clock_given : whether the rig file itself gives ``ptu_clock``, be it zero.
    ptu_axes : errors of the axes, which map readings to angles.
    """

    name: str
    fixed: bool
    known: tuple[str, ...]
    ptu_position_m: FloatArray
    runway_from_base_wxyz: FloatArray
    head_from_camera_wxyz: FloatArray
    camera_in_head_m: FloatArray
    lens: Lens
    ptu_resolution_rad: float
    ptu_sigma_rad: float
    ptu_clock: ClockModel
    camera_clock: ClockModel | None
    readout_s: float
    covariance_parameters: tuple[str, ...]
    covariance: FloatArray
    ptu_clock_given: bool = False
    ptu_axes: PtuAxes = IDEAL_AXES
    readout_sigma_s: float = 0.0

    @property
    def angle_sigma_rad(self) -> float:
        """One sigma of one angle reading: the noise and the quantisation step together."""
        return float(np.hypot(self.ptu_sigma_rad, self.ptu_resolution_rad / np.sqrt(12.0)))

    def geometry(self) -> StationGeometry:
        """Return the station's measurement geometry; packs its arrays, so keep the result."""
        return StationGeometry(
            name=self.name,
            ptu_position_m=self.ptu_position_m,
            runway_from_base_wxyz=self.runway_from_base_wxyz,
            head_from_camera_wxyz=self.head_from_camera_wxyz,
            camera_in_head_m=self.camera_in_head_m,
            lens=self.lens,
            lean_rad=self.ptu_axes.lean_rad,
        )

    def changed(self, change: FloatArray) -> "Station":
        """Return the station with a change (21,) of its calibration, by `geometry.calibration.perturbed_station`."""
        changed = perturbed_station(self.geometry(), change)
        return replace(
            self,
            ptu_position_m=changed.packed[9:12],
            runway_from_base_wxyz=wxyz_from_matrix(changed.packed[0:9].reshape(3, 3)),
            head_from_camera_wxyz=wxyz_from_matrix(changed.packed[12:21].reshape(3, 3)),
            camera_in_head_m=changed.packed[21:24],
            lens=changed.lens,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """The stations of one set-up, in the file's order.

    Attributes
    ----------
    path : where they were read.
    shared_covariance : the calibration's covariance over stations, its names ``station.parameter``; may be empty.
        A parameter that is also in its station's covariance has the same variance in both.
    reference : clock and antenna of the DGPS, from a flight calibration; None without such a table.
    """

    stations: tuple[Station, ...]
    path: str = ""
    shared_covariance: ParameterCovariance = field(default_factory=ParameterCovariance.nothing)
    reference: RigReference | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Station names in the file's order."""
        return tuple(s.name for s in self.stations)

    def __getitem__(self, name: str) -> Station:
        for station in self.stations:
            if station.name == name:
                return station
        raise RigError(self.path, got=f"no station {name!r}", wanted="one of " + ", ".join(self.names))

    def calibration_covariance(self) -> ParameterCovariance:
        """Return the covariance of everything uncertain, names ``station.parameter``.

        Each station's own block and the shared one, which holds where both name a parameter; the shared one may
        include clocks, shutters and parameters of the DGPS.
        """
        blocks = [(tuple(f"{s.name}.{p}" for p in s.covariance_parameters), s.covariance) for s in self.stations]
        names = tuple(name for block, _ in blocks for name in block)
        matrix = np.zeros((len(names), len(names)))
        start = 0
        for block, values in blocks:
            stop = start + len(block)
            matrix[start:stop, start:stop] = values
            start = stop
        return joined(ParameterCovariance(names=names, matrix=matrix), self.shared_covariance)

    def station_covariance(self, name: str) -> ParameterCovariance:
        """Return the covariance of a station's calibration, whichever table has it; names as in its own table."""
        return self.calibration_covariance().of_station(self[name].name)

    def require_known(self, parts: Sequence[str] = PARTS) -> None:
        """Raise `RigError` if any station lacks one of ``parts``."""
        for station in self.stations:
            missing = [p for p in parts if p not in station.known]
            if missing:
                raise RigError(
                    f"{self.path}: station {station.name}",
                    got=f"known = {list(station.known)}",
                    wanted=f"a calibrated {' and '.join(missing)} (find it with `groundstation calibrate flight`)",
                )


def load_rig(path: TextFile) -> Rig:
    """Read a rig file; raises `RigError` with file, station and key of the first fault."""
    document = load_toml(path, RigError)
    top = TomlTable(document, str(path), RigError)
    top.refuse_unknown({"format", "station", "covariance", "reference"})
    if top.text("format") != RIG_FORMAT:
        raise top.fail("format", quoted(document["format"]), repr(RIG_FORMAT))
    rows = document.get("station", [])
    if not isinstance(rows, list) or not 1 <= len(rows) <= MAX_STATIONS:
        got = f"{len(rows)} of them" if isinstance(rows, list) else quoted(rows)
        raise top.fail("station", got, f"1 to {MAX_STATIONS} [[station]] tables")
    stations = tuple(_station(row, i, str(path)) for i, row in enumerate(rows))
    names = [s.name for s in stations]
    for name in names:
        if names.count(name) > 1:
            raise top.fail("station", f"two stations named {name!r}", "names that differ")
        # where upper and lower case are one, so would be their files
        if sum(name.casefold() == other.casefold() for other in names) > 1:
            raise top.fail("station", f"two stations named {name!r} but for upper and lower case", "names that differ")
    shared = read_covariance(top.table("covariance"), names)
    require_agreement(top, shared, _own_variances(stations))
    reference = read_reference(top.table("reference")) if "reference" in top else None
    return Rig(stations=stations, path=str(path), shared_covariance=shared, reference=reference)


def _own_variances(stations: Sequence[Station]) -> dict[str, float]:
    """Return the variances of the stations' parameters, clocks and shutters, by ``station.parameter``."""
    variances: dict[str, float] = {}
    for s in stations:
        pairs = zip(s.covariance_parameters, np.diag(s.covariance), strict=True)
        variances.update({f"{s.name}.{parameter}": float(v) for parameter, v in pairs})
        for clock, model in (
            ("camera_clock", s.camera_clock),
            ("ptu_clock", s.ptu_clock if s.ptu_clock_given else None),
        ):
            if model is not None:
                variances[f"{s.name}.{clock}.offset"] = model.sigma_s**2
        if s.readout_sigma_s > 0.0:
            variances[f"{s.name}.{READOUT}"] = s.readout_sigma_s**2
    return variances


def _station(row: dict[str, Any], number: int, path: str) -> Station:
    """Parse one [[station]] table."""
    table = TomlTable(row, f"{path}: station {number + 1}", RigError)
    name = table.text("name")
    if not name.replace("_", "a").replace("-", "a").isalnum():
        raise table.fail("name", quoted(name), "letters, digits, - and _")
    if len(name) > MAX_NAME_CHARACTERS:
        raise table.fail("name", f"{len(name)} characters", f"at most {MAX_NAME_CHARACTERS}")
    # videos, folders and pictures are called as their stations are
    if (fault := name_fault(name)) is not None:
        raise table.fail("name", fault, "a name that files can have")
    table = TomlTable(row, f"{path}: station {name}", RigError)
    table.refuse_unknown(_STATION_KEYS)
    fixed = table.flag("fixed", False)
    known = _known(table)
    oriented = "orientation" in known
    identity = (1.0, 0.0, 0.0, 0.0)
    resolution_rad = np.radians(read_reading_deg(table, "ptu_resolution_deg", 0.0))
    default_sigma_deg = float(np.degrees(resolution_rad) / np.sqrt(12.0))
    covariance = read_covariance(table.table("covariance"))
    return Station(
        name=name,
        fixed=fixed,
        known=known,
        ptu_position_m=_position(table, None if "position" in known else (0.0, 0.0, 0.0)),
        runway_from_base_wxyz=_unit_quaternion(table, "runway_from_base_wxyz", None if oriented else identity),
        head_from_camera_wxyz=_unit_quaternion(
            table,
            "head_from_camera_wxyz",
            (0.5**0.5, -(0.5**0.5), 0.0, 0.0) if fixed or not oriented else None,
        ),
        camera_in_head_m=read_arm(table),
        lens=_lens(table, required="lens" in known),
        ptu_resolution_rad=float(resolution_rad),
        ptu_sigma_rad=float(np.radians(read_reading_deg(table, "ptu_sigma_deg", default_sigma_deg))),
        ptu_clock=parse_clock(table.table("ptu_clock")),
        camera_clock=parse_clock(table.table("camera_clock")) if "camera_clock" in table else None,
        readout_s=read_readout(table),
        covariance_parameters=covariance.names,
        covariance=covariance.matrix,
        ptu_clock_given="ptu_clock" in table,
        ptu_axes=read_axes(table.table("ptu_axes")),
        readout_sigma_s=table.number("readout_sigma_s", 0.0, minimum=0.0),
    )


def _known(table: TomlTable) -> tuple[str, ...]:
    """Return the calibrated parts; all of them without the key ``known``."""
    value = table.values.get("known", list(PARTS))
    if not isinstance(value, list) or any(v not in PARTS for v in value):
        raise table.fail("known", quoted(value), "a list of " + ", ".join(PARTS))
    # a station that gives its lens has one, whether or not `known` repeats it
    given = set(value) | ({"lens"} if "focal_px" in table else set())
    return tuple(p for p in PARTS if p in given)


def _position(table: TomlTable, default: tuple[float, float, float] | None) -> FloatArray:
    """Return where a station's head stands, runway frame, m."""
    position = table.vector("ptu_position_m", 3, default)
    if np.any(np.abs(position) > _FARTHEST_M):
        raise table.fail(
            "ptu_position_m", quoted(position.tolist()), f"metres, at most {_FARTHEST_M:g} of the threshold"
        )
    return position


def _unit_quaternion(table: TomlTable, key: str, default: tuple[float, ...] | None) -> FloatArray:
    """Return a (4,) wxyz quaternion of unit length, renormalised."""
    q = table.vector(key, 4, default)
    length = math.hypot(*q)
    if abs(length - 1.0) > UNIT_QUATERNION_TOLERANCE:
        raise table.fail(key, f"length {length:.6g}", "a unit quaternion w, x, y, z")
    return q / length


def _lens(table: TomlTable, required: bool) -> Lens:
    """Parse the lens keys."""
    size = table.vector("image_size_px", 2, None if required else (1.0, 1.0), names="[width, height]")
    if np.any(size < 1) or np.any(size != np.round(size)) or np.any(size > 65536) or np.prod(size) > MAX_PICTURE_PX:
        wanted = f"two whole numbers of pixels from 1 to 65536, at most {MAX_PICTURE_PX // 10**6} million pixels"
        raise table.fail("image_size_px", str(size.tolist()), wanted)
    focal = table.vector("focal_px", 2, None if required else (1.0, 1.0), names="[fx, fy]")
    if np.any(focal <= 0):
        raise table.fail("focal_px", str(focal.tolist()), "two numbers > 0")
    if required and (wanted := focal_wanted(size, focal)):
        raise table.fail("focal_px", str(focal.tolist()), wanted)
    middle = table.vector("principal_point_px", 2, None if required else (0.0, 0.0), names="[cx, cy]")
    if required and np.all((middle > 0) & (middle < 1)):
        raise table.fail("principal_point_px", str(middle.tolist()), "pixels, not shares of the picture")
    # a part of a sensor that is read out, or a shifted lens, may have it outside, but not far
    if np.any(middle < -size) or np.any(middle > 2 * size):
        wanted = f"a point in the picture of {size[0]:.0f} × {size[1]:.0f} px, or at most its size away"
        raise table.fail("principal_point_px", str(middle.tolist()), wanted)
    # without a size or a focal length there is no corner to displace
    measured = "image_size_px" in table and "focal_px" in table
    distortion = read_distortion(table, size, focal) if measured else table.vector("distortion", 5, (0.0,) * 5)
    return Lens(
        image_size_px=(int(size[0]), int(size[1])),
        focal_px=focal,
        principal_point_px=middle,
        distortion=distortion,
    )


def parse_clock(table: TomlTable) -> ClockModel:
    """Read a clock table of rig.toml or session.toml."""
    table.refuse_unknown(_CLOCK_KEYS)
    drift_ppm = table.number("drift_ppm", 0.0)
    if abs(drift_ppm) > MAX_DRIFT_PPM:
        raise table.fail("drift_ppm", f"{drift_ppm:g}", f"at most {MAX_DRIFT_PPM:g} either way")
    return ClockModel(
        offset_s=table.number("offset_s", 0.0),
        drift_ppm=drift_ppm,
        sigma_s=table.number("sigma_s", 0.0, minimum=0.0),
    )
