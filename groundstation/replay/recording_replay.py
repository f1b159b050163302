"""Replay of a recording: its tuning, its events, the recorder of a new one, and notes on missing data."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from groundstation.conversion.recording_header import build_header
from groundstation.messages import Event, FilterReset, InitialState, ReferenceFix
from groundstation.recording.mcap_metadata import CONFIG
from groundstation.recording.recorder import PATIENT, Recorder
from groundstation.session import Session
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.recording_source import RecordingSource
from groundstation.tracking.config import Config, load_config


def load_replay_config(session: Session, path: Path | None) -> Config:
    """Return the tuning of a file; without one, that of the recording; without either, the defaults."""
    if path is None and session.recorded is not None:
        return load_config(session.folder / CONFIG)
    return load_config(path)


def without_reference_fixes(events: Iterable[Event]) -> Iterator[Event]:
    """Yield all events but the recorded reference fixes, which are replaced by those of the DGPS log."""
    return (event for event in events if not isinstance(event, ReferenceFix))


def apply_filter_resets(events: Iterable[Event]) -> Iterator[Event]:
    """Drop each event at which the filter failed in operation, and pass on the reset that followed it.

    Such an event gave no output; without it the track is the same on a machine where the filter does not fail.
    """
    held: Event | None = None
    for event in events:
        if isinstance(event, FilterReset) and event.in_vain:
            held = replace(event, in_vain=False)
            continue
        if held is not None:
            yield held
        held = event
    if held is not None:
        yield held


def recorder_for(
    path: Path,
    session: Session,
    rig: Path | None,
    config: Config,
    initial: InitialState | None,
    learns: bool,
) -> Recorder:
    """Return the recorder of a replay, which waits for the disk instead of dropping pictures.

    Raises `InputError` if the file exists or cannot be created.
    """
    header = build_header(session, rig, config, initial=initial, learns_from_reference=learns)
    return Recorder(path, session.rig, header, PATIENT)


def recording_notes(source: FolderSource | RecordingSource, recorder: Recorder | None) -> list[str]:
    """Return notes on data missing from the recording that was read, and on faults of the one written."""
    notes = []
    if isinstance(source, RecordingSource) and source.missing:
        missing = source.missing
        first = "" if missing.first_epoch is None else f", from epoch {missing.first_epoch} on"
        notes.append(
            f"the recording lacks the pictures of {missing.frames} frames and {missing.events} events: "
            f"what follows cannot be the same as it was live{first}"
        )
    if recorder is not None and recorder.status.trouble:
        notes.append(f"the recording is not whole: {recorder.status.line()}")
    return notes
