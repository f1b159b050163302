"""Scheduled faults of simulated devices: frames of a camera, serial line of a PTU."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from ptu_drivers.simulated.faults import FAULTS
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer

CAMERA_LOST, CAMERA_FROZEN, PTU_SILENT = "camera lost", "camera frozen", "PTU silent"
CAMERA_LATE, CAMERA_CLOCK_STEPPED = "camera late", "camera clock stepped"
_ONCE = ("power cycle", "unplugged", "echo off", "verbose")
_AGAIN_S = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedFault:
    """``what`` happens to a station's devices between two times of the flight, s.

    Of cameras "camera lost", "camera frozen", "camera late" and "camera clock stepped"; of PTUs "PTU silent", or a
    name of `ptu_drivers.simulated.faults`, which occurs repeatedly (once if it has its own duration). ``by_s``
    is how late a late camera's pictures are, and how far a clock steps.
    """

    what: str
    station: str
    from_s: float
    to_s: float
    by_s: float = 0.2


def is_there(faults: Sequence[TimedFault], what: str, station: str, since_s: float) -> bool:
    """Return whether a fault is there, so long after the flight began."""
    return any(f.what == what and f.station == station and f.from_s <= since_s < f.to_s for f in faults)


def size_s(faults: Sequence[TimedFault], what: str, station: str, since_s: float) -> float:
    """Return how large the faults of a kind are together, s, so long after the flight began; 0 where none is there."""
    return sum(f.by_s for f in faults if is_there((f,), what, station, since_s))


def strike(server: SimulatedServer, faults: Sequence[TimedFault], station: str, start_s: float, seed: int) -> None:
    """Put a station's PTU faults in line, for a flight that begins at ``start_s`` of the server's clock."""
    line, rnd = server.line, random.Random(seed)
    with server.lock:
        for fault in (f for f in faults if f.station == station):
            if fault.what == PTU_SILENT:
                line.at(start_s + fault.from_s, lambda: setattr(line, "dead", True))
                if math.isfinite(fault.to_s):
                    line.at(start_s + fault.to_s, lambda: setattr(line, "dead", False))
            elif fault.what in FAULTS:
                for since_s in struck_at(fault):
                    line.at(start_s + since_s, partial(_do, fault.what, line, rnd))


def struck_at(fault: TimedFault) -> tuple[float, ...]:
    """Return when a PTU's fault strikes, s of the flight."""
    times = 1 if fault.what in _ONCE else max(1, int((fault.to_s - fault.from_s) / _AGAIN_S))
    return tuple(fault.from_s + k * _AGAIN_S for k in range(times))


def _do(what: str, line: VirtualLine, rnd: random.Random) -> None:
    FAULTS[what](line, rnd)
