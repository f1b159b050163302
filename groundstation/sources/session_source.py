"""The events of a session, whatever it is kept in."""

from collections.abc import Callable

from groundstation.session import Session
from groundstation.sources.recording import RecordingSource
from groundstation.sources.replay import ReplaySource


def session_source(
    session: Session,
    from_s: float | None = None,
    to_s: float | None = None,
    on_answer: Callable[[bytes], None] = lambda line: None,
) -> ReplaySource | RecordingSource:
    """Return the source for a folder or a recording; ``on_answer`` is told the answers that a recording holds."""
    if session.recorded is None:
        return ReplaySource(session, from_s, to_s)
    return RecordingSource(session, session.recorded, from_s, to_s, on_answer=on_answer)
