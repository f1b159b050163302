"""A receiver of ADS-B, at a TCP port or as a file: its positions kept as lines of JSON, and the newest at hand.

Positions of a port have the time at which they came, by this computer's clock: SBS has the receiver's time zone, JSON
its clock. Those of a file have their own.
"""

import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType

from calibration.sky.adsb import AdsbReport, as_json, reports_of
from groundstation.cli.adsb_lines import connection_lines, file_lines
from groundstation.errors import InputError, UsageError, os_words

FILE_SCHEME = "file:"
_CONNECT_S = 5.0
_LOOK_S = 0.5
_TELL_EACH_S = 10.0
_END_S = 2.0
# what is at hand: the positions of the last minutes, of so many an aircraft at most
_NEW_S, _MOST_NEW, _MOST_AIRCRAFT = 120.0, 600, 5_000


class AdsbReceiver:
    """A receiver, opened on ``with``; a thread of its own reads it.

    Parameters
    ----------
    source : ``HOST:PORT``, or ``file:PATH`` of a file that grows, or that is written again and again (aircraft.json).
    keep : the file that positions are added to.

    ``count`` is how many were kept, ``aircraft`` of which aircraft. Raises `UsageError` for another source, and
    `InputError` where it cannot be reached or the file not written.
    """

    def __init__(self, source: str, keep: Path) -> None:
        self.count = 0
        self.aircraft: set[str] = set()
        self._source, self._keep = source, keep
        self._file = Path(source.removeprefix(FILE_SCHEME)) if source.startswith(FILE_SCHEME) else None
        host, _, number = source.rpartition(":")
        if self._file is None and (not host or not number.isdigit() or not 0 < int(number) < 65536):
            wanted = "HOST:PORT, as localhost:30003, or file:PATH"
            raise UsageError("--receive", got=repr(source), wanted=wanted)
        if self._file is not None and self._file.resolve() == keep.resolve():
            wanted = "another file than that in which positions are kept"
            raise UsageError("--receive", got=repr(source), wanted=wanted)
        self._host, self._port = host, 0 if self._file is not None else int(number)
        self._newest: dict[str, deque[AdsbReport]] = {}
        self._lock, self._stop, self._stack = threading.Lock(), threading.Event(), ExitStack()
        self._ended = ""
        self._fault: InputError | None = None

    def __enter__(self) -> "AdsbReceiver":
        with ExitStack() as stack:
            connection = None if self._file is not None else stack.enter_context(self._connected())
            if self._file is not None and not self._file.is_file():
                raise InputError(str(self._file), got="no such file", wanted="a file of a receiver's lines")
            try:
                self._keep.parent.mkdir(parents=True, exist_ok=True)
                self._out = stack.enter_context(self._keep.open("a", encoding="utf-8"))
            except OSError as fault:
                raise self._not_written(fault) from fault
            thread = threading.Thread(target=self._run, args=(connection,), name="adsb", daemon=True)
            thread.start()
            stack.callback(thread.join, _END_S)
            stack.callback(self._stop.set)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def newest(self) -> Mapping[str, Sequence[AdsbReport]]:
        """Return the positions of the last minutes by aircraft, in order of time."""
        with self._lock:
            return {name: tuple(own) for name, own in self._newest.items()}

    def ended(self) -> str:
        """Return why no more will come; "" while they do. Raises `InputError` where they can no longer be kept."""
        if self._fault is not None:
            raise self._fault
        return self._ended

    def _connected(self) -> socket.socket:
        try:
            return socket.create_connection((self._host, self._port), timeout=_CONNECT_S)
        except OSError as fault:
            wanted = "a receiver's port of lines (SBS: 30003)"
            raise InputError(self._source, got=os_words(fault), wanted=wanted) from fault

    def _run(self, connection: socket.socket | None) -> None:
        try:
            if connection is not None:
                try:
                    for line in connection_lines(connection, self._stop):
                        self._take(line, time.time())
                except ConnectionError as fault:
                    self._ended = f"{self._source}: {os_words(fault)}"
            elif self._file is not None:
                for line in file_lines(self._file, self._stop):
                    self._take(line, None)
            self._ended = self._ended or f"{self._source}: the receiver ended the connection"
        except InputError as fault:
            self._fault = fault
        except OSError as fault:
            self._fault = self._not_written(fault)
        except Exception as fault:  # noqa: BLE001 - a thread that ended in silence would be waited for
            got = f"a line that cannot be read ({type(fault).__name__}: {fault})"
            self._fault = InputError(self._source, got=got, wanted="a receiver's lines")

    def _take(self, line: str, came_s: float | None) -> None:
        for found in reports_of([line]):
            report = found if came_s is None else replace(found, t_s=came_s)
            with self._lock:
                own = self._newest.setdefault(report.aircraft, deque(maxlen=_MOST_NEW))
                if own and (report.lat_deg, report.lon_deg) == (own[-1].lat_deg, own[-1].lon_deg):
                    # a position is repeated until there is another
                    continue
                own.append(report)
                while own[0].t_s < report.t_s - _NEW_S:
                    own.popleft()
                if len(self._newest) > _MOST_AIRCRAFT:
                    self._newest.pop(min(self._newest, key=lambda name: self._newest[name][-1].t_s))
                self.count += 1
                self.aircraft.add(report.aircraft)
            self._out.write(as_json(report) + "\n")
            self._out.flush()

    def _not_written(self, fault: OSError) -> InputError:
        return InputError(str(self._keep), got=os_words(fault), wanted="a file that can be written")


def keep_lines(source: str, path: Path, tell: Callable[[str], None]) -> int:
    """Add a receiver's positions to a file until it ends the connection, or Ctrl-C; returns how many."""
    with AdsbReceiver(source, path) as receiver:
        told_s = time.monotonic()
        try:
            while not receiver.ended():
                time.sleep(_LOOK_S)
                if time.monotonic() - told_s > _TELL_EACH_S:
                    told_s = time.monotonic()
                    tell(f"{receiver.count} positions of {len(receiver.aircraft)} aircraft")
        except KeyboardInterrupt:
            # the usual end; every line is written
            return receiver.count
        return receiver.count
