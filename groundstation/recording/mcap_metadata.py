"""Header and closing record of a recording: attached files, configuration, number of events."""

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from groundstation import __version__
from groundstation.errors import RecordingError
from groundstation.files.toml_table import TomlTable, quoted
from groundstation.messages import InitialState
from groundstation.recording.mcap_reader import McapContents

FORMAT = "groundstation-recording/1"
ABOUT = "groundstation"
END = "groundstation.end"
SESSION, RIG, CONFIG = "session.toml", "rig.toml", "config.toml"
# tables that a session may have, for evaluation and for calibration states
REFERENCES = ("dgps.csv", "truth.csv")
EVENTS_TOPIC, TRACK_TOPIC, CAMERAS_TOPIC = "/groundstation/events", "/groundstation/track", "/groundstation/cameras"
STATES_TOPIC = "/groundstation/states"
# how the notes in the session.toml of a recording of operation begin
IN_OPERATION = "recorded in operation"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordingHeader:
    """Configuration of a recorded run.

    Attributes
    ----------
    name : of the session.
    files : session.toml, rig.toml, config.toml as they were read, and the reference tables that there are.
    pictures : whether the events hold pictures; else pixels of an external detector.
    initial : the initial state of the pipeline, if it had one.
    learns_from_reference : whether reference positions update the filter.
    left_out : stations that session.toml may name and the rig does not have.
    corrected : whether stamps and readings are corrected by the rig; those of early recordings of operation are not.
    clock_by_identity : whether the rig's DGPS clock of a named session was that of the run only if it names this run:
        earlier recordings of operation took it by the station's name, which all of them have.
    """

    name: str
    files: Mapping[str, bytes]
    pictures: bool = True
    initial: InitialState | None = None
    learns_from_reference: bool = False
    left_out: tuple[str, ...] = ()
    corrected: bool = True
    clock_by_identity: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingStatistics:
    """The closing record: number of events and epochs, and the stamps of the first and last epoch."""

    events: int
    epochs: int
    first_s: float
    last_s: float


def header_values(header: RecordingHeader) -> dict[str, str]:
    """Return the header as text values; the versions are informative only."""
    values = {
        "format": FORMAT,
        "name": header.name,
        "pictures": json.dumps(header.pictures),
        "taught": json.dumps(header.learns_from_reference),
        "left_out": json.dumps(list(header.left_out)),
        "corrected": json.dumps(header.corrected),
        "clock_by_identity": json.dumps(header.clock_by_identity),
        "initial": json.dumps(None if header.initial is None else _initial_values(header.initial)),
        "version": __version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }
    return values | {name: version(name) for name in ("numpy", "scipy", "numba", "opencv-python-headless", "mcap")}


def parse_header(contents: McapContents, where: str) -> RecordingHeader:
    """Return the header of a file; raises `RecordingError` for a file of another format."""
    about = contents.metadata.get(ABOUT)
    if about is None or about.get("format") != FORMAT:
        got = f"format {quoted(about.get('format'))}" if about is not None else "another program's file"
        if about is None and contents.fault is not None:
            got = f"{contents.fault.got} before the header"
        raise RecordingError(where, got=got, wanted=f"a recording of the format {FORMAT!r}")
    missing = [name for name in (SESSION, RIG, CONFIG) if name not in contents.attachments]
    if missing:
        raise RecordingError(where, got=f"no {missing[0]} in it", wanted="one, as in each recording of this program")
    in_operation = IN_OPERATION.encode() in contents.attachments[SESSION]
    initial, left_out = _json(about, "initial", where), _json(about, "left_out", where)
    if not isinstance(left_out, list) or not all(isinstance(name, str) for name in left_out):
        raise RecordingError(f"{where}: left_out", got=quoted(left_out), wanted="a list of stations")
    return RecordingHeader(
        name=about.get("name", ""),
        files=contents.attachments,
        pictures=_json(about, "pictures", where) is True,
        initial=None if initial is None else _initial(TomlTable(initial, f"{where}: initial", RecordingError)),
        learns_from_reference=_json(about, "taught", where) is True,
        left_out=tuple(left_out),
        corrected=about.get("corrected") == "true" or not in_operation,
        clock_by_identity=about.get("clock_by_identity") == "true" or not in_operation,
    )


def statistics_values(end: RecordingStatistics) -> dict[str, str]:
    """Return the closing record as text values."""
    return {
        "events": str(end.events),
        "epochs": str(end.epochs),
        "first_s": repr(end.first_s),
        "last_s": repr(end.last_s),
    }


def parse_statistics(contents: McapContents) -> RecordingStatistics | None:
    """Return the closing record; None if it is missing or invalid."""
    values = contents.metadata.get(END)
    if contents.fault is not None or values is None:
        return None
    try:
        end = RecordingStatistics(
            events=int(values["events"]),
            epochs=int(values["epochs"]),
            first_s=float(values["first_s"]),
            last_s=float(values["last_s"]),
        )
    except (KeyError, ValueError):
        return None
    return end if np.isfinite([end.first_s, end.last_s]).all() and min(end.events, end.epochs) >= 0 else None


def _initial_values(initial: InitialState) -> dict[str, Any]:
    return {
        "t_s": float(initial.t_s),
        "position_runway_m": initial.position_runway_m.tolist(),
        "velocity_runway_m_s": initial.velocity_runway_m_s.tolist(),
        "sigma_position_m": initial.sigma_position_m.tolist(),
        "sigma_velocity_m_s": initial.sigma_velocity_m_s.tolist(),
    }


def _initial(table: TomlTable) -> InitialState:
    return InitialState(
        t_s=table.number("t_s"),
        position_runway_m=table.vector("position_runway_m", 3),
        velocity_runway_m_s=table.vector("velocity_runway_m_s", 3),
        sigma_position_m=table.vector("sigma_position_m", 3),
        sigma_velocity_m_s=table.vector("sigma_velocity_m_s", 3),
    )


def _json(values: Mapping[str, str], key: str, where: str) -> Any:
    try:
        return json.loads(values.get(key, "null"))
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{where}: {key}", got=quoted(values.get(key)), wanted="JSON") from error
