"""The line on which a reference receiver's sentences come: a serial port, a TCP connection, UDP datagrams."""

import socket
import time
from typing import Protocol

from groundstation.errors import os_words
from groundstation.live.head_device import DeviceError
from groundstation.live.reference_device import ReferenceDevice, UdpAddress, udp_address
from ptu_drivers.errors import PtuError
from ptu_drivers.transport import SerialTransport

_MOST = 65_536


class ReceiverLine(Protocol):
    """A line that is open.

    Attributes
    ----------
    refused : how many datagrams came from senders that are not allowed; nothing of them is read.
    refused_sender : who sent the newest of them, "" for none.
    """

    refused: int
    refused_sender: str

    def read(self, timeout_s: float) -> bytes:
        """Return what came; nothing where nothing came in time. Raises `DeviceError` where the line is gone."""

    def close(self) -> None:
        """Let go of it; never raises."""


def open_reference_line(device: ReferenceDevice) -> ReceiverLine:
    """Open a receiver's line; raises `DeviceError`, `ConfigError`."""
    address = udp_address(device.url)
    return _SerialLine(device) if address is None else _UdpLine(device, address)


class _SerialLine:
    """A serial port or a TCP connection, as pyserial opens it."""

    def __init__(self, device: ReferenceDevice) -> None:
        self.refused, self.refused_sender = 0, ""
        try:
            self._transport = SerialTransport(device.url, device.baud)
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

    def __init__(self, device: ReferenceDevice, address: UdpAddress) -> None:
        self.refused, self.refused_sender = 0, ""
        self._device = device
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((str(address.host), address.port))
        except OSError as fault:
            self._socket.close()
            raise DeviceError(f"{device.url}: got {os_words(fault)}; wanted a port to listen at") from fault

    def read(self, timeout_s: float) -> bytes:
        """Wait for a datagram of an allowed sender; those of others are counted, and do not lengthen the wait."""
        until_s = time.monotonic() + timeout_s
        try:
            while (left_s := until_s - time.monotonic()) > 0.0:
                self._socket.settimeout(left_s)
                data, (sender, _) = self._socket.recvfrom(_MOST)
                if self._device.allows(sender):
                    return data
                self.refused += 1
                self.refused_sender = sender
        except TimeoutError:
            pass
        except OSError as fault:
            raise DeviceError(f"{self._device.url}: got {os_words(fault)}; wanted datagrams") from fault
        return b""

    def close(self) -> None:
        """Close it."""
        self._socket.close()
