"""Packets of Dynamixel Protocol 2.0, for the simulated servos: bytes to packets and back, no input or output.

FF FF FD 00, identifier, length (2 bytes, little end first), instruction, parameters, CRC-16 (polynomial 8005, start 0).
After FF FF FD inside a packet another FD is inserted, so that no packet contains a header. A status packet has
instruction 55 and an error byte before its parameters. The driver itself uses the maker's own SDK.
"""

from dataclasses import dataclass, field
from enum import IntEnum

from ptu_drivers.errors import ProtocolError

BROADCAST = 0xFE
_HEADER = b"\xff\xff\xfd\x00"
_TRIPLE = b"\xff\xff\xfd"
_LONGEST = 1024
_OVERHEAD = 7


class Instruction(IntEnum):
    """The kinds of packets."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


class ServoError(IntEnum):
    """Error number in a status packet; the alert bit (80) may be added."""

    NONE = 0x00
    RESULT_FAIL = 0x01
    INSTRUCTION = 0x02
    CRC = 0x03
    DATA_RANGE = 0x04
    DATA_LENGTH = 0x05
    DATA_LIMIT = 0x06
    ACCESS = 0x07
    ALERT = 0x80


@dataclass(frozen=True, slots=True, kw_only=True)
class Packet:
    """One packet: identifier 0 to 254, instruction, parameters (a status packet's begin with its error byte)."""

    identifier: int
    instruction: int
    parameters: bytes = b""

    def __post_init__(self) -> None:
        if not 0 <= self.identifier <= BROADCAST:
            raise ProtocolError("Dynamixel identifier", got=str(self.identifier), wanted="0 to 254")
        if not 0 <= self.instruction <= 0xFF:
            raise ProtocolError("Dynamixel instruction", got=str(self.instruction), wanted="0 to 255")


def _crc_table() -> tuple[int, ...]:
    table = []
    for high in range(256):
        value = high << 8
        for _ in range(8):
            value = (value << 1 ^ 0x8005 if value & 0x8000 else value << 1) & 0xFFFF
        table.append(value)
    return tuple(table)


_CRC = _crc_table()


def crc16(data: bytes) -> int:
    """Return the CRC of Protocol 2.0: polynomial 8005, start 0, not reflected."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFFFF) ^ _CRC[value >> 8 ^ byte]
    return value


def encode(packet: Packet) -> bytes:
    """Return a packet's bytes, stuffed and with its CRC."""
    body = _stuffed(bytes((packet.instruction,)) + packet.parameters)
    length = len(body) + 2
    if length + _OVERHEAD > _LONGEST:
        raise ProtocolError("Dynamixel packet", got=f"{length + _OVERHEAD} bytes", wanted=f"at most {_LONGEST}")
    head = _HEADER + bytes((packet.identifier, length & 0xFF, length >> 8)) + body
    crc = crc16(head)
    return head + bytes((crc & 0xFF, crc >> 8))


def decode(data: bytes) -> Packet | None:
    """Return the packet that exactly these bytes are, or None where header, length or CRC are wrong."""
    if len(data) < _OVERHEAD + 3 or not data.startswith(_HEADER) or data[4] > BROADCAST:
        return None
    if len(data) != _OVERHEAD + (data[5] | data[6] << 8) or crc16(data[:-2]) != data[-2] | data[-1] << 8:
        return None
    body = _unstuffed(data[_OVERHEAD:-2])
    return Packet(identifier=data[4], instruction=body[0], parameters=body[1:])


@dataclass(slots=True)
class PacketDecoder:
    """Divides a stream of bytes into packets, skipping other bytes.

    Attributes
    ----------
    skipped : bytes so far that belonged to no packet.
    """

    skipped: int = 0
    _pending: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that these bytes complete."""
        self._pending += data
        found: list[Packet] = []
        while True:
            begin = self._pending.find(_HEADER)
            if begin < 0:
                # up to three bytes may be the start of a header
                begin = max(0, len(self._pending) - 3)
            self.skipped += begin
            del self._pending[:begin]
            if len(self._pending) < _OVERHEAD:
                return found
            size = _OVERHEAD + (self._pending[5] | self._pending[6] << 8)
            if size <= _LONGEST and len(self._pending) < size:
                return found
            packet = decode(bytes(self._pending[:size])) if size <= _LONGEST else None
            if packet is None:
                self.skipped += 1
                del self._pending[:1]
            else:
                found.append(packet)
                del self._pending[:size]


def _stuffed(body: bytes) -> bytes:
    return body.replace(_TRIPLE, _TRIPLE + b"\xfd")


def _unstuffed(body: bytes) -> bytes:
    return body.replace(_TRIPLE + b"\xfd", _TRIPLE)
