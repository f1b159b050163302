"""The recording of an operation: a session like any other, whose events came from devices."""

import dataclasses
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from groundstation.config import Config, config_to_mapping, config_to_toml
from groundstation.live.station_file import StationFile
from groundstation.recording.contents import CONFIG, RIG, SESSION, RecordingHeader
from groundstation.reference_knowledge import ReferenceKnowledge, reference_knowledge
from groundstation.rig import Rig
from groundstation.session.folder import read_session
from groundstation.sinks.recorder import Recorder, RecorderConfig
from groundstation.text_file import AttachedFiles


class LiveRecorder(Recorder):
    """`Recorder` that says how it does in a few words."""

    def words(self) -> str:
        """Return what the operator is told."""
        return self.status.line()


def live_header(file: StationFile, config: Config) -> RecordingHeader:
    """Return how an operation is set up, as its recording says it and a replay reads it."""
    session: dict[str, Any] = {
        "name": file.name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "notes": "recorded in operation; session time is the host's monotonic clock from the start on",
    }
    target: dict[str, Any] = {}
    if file.span_m is not None:
        target["span_m"] = file.span_m
    if file.antenna_in_body_m is not None:
        target["antenna_in_body_m"] = list(file.antenna_in_body_m)
    if target:
        session["target"] = target
    if file.origin is not None:
        session["origin"] = dataclasses.asdict(file.origin)
    files = {
        SESSION: config_to_toml(session).encode() + b"\n",
        # as it is: written anew, angles in degrees might read back different in the last bit
        RIG: file.rig.read_bytes(),
        CONFIG: config_to_toml(config_to_mapping(config)).encode() + b"\n",
    }
    taught = file.reference is not None and file.reference.learn
    return RecordingHeader(name=file.name, files=files, taught=taught)


def live_reference(header: RecordingHeader, rig: Rig, config: Config) -> ReferenceKnowledge:
    """Return what is known of the reference receiver, read as a replay of the recording will read it."""
    session = read_session(AttachedFiles(header.name, header.files), header.name, rig, frozenset(), {})
    return reference_knowledge(session, config.estimation)


def open_recorder(path: Path, rig: Rig, header: RecordingHeader) -> LiveRecorder:
    """Begin a recording; raises `InputError` where the file exists or cannot be made."""
    # packing pictures costs the cores more than writing them costs the disk
    return LiveRecorder(path, rig, header, RecorderConfig(png_fill=0.0))
