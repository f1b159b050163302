"""A device server (RFC 2217) before a serial port, as ser2net is one: the far end is pyserial's own `PortManager`."""

import contextlib
import socket
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

import serial
from serial import rfc2217


class _PtyPort(serial.Serial):
    """A pty has no modem lines."""

    cts = dsr = ri = cd = True

    def _update_rts_state(self) -> None:
        pass

    def _update_dtr_state(self) -> None:
        pass


class _Connection:
    """What a `PortManager` writes to, from two threads."""

    def __init__(self, peer: socket.socket) -> None:
        self._peer = peer
        self._lock = threading.Lock()

    def write(self, data: bytes) -> None:
        with self._lock, contextlib.suppress(OSError):
            self._peer.sendall(data)


class DeviceServer:
    """Serves the serial port at `path` on a TCP port of this machine, one client at a time.

    Attributes
    ----------
    mute : takes what comes and sends nothing, as a connection that is half open.
    """

    def __init__(self, path: Path) -> None:
        self.mute = False
        self._path = path
        self._port = 0
        self._server: socket.socket | None = None
        self._peer: socket.socket | None = None
        self._ended = threading.Event()
        self._threads: list[threading.Thread] = []
        self.plug_in()

    @property
    def url(self) -> str:
        return f"rfc2217://127.0.0.1:{self._port}"

    def plug_in(self) -> None:
        """Listen, at the same port as before."""
        self._server = socket.create_server(("127.0.0.1", self._port))
        self._port = self._server.getsockname()[1]
        self._ended.clear()
        self._start(self._accept)

    def pull_out(self) -> None:
        """Break the connection, and take no other."""
        self._ended.set()
        for end in (self._server, self._peer):
            if end is not None:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
                end.close()
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.pull_out()

    def _start(self, work: object, *arguments: object) -> None:
        thread = threading.Thread(target=work, args=arguments, daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while not self._ended.is_set():
                assert self._server is not None
                self._peer, _ = self._server.accept()
                self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with _PtyPort(str(self._path), timeout=0.005) as port:
                    manager = rfc2217.PortManager(port, _Connection(self._peer))
                    gone = threading.Event()
                    sender = threading.Thread(target=self._send, args=(manager, port, self._peer, gone), daemon=True)
                    sender.start()
                    self._receive(manager, port, self._peer)
                    gone.set()
                    sender.join()
                self._peer.close()

    def _receive(self, manager: rfc2217.PortManager, port: serial.Serial, peer: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := peer.recv(1024):
                if not self.mute:
                    port.write(b"".join(manager.filter(data)))

    def _send(
        self, manager: rfc2217.PortManager, port: serial.Serial, peer: socket.socket, gone: threading.Event
    ) -> None:
        with contextlib.suppress(OSError):
            while not gone.is_set():
                data = port.read(port.in_waiting or 1)
                if data and not self.mute:
                    peer.sendall(b"".join(manager.escape(data)))
