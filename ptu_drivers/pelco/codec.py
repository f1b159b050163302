"""Pelco-D and Pelco-P frames: bytes to messages and back, no input or output.

Pelco-D is FF, address, two command bytes, two data bytes, and the sum of the middle five modulo 256. Pelco-P has
the same four middle bytes between A0, an address counted from 0, and AF, then the exclusive or of all that. The short
reply of four bytes by which some units acknowledge a command is FF, address, alarms, and its sum plus the alarms.
"""

from dataclasses import dataclass, field
from enum import Enum, IntEnum

from ptu_drivers.errors import ProtocolError


class PelcoFraming(Enum):
    """How the four bytes of a message are wrapped."""

    D = "d"
    P = "p"


class Opcode(IntEnum):
    """Second command byte of the messages that this project uses."""

    STOP = 0x00
    RIGHT = 0x02
    LEFT = 0x04
    UP = 0x08
    DOWN = 0x10
    SET_PAN = 0x4B
    SET_TILT = 0x4D
    QUERY_PAN = 0x51
    QUERY_TILT = 0x53
    PAN_IS = 0x59
    TILT_IS = 0x5B


TURN = 36000  # counts of 0.01 degree
_D_START, _P_START, _P_END = 0xFF, 0xA0, 0xAF
_LENGTH = {PelcoFraming.D: 7, PelcoFraming.P: 8}
_SHORT = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class PelcoMessage:
    """One message: address counted from 1 in both framings, command and data bytes."""

    address: int
    opcode: int
    data_1: int = 0
    data_2: int = 0
    command_1: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.address <= 255:
            raise ProtocolError("Pelco address", got=str(self.address), wanted="1 to 255")
        for name in ("opcode", "data_1", "data_2", "command_1"):
            if not 0 <= getattr(self, name) <= 255:
                raise ProtocolError(f"Pelco {name}", got=str(getattr(self, name)), wanted="0 to 255")

    @property
    def word(self) -> int:
        """Both data bytes as one number, 0 to 65535."""
        return self.data_1 << 8 | self.data_2


@dataclass(frozen=True, slots=True, kw_only=True)
class PelcoAcknowledgement:
    """The short reply to a command: the unit's address, and its alarm bits."""

    address: int
    alarms: int


def with_word(address: int, opcode: int, word: int) -> PelcoMessage:
    """Return the message that carries a 16-bit number, 0 to 65535."""
    if not 0 <= word <= 0xFFFF:
        raise ProtocolError("Pelco data", got=str(word), wanted="0 to 65535")
    return PelcoMessage(address=address, opcode=opcode, data_1=word >> 8, data_2=word & 0xFF)


def encode(message: PelcoMessage, framing: PelcoFraming = PelcoFraming.D) -> bytes:
    """Return a message's bytes: 7 in Pelco-D, 8 in Pelco-P."""
    middle = bytes((message.command_1, message.opcode, message.data_1, message.data_2))
    if framing is PelcoFraming.D:
        body = bytes((message.address,)) + middle
        return bytes((_D_START,)) + body + bytes((sum(body) & 0xFF,))
    if message.address > 0x20:
        raise ProtocolError("Pelco-P address", got=str(message.address), wanted="1 to 32")
    body = bytes((_P_START, message.address - 1)) + middle + bytes((_P_END,))
    return body + bytes((_xor(body),))


def encode_acknowledgement(command: PelcoMessage, alarms: int = 0) -> bytes:
    """Return the short reply to a Pelco-D command."""
    total = encode(command)[-1] + alarms
    return bytes((_D_START, command.address, alarms & 0xFF, total & 0xFF))


def decode(frame: bytes, framing: PelcoFraming = PelcoFraming.D) -> PelcoMessage | None:
    """Return the message that exactly these bytes are, or None where start, end, length or checksum are wrong."""
    if len(frame) != _LENGTH[framing]:
        return None
    if framing is PelcoFraming.D:
        if frame[0] != _D_START or sum(frame[1:6]) & 0xFF != frame[6] or frame[1] == 0:
            return None
        address = frame[1]
    else:
        if frame[0] != _P_START or frame[6] != _P_END or _xor(frame[:7]) != frame[7] or frame[1] > 0x1F:
            return None
        address = frame[1] + 1
    return PelcoMessage(address=address, command_1=frame[2], opcode=frame[3], data_1=frame[4], data_2=frame[5])


def acknowledgement_of(frame: bytes, command: PelcoMessage) -> PelcoAcknowledgement | None:
    """Return the short reply to this command in exactly these bytes, or None."""
    if len(frame) != _SHORT or frame[0] != _D_START or frame[1] != command.address:
        return None
    if (encode(command)[-1] + frame[2]) & 0xFF != frame[3]:
        return None
    return PelcoAcknowledgement(address=frame[1], alarms=frame[2])


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """Content of a part of a stream.

    Attributes
    ----------
    found : messages with the index of their first byte.
    used : bytes that cannot be part of a later message.
    skipped : those of them that belonged to no message.
    """

    found: tuple[tuple[int, PelcoMessage], ...]
    used: int
    skipped: int


def scan(data: bytes, framing: PelcoFraming = PelcoFraming.D) -> Scan:
    """Find the messages in a part of a stream, skipping other bytes.

    A start byte without a valid message is skipped, and the search continues at the next byte: a message
    after garbage is found, even when the garbage contains start bytes.
    """
    start = _D_START if framing is PelcoFraming.D else _P_START
    length = _LENGTH[framing]
    found: list[tuple[int, PelcoMessage]] = []
    at = 0
    while True:
        begin = data.find(start, at)
        at = begin if begin >= 0 else len(data)
        if len(data) - at < length:
            break
        message = decode(data[at : at + length], framing)
        if message is None:
            at += 1
        else:
            found.append((at, message))
            at += length
    return Scan(found=tuple(found), used=at, skipped=at - length * len(found))


@dataclass(slots=True)
class PelcoDecoder:
    """Cuts a stream of bytes into messages; see `scan`.

    Attributes
    ----------
    framing : Pelco-D or Pelco-P.
    skipped : bytes so far that belonged to no message.
    """

    framing: PelcoFraming = PelcoFraming.D
    skipped: int = 0
    _pending: bytearray = field(default_factory=bytearray)

    @property
    def pending(self) -> int:
        """Bytes held back, because they may be the start of a message."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[PelcoMessage]:
        """Return the messages that these bytes complete."""
        self._pending += data
        seen = scan(bytes(self._pending), self.framing)
        self.skipped += seen.skipped
        del self._pending[: seen.used]
        return [message for _, message in seen.found]


def _xor(data: bytes) -> int:
    result = 0
    for byte in data:
        result ^= byte
    return result
