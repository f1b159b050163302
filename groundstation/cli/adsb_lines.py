"""Lines of a receiver of ADS-B as they come: of a TCP connection, or of a file that others write meanwhile."""

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

from groundstation.errors import InputError, os_words

_LOOK_S = 0.5
# a receiver may have nothing to say for hours: whether it is still there is asked after a minute, three times
_ASK_AFTER_S, _ASK_EACH_S, _ASKED = 60, 10, 3
_MOST_LINE = 1_000_000
_PART_BYTES = 65_536


def connection_lines(connection: socket.socket, stop: threading.Event) -> Iterator[str]:
    """Yield the lines of a connection until it ends or is to stop.

    Raises `ConnectionError` where it fails or its other end is gone, and `InputError` for a line without an end.
    """
    connection.settimeout(_LOOK_S)
    _keep_alive(connection)
    rest = b""
    while not stop.is_set():
        try:
            part = connection.recv(_PART_BYTES)
        except OSError as fault:
            if isinstance(fault, TimeoutError) and fault.errno is None:
                # nothing to say for now; the same error with a number is the network's
                continue
            raise ConnectionError(fault.errno, os_words(fault)) from fault
        if not part:
            return
        *whole, rest = (rest + part).split(b"\n")
        _require_short(rest)
        yield from (line.decode("utf-8", errors="replace") for line in whole)


def _keep_alive(connection: socket.socket) -> None:
    """Have the system find out that the other end is gone."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", _ASK_AFTER_S), ("TCP_KEEPINTVL", _ASK_EACH_S), ("TCP_KEEPCNT", _ASKED)):
        # not every system has them; its own, longer times hold then
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def file_lines(path: Path, stop: threading.Event) -> Iterator[str]:
    """Yield the lines of a file and those that are added to it; of one that is written again, all of them again.

    A file without an end of line (aircraft.json) is one line. Raises `InputError` where it cannot be read.
    """
    place, before = 0, (-1, -1)
    rest = b""
    while not stop.is_set():
        more = False
        try:
            state = path.stat()
            if (state.st_ino, state.st_mtime_ns) != before:
                if state.st_ino != before[0] or state.st_size < place:
                    place, rest = 0, b""
                before = (state.st_ino, state.st_mtime_ns)
                with path.open("rb") as file:
                    file.seek(place)
                    part = file.read(_MOST_LINE)
                place += len(part)
                if len(part) == _MOST_LINE:
                    # there may be more, and it is read at once
                    before, more = (state.st_ino, -1), True
                *whole, rest = (rest + part).split(b"\n")
                yield from (line.decode("utf-8", errors="replace") for line in whole)
                if rest.rstrip().endswith(b"}") and place == len(rest):
                    yield rest.decode("utf-8", errors="replace")
                _require_short(rest)
        except FileNotFoundError:
            # between two of them
            before = (-1, -1)
        except OSError as fault:
            raise InputError(str(path), got=os_words(fault), wanted="a file of a receiver's lines") from fault
        if not more:
            stop.wait(_LOOK_S)


def _require_short(rest: bytes) -> None:
    if len(rest) > _MOST_LINE:
        raise InputError("ADS-B", got=f"a line of {len(rest)} bytes", wanted="a receiver's lines")
