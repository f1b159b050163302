"""Faults of real lines, by name, applied to a simulated one at an instant."""

import random
from collections.abc import Callable, Mapping
from types import MappingProxyType

from ptu_drivers.errors import ProtocolError
from ptu_drivers.simulated.flir_line import SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

Fault = Callable[[VirtualLine, random.Random], float]
"""Does it now; returns how long it lasts, s: after that the line and the unit are well again."""


def _flir(line: VirtualLine) -> SimulatedUnit:
    if not isinstance(line.unit, SimulatedUnit):
        raise ProtocolError("fault", got=type(line.unit).__name__, wanted="a simulated FLIR unit")
    return line.unit


def _banner(line: VirtualLine, rnd: random.Random) -> float:
    text = rnd.choice((b"\r\nPTU PAN-TILT Controller * ready\r\n", b"### FLIR Motion PAN-TILT v3.2 " * 4 + b"\r\n"))
    line.unit.say(line.now(), text)
    return 0.1


def _limit_message(line: VirtualLine, rnd: random.Random) -> float:
    line.unit.say(line.now(), rnd.choice((b"!P", b"!T", b"!T!T!P", b"!P\r\n")))
    return 0.0


def _stale_answer(line: VirtualLine, rnd: random.Random) -> float:
    """Send a reply to an old query, in any case of letters, or a set command's acknowledgement."""
    axis = rnd.choice("PT")
    echo = "".join(rnd.choice((c.lower(), c)) for c in axis + "P")
    counts = _flir(line).flir.axes[axis].counter(line.now() - rnd.uniform(0.3, 2.0)) + rnd.randrange(-300, 300)
    text = rnd.choice((f"{echo} * {counts}", f"* {counts}", f"{echo}{counts} *", f"{echo} * Current Pan position is 5"))
    line.unit.say(line.now(), text.encode() + b"\r\n")
    return 0.1


def _late_answer(line: VirtualLine, rnd: random.Random) -> float:
    delay = rnd.uniform(0.1, 1.2)
    line.unit.late_s.append(delay)
    return delay


def _lost_byte(line: VirtualLine, rnd: random.Random) -> float:
    line.faults.skip, line.faults.lose = rnd.randrange(24), rnd.choice((1, 1, 1, 2, 4))
    return 0.1


def _lost_command_byte(line: VirtualLine, rnd: random.Random) -> float:
    line.faults.to_unit_lose = rnd.choice((1, 1, 2))
    return 0.1


def _garbage(line: VirtualLine, rnd: random.Random) -> float:
    line.faults.skip, line.faults.garble = rnd.randrange(24), rnd.choice((1, 2, 5, 20))
    return 0.2


def _noise(line: VirtualLine, rnd: random.Random) -> float:
    line.unit.say(line.now(), rnd.randbytes(rnd.randrange(1, 30)))
    return 0.1


def _truncated(line: VirtualLine, rnd: random.Random) -> float:
    line.at(line.now() + rnd.uniform(0.0, 0.03), lambda: setattr(line.faults, "truncate", True))
    return 0.1


def _merged(line: VirtualLine, rnd: random.Random) -> float:
    line.faults.merge = rnd.choice((1, 1, 2))
    return 0.1


def _echo_off(line: VirtualLine, _rnd: random.Random) -> float:
    line.unit.echo = False
    return 0.0


def _verbose(line: VirtualLine, _rnd: random.Random) -> float:
    _flir(line).flir.verbose = True
    return 0.0


def _wrong_baud(line: VirtualLine, rnd: random.Random) -> float:
    """Garble all for a while: the unit's end is at another speed."""
    if not line.unit.baud:
        return 0.0
    right, duration = line.unit.baud, rnd.uniform(0.1, 1.0)
    line.unit.baud = 19200

    def back() -> None:
        if line.unit.baud == 19200:
            line.unit.baud = right

    line.at(line.now() + duration, back)
    return duration


def _half_open(line: VirtualLine, rnd: random.Random) -> float:
    duration = rnd.choice((rnd.uniform(0.05, 0.5), rnd.uniform(0.5, 4.0)))
    line.dead = True
    line.at(line.now() + duration, lambda: setattr(line, "dead", False))
    return duration


def _unplugged(line: VirtualLine, rnd: random.Random) -> float:
    duration = rnd.uniform(0.1, 4.0)
    line.gone = True
    line.at(line.now() + duration, lambda: setattr(line, "gone", False))
    return duration


def _power_cycle(line: VirtualLine, rnd: random.Random) -> float:
    """Lose power, boot and home, deaf for up to 40 s, with the factory's settings afterwards."""
    unit = _flir(line)
    unit.power_cycle(line.now(), rnd.uniform(0.2, 3.0))
    return unit.homed_s - line.now()


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "banner": _banner,
        "limit message": _limit_message,
        "stale answer": _stale_answer,
        "late answer": _late_answer,
        "lost byte": _lost_byte,
        "lost command byte": _lost_command_byte,
        "garbage": _garbage,
        "noise": _noise,
        "truncated": _truncated,
        "merged": _merged,
        "echo off": _echo_off,
        "verbose": _verbose,
        "wrong baud": _wrong_baud,
        "half open": _half_open,
        "unplugged": _unplugged,
        "power cycle": _power_cycle,
    }
)
