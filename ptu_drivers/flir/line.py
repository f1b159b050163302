"""One exchange at a time on a FLIR line: the echo identifies the reply, the times bound the time of the query."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

from ptu_drivers.errors import ProtocolError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import DELIMITER, FlirReply, LineSplitter, RawLine, Stray, encode, parse_line
from ptu_drivers.health import FailureReason, HealthCounter
from ptu_drivers.transport import Transport

# length on the line of a reply that is waited for beyond the timeout
LONGEST_ANSWER_CHARACTERS = 60
# an echo and a refusal
_REFUSAL = 40
# data available at the deadline are still read, because a busy machine is late: so many chunks, not more
_LATE_CHUNKS = 4
_QUIET_S = 0.03
_DRAIN_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchanged:
    """A query with its reply.

    Attributes
    ----------
    answer : the received line; its echo is the query's.
    begun_s, done_s : when the first byte was sent, and the last one received, s.
    earliest_s, latest_s : the delimiter reached the unit between these, s: not before all bytes had been on the line,
        not after its echo or the first byte of the reply had begun.
    sent_s : end of the delimiter on the line if the port sent it at once, s.
    mark_s : when the first byte of the reply had arrived, s.
    """

    answer: FlirReply
    begun_s: float
    done_s: float
    earliest_s: float
    latest_s: float
    sent_s: float
    mark_s: float


@dataclass(slots=True, kw_only=True)
class _Question:
    """A sent query without a reply yet."""

    command: str
    begun_s: float
    earliest_s: float
    sent_s: float


class FlirLine:
    """The line to one unit, which echoes.

    Parameters
    ----------
    transport : the line.
    counter : counts failures.
    timeout_s : time for a reply beyond the time on the line, s.
    """

    def __init__(self, transport: Transport, counter: HealthCounter, timeout_s: float) -> None:
        self.transport = transport
        self.pace_s = 0.1
        """Least time between commands, s: a D-series unit takes 10 a second; set once the unit is known."""
        self._counter = counter
        self._timeout_s = timeout_s
        self._splitter = LineSplitter()
        self._spelling: Counter[str] = Counter()
        self._nonce = count(1000)
        self._length: dict[str, int] = {}
        self._last_s = float("-inf")

    def longest_s(self) -> float:
        """Return the longest time that an exchange may take, s."""
        return self._timeout_s + LONGEST_ANSWER_CHARACTERS * self.transport.character_s() + self.pace_s

    def query(self, command: str, *, deadline_s: float | None = None) -> Exchanged:
        """Send a command and return its reply.

        Parameters
        ----------
        command : without delimiter; the case of its letters is varied, so that late replies do not match.
        deadline_s : wait no longer than that, s on the transport's clock.

        Raises
        ------
        ExchangeFailed : no valid reply. LineError : the line is lost.
        """
        self._sweep()
        self._keep_pace()
        spelled = self._spell(command)
        return self._finish(self._send(spelled), deadline_s)

    def query_pair(self, first: str, second: str, *, deadline_s: float | None = None) -> tuple[Exchanged, Exchanged]:
        """Send two queries, the letters of the second while the reply to the first arrives.

        Still one command at a time: the second has no effect before its delimiter, which follows the first reply's end.
        """
        self._sweep()
        self._keep_pace()
        spelled = self._spell(second)
        typed = False

        def type_ahead() -> None:
            nonlocal typed
            self.transport.write(spelled.encode("ascii"))
            typed = True

        one = self._finish(self._send(self._spell(first)), deadline_s, type_ahead)
        self._keep_pace()
        question = self._send(spelled, typed=typed)
        return one, self._finish(question, deadline_s)

    def resynchronise(self, deadline_s: float) -> None:
        """Flush the line, and send a query not sent before: replies after its own belong to later queries.

        The query is an illegal command with a number, which the unit echoes and refuses; it also invalidates a
        half-received command in the unit, without executing it.

        Raises
        ------
        ExchangeFailed : no such reply. LineError.
        """
        self._drain(deadline_s)
        self._keep_pace()
        question = self._send(f"Z{next(self._nonce)}")
        deadline_s = min(deadline_s, self.transport.now() + self._timeout_s + _REFUSAL * self.transport.character_s())
        while True:
            for line in self._lines(deadline_s, question.command):
                parsed = self._parse(line)
                if isinstance(parsed, FlirReply) and parsed.echo == question.command:
                    return
                if isinstance(parsed, FlirReply) and parsed.echo.endswith(question.command):
                    # half a command stood before it and is spoilt; now it must come back alone
                    self._keep_pace()
                    question = self._send(f"Z{next(self._nonce)}")
            if self.transport.now() >= deadline_s:
                raise ExchangeFailed(FailureReason.TIMEOUT, f"only lines that do not answer {question.command}")

    def halt_blind(self) -> None:
        """Send a halt without waiting for anything, behind what spoils half a command; `resynchronise` is due then.

        Raises
        ------
        LineError.
        """
        for command in ("Z0", "H"):
            self._keep_pace()
            self._send(command)

    def greet(self, deadline_s: float) -> None:
        """Bring a unit of unknown state to echo: spoil half a command, switch the echo on, and `resynchronise`.

        Raises
        ------
        ExchangeFailed, LineError.
        """
        for command in ("Z0", "EE"):
            self._drain(deadline_s)
            self._keep_pace()
            self._send(command)
        self.resynchronise(deadline_s)

    def begin(self, command: str) -> Callable[[float], bool]:
        """Send a command whose reply may take long; return a test (until a time) of its arrival."""
        self._sweep()
        self._keep_pace()
        question = self._send(self._spell(command))

        def answered(until_s: float) -> bool:
            try:
                self._finish(question, until_s)
            except ExchangeFailed as failure:
                if failure.reason is FailureReason.TIMEOUT:
                    # the echo arrives at once, the reply after completion
                    return False
                raise
            return True

        return answered

    def outwait(self, command: str, timeout_s: float) -> None:
        """Send a command and wait for its reply, `timeout_s` at most. Raises ExchangeFailed, LineError."""
        began = self.transport.now()
        answered = self.begin(command)
        while not answered(self.transport.now() + self.longest_s()):
            if self.transport.now() - began > timeout_s:
                raise ExchangeFailed(FailureReason.TIMEOUT, "nothing")
            # the time of an exchange is over: from now on it returns at once
            self.transport.wait(_QUIET_S)

    def _spell(self, command: str) -> str:
        """Vary the case of the letters; the unit does not care, and its echo repeats it."""
        self._spelling[command] += 1
        n = self._spelling[command]
        letters = sum(1 for c in command if c.isalpha())
        if not letters or command.startswith("@"):
            return command
        spelled, bit = [], 0
        for c in command:
            varied = c.isalpha() and bit < 3
            spelled.append((c.lower() if n >> bit & 1 else c.upper()) if varied else c)
            bit += varied
        return "".join(spelled)

    def _send(self, command: str, *, typed: bool = False) -> _Question:
        data = DELIMITER if typed else encode(command)
        begun = self.transport.now()
        self._counter.exchanges += 1
        written = self.transport.write(data)
        # the unit counts from the delimiter, which is sent last
        self._last_s = begun + len(data) * self.transport.character_s()
        on_line = len(data) * self.transport.character_s()
        return _Question(command=command, begun_s=begun, earliest_s=begun + on_line, sent_s=written + on_line)

    def _finish(
        self, question: _Question, deadline_s: float | None, type_ahead: Callable[[], None] | None = None
    ) -> Exchanged:
        limit = question.begun_s + self.longest_s()
        limit = limit if deadline_s is None else min(limit, deadline_s)
        while True:
            for line in self._lines(limit, question.command, type_ahead):
                parsed = self._parse(line)
                if isinstance(parsed, FlirReply):
                    if parsed.echo != question.command:
                        raise ExchangeFailed(FailureReason.ECHO_MISMATCH, parsed.echo or "an answer without echo")
                    if question.command.isalpha():
                        self._length[question.command.upper()] = len(line.data)
                    return self._exchanged(question, parsed, line)
            if self.transport.now() >= limit:
                raise ExchangeFailed(FailureReason.TIMEOUT, f"only lines that do not answer {question.command}")

    def _exchanged(self, question: _Question, answer: FlirReply, line: RawLine) -> Exchanged:
        character = self.transport.character_s()
        mark = line.times_s[answer.mark_at]
        latest = mark - character
        if 0 <= answer.delimiter_at < answer.mark_at:
            latest = min(latest, line.times_s[answer.delimiter_at] - character)
        # a line faster than its stated speed (a pty) gives no bound by its times, except that it was sent before
        earliest = question.earliest_s if question.earliest_s <= latest else min(question.begun_s, latest)
        return Exchanged(
            answer=answer,
            begun_s=question.begun_s,
            done_s=line.times_s[-1],
            earliest_s=earliest,
            sent_s=question.sent_s,
            latest_s=latest,
            mark_s=mark,
        )

    def _lines(self, until_s: float, asked: str, on_mark: Callable[[], None] | None = None) -> list[RawLine]:
        """Wait for at least one whole line."""
        late = 0
        while True:
            chunk = self.transport.read(until_s)
            if not chunk.data:
                left = self._splitter.unfinished
                begun = b"*" in left or b"!" in left
                reason = FailureReason.TRUNCATED if begun else FailureReason.TIMEOUT
                raise ExchangeFailed(reason, repr(left)[:60] if left else f"nothing to {asked}")
            lines = self._splitter.feed(chunk.data, chunk.t_s, self.transport.character_s())
            if lines:
                return lines
            late += self.transport.now() >= until_s
            if late > _LATE_CHUNKS:
                raise ExchangeFailed(FailureReason.TRUNCATED, repr(self._splitter.unfinished)[:60])
            left = self._splitter.unfinished
            if on_mark and b"*" in left:
                on_mark()
                on_mark = None
            self._doze(asked, left, until_s, whole=on_mark is None and b"*" in left)

    def _doze(self, asked: str, left: bytes, until_s: float, *, whole: bool) -> None:
        """Sleep while expected bytes arrive: waking up for each costs more processor time than all else.

        First until the echo must be complete, then until the reply may be, if it is as long as the last one.
        """
        expected = self._length.get(asked.upper(), 0) - 2 if whole else len(asked) + 1
        least = (expected - len(left)) * self.transport.character_s()
        if least > 0.0:
            self.transport.wait(min(least, until_s - self.transport.now()))

    def _parse(self, line: RawLine) -> FlirReply | Stray:
        try:
            parsed = parse_line(line.data)
        except ProtocolError as fault:
            raise ExchangeFailed(FailureReason.GARBAGE, fault.got) from fault
        self._counter.limit_events += parsed.events
        if isinstance(parsed, Stray) and not parsed.events:
            self._counter.failures[FailureReason.UNEXPECTED] += 1
        return parsed

    def _sweep(self) -> None:
        """Read unsolicited bytes: anything but limit messages is a reason to reject the following reply."""
        chunk = self.transport.read(self.transport.now())
        lines = self._splitter.feed(chunk.data, chunk.t_s, self.transport.character_s()) if chunk.data else []
        for line in lines:
            parsed = self._parse(line)
            if isinstance(parsed, FlirReply):
                raise ExchangeFailed(FailureReason.ECHO_MISMATCH, f"{parsed.echo} {parsed.text}")

    def _drain(self, deadline_s: float) -> None:
        end = min(self.transport.now() + _DRAIN_S, deadline_s)
        while self.transport.now() < end:
            if not self.transport.read(min(end, self.transport.now() + _QUIET_S)).data:
                break
        self._splitter.forget()

    def _keep_pace(self) -> None:
        if self.pace_s:
            self.transport.wait(self._last_s + self.pace_s - self.transport.now())
