"""One query on a Pelco line: the bytes of its reply, its time, and the rules by which it is refused.

Pelco messages have no sequence number and a checksum of 8 bits, so that order and time have to identify them: one query
is on the line at a time; a reply that is complete before the end of the query belongs to an older one; after a query
without a reply the other axis is queried first, because a unit replies in order; bytes directly after a reply make
it doubtful (one with an additional byte passes the checksum once in 256).
"""

from collections import Counter
from dataclasses import dataclass, field

from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import Axis
from ptu_drivers.pelco.codec import Opcode, PelcoFraming, PelcoMessage, acknowledgement_of, encode, scan
from ptu_drivers.transport import Transport

_QUERY = {Axis.PAN: Opcode.QUERY_PAN, Axis.TILT: Opcode.QUERY_TILT}
_REPLY = {Axis.PAN: Opcode.PAN_IS, Axis.TILT: Opcode.TILT_IS}
_ANSWERS = frozenset((Opcode.PAN_IS, Opcode.TILT_IS))
# silence after a reply, in characters, and at least this long where characters take no time
_QUIET_CHARACTERS = 2.0
_QUIET_S = 0.002
# limit of the bytes read for one reply: a line that never falls silent gives none
_LONGEST = 1024
_CHUNKS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class PelcoReply:
    """The number in a unit's reply.

    Attributes
    ----------
    word : 0 to 65535.
    sent_s, answered_s : when the query was written to the line, and when the reply was complete, s.
    asked_s : earliest instant at which the unit had the whole query, s.
    first_bit_s : latest instant at which the reply can have begun, s.
    """

    word: int
    sent_s: float
    asked_s: float
    first_bit_s: float
    answered_s: float


@dataclass(slots=True, kw_only=True)
class PelcoExchange:
    """The line with its outstanding queries.

    Attributes
    ----------
    line : the line.
    address, framing : of the unit.
    reply_timeout_s : time to wait for a reply beyond the time of its bytes, s.
    late_s : time after a query beyond which no reply arrives, s.
    failures : counts of skipped bytes and messages, by reason.
    echoes : own messages received as echoes, as on two wires.
    """

    line: Transport
    address: int
    framing: PelcoFraming
    reply_timeout_s: float
    late_s: float
    failures: Counter[FailureReason] = field(default_factory=Counter)
    echoes: int = 0
    sent: int = 0
    _unanswered: dict[Axis, float] = field(default_factory=dict)

    def query(self, axis: Axis, until_s: float) -> PelcoReply:
        """Query one axis.

        Raises
        ------
        ExchangeFailed : no valid reply. LineError : the line is lost.
        """
        question = encode(PelcoMessage(address=self.address, opcode=_QUERY[axis]), self.framing)
        self.drain()
        sent_s = self.line.now()
        character_s = self.line.character_s()
        asked_s = sent_s + len(question) * character_s
        self.sent += 1
        self._unanswered[axis] = sent_s
        self.line.write(question)
        until_s = min(until_s, asked_s + self.reply_timeout_s + len(question) * character_s)
        received, arrivals = bytearray(), []
        refused: set[int] = set()
        while True:
            chunk = self.line.read(until_s)
            received += chunk.data
            if not chunk.data or len(received) > _LONGEST:
                raise ExchangeFailed(self._failure_without_answer(bytes(received[:_LONGEST]), question))
            arrivals.append((len(received), chunk.t_s))
            for at, message in scan(bytes(received), self.framing).found:
                if at in refused:
                    continue
                began_s = _began(at, arrivals, character_s)
                if self._is_answer(message, axis, began_s >= asked_s, question):
                    self._check_silence(bytes(received), at + len(question), character_s)
                    self._answered(axis, sent_s)
                    return PelcoReply(
                        word=message.word,
                        sent_s=sent_s,
                        asked_s=asked_s,
                        first_bit_s=began_s,
                        answered_s=self.line.now(),
                    )
                refused.add(at)

    def send(self, message: PelcoMessage) -> None:
        """Send a command that has no reply."""
        self.sent += 1
        self.line.write(encode(message, self.framing))

    def send_and_wait(self, message: PelcoMessage, until_s: float) -> int:
        """Send a command to a unit that acknowledges; returns its alarm bits. Raises ExchangeFailed, LineError."""
        self.drain()
        self.send(message)
        frame = encode(message, self.framing)
        received = bytearray()
        until_s = min(until_s, self.line.now() + 2 * len(frame) * self.line.character_s() + self.reply_timeout_s)
        while True:
            chunk = self.line.read(until_s)
            received += chunk.data
            if not chunk.data or len(received) > _LONGEST:
                raise ExchangeFailed(FailureReason.TIMEOUT, "no acknowledgement")
            rest = bytes(received).removeprefix(frame)
            for at in range(len(rest) - 3):
                short = acknowledgement_of(rest[at : at + 4], message)
                if short is not None:
                    return short.alarms

    def barrier(self) -> tuple[Axis, Axis]:
        """Return the order of the queries: first the axis whose reply cannot be an old one."""
        return (Axis.TILT, Axis.PAN) if Axis.PAN in self._unanswered else (Axis.PAN, Axis.TILT)

    def wait_until_idle(self, until_s: float) -> None:
        """Listen until old replies can be excluded. Raises ExchangeFailed if that takes longer, LineError."""
        self.drain()
        if len(self._unanswered) < len(Axis):
            return
        certain_s = max(self._unanswered.values()) + self.late_s
        while self.line.now() < min(certain_s, until_s):
            if self.line.read(min(certain_s, until_s)).data:
                self.failures[FailureReason.UNEXPECTED] += 1
        if self.line.now() < certain_s:
            raise ExchangeFailed(FailureReason.TIMEOUT, "answers that may still come")
        self._unanswered.clear()

    def drain(self) -> None:
        """Discard received bytes that belong to no exchange."""
        for _ in range(_CHUNKS):
            if not self.line.read(self.line.now()).data:
                return

    def _answered(self, axis: Axis, sent_s: float) -> None:
        """Clear the earlier queries: a unit replies in order, so they get no reply any more."""
        self._unanswered = {a: t for a, t in self._unanswered.items() if a is not axis and t > sent_s}

    def _is_answer(self, message: PelcoMessage, axis: Axis, in_time: bool, question: bytes) -> bool:
        if encode(message, self.framing) == question:
            self.echoes += 1
            return False
        if message.address != self.address or message.command_1 != 0 or message.opcode not in _ANSWERS:
            self.failures[FailureReason.UNEXPECTED] += 1
            return False
        if message.opcode != _REPLY[axis] or not in_time:
            self.failures[FailureReason.ECHO_MISMATCH] += 1
            return False
        return True

    def _check_silence(self, received: bytes, end: int, character_s: float) -> None:
        quiet_s = max(_QUIET_CHARACTERS * character_s, _QUIET_S)
        if len(received) > end or self.line.read(self.line.now() + quiet_s).data:
            raise ExchangeFailed(FailureReason.GARBAGE, "bytes on the heels of the answer")

    def _failure_without_answer(self, received: bytes, question: bytes) -> FailureReason:
        seen = scan(received, self.framing)
        if not seen.skipped and seen.used == len(received):
            # nothing, or whole messages of others
            return FailureReason.TIMEOUT
        rest = received.removeprefix(question)
        start = rest.find(question[:2])
        if start < 0:
            return FailureReason.GARBAGE
        return FailureReason.TRUNCATED if len(rest) - start < len(question) else FailureReason.CHECKSUM


def _began(at: int, arrivals: list[tuple[int, float]], character_s: float) -> float:
    """Return the latest instant at which the byte at this index can have begun, s.

    Each byte had arrived at its chunk's instant at the latest, and each takes a character's time on the line: the last
    byte of a chunk bounds the first, also for an adapter that delivers many bytes at once.
    """
    return min(t_s - (end - at) * character_s for end, t_s in arrivals if end > at)
