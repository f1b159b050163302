"""The recording of an operation: a session like any other, whose events came from devices."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from groundstation.config import Config, config_to_mapping, config_to_toml
from groundstation.live.station_file import StationFile
from groundstation.recording.contents import CONFIG, RIG, SESSION, RecordingHeader
from groundstation.rig import Rig
from groundstation.sinks.recorder import Recorder, RecorderConfig


class LiveRecorder(Recorder):
    """`Recorder` that says how it does in a few words."""

    def words(self) -> str:
        """Return what the operator is told."""
        return self.status.line()


def open_recorder(path: Path, file: StationFile, rig: Rig, config: Config) -> LiveRecorder:
    """Begin a recording; raises `InputError` where the file exists or cannot be made."""
    session: dict[str, Any] = {
        "name": file.name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "notes": "recorded in operation; session time is the host's monotonic clock from the start on",
    }
    if file.span_m is not None:
        session["target"] = {"span_m": file.span_m}
    files = {
        SESSION: config_to_toml(session).encode() + b"\n",
        # as it is: written anew, angles in degrees might read back different in the last bit
        RIG: file.rig.read_bytes(),
        CONFIG: config_to_toml(config_to_mapping(config)).encode() + b"\n",
    }
    # packing pictures costs the cores more than writing them costs the disk
    return LiveRecorder(path, rig, RecordingHeader(name=file.name, files=files), RecorderConfig(png_fill=0.0))
