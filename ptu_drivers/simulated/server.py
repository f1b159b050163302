"""A simulated unit behind a real pty or TCP port, in real time, for any program."""

import contextlib
import errno
import hashlib
import os
import random
import select
import socket
import termios
import threading
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from ptu_drivers.errors import LineError, os_words
from ptu_drivers.simulated.faults import FAULTS
from ptu_drivers.simulated.line import VirtualLine

_LONGEST_SLEEP_S = 0.05
_PTYS = "/dev/pts"
_LAST_PORT = 65535
_SPEEDS = {getattr(termios, f"B{baud}"): baud for baud in (600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)}


class _Pty:
    """A pty behind a symbolic link; it is recreated when the unit is unplugged and returns."""

    def __init__(self, link: Path) -> None:
        self._link = link
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        try:
            if link.is_symlink() and (not link.exists() or link.readlink().is_relative_to(_PTYS)):
                # a dangling link, or one to a pty that belongs to another process by now
                link.unlink()
            link.symlink_to(os.ttyname(self._slave))
        except OSError as fault:
            self._close_ends()
            raise LineError(str(link), got=os_words(fault), wanted="a path for a link") from fault

    def fileno(self) -> int:
        return self._master

    def baud(self) -> int:
        """Return the speed that was set at the other end."""
        return _SPEEDS.get(termios.tcgetattr(self._slave)[5], 0)

    def read(self) -> bytes:
        return os.read(self._master, 4096)

    def write(self, data: bytes) -> None:
        # no reader: a real line would lose it, too
        if select.select([], [self._master], [], 0)[1]:
            os.write(self._master, data)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            # unless it was replaced meanwhile
            if str(self._link.readlink()) == os.ttyname(self._slave):
                self._link.unlink()
        self._close_ends()

    def _close_ends(self) -> None:
        os.close(self._master)
        os.close(self._slave)


class _PathLock:
    """A link's path is this program's as long as it runs, however it ends; others that would take it are refused."""

    def __init__(self, link: Path) -> None:
        # a name in the kernel, not a file: it cannot outlive the program
        self._name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        place = hashlib.sha256(os.fsencode(link.absolute().parent.resolve() / link.name)).hexdigest()[:32]
        try:
            self._name.bind(f"\0simulated-ptu-{place}")
        except OSError as fault:
            self._name.close()
            if fault.errno != errno.EADDRINUSE:
                raise LineError(str(link), got=os_words(fault), wanted="a path for a link") from fault
            raise LineError(
                str(link), got="a link that a running simulated unit serves", wanted="another path, or its end first"
            ) from fault

    def release(self) -> None:
        self._name.close()


class _Tcp:
    """One connection at a time to a port of this machine."""

    def __init__(self, port: int, on_connect: Callable[[], None]) -> None:
        wanted = "a free port, 1024 to 65535, or 0 for any"
        if not 0 <= port <= _LAST_PORT:
            raise LineError(f"port {port}", got="no port of TCP", wanted=wanted)
        try:
            self._server = socket.create_server(("127.0.0.1", port))
        except OSError as fault:
            got = os_words(fault)
            raise LineError(f"port {port}", got=got, wanted=wanted) from fault
        self.port = self._server.getsockname()[1]
        self._peer: socket.socket | None = None
        self._on_connect = on_connect

    def fileno(self) -> int:
        return (self._peer or self._server).fileno()

    def baud(self) -> int:
        return 0

    def read(self) -> bytes:
        if self._peer is None:
            self._peer = self._server.accept()[0]
            self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._on_connect()
            return b""
        data = b""
        with contextlib.suppress(ConnectionError):
            data = self._peer.recv(4096)
        if not data:
            self.drop()
        return data

    def write(self, data: bytes) -> None:
        if self._peer is not None:
            with contextlib.suppress(ConnectionError):
                self._peer.sendall(data)

    def drop(self) -> None:
        """Close the connection, and wait for another."""
        if self._peer is not None:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        self.drop()
        self._server.close()


class SimulatedServer:
    """Serves a simulated line until it is stopped; a context manager runs it in a thread.

    Parameters
    ----------
    line : the unit's line, made with `start_s=clock()`.
    link : path of the symbolic link to a pty, or a TCP port (0 takes any).
    faults : names of `FAULTS`, struck at random. faults_per_minute : how often.
    """

    def __init__(
        self,
        line: VirtualLine,
        link: Path | int,
        *,
        faults: Sequence[str] = (),
        faults_per_minute: float = 0.0,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,
        on_fault: Callable[[str], None] = lambda _name: None,
    ) -> None:
        self.line = line
        self.lock = threading.Lock()
        """Lock of the unit's state; another thread that reads its axes takes it, too."""
        self._link = link
        self._clock = clock
        self._faults, self._rate, self._on_fault = tuple(faults), faults_per_minute / 60.0, on_fault
        self._random = random.Random(seed)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._claim = _PathLock(link) if isinstance(link, Path) else None
        try:
            self._end: _Pty | _Tcp | None = self._make()
        except LineError:
            self._release()
            raise
        self.url = str(link) if isinstance(self._end, _Pty) else f"socket://127.0.0.1:{self._end.port}"
        if self._rate and self._faults:
            self._plan_fault()

    def strike(self, faults: Sequence[str], per_minute: float) -> None:
        """From now on let names of `FAULTS` strike at random; for a server that was made without any."""
        with self.lock:
            self._faults, self._rate = tuple(faults), per_minute / 60.0
            if self._rate and self._faults:
                self._plan_fault()

    def _make(self) -> "_Pty | _Tcp":
        if isinstance(self._link, Path):
            return _Pty(self._link)
        return _Tcp(self._link, lambda: self.line.unit.connect(self._clock()))

    def _plan_fault(self) -> None:
        def strike() -> None:
            name = self._random.choice(self._faults)
            FAULTS[name](self.line, self._random)
            self._on_fault(name)
            self._plan_fault()

        self.line.at(self._clock() + self._random.expovariate(self._rate), strike)

    def run(self) -> None:
        """Serve until `stop` is called or the program is interrupted."""
        line = self.line
        try:
            while not self._stop.is_set():
                with self.lock:
                    line.settle(self._clock() - line.now())
                if line.gone and self._end is not None:
                    self._unplug()
                elif not line.gone and self._end is None:
                    self._end = self._make()
                data = line.take()
                sleep_s = min(max(line.next_s() - self._clock(), 0.0), _LONGEST_SLEEP_S)
                if self._end is None:
                    self._stop.wait(sleep_s)
                    continue
                if data:
                    self._end.write(data)
                if select.select([self._end], [], [], sleep_s)[0] and (typed := self._end.read()):
                    with self.lock:
                        line.settle(self._clock() - line.now())
                        line.put(typed, self._end.baud())
        finally:
            if self._end is not None:
                self._end.close()
            self._release()

    def _release(self) -> None:
        if self._claim is not None:
            self._claim.release()

    def _unplug(self) -> None:
        if isinstance(self._end, _Tcp):
            self._end.drop()
        elif self._end is not None:
            self._end.close()
            self._end = None

    def stop(self) -> None:
        """End it."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self.run, name="ptu-simulator", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
