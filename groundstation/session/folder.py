"""The session folder: session.toml, the rig, and checks of the tables and videos."""

import difflib
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import GroundstationError, RecordingError, SessionError
from groundstation.files.csv_table import CsvTable
from groundstation.files.text_file import TextFolder, absence, is_other_kind
from groundstation.files.toml_table import TomlTable, load_toml, quoted
from groundstation.messages import InitialState
from groundstation.recording.mcap_metadata import IN_OPERATION, RecordingHeader
from groundstation.rig.dgps import read_antenna
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import ClockModel, Rig, Station, load_rig
from groundstation.session.applied_axes import APPLIED_AXES, read_applied_axes, require_applied_axes
from groundstation.session.dgps_options import DgpsOptions, parse_dgps
from groundstation.session.media import Medium, MediumKind, check_medium, find_media, image_files
from groundstation.session.session_clocks import parse_clocks, with_session_clocks
from groundstation.session.site_air import SiteAir, parse_air

_TABLES = ("clocks", "target", "initial", "origin", "air", "phase", "dgps", APPLIED_AXES)
_MAX_PHASES = 10_000
# the recorder's own notes are few; searching for misspelt keys costs a comparison with each known key
_MAX_ENTRIES = 1_000
# how this program's files of other kinds call themselves
_OTHER_FILES = ("groundstation-", "stereo-ptu-rig/")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetModel:
    """The aircraft: wing span in m; antenna position from the nose in m, (3,) x forward, y right, z down."""

    span_m: float | None
    antenna_in_body_m: FloatArray | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BackgroundPhase:
    """A stretch of session time with one kind of background: sky, mixed or ground."""

    from_s: float
    to_s: float
    background: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoOrigin:
    """Pose of the session's frame on Earth; height above the ellipsoid, azimuth of +y from true north."""

    lat_deg: float
    lon_deg: float
    height_m: float
    y_axis_azimuth_deg: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordingInfo:
    """The recording of a session: the file, the configuration of the run, and whether the file was closed.

    ``path`` of the container; ``header`` describes the run; by the clocks and axes of ``rig`` the events are corrected:
    the recorded one, or of an early recording of operation one of ideal devices. ``rig_replaced``: the session's rig is
    another than the recorded one, and corrects them instead. ``fault`` is a fault at the end of the file, if any.
    ``epochs`` and ``span_s`` (first and last) are None for a file that was not closed.
    """

    path: Path
    header: RecordingHeader
    rig: Rig
    epochs: int | None
    span_s: tuple[float, float] | None
    fault: RecordingError | None
    rig_replaced: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Session:
    """One session, a folder or a recording, checked.

    Attributes
    ----------
    folder : container of its tables: a folder, or the files attached to a recording.
    rig : the calibrated stations; clocks missing from the rig file are those of [clocks].
    frame : "runway" or "east-north-up".
    date, licence, notes : text of the file; empty if absent.
    initial, origin : None where the file does not give them.
    clocks : the [clocks] table, by station or table name.
    dgps : options for reading a log of positions, where there is one instead of dgps.csv.
    media : each station's pictures; empty for a session of detections only.
    left_out : stations of the folder's own rig that are missing from the rig in use; their rows are skipped.
    recorded : information on the recording; None for a folder.
    air : of the site, for refraction.
    clock_entries : clocks of ``rig`` that its file lacks, ``station.camera_clock`` or ``.ptu_clock``: the entry of
        [clocks] that each is a copy of.
    applied_axes : axis errors, by station, that are taken out of its angles already, instead of readings.
    """

    name: str
    folder: TextFolder
    rig: Rig
    frame: str
    date: str
    licence: str
    notes: str
    target: TargetModel
    initial: InitialState | None
    origin: GeoOrigin | None
    phases: tuple[BackgroundPhase, ...]
    clocks: dict[str, ClockModel]
    dgps: DgpsOptions
    media: dict[str, Medium]
    left_out: frozenset[str]
    recorded: RecordingInfo | None = None
    air: SiteAir = field(default_factory=SiteAir)
    clock_entries: Mapping[str, str] = field(default_factory=dict)
    applied_axes: Mapping[str, PtuAxes] = field(default_factory=dict)

    @property
    def in_operation(self) -> bool:
        """Whether it was recorded by `groundstation live`."""
        return self.notes.startswith(IN_OPERATION)

    @property
    def identity(self) -> str:
        """What tells it from other sessions: its name, of a recording of operation the station's name and its date."""
        return f"{self.name} {self.date}".strip() if self.in_operation else self.name

    @property
    def clock_identity(self) -> str:
        """What a named DGPS clock is to name: the identity, or the name alone where an earlier run took it by that."""
        recorded = self.recorded
        by_name = recorded is not None and not (recorded.rig_replaced or recorded.header.clock_by_identity)
        return self.name if by_name else self.identity

    @property
    def detections_only(self) -> bool:
        """Whether target pixels come from detections.csv instead of pictures."""
        return not self.media

    @property
    def has_clocks(self) -> bool:
        """Whether [clocks] names the stations: then the session's clock is the DGPS clock."""
        cameras = (*self.rig.names, "detections" if self.detections_only else "frames")
        return any(name in self.clocks for name in cameras)

    def camera_clock(self, station: Station) -> ClockModel:
        """Return the map from a camera's stamps to session time: from the rig, else [clocks], else equal."""
        return ClockModel() if station.camera_clock is None else station.camera_clock

    def ptu_clock(self, station: Station) -> ClockModel:
        """Return the map from PTU stamps to session time: from the rig, else [clocks] of ``ptu``, else equal."""
        return station.ptu_clock

    def reading_axes(self, station: Station) -> PtuAxes:
        """Return the axes that make angles of the readings: the rig's, but for the lean none where they are applied."""
        own = station.ptu_axes
        return PtuAxes(lean_rad=own.lean_rad) if station.name in self.applied_axes else own


def load_folder(folder: Path, rig_path: Path | None = None) -> Session:
    """Read a session folder and check what can be checked without reading its recordings.

    Raises `SessionError` or `RigError` with the place, the value found and the value expected.
    """
    if not folder.is_dir():
        got = absence(folder) if is_other_kind(folder) else "no such folder"
        raise SessionError(str(folder), got=got, wanted="a session folder with session.toml")
    rig = load_rig(rig_path if rig_path is not None else folder / "rig.toml")
    left_out = _left_out(folder, rig) if rig_path is not None else frozenset()
    session = read_session(folder, Path(os.path.realpath(folder)).name, rig, left_out, find_media(folder, rig))
    if session.media:
        frames_table(session)
    else:
        detections_table(session)
    ptu_table(session)
    for name, medium in session.media.items():
        if not _is_empty_as_listed(session, name, medium):
            check_medium(medium, rig[name].lens.image_size_px)
    return session


def _is_empty_as_listed(session: Session, name: str, medium: Medium) -> bool:
    """Return whether a station's folder has no picture and frames.csv no stamp of it: a part that it has not filmed."""
    if medium.kind is not MediumKind.IMAGES or image_files(medium.path):
        return False
    table = frames_table(session)
    with suppress(SessionError):
        # a faulty row ends the table, and what it is reported by is a replay
        return all(table.optional_number(row, f"{name}_t_s") is None for row in table)
    return True


def read_session(
    folder: TextFolder, name: str, rig: Rig, left_out: frozenset[str], media: dict[str, Medium]
) -> Session:
    """Read session.toml of a folder or a recording; ``name`` where it gives none.

    Raises `SessionError`, or `RigError` for a rig with other axes than those that the angles are corrected by.
    """
    path = folder / "session.toml"
    top = TomlTable(load_toml(path, SessionError), str(path), SessionError)
    _refuse_misspelt(top)
    kind = top.values.get("format")
    if isinstance(kind, str) and kind.startswith(_OTHER_FILES):
        raise top.fail("format", quoted(kind), "a session's description, which has none")
    clocks = parse_clocks(top.table("clocks"), {*rig.names, *left_out})
    clocked = with_session_clocks(rig, clocks, "frames" if media else "detections")
    applied = read_applied_axes(top.table(APPLIED_AXES), {*rig.names, *left_out})
    require_applied_axes(rig, applied)
    frame = top.text("frame", "runway")
    if frame not in ("runway", "east-north-up"):
        raise top.fail("frame", quoted(frame), "'runway' or 'east-north-up'")
    return Session(
        name=top.text("name", name),
        folder=folder,
        rig=clocked.rig,
        frame=frame,
        date=str(top.values.get("date", "")),
        licence=top.text("licence", ""),
        notes=top.text("notes", ""),
        target=read_target(top.table("target")),
        initial=_initial(top.table("initial")) if "initial" in top else None,
        origin=parse_origin(top.table("origin"), frame) if isinstance(top.values.get("origin"), dict) else None,
        phases=_phases(top),
        clocks=clocks,
        dgps=parse_dgps(top.table("dgps")),
        media=media,
        left_out=left_out,
        air=parse_air(top.table("air")) if isinstance(top.values.get("air"), dict) else SiteAir(),
        clock_entries=clocked.entries,
        applied_axes=applied,
    )


def frames_table(session: Session) -> CsvTable:
    """Open frames.csv; raises `SessionError` if it or a station's column is missing."""
    return CsvTable(session.folder / "frames.csv", ["index", *(f"{name}_t_s" for name in session.rig.names)])


def detections_table(session: Session) -> CsvTable:
    """Open detections.csv; raises `SessionError` if it or a column is missing."""
    return CsvTable(session.folder / "detections.csv", ["t_s", "station", "u_px", "v_px"])


def ptu_table(session: Session) -> CsvTable | None:
    """Open ptu.csv; None if no station turns. Raises `SessionError` if it or a turning station's column is missing."""
    turning = [s.name for s in session.rig.stations if not s.fixed]
    columns = [f"{name}_{axis}_deg" for name in turning for axis in ("pan", "tilt")]
    return CsvTable(session.folder / "ptu.csv", ["t_s", *columns]) if turning else None


def _refuse_misspelt(top: TomlTable) -> None:
    """Raise for a table whose name is nearly one that is read; other entries are the recorder's own notes."""
    if len(top.values) > _MAX_ENTRIES:
        raise SessionError(top.where, got=f"{len(top.values)} entries", wanted=f"at most {_MAX_ENTRIES}")
    longest = 2 * max(map(len, _TABLES))
    for key, value in top.values.items():
        if len(key) > longest:
            continue
        near = difflib.get_close_matches(key.lower(), _TABLES, n=1, cutoff=0.75)
        if key not in _TABLES and near and isinstance(value, dict | list):
            raise top.fail(key, "an unknown table", f"[{near[0]}], if that is what is meant")


def _left_out(folder: Path, rig: Rig) -> frozenset[str]:
    """Return the stations that only the folder's own rig has; none if that cannot be read."""
    try:
        own = load_rig(folder / "rig.toml")
    except GroundstationError:
        return frozenset()
    return frozenset(own.names) - frozenset(rig.names)


def read_target(table: TomlTable) -> TargetModel:
    """Read what is known of the aircraft."""
    table.refuse_unknown({"span_m", "antenna_in_body_m"})
    span_m = table.number("span_m", above=0.0, maximum=200.0) if "span_m" in table else None
    return TargetModel(span_m=span_m, antenna_in_body_m=read_antenna(table, span_m))


def _initial(table: TomlTable) -> InitialState:
    table.refuse_unknown({"t_s", "position_m", "velocity_m_s", "sigma_position_m", "sigma_velocity_m_s"})
    return InitialState(
        t_s=table.number("t_s"),
        position_runway_m=table.vector("position_m", 3),
        velocity_runway_m_s=table.vector("velocity_m_s", 3),
        sigma_position_m=_sigmas(table, "sigma_position_m"),
        sigma_velocity_m_s=_sigmas(table, "sigma_velocity_m_s"),
    )


def _sigmas(table: TomlTable, key: str) -> FloatArray:
    """Return one sigma for all axes, or three."""
    if isinstance(table.values.get(key), list):
        sigmas = table.vector(key, 3)
        if np.any(sigmas <= 0):
            raise table.fail(key, str(sigmas.tolist()), "numbers > 0")
        return sigmas
    return np.full(3, table.number(key, above=0.0))


def parse_origin(table: TomlTable, frame: str) -> GeoOrigin:
    """Parse [origin]; raises the table's error."""
    table.refuse_unknown({"lat_deg", "lon_deg", "height_m", "y_axis_azimuth_deg"})
    return GeoOrigin(
        lat_deg=table.number("lat_deg", minimum=-90.0, maximum=90.0),
        lon_deg=table.number("lon_deg", minimum=-360.0, maximum=360.0),
        height_m=table.number("height_m"),
        # y is north in the frame east-north-up; a runway's direction must be given
        y_axis_azimuth_deg=table.number("y_axis_azimuth_deg", None if frame == "runway" else 0.0),
    )


def _phases(top: TomlTable) -> tuple[BackgroundPhase, ...]:
    rows = top.values.get("phase", [])
    if not isinstance(rows, list) or len(rows) > _MAX_PHASES:
        raise top.fail("phase", quoted(rows), f"at most {_MAX_PHASES} [[phase]] tables")
    phases = []
    for number, row in enumerate(rows, start=1):
        table = TomlTable(row, f"{top.where}: phase {number}", SessionError)
        table.refuse_unknown({"from_s", "to_s", "background"})
        start, end = table.number("from_s"), table.number("to_s")
        if end < start:
            raise table.fail("to_s", f"{end:g}", f"at least from_s = {start:g}")
        background = table.text("background")
        if background not in ("sky", "mixed", "ground"):
            raise table.fail("background", quoted(background), "'sky', 'mixed' or 'ground'")
        phases.append(BackgroundPhase(from_s=start, to_s=end, background=background))
    return tuple(phases)
