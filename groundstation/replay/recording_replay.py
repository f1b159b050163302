"""Replay of a recording: its tuning, its events, the recorder of a new one, and notes on missing data."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from groundstation.conversion.recording_header import build_header
from groundstation.errors import InputError
from groundstation.messages import Event, FilterReset, FrameAngles, InitialState, ReferenceFix, StepReport
from groundstation.recording.mcap_metadata import CONFIG
from groundstation.recording.recorder import PATIENT, Recorder, RecorderState
from groundstation.session import Session
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.recording_source import RecordingSource
from groundstation.tracking.config import Config, load_config
from groundstation.tracking.registered_heads import RegisteredHeads


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


class ReplayRecorder:
    """The recording of a replay, a sink of its events and reports: given up where the disk has no room for it.

    Parameters
    ----------
    path : a file that does not exist yet, .mcap; raises `InputError` if it exists or cannot be created.
    learns : whether reference fixes update the filter.
    heads : those of the pipeline: angles that it takes from pictures are recorded before the event that made it do so,
        instead of those that a source has.
    """

    def __init__(
        self,
        path: Path,
        session: Session,
        rig: Path | None,
        config: Config,
        initial: InitialState | None,
        learns: bool,
        heads: RegisteredHeads | None = None,
    ) -> None:
        header = build_header(session, rig, config, initial=initial, learns_from_reference=learns)
        self.path = path
        self.fault: str | None = None
        # it waits for the disk instead of dropping pictures
        self._recorder = Recorder(path, session.rig, header, PATIENT)
        self._heads = heads
        self._held: Event | None = None

    def taken(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, each one recorded once its step is done, before the step's output."""
        for event in events:
            self._held = event
            yield event
            self._record_held()

    def write(self, report: StepReport) -> None:
        """Record the output of one step."""
        self._record_held()
        if self.fault is None:
            self._recorder.write(report)

    def _record_held(self) -> None:
        """Record the angles that were taken from pictures lately, and the event that made it so."""
        events: list[Event] = [] if self._heads is None else list(self._heads.take_found())
        if self._held is not None and not (self._heads is not None and isinstance(self._held, FrameAngles)):
            events.append(self._held)
        self._held = None
        try:
            for event in events if self.fault is None else ():
                self._recorder.take(event)
        except InputError as fault:
            self.fault = fault.got
            self._recorder.abandon()

    def close(self) -> None:
        """Write what is queued; may be called twice."""
        self._record_held()
        self._recorder.close()
        status = self._recorder.status
        if self.fault is None and status.state is RecorderState.FAILED:
            self.fault = status.reason
            self._recorder.abandon()

    @property
    def note(self) -> str:
        """What is missing in it; "" where it is whole, or was given up."""
        status = self._recorder.status
        return f"the recording is not whole: {status.line()}" if self.fault is None and status.trouble else ""


def source_notes(
    source: FolderSource | RecordingSource,
    recorder: ReplayRecorder | None,
    most_apart_s: float,
    *,
    unseen: Sequence[str],
) -> list[str]:
    """Return notes on data missing from what was read, and on faults of the recording that was written.

    Between readings further apart than ``most_apart_s`` nothing is interpolated. ``unseen`` are the stations of the rig
    of which neither picture nor pixel came.
    """
    notes = source.notes(most_apart_s) if isinstance(source, FolderSource) else []
    if isinstance(source, RecordingSource):
        notes += [f"{name}: neither picture nor pixel in what was replayed of the recording" for name in unseen]
    if isinstance(source, RecordingSource) and source.missing:
        missing = source.missing
        first = "" if missing.first_epoch is None else f", from epoch {missing.first_epoch} on"
        notes.append(
            f"the recording lacks the pictures of {missing.frames} frames and {missing.events} events: "
            f"what follows cannot be the same as it was live{first}"
        )
    if recorder is not None and recorder.note:
        notes.append(recorder.note)
    return notes
