"""Between the two forms of a session: a plain folder and a recording."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from groundstation.config import load_config
from groundstation.errors import InputError
from groundstation.session import load_session
from groundstation.sinks.recorded_session import header_of
from groundstation.sinks.recorder import PATIENT, Recorder
from groundstation.sinks.unpacked_folder import Unpacked, UnpackedFolder
from groundstation.sources.recording import RecordingSource
from groundstation.sources.session_source import session_source


@dataclass(frozen=True, slots=True, kw_only=True)
class Converted:
    """What was written, and in words what the new form does not have."""

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
) -> Converted:
    """Turn a session folder into a recording (``out`` ends in .mcap) or a recording into a folder.

    Into a recording whole frames go, without loss; into a folder what a recording has, as PNG. Raises `InputError`.
    """
    session = load_session(source)
    packs = out.suffix == ".mcap"
    if packs is (session.recorded is not None):
        got = f"{source.name} and {out.name}, both {'recordings' if packs else 'folders'}"
        raise InputError(str(out), got=got, wanted="a folder and a file that ends in .mcap")
    session.rig.require_known()
    events = epochs = 0
    fault: InputError | None = None
    with session_source(session, from_s, to_s) as stream:
        if packs:
            config = load_config(None)
            header = header_of(session, None, config, initial=session.initial, taught=False)
            recorder = Recorder(out, session.rig, header, PATIENT, whole_frames=True)
            take, finish = recorder.take, recorder.close
        else:
            folder = UnpackedFolder(out, session)
            take, finish = folder.take, lambda: None
        try:
            for event in stream:
                take(event)
                events += 1
                if type(event).__name__ == "Epoch":
                    epochs += 1
                    progress(epochs, stream.epoch_count)
        except InputError as error:
            fault = error
        finally:
            finish()
        if packs:
            notes = [recorder.status.line()] if recorder.status.trouble else []
        else:
            header_files = session.recorded.header.files if session.recorded is not None else {}
            notes = _notes(folder.done, stream)
            folder.finish(header_files, notes[0] if folder.done.partial else "")
            notes = _notes(folder.done, stream)
    return Converted(out=out, events=events, notes=tuple(notes), fault=fault)


def _notes(done: Unpacked, stream: object) -> list[str]:
    """Say what the folder does not have."""
    notes = []
    if done.partial:
        notes.append(f"{done.partial} of {done.frames} pictures hold only what detection read; the rest is black")
    if isinstance(stream, RecordingSource) and stream.missing:
        missing = stream.missing
        notes.append(f"the recording lacks the pictures of {missing.frames} frames and {missing.events} events")
    if done.out_of_order:
        notes.append(f"{done.out_of_order} records came twice or out of order, which a folder cannot say")
    if done.references:
        notes.append(f"{done.references} positions that the filter learnt from are not in the folder, only dgps.csv")
    return notes
