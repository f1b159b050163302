"""The line on which a reference receiver's sentences come: a serial port, a TCP connection, UDP datagrams."""

import re
import socket
import time
from typing import Protocol

from groundstation.live.head_device import DeviceError
from ptu_drivers.errors import PtuError
from ptu_drivers.transport import SerialTransport

_MOST = 65_536
_UDP = re.compile(r"udp://([^:/\s]*):(\d{1,5})")


class ReferenceLine(Protocol):
    """A line that is open."""

    def read(self, timeout_s: float) -> bytes:
        """Return what came; nothing where nothing came in time. Raises `DeviceError` where the line is gone."""

    def close(self) -> None:
        """Let go of it; never raises."""


def open_reference_line(url: str, baud: int) -> ReferenceLine:
    """Open a line by its URL; raises `DeviceError`."""
    if url.startswith("udp:"):
        return _UdpLine(url)
    return _SerialLine(url, baud)


class _SerialLine:
    """A serial port or a TCP connection, as pyserial opens it."""

    def __init__(self, url: str, baud: int) -> None:
        try:
            self._transport = SerialTransport(url, baud)
        except PtuError as fault:
            raise DeviceError(str(fault)) from fault

    def read(self, timeout_s: float) -> bytes:
        """Wait for the first byte, then take all that is there."""
        try:
            return self._transport.read(time.monotonic() + timeout_s).data
        except PtuError as fault:
            raise DeviceError(str(fault)) from fault

    def close(self) -> None:
        """Close it."""
        self._transport.close()


class _UdpLine:
    """Datagrams to a port of this machine; of sentences, never parts of them, it is supposed."""

    def __init__(self, url: str) -> None:
        match = _UDP.fullmatch(url)
        if match is None or not 0 < int(match[2]) < 65_536:
            raise DeviceError(f"{url}: got no address; wanted udp://:PORT, or udp://ADDRESS:PORT of this machine")
        self._url = url
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((match[1], int(match[2])))
        except OSError as fault:
            self._socket.close()
            raise DeviceError(f"{url}: got {fault.strerror or fault}; wanted a port to listen at") from fault

    def read(self, timeout_s: float) -> bytes:
        """Wait for a datagram."""
        try:
            self._socket.settimeout(timeout_s)
            return self._socket.recv(_MOST)
        except TimeoutError:
            return b""
        except OSError as fault:
            raise DeviceError(f"{self._url}: got {fault.strerror or fault}; wanted datagrams") from fault

    def close(self) -> None:
        """Close it."""
        self._socket.close()
