"""The events of a session, whatever it is kept in."""

from collections.abc import Callable

from groundstation.messages import ReferenceFix
from groundstation.session import Session
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.recording_source import RecordingSource


def session_source(
    session: Session,
    from_s: float | None = None,
    to_s: float | None = None,
    on_output: Callable[[bytes], None] = lambda line: None,
    reference: Callable[[ReferenceFix], ReferenceFix] | None = None,
) -> FolderSource | RecordingSource:
    """Return the source for a folder or a recording.

    ``on_output`` is called with the outputs in a recording; ``reference`` makes the position of a reference receiver
    by the session's rig of a recorded one.
    """
    if session.recorded is None:
        return FolderSource(session, from_s, to_s)
    return RecordingSource(session, session.recorded, from_s, to_s, on_output=on_output, reference=reference)
