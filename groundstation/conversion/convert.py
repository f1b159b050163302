"""Between the two forms of a session: a plain folder and a recording."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from groundstation.conversion.device_records import DeviceRecords, folder_files
from groundstation.conversion.recording_header import build_header
from groundstation.conversion.reference_cut import SessionPart, cut_references, session_part
from groundstation.conversion.session_folder_writer import SessionFolderWriter, WrittenCounts
from groundstation.errors import InputError, UsageError
from groundstation.files.output_names import below
from groundstation.files.text_file import absence, is_other_kind
from groundstation.messages import Epoch, Event
from groundstation.recording.mcap_metadata import RIG
from groundstation.recording.recorder import PATIENT, Recorder, RecorderState
from groundstation.rig.rig import load_rig
from groundstation.session import Session, load_session
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.recording_source import RecordingSource
from groundstation.sources.recorrection import Recorrection
from groundstation.sources.session_source import session_source
from groundstation.tracking.config import load_config

Source = FolderSource | RecordingSource
# a session has no track yet
_MAPS = (".kml", ".geojson")
_EARLY = (
    "the recording has readings and stamps that no axes or clocks have corrected; the folder's rig.toml corrects them,"
    " as `replay --rig` does those of the recording"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConversionResult:
    """The output, and notes on data that the new form lacks."""

    out: Path
    events: int
    notes: tuple[str, ...]
    fault: InputError | None


def convert(
    source: Path,
    out: Path,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ConversionResult:
    """Turn a session folder into a recording (``out`` ends in .mcap) or a recording into a folder.

    Into a recording whole frames go, without loss; into a folder what a recording has, as PNG. Raises `InputError`.
    """
    if out.suffix.lower() in _MAPS:
        wanted = (
            "a recording (.mcap) or a folder; a map of the track is one of the results of replay and evaluate --out"
        )
        raise UsageError(str(out), got=f"a name that ends in {out.suffix}", wanted=wanted)
    if is_other_kind(out) and not out.is_dir():
        raise InputError(str(out), got=absence(out), wanted="a file that ends in .mcap, or a new folder")
    session = load_session(source)
    packs = out.suffix == ".mcap"
    if not packs and session.recorded is None and out.suffix and not out.is_dir():
        raise InputError(str(out), got=f"a name that ends in {out.suffix}", wanted="a file that ends in .mcap")
    if packs is (session.recorded is not None):
        got = f"{source.name} and {out.name}, both {'recordings' if packs else 'folders'}"
        raise InputError(str(out), got=got, wanted="a folder and a file that ends in .mcap")
    session.rig.require_known()
    with session_source(session, from_s, to_s) as stream:
        part = session_part(session, from_s, to_s)
        if packs:
            return _packed(session, stream, part, out, progress)
        return _unpacked(session, stream, part, out, progress)


def _packed(
    session: Session, stream: Source, part: SessionPart, out: Path, progress: Callable[[int, int], None]
) -> ConversionResult:
    """Write a recording of whole frames, set up as a replay of the folder would be."""
    header = build_header(session, None, load_config(None), initial=session.initial, learns_from_reference=False)
    header = replace(header, files=cut_references(header.files, session, part))
    with Recorder(out, session.rig, header, PATIENT, whole_frames=True) as recorder:
        events, fault = pass_on(stream, recorder.take, progress, stream.epoch_count)
        if recorder.status.state in (RecorderState.WAITING, RecorderState.FAILED):
            recorder.abandon()
    if recorder.status.state is RecorderState.FAILED:
        raise InputError(str(out), got=recorder.status.reason, wanted="a disk with room for the recording")
    notes = (recorder.status.line(),) if recorder.status.trouble else ()
    return ConversionResult(out=out, events=events, notes=notes, fault=fault)


def _unpacked(
    session: Session, stream: Source, part: SessionPart, out: Path, progress: Callable[[int, int], None]
) -> ConversionResult:
    """Write a folder of the recorded devices' own stamps and readings, with the recorded rig."""
    recorded = session.recorded
    corrected_by = session.rig if recorded is None else recorded.rig
    devices = DeviceRecords(corrected_by.stations, session.applied_axes)
    files = {} if recorded is None else cut_references(recorded.header.files, session, part)
    files, remarks = folder_files(files, load_rig(session.folder / RIG), devices.kept)
    if recorded is not None and Recorrection(corrected_by, session.rig).is_needed:
        remarks += (_EARLY,)
    for name in files:
        # before anything is written, not after
        below(out, name)
    folder = SessionFolderWriter(out, session, devices)
    events, fault = pass_on(stream, folder.take, progress, stream.epoch_count)
    remark = _partial(folder.done)
    folder.finish(files, "".join(remark))
    notes = (*remark, *remarks, *_notes(folder.done, stream))
    return ConversionResult(out=out, events=events, notes=notes, fault=fault)


def pass_on(
    stream: Iterable[Event], take: Callable[[Event], None], progress: Callable[[int, int], None], total: int
) -> tuple[int, InputError | None]:
    """Pass on all events; ``total`` is the number of epochs. Return their number and the fault that ended them."""
    events = epochs = 0
    try:
        for event in stream:
            take(event)
            events += 1
            if isinstance(event, Epoch):
                epochs += 1
                progress(epochs, total)
    except InputError as fault:
        return events, fault
    return events, None


def _partial(done: WrittenCounts) -> tuple[str, ...]:
    """Return a note if any picture is incomplete."""
    if not done.partial:
        return ()
    return (f"{done.partial} of {done.frames} pictures hold only what detection read; the rest is black",)


def missing_notes(stream: Source) -> list[str]:
    """Return a note on what a recording itself lacks."""
    if not isinstance(stream, RecordingSource) or not stream.missing:
        return []
    missing = stream.missing
    return [f"the recording lacks the pictures of {missing.frames} frames and {missing.events} events"]


def _notes(done: WrittenCounts, stream: Source) -> list[str]:
    """Return notes on data that the folder lacks."""
    notes = missing_notes(stream)
    if done.out_of_order:
        notes.append(f"{done.out_of_order} records came twice or out of order, which a folder cannot represent")
    if done.references:
        notes.append(f"{done.references} positions that the filter learnt from are not in the folder, only dgps.csv")
    if done.heartbeats:
        notes.append(f"{done.heartbeats} heartbeats are not in the folder, which has no time but that of its records")
    if done.resets:
        notes.append(f"{done.resets} resets of the filter are not in the folder: a replay of it has its own")
    return notes
