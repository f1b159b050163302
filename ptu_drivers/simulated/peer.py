"""The far end of a simulated serial line, of any protocol: bytes with times in and out; no clock, no I/O."""

import heapq
import random
from abc import ABC, abstractmethod

from ptu_drivers.transport import BITS_PER_CHARACTER


class SimulatedPeer(ABC):
    """Bytes that arrive one by one, and bytes that wait for their turn on the line. Calls are in order of time.

    Parameters
    ----------
    baud : speed, bit/s; 0 is a line without character times.
    latency_s : least and most time from the end of a command to the first bit of its reply, s.
    echo : each received byte is echoed, as on two wires.
    seed : of the latencies.
    """

    def __init__(
        self, *, baud: int, latency_s: tuple[float, float] = (0.002, 0.008), echo: bool = False, seed: int = 0
    ) -> None:
        self.baud = baud
        self.latency_s = latency_s
        self.echo = echo
        self.late_s: list[float] = []
        """Extra delays of the next answers, s: a fault to be set from outside."""
        self.late_until_s = 0.0
        """When the last answer that was late began, s."""
        self._power_up_baud = baud
        self._random = random.Random(seed)
        self._off_until_s = float("-inf")
        self._busy_until_s = float("-inf")
        self._outputs: list[tuple[float, int, bytes, int]] = []
        self._ready: list[tuple[float, int, int]] = []
        self._order = 0
        self._line_free_s = float("-inf")

    @abstractmethod
    def _take(self, t_s: float, byte: int) -> None:
        """Take one byte that arrived whole."""

    @abstractmethod
    def _lose_power(self, t_s: float, off_s: float, *, homing: bool) -> float:
        """Reset the volatile state, and return until when nothing is received, s."""

    def character_s(self) -> float:
        """Return the time of one character, s."""
        return _character_s(self.baud)

    def connect(self, t_s: float) -> None:  # noqa: B027 - most units have nothing to say to that
        """Handle the opening of the line."""

    def say(self, t_s: float, data: bytes) -> None:
        """Put bytes on the line, at the speed of now."""
        self._order += 1
        heapq.heappush(self._outputs, (t_s, self._order, data, self.baud))

    def power_cycle(self, t_s: float, off_s: float, *, homing: bool = True) -> None:
        """Lose power, and come back."""
        self._outputs.clear()
        self._ready.clear()
        self.baud = self._power_up_baud
        self._off_until_s = self._busy_until_s = self._lose_power(t_s, off_s, homing=homing)
        self._line_free_s = t_s + off_s

    def receive(self, t_s: float, byte: int, baud: int) -> None:
        """Receive one byte whose last bit arrived at `t_s`, sent at `baud`."""
        if t_s < self._off_until_s:
            return
        if self.baud and baud != self.baud:
            byte = self._random.choice((0x00, 0xE0, 0xF8, 0x78, 0x80))
        if self.echo:
            self._send_back(t_s, byte)
        self._take(t_s, byte)

    def _send_back(self, t_s: float, byte: int) -> None:
        self.say(t_s, bytes((byte,)))

    def _answer(self, t_s: float, data: bytes, not_before_s: float = 0.0) -> float:
        """Send a reply to a message complete at `t_s`; returns when it begins, s. A late one delays the next."""
        ready_s = max(max(t_s, self._busy_until_s) + self._random.uniform(*self.latency_s), not_before_s)
        if self.late_s:
            ready_s += self.late_s.pop()
            self.late_until_s = ready_s
        self._busy_until_s = ready_s
        self.say(ready_s, data)
        return ready_s

    def send(self, until_s: float) -> list[tuple[float, int, int]]:
        """Return the bytes sent until then: (time of the byte's last bit, byte, baud), in order."""
        while self._outputs and self._outputs[0][0] <= until_s:
            ready_s, _, data, baud = heapq.heappop(self._outputs)
            t_s = max(ready_s, self._line_free_s)
            for byte in data:
                t_s += _character_s(baud)
                self._ready.append((t_s, byte, baud))
            self._line_free_s = t_s
        done = 0
        while done < len(self._ready) and self._ready[done][0] <= until_s:
            done += 1
        sent, self._ready = self._ready[:done], self._ready[done:]
        return sent

    def next_s(self) -> float:
        """Return when the next byte may leave, s; infinite when none is under way."""
        if self._ready:
            return self._ready[0][0]
        if self._outputs:
            ready_s, _, _, baud = self._outputs[0]
            return max(ready_s, self._line_free_s) + _character_s(baud)
        return float("inf")


def _character_s(baud: int) -> float:
    return BITS_PER_CHARACTER / baud if baud else 0.0
