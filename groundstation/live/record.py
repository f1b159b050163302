"""The recording of an operation: a session like any other, whose events came from devices."""

import dataclasses
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from groundstation.files.text_file import AttachedFiles
from groundstation.live.devices import text_of_one_host
from groundstation.live.recent_rate import RecentRate
from groundstation.live.station_file import StationFile
from groundstation.recording.mcap_metadata import CONFIG, IN_OPERATION, RIG, SESSION, RecordingHeader
from groundstation.recording.recorder import Recorder, RecorderConfig
from groundstation.replay.reference_prior import ReferencePrior, reference_prior
from groundstation.rig.rig import Rig
from groundstation.session.folder import read_session
from groundstation.tracking.config import Config, config_to_mapping, config_to_toml


class LiveRecorder(Recorder):
    """`Recorder` with a short status text: data rate, and time until the disk is full."""

    def __init__(
        self,
        path: Path,
        rig: Rig,
        header: RecordingHeader,
        config: RecorderConfig,
        *,
        free_bytes: Callable[[], int] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(path, rig, header, config, free_bytes=free_bytes, clock=clock)
        self._now, self._recent = clock, RecentRate()
        self._least_free = config.keep_free_bytes

    def summary(self) -> str:
        """Return the operator's status text."""
        status = self.status
        rate = self._recent.at(self._now(), status.written_bytes)
        # nothing written has no rate
        text = status.line() + (f" at {rate / 1e6:.1f} MB/s" if status.written_bytes else "")
        if status.free_bytes is None:
            return text
        text += f", disk {status.free_bytes / 1e9:.1f} GB free"
        if rate <= 1.0:
            return text
        return text + f", enough for {_long(max(status.free_bytes - self._least_free, 0) / rate)} of this"

    def written_summary(self) -> str:
        """Return what it came to in the end: bytes, and how many a second while tracking and searching; "" for none."""
        status = self.status
        if not status.written_bytes:
            return ""
        return ", ".join(w for w in (f"{status.written_bytes / 1e6:.1f} MB", status.rates.line()) if w)


def _long(seconds: float) -> str:
    """Return a time in the unit that a person would say it in."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 100.0 * 60.0 else f"{seconds / 3600.0:.0f} h"


def _utc_now() -> datetime:
    return datetime.now(UTC)


def live_header(file: StationFile, config: Config) -> RecordingHeader:
    """Return an operation's settings in the form of its recording, which a replay reads."""
    session: dict[str, Any] = {
        "name": file.name,
        # tells its recordings apart: `Session.identity`
        "date": _utc_now().isoformat(timespec="seconds"),
        "notes": f"{IN_OPERATION}; session time is the host's monotonic clock from the start on",
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
    if file.air.keys():
        session["air"] = file.air.keys()
    of_host = text_of_one_host(file.load_rig())
    files = {
        SESSION: config_to_toml(session).encode() + b"\n",
        # unchanged: rewritten, angles in degrees might read back different in the last bit
        RIG: file.rig.read_bytes() if of_host is None else of_host.encode(),
        CONFIG: config_to_toml(config_to_mapping(config)).encode() + b"\n",
    }
    learns_from_reference = file.reference is not None and file.reference.learn
    return RecordingHeader(name=file.name, files=files, learns_from_reference=learns_from_reference)


def live_reference(header: RecordingHeader, rig: Rig, config: Config) -> ReferencePrior:
    """Return what is known of the reference receiver, read as a replay of the recording will read it."""
    session = read_session(AttachedFiles(header.name, header.files), header.name, rig, frozenset(), {})
    return reference_prior(session, config.estimation)


def open_recorder(path: Path, rig: Rig, header: RecordingHeader) -> LiveRecorder:
    """Begin a recording; raises `InputError` where the file exists or cannot be made."""
    # packing pictures costs the cores more than writing them costs the disk
    return LiveRecorder(path, rig, header, RecorderConfig(png_fill=0.0, retry_s=0.2, refused_close_s=0.4))
