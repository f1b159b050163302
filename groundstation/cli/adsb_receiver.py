"""A receiver of ADS-B at a TCP port: its positions kept as lines of JSON, each with the time at which it came."""

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from calibration.sky.adsb import as_json, reports_of
from groundstation.errors import InputError, os_words

_CONNECT_S = 5.0
_LOOK_S = 1.0
_MOST_LINE = 1_000_000
_TELL_EACH_S = 10.0


def keep_lines(host: str, port: int, path: Path, tell: Callable[[str], None]) -> int:
    """Add a receiver's positions to a file until it ends the connection, or Ctrl-C; returns how many.

    Raises `InputError` where it cannot be reached, or the file not written.
    """
    where = f"{host}:{port}"
    try:
        connection = socket.create_connection((host, port), timeout=_CONNECT_S)
    except OSError as fault:
        wanted = "a receiver's port of lines (SBS: 30003)"
        raise InputError(where, got=os_words(fault), wanted=wanted) from fault
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with connection, path.open("a", encoding="utf-8") as file:
            return _keep(connection, file.write, file.flush, tell)
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault


def _keep(
    connection: socket.socket, write: Callable[[str], int], flush: Callable[[], None], tell: Callable[[str], None]
) -> int:
    count, told_s = 0, time.monotonic()
    aircraft: set[str] = set()
    try:
        for line in _lines(connection):
            now = time.time()
            for report in reports_of([line]):
                # SBS has the receiver's time zone, JSON its clock: the time of arrival is this computer's
                write(as_json(report, now) + "\n")
                flush()
                count += 1
                aircraft.add(report.aircraft)
            if time.monotonic() - told_s > _TELL_EACH_S:
                told_s = time.monotonic()
                tell(f"{count} positions of {len(aircraft)} aircraft")
    except KeyboardInterrupt:
        # the usual end; every line is written
        return count
    return count


def _lines(connection: socket.socket) -> Iterator[str]:
    connection.settimeout(_LOOK_S)
    rest = b""
    while True:
        try:
            part = connection.recv(65536)
        except TimeoutError:
            continue
        if not part:
            return
        *whole, rest = (rest + part).split(b"\n")
        if len(rest) > _MOST_LINE:
            raise InputError("ADS-B", got=f"a line of {len(rest)} bytes", wanted="a receiver's lines")
        for line in whole:
            yield line.decode("utf-8", errors="replace")
