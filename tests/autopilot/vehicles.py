"""A vehicle on a UDP port that answers as an autopilot: heartbeats, parameters, the time."""

import socket
import struct
import threading
import time
from collections.abc import Mapping
from types import TracebackType

from pymavlink.dialects.v20 import common


class ParameterVehicle:
    """A vehicle with parameters; a link reaches it at ``url``.

    ``autopilot``: MAV_AUTOPILOT, 3 ArduPilot, 12 PX4. It answers TIMESYNC if it ``tells_time``.
    """

    def __init__(self, autopilot: int, parameters: Mapping[str, float | int], *, tells_time: bool = True) -> None:
        self._autopilot, self._parameters, self._tells_time = autopilot, parameters, tells_time
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.05)
        self.url = f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"
        self._mav = common.MAVLink(self, srcSystem=7, srcComponent=1)
        self._mav.robust_parsing = True
        self._peer: tuple[str, int] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "ParameterVehicle":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.set()
        self._thread.join()
        self._socket.close()

    def write(self, data: bytes) -> None:
        """Send bytes to the link."""
        if self._peer is not None:
            self._socket.sendto(data, self._peer)

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                data, self._peer = self._socket.recvfrom(4096)
            except TimeoutError:
                continue
            self._mav.heartbeat_send(1, self._autopilot, 0, 0, 4)
            for message in self._mav.parse_buffer(data) or ():
                if message.get_type() == "PARAM_REQUEST_READ" and message.param_id in self._parameters:
                    self._answer(message.param_id)
                if message.get_type() == "TIMESYNC" and message.tc1 == 0 and self._tells_time:
                    self._mav.timesync_send(time.monotonic_ns(), message.ts1)

    def _answer(self, name: str) -> None:
        value = self._parameters[name]
        kind = 6 if isinstance(value, int) else 9
        sent = float(value)
        if self._autopilot == 12 and isinstance(value, int):
            # PX4: the bits of the integer in the place of a float's
            (sent,) = struct.unpack("<f", struct.pack("<i", value))
        self._mav.param_value_send(name.encode(), sent, kind, len(self._parameters), 0)
