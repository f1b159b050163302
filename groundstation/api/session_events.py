"""The events of a recorded session, for a tracker that is fed one by one."""

from collections.abc import Iterator
from pathlib import Path

from groundstation.messages import Event
from groundstation.session import load_session
from groundstation.sources.session_source import session_source


def session_events(path: str | Path, *, from_s: float | None = None, to_s: float | None = None) -> Iterator[Event]:
    """Yield the events of a session folder, a recording (.mcap) or the folder of a live run, in order.

    PTU readings, frames or pixels, and an `Epoch` after each stereo pair; ``from_s`` and ``to_s`` are a part of the
    session's time, s. Raises `InputError` for a session that cannot be loaded, and where it is damaged.
    """
    session = load_session(Path(path))
    with session_source(session, from_s, to_s) as source:
        yield from source
