"""The bus of two Dynamixel servos, through the maker's SDK: its framing and CRC, the driver's line and checks.

The SDK accepts any status packet of the right servo. Here its length must also be the requested one, and it must not
have begun before the end of the query.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ptu_drivers.dynamixel.codec import ServoError
from ptu_drivers.dynamixel.table import STATE, Register, number
from ptu_drivers.errors import MissingPackageError, RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.transport import Transport

_STATUS_OVERHEAD = 11
_LENGTH_OF_EMPTY = 4
_SLICE_S = 0.05
# so often a line that never falls silent is emptied, before it is asked all the same
_CHUNKS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """A servo's reply.

    Attributes
    ----------
    identifier : of the servo. data : its parameters. alert : it reports a hardware error.
    asked_s, first_bit_s : bounds of the time at which the servo composed it, s.
    """

    identifier: int
    data: bytes
    alert: bool
    asked_s: float
    first_bit_s: float


class SdkPort:
    """A line with the interface of the SDK's packet handler, whose own port opens only devices, without times."""

    def __init__(self, line: Transport, reply_timeout_s: float) -> None:
        self.is_using = False
        self.line = line
        self.reply_timeout_s = reply_timeout_s
        self.sent_s = self.asked_s = 0.0
        self.sent = 0
        self.limit_s = float("inf")
        """No answer is waited for beyond this, s."""
        self._until_s = 0.0
        self._buffer = bytearray()
        self._arrivals: list[tuple[int, float]] = []
        self._taken = 0

    def clearPort(self) -> None:  # noqa: N802 - the SDK's name
        """Drop unsolicited bytes."""
        for _ in range(_CHUNKS):
            if not self.line.read(self.line.now()).data:
                break
        self._buffer.clear()
        self._arrivals.clear()
        self._taken = 0

    def writePort(self, packet: list[int] | bytes) -> int:  # noqa: N802
        """Send a packet."""
        data = bytes(packet)
        self.sent += 1
        self.sent_s = self.line.now()
        self.asked_s = self.sent_s + len(data) * self.line.character_s()
        self.line.write(data)
        return len(data)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Return up to so many bytes; waits for some while the SDK's timeout has not passed."""
        if length <= 0:
            return b""
        if not self._buffer:
            now_s = self.line.now()
            if now_s >= self._until_s:
                return b""
            chunk = self.line.read(min(self._until_s, now_s + _SLICE_S))
            self._buffer += chunk.data
            if chunk.data:
                self._arrivals.append((self._taken + len(self._buffer), chunk.t_s))
        data = bytes(self._buffer[:length])
        del self._buffer[:length]
        self._taken += len(data)
        return data

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        """Allow for so many bytes, and for the reply time of the settings."""
        until_s = self.asked_s + length * self.line.character_s() + self.reply_timeout_s
        self._until_s = min(until_s, self.limit_s)

    def setPacketTimeoutMillis(self, milliseconds: float) -> None:  # noqa: N802
        """Allow for so long."""
        self._until_s = self.line.now() + milliseconds / 1000.0

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Return whether the time is up."""
        return self.line.now() >= self._until_s

    def getBaudRate(self) -> int:  # noqa: N802
        """Return the line's speed, bit/s."""
        return self.line.baud() or 1_000_000

    def began_s(self, length: int) -> float:
        """Return the latest instant at which the first bit of the last so many bytes taken can have come, s."""
        first = self._taken - length
        character_s = self.line.character_s()
        return min(
            (t_s - (end - first) * character_s for end, t_s in self._arrivals if end > first),
            default=self.line.now(),
        )

    def leftover(self) -> int:
        """Return the number of received bytes that were not read."""
        return len(self._buffer)


@dataclass(slots=True)
class DynamixelBus:
    """Queries and commands to servos by identifier; every reply is checked."""

    line: Transport
    reply_timeout_s: float
    hardware_alert: set[int] = field(default_factory=set)
    _port: SdkPort = field(init=False)
    _sdk: Any = field(init=False)
    _success: int = field(init=False)

    def __post_init__(self) -> None:
        sdk = _dynamixel_sdk()
        self._port = SdkPort(self.line, self.reply_timeout_s)
        self._sdk = sdk.PacketHandler(2.0)
        self._success = sdk.COMM_SUCCESS

    def finish_by(self, until_s: float) -> None:
        """Wait for no reply beyond an instant, s."""
        self._port.limit_s = until_s

    @property
    def sent(self) -> int:
        """Packets sent so far."""
        return self._port.sent

    def ping(self, identifier: int) -> int:
        """Return a servo's model number. Raises ExchangeFailed, LineError."""
        self._send(self._sdk.txPacket, [0, 0, 0, 0, identifier, 3, 0, 1, 0, 0])
        self._port.setPacketTimeout(_STATUS_OVERHEAD + 3)
        return number(self._receive(identifier, 3, "ping").data[:2])

    def read(self, identifier: int, register: Register) -> int:
        """Return a register's number. Raises ExchangeFailed, RefusedError, LineError."""
        self._send(self._sdk.readTx, identifier, register.address, register.size)
        status = self._receive(identifier, register.size, f"read {register.address}")
        return number(status.data, signed=register.signed)

    def write(self, identifier: int, register: Register, value: int) -> None:
        """Set a register, acknowledged. Raises ExchangeFailed, RefusedError, LineError."""
        data = list(value.to_bytes(register.size, "little", signed=register.signed))
        self._port.is_using = False
        self._send(self._sdk.writeTxOnly, identifier, register.address, register.size, data)
        self._port.setPacketTimeout(_STATUS_OVERHEAD)
        self._receive(identifier, 0, f"write {register.address}")

    def sync_write(self, register: Register, values: Mapping[int, int]) -> None:
        """Set a register of several servos at once, to which they do not reply. Raises ExchangeFailed, LineError."""
        packed: list[int] = []
        for identifier, value in values.items():
            packed += [identifier, *value.to_bytes(register.size, "little", signed=register.signed)]
        self._send(self._sdk.syncWriteTxOnly, register.address, register.size, packed, len(packed))
        self._port.is_using = False

    def states(self, identifiers: tuple[int, ...]) -> tuple[Status, ...]:
        """Query several servos at once for tick, velocity and position. Raises ExchangeFailed, LineError."""
        self._send(self._sdk.syncReadTx, STATE.address, STATE.size, list(identifiers), len(identifiers), False)
        self._port.setPacketTimeout((_STATUS_OVERHEAD + STATE.size) * len(identifiers))
        answers = tuple(self._receive(i, STATE.size, "sync read") for i in identifiers)
        if self._port.leftover():
            raise ExchangeFailed(FailureReason.GARBAGE, "bytes on the heels of the answer")
        return answers

    def drain(self) -> None:
        """Listen until the line is silent, at most for the reply time. Raises LineError."""
        quiet_s = max(0.005, 20 * self.line.character_s())
        until_s = min(self.line.now() + self.reply_timeout_s, self._port.limit_s)
        while self.line.now() < until_s and self.line.read(self.line.now() + quiet_s).data:
            pass
        self._port.is_using = False

    def _send(self, send: Any, *arguments: Any) -> None:
        self._port.is_using = False
        result = send(self._port, *arguments)
        if result != self._success:
            raise ExchangeFailed(FailureReason.TIMEOUT, self._sdk.getTxRxResult(result))

    def _receive(self, identifier: int, size: int, what: str) -> Status:
        try:
            packet, result = self._sdk.rxPacket(self._port, False)
        except IndexError as short:
            # the SDK indexes into packets whose own length field is too small
            raise ExchangeFailed(FailureReason.TRUNCATED, f"{what}: a packet that is too short") from short
        if result != self._success:
            reason = FailureReason.CHECKSUM if packet else FailureReason.TIMEOUT
            raise ExchangeFailed(reason, f"{what}: {self._sdk.getTxRxResult(result)}")
        # the SDK has removed the stuffing, and corrected the length field
        length = packet[5] | packet[6] << 8
        began_s = self._port.began_s(len(packet))
        if packet[4] != identifier:
            raise ExchangeFailed(FailureReason.ECHO_MISMATCH, f"{what}: an answer of servo {packet[4]}")
        if began_s < self._port.asked_s - self.line.character_s():
            raise ExchangeFailed(
                FailureReason.ECHO_MISMATCH, f"{what}: an answer that began before the question was out"
            )
        error = packet[8]
        alert = bool(error & ServoError.ALERT)
        (self.hardware_alert.add if alert else self.hardware_alert.discard)(identifier)
        if error & ~ServoError.ALERT:
            raise RefusedError(f"{what} of servo {identifier}", reported=self._sdk.getRxPacketError(error & 0x7F))
        if length != size + _LENGTH_OF_EMPTY:
            raise ExchangeFailed(FailureReason.ECHO_MISMATCH, f"{what}: {length - _LENGTH_OF_EMPTY} bytes, not {size}")
        return Status(
            identifier=identifier,
            data=bytes(packet[9 : 9 + size]),
            alert=alert,
            asked_s=self._port.asked_s,
            first_bit_s=began_s,
        )


def _dynamixel_sdk() -> Any:
    try:
        import dynamixel_sdk
    except ModuleNotFoundError as missing:
        raise MissingPackageError("the Dynamixel protocol", "'groundstation[dynamixel]'") from missing
    return dynamixel_sdk
