"""Byte transport over any line that pyserial opens by URL, with a clock."""

import contextlib
import errno
import math
import os
import select
import stat
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from ptu_drivers.errors import LineError, MissingPackageError, PtuError, os_words
from ptu_drivers.shared_line import is_shared_line

_SLICE_S = 0.02
# a port that takes no bytes for so long is lost; a halt waits behind it
_WRITE_S = 0.25
_MOST = 4096
# a USB adapter takes bytes once a millisecond
_SEND_SIGMA_S = 0.0005
_REOPEN_S = 0.1
_AGREED_S = 0.3
# start, 8 data and stop bit
BITS_PER_CHARACTER = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """Bytes read from the line at once.

    Attributes
    ----------
    data : bytes, empty if none arrived in time.
    t_s : when the last of them had been read, s: none arrived later; without bytes, the end of the wait.
    """

    data: bytes
    t_s: float


class Transport(Protocol):
    """A line that is open. The device takes time from here alone, so that a simulated line can run on its own time."""

    url: str

    def now(self) -> float:
        """Return the clock, s."""

    def wait(self, duration_s: float) -> None:
        """Let time pass."""

    def character_s(self) -> float:
        """Return what one character takes on the line, s; 0 where the line is no serial one."""

    def send_sigma_s(self) -> float:
        """Return the spread of the delay between `write` and the line, s; infinite over a network."""

    def set_baud(self, baud: int) -> bool:
        """Change the speed of the host's end; False where the line has none. Raises LineError."""

    def baud(self) -> int:
        """Return the speed of the host's end, bit/s; 0 where the line has none."""

    def write(self, data: bytes) -> float:
        """Send all of it; return when the last byte was handed over, s. Raises LineError."""

    def read(self, until_s: float) -> Chunk:
        """Return available data, or wait for them until `until_s` on the clock. Raises LineError."""

    def reopen(self) -> None:
        """Close and open again, at the speed that is set. Raises LineError."""

    def close(self) -> None:
        """Close the line; never raises; idempotent."""


class SerialTransport:
    """A line that pyserial opens: a device, a pty, `socket://host:port`, `rfc2217://host:port`.

    Parameters
    ----------
    url : as for pyserial's `serial_for_url`.
    baud : speed, bit/s, 8N1; of no effect on a socket or a pty.
    clock : monotonic, s.
    exclusive : refuse a serial device that another program has open; False only to halt a unit that it left turning.
    open_within_s : time limit of a network connection, s; None waits as long as the system does.
    """

    def __init__(
        self,
        url: str,
        baud: int,
        clock: Callable[[], float] = time.monotonic,
        *,
        exclusive: bool = True,
        open_within_s: float | None = None,
    ) -> None:
        _check_address(url)
        self.url = url
        self._exclusive = exclusive
        self._baud = baud
        self._clock = clock
        self._is_serial = not url.startswith("socket://")
        self._is_rfc2217 = url.startswith("rfc2217://")
        self._port: Any = None
        self._opening: threading.Thread | None = None
        self._opened_port: Any = None
        self._fault: BaseException | None = None
        self._fileno = -1
        # a device of this machine opens at once, and needs no thread, for which there may be no memory
        self._take(self._open() if open_within_s is None or "://" not in url else self._open_within(open_within_s))

    def now(self) -> float:
        """Return the clock, s."""
        return self._clock()

    def wait(self, duration_s: float) -> None:
        """Sleep."""
        time.sleep(max(0.0, duration_s))

    def character_s(self) -> float:
        """Return the time of one character, s."""
        return BITS_PER_CHARACTER / self._baud if self._is_serial else 0.0

    def send_sigma_s(self) -> float:
        """Return the spread of the delay before the line, s."""
        return math.inf if "://" in self.url else _SEND_SIGMA_S

    def baud(self) -> int:
        """Return the speed, bit/s."""
        return self._baud if self._is_serial else 0

    def set_baud(self, baud: int) -> bool:
        """Change the speed of this end."""
        if not self._is_serial:
            return False
        self._baud = baud
        with _line_errors(self.url):
            port = self._opened()
            if not self._is_rfc2217:
                port.baudrate = baud
                return True
            # the far end must agree, for which pyserial waits for seconds
            agreed = _within(_AGREED_S, partial(_set_baud, port, baud))
        if not agreed:
            raise LineError(self.url, got=f"no agreement to {baud} bit/s in {_AGREED_S} s", wanted="a port that agrees")
        return True

    def write(self, data: bytes) -> float:
        """Send all bytes."""
        with _line_errors(self.url):
            port = self._opened()
            if not self._is_rfc2217:
                port.write(data)
            elif not _within(_WRITE_S, partial(port.write, data)):
                # a network that accepts no more data: waiting bytes may still arrive, on a connection that is closed
                self._port = None
                raise OSError(f"no bytes taken for {_WRITE_S} s")
        return self._clock()

    def read(self, until_s: float) -> Chunk:
        """Wait for the first byte, then read all that are available."""
        with _line_errors(self.url):
            port = self._opened()
            data = self._read_port(port, until_s) if self._fileno < 0 else self._read_file(until_s)
            return Chunk(data=data, t_s=self._clock())

    def _read_file(self, until_s: float) -> bytes:
        """Read from the system's own file: half the work, and no waiting in slices."""
        while True:
            ready, _, _ = select.select([self._fileno], [], [], max(0.0, until_s - self._clock()))
            if not ready:
                return b""
            data = os.read(self._fileno, _MOST)
            if data:
                return data
            if not is_shared_line(self._fileno):
                raise OSError("the other side has closed it")
            if self._clock() >= until_s:
                return b""

    def _read_port(self, port: Any, until_s: float) -> bytes:
        """Read through pyserial, where there is no file: RFC 2217."""
        while self._clock() < until_s or port.in_waiting:
            data: bytes = port.read(1)
            if data:
                return data + (port.read(waiting) if (waiting := port.in_waiting) else b"")
        return b""

    def reopen(self) -> None:
        """Open, after closing the previous connection.

        Closing and connecting over a network may take long: both run in a thread, and each call checks whether it is
        done.
        """
        old, self._port = self._port, None
        if self._opening is None:
            self._opened_port, self._fault = None, None
            self._opening = threading.Thread(target=self._open_aside, args=(old,), name="ptu-reopen", daemon=True)
            self._opening.start()
        self._opening.join(_REOPEN_S)
        if self._opening.is_alive():
            raise LineError(self.url, got="no connection yet", wanted="a line that is there")
        self._opening = None
        if self._fault is not None:
            raise LineError(self.url, got=str(self._fault), wanted="a line that is there") from self._fault
        self._take(self._opened_port)

    def _take(self, port: Any) -> None:
        self._port = port
        try:
            self._fileno = port.fileno()
        except (OSError, AttributeError):
            self._fileno = -1

    def _open_aside(self, old: Any) -> None:
        _close(old)
        try:
            self._opened_port = self._open()
        except PtuError as fault:
            self._fault = fault

    def _open(self) -> Any:
        serial = _pyserial()
        with _line_errors(self.url):
            try:
                # one timeout for good: changing it renegotiates the whole port of an RFC 2217 server
                return serial.serial_for_url(
                    self.url,
                    baudrate=self._baud,
                    timeout=_SLICE_S,
                    # pyserial's RFC 2217 port has none, and reports an error
                    write_timeout=None if self._is_rfc2217 else _WRITE_S,
                    exclusive=self._exclusive,
                )
            except ValueError as wrong:
                wanted = f"a line that is there: /dev/..., socket://HOST:PORT, rfc2217://HOST:PORT, {self._baud} bit/s"
                raise LineError(self.url, got=str(wrong), wanted=wanted) from wrong

    def _open_within(self, seconds: float) -> Any:
        """Open, or stop waiting; a connection that is established later is closed again."""
        opened: list[Any] = []
        given_up = threading.Event()

        def open_and_hand_over() -> None:
            opened.append(self._open())
            if given_up.is_set():
                _close(opened[0])

        if not _within(seconds, open_and_hand_over):
            given_up.set()
            raise LineError(self.url, got=f"no connection in {seconds:g} s", wanted="a line that is there")
        return opened[0]

    def close(self) -> None:
        """Close; a line that is gone is closed already."""
        port, self._port = self._port, None
        _close(port)

    def _opened(self) -> Any:
        if self._port is None:
            raise LineError(self.url, got="a closed line", wanted="an open one")
        return self._port


def _check_address(url: str) -> None:
    """Return if a network line's URL has a host and a port, and another's path can be a line. Raises LineError.

    Pyserial's messages about these are less clear.
    """
    if "://" not in url and (got := _no_line(url)):
        raise LineError(url, got=got, wanted="a serial port or a pty, as /dev/ttyUSB0")
    for scheme in ("socket", "rfc2217"):
        if url.startswith(f"{scheme}://"):
            try:
                parts = urlsplit(url)
                complete = bool(parts.hostname and parts.port)
            except ValueError:
                complete = False
            if not complete:
                raise LineError(url, got="no host and port", wanted=f"{scheme}://HOST:PORT")


def _no_line(path: str) -> str:
    """Return what is there in place of a line; "" where there may be one, or nothing."""
    try:
        mode = Path(path).stat().st_mode
    except OSError as fault:
        return "a link that leads to itself" if fault.errno == errno.ELOOP else ""
    return "a file" if stat.S_ISREG(mode) else "a folder" if stat.S_ISDIR(mode) else ""


def _close(port: Any) -> None:
    if port is not None:
        # pyserial stumbles in several ways over a port that was pulled out; there is nothing left to close
        with contextlib.suppress(OSError, ValueError, TypeError, AttributeError):
            port.close()


def _within(seconds: float, call: Callable[[], object]) -> bool:
    """Call it in a thread; return whether it returned in time, and raise its exception.

    Where no thread can be started, which takes memory, it is called here, without a time limit.
    """
    raised: list[BaseException] = []

    def run() -> None:
        try:
            call()
        except BaseException as fault:  # noqa: BLE001 - raised again where it is waited for
            raised.append(fault)

    thread = threading.Thread(target=run, name="ptu-line", daemon=True)
    try:
        thread.start()
    except RuntimeError:
        call()
        return True
    thread.join(seconds)
    if thread.is_alive():
        return False
    for fault in raised:
        raise fault
    return True


def _set_baud(port: Any, baud: int) -> None:
    """Set it; an error here is that of a line that is lost, which is seen at the next use."""
    with contextlib.suppress(OSError, ValueError, TypeError, AttributeError):
        port.baudrate = baud


class _line_errors:  # noqa: N801 - read as a statement: with _line_errors(url)
    """Errors of pyserial and the system for a lost line, as `LineError`."""

    def __init__(self, url: str) -> None:
        self.url = url

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: type[BaseException] | None, fault: BaseException | None, trace: object) -> None:
        # TypeError and AttributeError: pyserial on a port that another thread closed under it
        if isinstance(fault, OSError | ValueError | TypeError | AttributeError):
            raise LineError(self.url, got=os_words(fault), wanted="a line that is there") from fault


def _pyserial() -> Any:
    try:
        import serial
    except ModuleNotFoundError as missing:
        raise MissingPackageError("a serial line", "pyserial") from missing
    return serial
