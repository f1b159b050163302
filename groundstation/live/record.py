"""The recorder of a live station: set up so that replaying its file is what was flown."""

from pathlib import Path

from groundstation.config import Config, config_to_mapping, config_to_toml
from groundstation.live.station_file import StationFile
from groundstation.recording.contents import CONFIG, RIG, SESSION, RecordingHeader
from groundstation.rig import Rig
from groundstation.sinks.recorder import Recorder


class LiveRecorder(Recorder):
    """A recorder that says how it goes, in words."""

    def words(self) -> str:
        """Return how recording goes, for the operator."""
        return self.status.line()


def open_recorder(path: Path, file: StationFile, rig: Rig, config: Config) -> LiveRecorder:
    """Open a recording of a live run without a given start; raises `InputError` if the file cannot be made.

    ``rig`` is that of the station file, whose rig file goes into the recording as it is.
    """
    return LiveRecorder(path, rig, live_header(file, config))


def live_header(file: StationFile, config: Config) -> RecordingHeader:
    """Return what a replay has to know of a live run: its name, the target's span, the rig file, the tuning."""
    session: dict[str, object] = {"name": file.name, "origin": "Recorded live"}
    if file.span_m is not None:
        session["target"] = {"span_m": float(file.span_m)}
    files = {
        SESSION: config_to_toml(session).encode() + b"\n",
        RIG: file.rig.read_bytes(),
        CONFIG: config_to_toml(config_to_mapping(config)).encode() + b"\n",
    }
    return RecordingHeader(name=file.name, files=files)
