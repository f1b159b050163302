"""Loading of a session: a folder of videos and tables, or a recording (.mcap)."""

import errno
import os
from dataclasses import replace
from pathlib import Path

from groundstation.errors import SessionError
from groundstation.files.text_file import AttachedFiles
from groundstation.files.toml_table import shown
from groundstation.recording.mcap_metadata import RIG, RecordingHeader, parse_header, parse_statistics
from groundstation.recording.mcap_reader import McapContents, McapReader
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import EQUAL_CLOCKS, Rig, load_rig
from groundstation.session.folder import RecordingInfo, Session, load_folder, read_session
from groundstation.session.media import Medium, MediumKind

# the recording in the folder of a run of `groundstation live`
LIVE_RECORDING = "flight.mcap"


def load_session(path: Path, rig_path: Path | None = None) -> Session:
    """Read a session folder or a recording (.mcap) and check what can be checked without reading all of it.

    The folder of a live run is its recording.

    Raises `SessionError`, `RecordingError` or `RigError` with the place, the value found and the value expected.
    """
    if path.is_dir() and not os.access(path, os.R_OK | os.X_OK):
        raise SessionError(str(path), got=os.strerror(errno.EACCES), wanted="a folder that can be read")
    if (path / LIVE_RECORDING).is_file() and not (path / "session.toml").exists():
        path = path / LIVE_RECORDING
    if path.is_file():
        return _load_recording(path, rig_path)
    if not path.exists() and path.suffix == ".mcap":
        raise SessionError(str(path), got="no such file", wanted="a recording")
    if (path / "metadata.yaml").is_file() and not (path / RIG).exists():
        wanted = "a session folder or a recording: `groundstation convert` turns a bag into a folder"
        raise SessionError(str(path), got="a ROS 2 bag", wanted=wanted)
    if path.is_dir() and not (path / RIG).exists() and not (path / "session.toml").exists():
        # as where a bag's files were copied one by one
        files = sorted(f.name for f in path.iterdir() if f.suffix in (".mcap", ".db3"))
        if files:
            wanted = "a session folder, or a ROS 2 bag with its metadata.yaml"
            raise SessionError(
                str(path), got=f"{shown(files[0])} and neither session.toml nor metadata.yaml", wanted=wanted
            )
    return load_folder(path, rig_path)


def _load_recording(path: Path, rig_path: Path | None) -> Session:
    """Read the header and the attached files of a recording; ``rig_path`` replaces the recorded rig."""
    with McapReader(path) as reader:
        contents: McapContents = reader.contents()
    header = parse_header(contents, path.name)
    folder = AttachedFiles(path.name, header.files)
    own = load_rig(folder / RIG)
    rig = own if rig_path is None else load_rig(rig_path)
    session = _read_attached(folder, path, header, own, rig)
    end = parse_statistics(contents)
    recorded = RecordingInfo(
        path=path,
        header=header,
        rig=_correcting_rig((session if rig is own else _read_attached(folder, path, header, own, own)).rig, header),
        epochs=None if end is None else end.epochs,
        span_s=None if end is None else (end.first_s, end.last_s),
        fault=contents.fault,
        rig_replaced=rig is not own,
    )
    return replace(session, recorded=recorded)


def _read_attached(folder: AttachedFiles, path: Path, header: RecordingHeader, own: Rig, rig: Rig) -> Session:
    """Read the attached files of a recording with ``rig`` for the recorded one, ``own``."""
    left_out = frozenset((*header.left_out, *own.names)) - frozenset(rig.names)
    medium = Medium(kind=MediumKind.RECORDING, path=path)
    media = dict.fromkeys(rig.names, medium) if header.pictures else {}
    return read_session(folder, path.stem, rig, left_out, media)


def _correcting_rig(own: Rig, header: RecordingHeader) -> Rig:
    """Return the rig by which the events of a recording are corrected: the recorded one, or one of ideal devices."""
    if header.corrected:
        return own
    stations = (
        replace(s, ptu_clock=EQUAL_CLOCKS, camera_clock=None, ptu_axes=PtuAxes(lean_rad=s.ptu_axes.lean_rad))
        for s in own.stations
    )
    return replace(own, stations=tuple(stations))
