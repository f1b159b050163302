"""A line to a simulated unit that runs on its own time: years pass in seconds, and each run is the same."""

from collections import deque
from collections.abc import Callable
from typing import Protocol

from ptu_drivers.errors import LineError
from ptu_drivers.transport import BITS_PER_CHARACTER, Chunk


class Peer(Protocol):
    """The far end: a simulated unit."""

    def receive(self, t_s: float, byte: int, baud: int) -> None:
        """Take a byte whose last bit came at `t_s`."""

    def send(self, until_s: float) -> list[tuple[float, int, int]]:
        """Return the bytes that left until then: instant of the last bit, byte, baud."""

    def next_s(self) -> float:
        """Return when the next byte may leave."""

    def connect(self, t_s: float) -> None:
        """Somebody opened the line."""


class VirtualLine:
    """A `Transport` in virtual time.

    Attributes
    ----------
    to_unit, to_host : what the line makes of each byte, (instant, byte) -> bytes: faults, to be set from outside.
    dead : bytes are lost both ways. unplugged : the system says that the line is not there.
    """

    def __init__(self, peer: Peer, baud: int, url: str = "virtual:") -> None:
        self.url = url
        self.peer = peer
        self.dead = False
        self.unplugged = False
        self.to_unit: Callable[[float, int], bytes] = _faithful
        self.to_host: Callable[[float, int], bytes] = _faithful
        self._baud = baud
        self._now_s = 0.0
        self._free_s = 0.0
        self._open = False
        self._under_way: deque[tuple[float, int]] = deque()
        self._arrived = bytearray()

    def now(self) -> float:
        """Return the virtual clock, s."""
        return self._now_s

    def wait(self, duration_s: float) -> None:
        """Let virtual time pass."""
        self._run(self._now_s + max(0.0, duration_s))

    def character_s(self) -> float:
        """Return the time of one character, s."""
        return BITS_PER_CHARACTER / self._baud if self._baud else 0.0

    def baud(self) -> int:
        """Return the speed of our end, bit/s."""
        return self._baud

    def set_baud(self, baud: int) -> bool:
        """Change the speed of our end."""
        self._baud = baud
        return True

    def write(self, data: bytes) -> float:
        """Hand all bytes over; they take their time on the line."""
        self._insist()
        self._free_s = max(self._free_s, self._now_s)
        for byte in data:
            self._free_s += self.character_s()
            self._under_way.append((self._free_s, byte))
        return self._now_s

    def read(self, until_s: float) -> Chunk:
        """Wait for bytes."""
        self._insist()
        self._run(self._now_s)
        while not self._arrived:
            following_s = self._following_s()
            if following_s > until_s:
                self._run(max(until_s, self._now_s))
                break
            self._run(following_s)
            self._insist()
        data = bytes(self._arrived)
        self._arrived.clear()
        return Chunk(data=data, t_s=self._now_s)

    def reopen(self) -> None:
        """Open, after closing."""
        self.close()
        if self.unplugged:
            raise LineError(self.url, got="no such device", wanted="a line that is there")
        self._open = True
        self.peer.connect(self._now_s)

    def close(self) -> None:
        """Let go of the line; bytes already handed over still leave."""
        self._open = False
        self._arrived.clear()

    def _insist(self) -> None:
        if self.unplugged or not self._open:
            raise LineError(self.url, got="an unplugged or closed line", wanted="a line that is there")

    def _following_s(self) -> float:
        leaving_s = self._under_way[0][0] if self._under_way else float("inf")
        return min(leaving_s, self.peer.next_s())

    def _run(self, until_s: float) -> None:
        """Let everything happen until then, in order."""
        while (at_s := self._following_s()) <= until_s:
            self._now_s = max(self._now_s, at_s)
            if self._under_way and self._under_way[0][0] <= at_s:
                t_s, byte = self._under_way.popleft()
                for changed in b"" if self.dead or self.unplugged else self.to_unit(t_s, byte):
                    self.peer.receive(t_s, changed, self._baud)
            for t_s, byte, _ in self.peer.send(at_s):
                for changed in b"" if self.dead or self.unplugged else self.to_host(t_s, byte):
                    self._arrived.append(changed)
        self._now_s = max(self._now_s, until_s)


def _faithful(t_s: float, byte: int) -> bytes:
    return bytes((byte,))
