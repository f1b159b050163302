"""A line to a simulated unit in virtual time, with the faults of real ones. No clock, no thread.

Time passes when the driver waits: a second of motion, or forty of homing, take the time of their computation.
"""

import heapq
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

from ptu_drivers.errors import LineError
from ptu_drivers.simulated.peer import SimulatedPeer
from ptu_drivers.transport import BITS_PER_CHARACTER, Chunk

_SEND_SIGMA_S = 0.0005


@dataclass(slots=True)
class LineFaults:
    """Present faults of the bytes from the unit; counts are used up.

    Attributes
    ----------
    lose : bytes to be lost, after `skip` more have passed. garble : bytes to be replaced by random ones, too.
    truncate : the rest of the present line, and its end, are lost.
    merge : this many line ends are lost.
    """

    skip: int = 0
    lose: int = 0
    garble: int = 0
    truncate: bool = False
    merge: int = 0
    to_unit_lose: int = 0


@dataclass(slots=True, order=True)
class _Action:
    t_s: float
    order: int
    act: Callable[[], None] = field(compare=False)


class VirtualLine:
    """A `Transport` whose other end is simulated.

    Parameters
    ----------
    unit : the other end.
    baud : speed of the host's end, bit/s; 0 for a network line.
    start_s : the clock's first value, s.
    batch_s : bytes are delivered in batches at this interval, s (a USB adapter's frame); 0 at once.
    send_delay_s : largest delay of bytes on the line after they were written, s (a USB adapter's frame).
    seed : of the random bytes.
    """

    def __init__(
        self,
        unit: SimulatedPeer,
        baud: int = 9600,
        *,
        start_s: float = 1000.0,
        batch_s: float = 0.0,
        send_delay_s: float = 0.0,
        seed: int = 0,
        url: str = "virtual",
    ) -> None:
        self.url = url
        self.unit = unit
        self.faults = LineFaults()
        self.dead = False
        """Lose bytes in both directions without an error: a half-open connection, a broken wire."""
        self.gone = False
        """The adapter is unplugged: every use is an error."""
        self.trickle_s = 0.0
        """The unit's bytes come no closer together than that, s: an answer without end, though never silence."""
        self.reopened = 0
        self.traffic: list[tuple[float, str, bytes]] = []
        self.record = False
        self._baud = baud
        self._t_s = start_s
        self._batch_s = batch_s
        self._send_delay_s = send_delay_s
        self._random = random.Random(seed)
        self._to_unit: deque[tuple[float, int, int]] = deque()
        self._sent_until_s = start_s
        self._inbox = bytearray()
        self._trickle: deque[tuple[float, int, int]] = deque()
        self._actions: list[_Action] = []
        self._order = count()
        self._open = True
        unit.connect(start_s)

    def at(self, t_s: float, act: Callable[[], None]) -> None:
        """Do something to the line or the unit at an instant, s."""
        heapq.heappush(self._actions, _Action(t_s, next(self._order), act))

    def now(self) -> float:
        """Return the virtual clock, s."""
        return self._t_s

    def wait(self, duration_s: float) -> None:
        """Let virtual time pass."""
        if duration_s > 0.0:
            self._advance(self._t_s + duration_s)

    def character_s(self) -> float:
        """Return the time of one character at the host's speed, s."""
        return BITS_PER_CHARACTER / self._baud if self._baud else 0.0

    def send_sigma_s(self) -> float:
        """Return the spread of the delay before the line, s."""
        return _SEND_SIGMA_S if self._baud else float("inf")

    def baud(self) -> int:
        """Return the speed of the host's end."""
        return self._baud

    def set_baud(self, baud: int) -> bool:
        """Change the speed of the host's end."""
        self._check()
        if not self._baud:
            return False
        self._baud = baud
        return True

    def write(self, data: bytes) -> float:
        """Put bytes on the line, after those that are on it."""
        self._check()
        if self.record:
            self.traffic.append((self._t_s, ">", data))
        t_s = self._t_s + (self._random.uniform(0.0, self._send_delay_s) if self._send_delay_s else 0.0)
        t_s = max(t_s, self._sent_until_s)
        for byte in data:
            t_s += self.character_s()
            if self.faults.to_unit_lose:
                self.faults.to_unit_lose -= 1
            else:
                self._to_unit.append((t_s, byte, self._baud))
        self._sent_until_s = t_s
        return self._t_s

    def read(self, until_s: float) -> Chunk:
        """Return received bytes, or let time pass until some arrive."""
        self._check()
        while not self._inbox and self._t_s < until_s:
            self._advance(min(until_s, self._next_s()))
            self._check()
        data = bytes(self._inbox)
        self._inbox.clear()
        if self.record and data:
            self.traffic.append((self._t_s, "<", data))
        return Chunk(data=data, t_s=self._t_s)

    def reopen(self) -> None:
        """Open again."""
        self._inbox.clear()
        if self.gone:
            self._open = False
            raise LineError(self.url, got="no such device", wanted="a line that is there")
        self._open = True
        self.reopened += 1
        if not self.dead:
            self.unit.connect(self._t_s)

    def close(self) -> None:
        """Close the line; bytes on the wire still arrive."""
        self._open = False

    def settle(self, duration_s: float) -> None:
        """Let time pass on a line that may be closed or gone: for the tests' side."""
        self._advance(self._t_s + duration_s)

    def take(self) -> bytes:
        """Return the bytes received until now, for a server that forwards them."""
        data = bytes(self._inbox)
        self._inbox.clear()
        if self.record and data:
            self.traffic.append((self._t_s, "<", data))
        return data

    def put(self, data: bytes, baud: int) -> None:
        """Send at a speed that may have changed: for a server."""
        if self._baud and baud:
            self._baud = baud
        if not self.gone:
            self._open = True
            self.write(data)

    def next_s(self) -> float:
        """Return the time of the next event, s."""
        return self._next_s()

    def _check(self) -> None:
        if self.gone:
            self._open = False
        if not self._open:
            raise LineError(self.url, got="a line that is gone", wanted="a line that is there")

    def _next_s(self) -> float:
        """Return the time of the next event, s; later than now."""
        t_s = self.unit.next_s()
        if self._to_unit:
            t_s = min(t_s, self._to_unit[0][0])
        if self._trickle:
            t_s = min(t_s, self._trickle[0][0] if self.trickle_s else self._t_s)
        if self._batch_s and t_s < float("inf"):
            t_s = (t_s // self._batch_s + 1) * self._batch_s
        if self._actions:
            t_s = min(t_s, self._actions[0].t_s)
        return max(t_s, self._t_s + 1e-9)

    def _advance(self, until_s: float) -> None:
        while self._actions and self._actions[0].t_s <= until_s:
            action = heapq.heappop(self._actions)
            self._move(max(self._t_s, action.t_s))
            action.act()
        self._move(until_s)

    def _move(self, until_s: float) -> None:
        """Carry bytes both ways until then."""
        while self._to_unit and self._to_unit[0][0] <= until_s:
            t_s, byte, baud = self._to_unit.popleft()
            if not (self.dead or self.gone):
                self.unit.receive(t_s, byte, baud)
        for t_s, byte, baud in self.unit.send(until_s):
            if self._trickle or self.trickle_s:
                before_s = self._trickle[-1][0] if self._trickle else t_s
                self._trickle.append((max(t_s, before_s + self.trickle_s), byte, baud))
            elif not (self.dead or self.gone):
                self._take(byte, baud)
        while self._trickle and (self._trickle[0][0] <= until_s or not self.trickle_s):
            _, byte, baud = self._trickle.popleft()
            if not (self.dead or self.gone):
                self._take(byte, baud)
        self._t_s = max(self._t_s, until_s)

    def _take(self, byte: int, baud: int) -> None:
        """Receive one byte, as the faults leave it."""
        f = self.faults
        ends = byte in b"\r\n"
        if f.truncate:
            f.truncate = byte != 0x0A
            return
        if f.merge and ends:
            f.merge -= byte == 0x0A
            return
        if f.skip:
            f.skip -= 1
        elif f.lose:
            f.lose -= 1
            return
        elif f.garble:
            f.garble -= 1
            byte = self._random.randrange(256)
        if baud != self._baud and self._baud:
            byte = self._random.choice((0x00, 0xE0, 0xF8, 0x78, 0x80, 0x1C))
        self._inbox.append(byte)
