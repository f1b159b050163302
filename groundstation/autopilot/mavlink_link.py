"""A MAVLink 2 link to a vehicle (pymavlink), with threads of its own for what is read and what is written.

The pipeline's thread never waits for it: what is to be sent goes into a queue of some messages, of which the oldest is
dropped and counted where the line is slower.
"""

import os
import struct
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from groundstation.autopilot.link_url import LinkUrl
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.received import answer_time_request
from groundstation.errors import ConfigError, MissingExtraError, os_words
from ptu_drivers.errors import os_words as line_words

_DIALECT = "common"
_READ_S = 0.1
_END_S = 0.5
# a message that waits behind more than these is late
_MOST_OUT = 16
_MOST_IN = 1000
# a radio's own report of itself is never signed
_UNSIGNED = {"RADIO_STATUS", "RADIO"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedMessage:
    """One message: its name and fields, system and component that sent it, and the session time of its arrival, s."""

    name: str
    fields: Mapping[str, object]
    source: tuple[int, int]
    received_s: float


class MavlinkLink:
    """An open link.

    Parameters
    ----------
    url : where.
    source : system and component of this station.
    session_s : the session's clock, s; called from any thread.
    link_ns : the same as time of the link's clock, ns.
    key : of message signing, 32 bytes; None without: then all are taken, otherwise those of this key alone.

    Raises `ConfigError` where it cannot be opened, `MissingExtraError` without pymavlink.
    """

    def __init__(
        self,
        url: LinkUrl,
        source: tuple[int, int],
        session_s: Callable[[], float],
        link_ns: Callable[[], int],
        key: bytes | None = None,
    ) -> None:
        self._dialect, self._connection = _open(url, source, key)
        self._session_s, self._link_ns = session_s, link_ns
        self._out: deque[MavlinkMessage] = deque()
        self._in: deque[ReceivedMessage] = deque(maxlen=_MOST_IN)
        self._wake, self._closing = threading.Condition(), threading.Event()
        self.dropped = 0
        self.refused = 0
        self.fault = ""
        self._threads = [threading.Thread(target=f, daemon=True) for f in (self._read, self._write)]
        for thread in self._threads:
            thread.start()

    def send(self, messages: Sequence[MavlinkMessage]) -> None:
        """Send messages, in their order; returns at once."""
        if not messages:
            return
        with self._wake:
            self._out.extend(messages)
            while len(self._out) > _MOST_OUT:
                self._out.popleft()
                self.dropped += 1
            self._wake.notify()

    def received(self) -> list[ReceivedMessage]:
        """Return what came since the last call, the oldest first."""
        messages = []
        while self._in:
            messages.append(self._in.popleft())
        return messages

    def close(self) -> None:
        """Close the link once what waits is sent, or half a second has passed."""
        self._closing.set()
        with self._wake:
            self._wake.notify()
        for thread in self._threads:
            thread.join(_END_S)
        self._connection.close()

    def _read(self) -> None:
        while not self._closing.is_set():
            try:
                message = self._connection.recv_match(blocking=True, timeout=_READ_S)
            except Exception as fault:  # noqa: BLE001 - a line that breaks: pymavlink passes on the errors of its drivers
                self.fault = f"{type(fault).__name__}: {fault}"
                self._closing.wait(_READ_S)
                continue
            if message is not None:
                self._take(message)

    def _take(self, message: Any) -> None:
        name = message.get_type()
        if name == "BAD_DATA" or name.startswith("UNKNOWN"):
            self.refused += name == "BAD_DATA"
            return
        fields = {key: value for key, value in message.to_dict().items() if key != "mavpackettype"}
        source = (message.get_srcSystem(), message.get_srcComponent())
        if name == "TIMESYNC":
            answer = answer_time_request(fields, self._link_ns())
            if answer is not None:
                self.send([answer])
                return
        self._in.append(ReceivedMessage(name=name, fields=fields, source=source, received_s=self._session_s()))

    def _write(self) -> None:
        while True:
            with self._wake:
                while not self._out and not self._closing.is_set():
                    self._wake.wait()
                if not self._out:
                    return
                message = self._out.popleft()
            try:
                self._connection.mav.send(encoded(self._dialect, message))
            except OSError as fault:
                self.fault = f"{type(fault).__name__}: {os_words(fault)}"
            except struct.error as fault:
                # a number that the message cannot hold: the others go on
                self.fault = f"{message.name} could not be sent: {fault}"


def encoded(dialect: ModuleType, message: MavlinkMessage) -> Any:
    """Return pymavlink's message of a dialect."""
    return getattr(dialect, f"MAVLink_{message.name.lower()}_message")(**message.fields)


def _open(url: LinkUrl, source: tuple[int, int], key: bytes | None) -> tuple[ModuleType, Any]:
    # before its import: extension fields (reset_counter, quality, yaw) are of MAVLink 2 alone
    os.environ["MAVLINK20"] = "1"
    try:
        from pymavlink import mavutil
    except ImportError as fault:
        raise MissingExtraError("sending to an autopilot", "autopilot") from fault
    try:
        connection = mavutil.mavlink_connection(
            url.device,
            baud=url.baud,
            source_system=source[0],
            source_component=source[1],
            dialect=_DIALECT,
            autoreconnect=True,
        )
    except Exception as fault:  # pymavlink passes on the errors of its drivers
        wanted = "a line that can be opened"
        raise ConfigError(f"autopilot URL {url.text}", got=line_words(fault), wanted=wanted) from fault
    dialect = mavutil.mavlink
    if key is not None:
        # an unsigned message is taken of a radio alone, one signed with another key never
        names = {getattr(dialect, f"MAVLINK_MSG_ID_{name}", -1) for name in _UNSIGNED}
        connection.setup_signing(key, sign_outgoing=True, allow_unsigned_callback=lambda _, kind: kind in names)
    return dialect, connection
