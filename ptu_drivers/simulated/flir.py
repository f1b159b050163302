"""Replies of a simulated FLIR / Directed Perception unit: commands in, texts out, as worded by factory-set units.

The words are those in the D46 and D300 manuals and in clients in use. The replies of `B`, `BT` and
`CNF` are assumed (no source shows them); a driver must not rely on their order.
"""

import re
from dataclasses import dataclass, replace
from typing import Any, Self

from ptu_drivers.simulated.axis import SimulatedAxis

_COMMAND = re.compile(r"([A-Z@_]+)([-+]?\d+)?")
_FOUR = re.compile(r"B([-+]?\d+),([-+]?\d+),(\d+),(\d+)")
_BAUD = re.compile(r"@\((\d+),(\d+),([TF])\)")
_BAUDS = (600, 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlirModel:
    """Properties of the simulated unit.

    Attributes
    ----------
    model, firmware, serial : its texts; without a model and serial it is a D-series, which has no `VM` and `VS`.
    arcsec : arc seconds per position, as reported by `PR` and `TR`.
    pan, tilt : stops, counts.
    rate, max_rate, min_rate : counts/s. acceleration : counts/s².
    play : backlash, counts.
    combined, device_clock : whether it supports `B`, and `BT` with `CNF`.
    homing_s : duration of a reset, s, during which it does not reply.
    """

    model: str = "PTU-D48E"
    firmware: str = "Pan-Tilt Controller v3.2.0(d48-C14/E) simulated"
    serial: str = "SIM001"
    arcsec: float = 23.142857
    pan: tuple[int, int] = (-27067, 27067)
    tilt: tuple[int, int] = (-4666, 13999)
    rate: int = 2000
    max_rate: int = 8000
    min_rate: int = 31
    acceleration: int = 8000
    play: float = 0.0
    combined: bool = True
    device_clock: bool = True
    clock_hz: int = 90_000
    homing_s: float = 15.0

    def replace(self, **changes: Any) -> Self:
        """Return the same with some figures changed."""
        return replace(self, **changes)


D_SERIES = FlirModel(
    model="",
    firmware="Pan-Tilt Controller v2.14.0 (D46) simulated",
    serial="",
    arcsec=92.5714,
    pan=(-3090, 3090),
    tilt=(-907, 604),
    rate=1000,
    max_rate=1985,
    acceleration=2000,
    combined=False,
    device_clock=False,
)
"""A unit of the D series, as its manual's examples have it."""


@dataclass(slots=True, kw_only=True)
class LineEffect:
    """Effect of a command on the line.

    Attributes
    ----------
    text : reply, from `*` or `!` on.
    not_before_s : the reply is delayed until then (await, reset), s.
    deaf_until_s : bytes received before are lost, s.
    baud : speed from after the reply on.
    """

    text: str
    not_before_s: float = 0.0
    deaf_until_s: float = 0.0
    baud: int = 0


class FlirInterpreter:
    """Commands and state of one unit; each command has its time."""

    def __init__(self, model: FlirModel) -> None:
        self.model = model
        self.axes = {
            "P": self._axis(model.pan),
            "T": self._axis(model.tilt),
        }
        self.powered_s = 0.0
        self.power_up(0.0)

    def _axis(self, stops: tuple[int, int]) -> SimulatedAxis:
        m = self.model
        return SimulatedAxis(
            low=stops[0], high=stops[1], rate=m.rate, max_rate=m.max_rate, acceleration=m.acceleration, play=m.play
        )

    def power_up(self, t_s: float) -> None:
        """Take the factory's settings: echo on, verbose, independent control, limits on."""
        self.echo, self.verbose, self.velocity, self.limits = True, True, False, True
        self.slaved = False
        self.waiting: dict[str, int] = {}
        self.powered_s = t_s
        self.wanted_rate = {"P": float(self.model.rate), "T": float(self.model.rate)}
        for axis in self.axes.values():
            axis.rate = self.model.rate

    def home(self, t_s: float) -> float:
        """Run to the stops and back to zero; return when that ends, s."""
        done = t_s + self.model.homing_s
        for axis in self.axes.values():
            axis.move_to(t_s, axis.high, axis.max_rate)
            # the counter is right again when it has been at its stop, and the head stands at zero at the end
            axis.origin = 0.0
            back = max(t_s, done - 2.0 * abs(axis.high) / axis.max_rate - 1.0)
            axis.move_to(back, 0.0, axis.max_rate)
        return max(done, *(axis.end_s() for axis in self.axes.values()))

    def execute(self, command: str, t_s: float) -> LineEffect:
        """Carry out one command, without its delimiter, that was complete at `t_s`."""
        text = command.upper()
        if four := _FOUR.fullmatch(text):
            return self._combined(tuple(int(g) for g in four.groups()), t_s)
        if baud := _BAUD.fullmatch(text):
            return LineEffect(text="*", baud=int(baud[1])) if int(baud[1]) in _BAUDS else self._illegal()
        found = _COMMAND.fullmatch(text)
        if not found:
            return self._illegal()
        name, value = found[1], None if found[2] is None else int(found[2])
        if name[0] in self.axes and len(name) == 2:
            return self._axis_command(name, value, t_s)
        return self._unit_command(name, t_s) if value is None else self._illegal()

    def _illegal(self) -> LineEffect:
        return LineEffect(text="! Illegal Command Entered" if self.verbose else "! Illegal Command")

    def _word(self, verbose: str, terse: object) -> LineEffect:
        return LineEffect(text=f"* {verbose if self.verbose else terse}")

    def _axis_command(self, name: str, value: int | None, t_s: float) -> LineEffect:
        axis, word = self.axes[name[0]], "Pan" if name[0] == "P" else "Tilt"
        what = name[1]
        if value is None:
            return self._axis_query(axis, word, what, t_s)
        if what == "P" and not self.velocity:
            return self._go(axis, word, value, t_s)
        if what == "O" and not self.velocity:
            return self._go(axis, word, round(axis.counter(t_s) + value), t_s)
        if what == "S":
            return self._rate(axis, word, value, t_s)
        if what == "P":
            # accepted, of no effect: pure velocity control overrides positions
            return LineEffect(text="*")
        return self._illegal()

    def _axis_query(self, axis: SimulatedAxis, word: str, what: str, t_s: float) -> LineEffect:
        low, high = round(axis.low - axis.origin), round(axis.high - axis.origin)
        m = self.model
        wanted, arcsec = round(self.wanted_rate[word[0]]), f"{m.arcsec:.6f}".rstrip("0")
        texts: dict[str, tuple[str, object]] = {
            "P": (f"Current {word} position is {(n := axis.counter(t_s))}", n),
            "O": (f"Target {word} position is {round(axis.target)}", round(axis.target)),
            "S": (f"Target {word} speed is {wanted} positions/sec", wanted),
            "D": (f"Current {word} speed is {(v := round(axis.speed(t_s)))} positions/sec", v),
            "R": (f"{arcsec} seconds arc per position", arcsec),
            "N": (f"Minimum {word} position is {low}", low),
            "X": (f"Maximum {word} position is {high}", high),
            "U": (f"Maximum {word} speed is {m.max_rate} positions/sec", m.max_rate),
            "L": (f"Minimum {word} speed is {m.min_rate} positions/sec", m.min_rate),
            "A": (f"{word} acceleration is {m.acceleration} positions/sec^2", m.acceleration),
            "B": (f"Current {word} base speed is {m.min_rate} positions/sec", m.min_rate),
        }
        return self._word(*texts[what]) if what in texts else self._illegal()

    def _go(self, axis: SimulatedAxis, word: str, value: int, t_s: float) -> LineEffect:
        low, high = round(axis.low - axis.origin), round(axis.high - axis.origin)
        if self.limits and value > high:
            return LineEffect(text=f"! Maximum allowable {word} position is {high}")
        if self.limits and value < low:
            return LineEffect(text=f"! Minimum allowable {word} position is {low}")
        if self.slaved:
            self.waiting[word[0]] = value
        else:
            axis.move_to(t_s, value, self.wanted_rate[word[0]])
        return LineEffect(text="*")

    def _release(self, t_s: float) -> None:
        """Start the moves that slaved mode has held back, together."""
        for letter, value in self.waiting.items():
            self.axes[letter].move_to(t_s, value, self.wanted_rate[letter])
        self.waiting.clear()

    def _rate(self, axis: SimulatedAxis, word: str, value: int, t_s: float) -> LineEffect:
        m = self.model
        if abs(value) > m.max_rate:
            return LineEffect(text=f"! {word} speed cannot exceed {m.max_rate} positions/sec")
        if abs(value) < m.min_rate and not (self.velocity and value == 0):
            return LineEffect(text=f"! Motor speed cannot be less than {m.min_rate} pos/sec")
        if value < 0 and not self.velocity:
            return self._illegal()
        self.wanted_rate[word[0]] = value
        if self.velocity:
            axis.move_at(t_s, value)
        elif not self.slaved:
            # on the fly, as the D46 manual has it (4.4.2)
            axis.change_rate(t_s, value)
        return LineEffect(text="*")

    def _combined(self, four: tuple[int, ...], t_s: float) -> LineEffect:
        if not self.model.combined or self.velocity:
            return self._illegal()
        parts = (("P", "S", four[2]), ("T", "S", four[3]), ("P", "P", four[0]), ("T", "P", four[1]))
        for letter, what, value in parts:
            reported = self._axis_command(letter + what, value, t_s)
            if reported.text != "*":
                return reported
        return LineEffect(text="*")

    def _unit_command(self, name: str, t_s: float) -> LineEffect:
        m = self.model
        if name in ("H", "HP", "HT"):
            for letter in "PT" if name == "H" else name[1]:
                self.axes[letter].halt(t_s)
            return LineEffect(text="*")
        if name == "A":
            self._release(t_s)
            end = self._end_s(t_s)
            return LineEffect(text="*", not_before_s=end, deaf_until_s=end)
        if name == "R":
            done = self.home(t_s)
            return LineEffect(text="!T!T!P!P*" if not m.model else "*", not_before_s=done, deaf_until_s=done)
        states = {"EE": "echo", "ED": "echo", "FV": "verbose", "FT": "verbose", "LE": "limits", "LD": "limits"}
        if name in states:
            setattr(self, states[name], name in ("EE", "FV", "LE"))
            return LineEffect(text="*")
        if name in ("CI", "CV"):
            for axis in self.axes.values():
                axis.halt(t_s)
            self.velocity = name == "CV"
            self.wanted_rate = dict.fromkeys(self.axes, 0.0 if self.velocity else float(m.rate))
            return LineEffect(text="*")
        if name in ("I", "S"):
            self.slaved = name == "S"
            self._release(t_s)
            return LineEffect(text="*")
        return self._unit_query(name, t_s)

    def _end_s(self, t_s: float) -> float:
        ends = [axis.end_s() for axis in self.axes.values()]
        return max([t_s, *(e for e in ends if e != float("inf"))])

    def _unit_query(self, name: str, t_s: float) -> LineEffect:
        m = self.model
        mode = "Pure Velocity" if self.velocity else "Independent"
        texts: dict[str, tuple[str, object]] = {
            "E": (f"Echoing {'ON' if self.echo else 'OFF'}", "ON" if self.echo else "OFF"),
            "F": ("ASCII verbose mode", "ASCII terse mode"),
            "L": ("Limit bounds are ENABLED (soft limits enabled)", "ENABLED" if self.limits else "DISABLED"),
            "C": (f"PTU is in {mode} Mode", mode),
            "V": (m.firmware, m.firmware),
            "O": ("Input 30 VDC @ 86 degF", "30.0,86,88,87"),
        }
        if m.model:
            texts["VM"], texts["VS"] = (m.model, m.model), (m.serial, m.serial)
        if m.combined:
            four = self._four(t_s)
            texts["B"] = (four, four)
        if m.device_clock:
            count = round((t_s - self.powered_s) * m.clock_hz) % 2**32
            texts["BT"] = (f"{self._four(t_s)},{count}",) * 2
            texts["CNT"], texts["CNF"] = (str(count),) * 2, (str(m.clock_hz),) * 2
        return self._word(*texts[name]) if name in texts else self._illegal()

    def _four(self, t_s: float) -> str:
        pan, tilt = self.axes["P"], self.axes["T"]
        return f"{pan.counter(t_s)},{tilt.counter(t_s)},{round(pan.speed(t_s))},{round(tilt.speed(t_s))}"
