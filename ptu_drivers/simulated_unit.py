"""A simulated unit on its serial line: bytes with times in, bytes with times out; no clock, no thread, no I/O."""

import bisect
import heapq
import random
from dataclasses import dataclass, field

from ptu_drivers.simulated_flir import FlirInterpreter, FlirModel
from ptu_drivers.transport import BITS_PER_CHARACTER

_DELIMITERS = b" \r\n"
DEFAULT_BAUD = 9600
_LONGEST = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class LineModel:
    """How a unit's line behaves.

    Attributes
    ----------
    baud : speed at power-up, bit/s; 0 is a network line without character times.
    latency_s : least and most time from a command's delimiter to the first bit of the reply, s.
    commands_per_s : commands that come faster than that are lost (D-series: 10); 0 is no limit.
    banner : sent when the line is opened (TCP), after `banner_s`.
    echo_interrupts : the echo of a byte does not wait for the end of an answer that is being sent.
    leading_lf : a line feed stands before each reply, as seen with echo off over TCP.
    """

    baud: int = DEFAULT_BAUD
    latency_s: tuple[float, float] = (0.002, 0.008)
    commands_per_s: float = 0.0
    banner: str = ""
    banner_s: float = 0.5
    leading_lf: bool = False
    echo_interrupts: bool = False


@dataclass(slots=True)
class _Output:
    """Bytes that wait for their turn on the line."""

    ready_s: float
    order: int
    data: bytes = field(compare=False)
    baud: int = field(compare=False)

    def __lt__(self, other: "_Output") -> bool:
        return (self.ready_s, self.order) < (other.ready_s, other.order)


class SimulatedUnit:
    """A unit and its end of the line. Calls come in order of time.

    Parameters
    ----------
    model, line : what it is. seed : of its latencies.
    """

    def __init__(self, model: FlirModel | None = None, line: LineModel | None = None, seed: int = 0) -> None:
        self.flir = FlirInterpreter(model or FlirModel())
        self.line = line or LineModel()
        self.baud = self.line.baud
        self.lost_commands = 0
        self.late_until_s = 0.0
        self.late_s: list[float] = []
        """Extra delays of the next replies, s: a fault to be set from outside."""
        self.homed_s = 0.0
        """When the last power-cycle's homing ends, s."""
        self._random = random.Random(seed)
        self._off_until_s = 0.0
        self._deaf_until_s = 0.0
        self._busy_until_s = 0.0
        self._last_command_s = float("-inf")
        self._typed = bytearray()
        self._outputs: list[_Output] = []
        self._ready: list[tuple[float, int, int]] = []
        self._order = 0
        self._line_free_s = 0.0

    def character_s(self) -> float:
        """Return the time of one character at the unit's speed, s."""
        return BITS_PER_CHARACTER / self.baud if self.baud else 0.0

    def connect(self, t_s: float) -> None:
        """Somebody opened the line."""
        if self.line.banner:
            self.say(t_s + self.line.banner_s, self.line.banner.encode() + b"\r\n")

    def say(self, t_s: float, data: bytes) -> None:
        """Put bytes on the line that nobody asked for."""
        self._order += 1
        heapq.heappush(self._outputs, _Output(t_s, self._order, data, self.baud))

    def power_cycle(self, t_s: float, off_s: float, *, homing: bool = True) -> None:
        """Lose power, come back with the factory's settings, and home."""
        self._outputs.clear()
        self._ready.clear()
        self._typed.clear()
        for axis in self.flir.axes.values():
            axis.freeze(t_s)
        up_s = t_s + off_s
        self.flir.power_up(up_s)
        self.baud = self.line.baud
        done = up_s
        if homing:
            done = self.flir.home(up_s)
        else:
            for axis in self.flir.axes.values():
                axis.origin = axis.motor(t_s)
        self.homed_s = self._off_until_s = self._deaf_until_s = self._busy_until_s = done
        self._line_free_s = up_s

    def receive(self, t_s: float, byte: int, baud: int) -> None:
        """Take one byte whose last bit came at `t_s`, sent at `baud`."""
        if t_s < max(self._off_until_s, self._deaf_until_s):
            return
        if baud != self.baud and self.baud:
            byte = self._random.choice((0x00, 0xE0, 0xF8, 0x78, 0x80))
        if self.flir.echo and self.line.echo_interrupts:
            bisect.insort(self._ready, (t_s + self.character_s(), byte, self.baud))
        elif self.flir.echo:
            self.say(t_s, bytes((byte,)))
        if byte not in _DELIMITERS:
            if len(self._typed) < _LONGEST:
                self._typed.append(byte)
            return
        command, self._typed = bytes(self._typed), bytearray()
        if command:
            self._obey(command, t_s)

    def _obey(self, command: bytes, t_s: float) -> None:
        begin = max(t_s, self._busy_until_s)
        pace = self.line.commands_per_s
        if pace and begin - self._last_command_s < 1.0 / pace - 1e-9:
            self.lost_commands += 1
            return
        self._last_command_s = begin
        said = self.flir.execute(command.decode("latin-1"), begin)
        ready = max(begin + self._random.uniform(*self.line.latency_s), said.not_before_s)
        if self.late_s:
            ready += self.late_s.pop()
            self.late_until_s = ready
        self._busy_until_s = ready
        self._deaf_until_s = max(self._deaf_until_s, said.deaf_until_s)
        lead = b"\n" if self.line.leading_lf and not self.flir.echo else b""
        self.say(ready, lead + said.text.encode("latin-1") + b"\r\n")
        if said.baud and self.baud:
            # the reply still goes out at the old speed
            self.baud = said.baud

    def send(self, until_s: float) -> list[tuple[float, int, int]]:
        """Return what has left until then: (time of the byte's last bit, byte, baud), in order."""
        while self._outputs and self._outputs[0].ready_s <= until_s:
            out = heapq.heappop(self._outputs)
            t_s = max(out.ready_s, self._line_free_s)
            each = BITS_PER_CHARACTER / out.baud if out.baud else 0.0
            for byte in out.data:
                t_s += each
                self._ready.append((t_s, byte, out.baud))
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
            out = self._outputs[0]
            return max(out.ready_s, self._line_free_s) + (BITS_PER_CHARACTER / out.baud if out.baud else 0.0)
        return float("inf")
