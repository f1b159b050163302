"""A simulated FLIR unit on its serial line: bytes with times in, bytes with times out; no clock, no thread, no I/O."""

import bisect
from dataclasses import dataclass

from ptu_drivers.simulated.flir import FlirInterpreter, FlirModel
from ptu_drivers.simulated.peer import SimulatedPeer

_DELIMITERS = b" \r\n"
DEFAULT_BAUD = 9600
_LONGEST = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class LineModel:
    """Behaviour of a unit's line.

    Attributes
    ----------
    baud : speed at power-up, bit/s; 0 is a network line without character times.
    latency_s : least and most time from a command's delimiter to the first bit of the reply, s.
    commands_per_s : commands faster than that are lost (D-series: 10); 0 is no limit.
    banner : sent when the line is opened (TCP), after `banner_s`.
    echo_interrupts : the echo of a byte does not wait for the end of a reply that is being sent.
    leading_lf : a line feed precedes each reply, as observed with echo off over TCP.
    """

    baud: int = DEFAULT_BAUD
    latency_s: tuple[float, float] = (0.002, 0.008)
    commands_per_s: float = 0.0
    banner: str = ""
    banner_s: float = 0.5
    leading_lf: bool = False
    echo_interrupts: bool = False


class SimulatedUnit(SimulatedPeer):
    """A FLIR unit and its end of the line.

    Parameters
    ----------
    model, line : its properties. seed : of its latencies.
    """

    def __init__(self, model: FlirModel | None = None, line: LineModel | None = None, seed: int = 0) -> None:
        self.flir = FlirInterpreter(model or FlirModel())
        self.line = line or LineModel()
        super().__init__(baud=self.line.baud, latency_s=self.line.latency_s, echo=self.flir.echo, seed=seed)
        self.lost_commands = 0
        self.homed_s = 0.0
        """When the last power-cycle's homing ends, s."""
        self._last_command_s = float("-inf")
        self._typed = bytearray()

    @property
    def echo(self) -> bool:
        """Return whether received bytes are echoed: the unit's own setting."""
        return self.flir.echo

    @echo.setter
    def echo(self, echo: bool) -> None:
        self.flir.echo = echo

    def connect(self, t_s: float) -> None:
        """Handle the opening of the line."""
        if self.line.banner:
            self.say(t_s + self.line.banner_s, self.line.banner.encode() + b"\r\n")

    def _lose_power(self, t_s: float, off_s: float, *, homing: bool) -> float:
        """Come back with the factory's settings, and home."""
        self._typed.clear()
        for axis in self.flir.axes.values():
            axis.freeze(t_s)
        up_s = t_s + off_s
        self.flir.power_up(up_s)
        self.homed_s = up_s
        if homing:
            self.homed_s = self.flir.home(up_s)
        else:
            for axis in self.flir.axes.values():
                axis.origin = axis.motor(t_s)
        return self.homed_s

    def _send_back(self, t_s: float, byte: int) -> None:
        if self.line.echo_interrupts:
            bisect.insort(self._ready, (t_s + self.character_s(), byte, self.baud))
        else:
            super()._send_back(t_s, byte)

    def _take(self, t_s: float, byte: int) -> None:
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
        reported = self.flir.execute(command.decode("latin-1"), begin)
        self._off_until_s = max(self._off_until_s, reported.deaf_until_s)
        lead = b"\n" if self.line.leading_lf and not self.flir.echo else b""
        self._answer(begin, lead + reported.text.encode("latin-1") + b"\r\n", reported.not_before_s)
        if reported.baud and self.baud:
            # the reply is still sent at the old speed
            self.baud = reported.baud
