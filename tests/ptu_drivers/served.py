"""A simulated unit on a pseudo terminal, in real time: for clients that know nothing of us."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.peer import SimulatedPeer
from ptu_drivers.simulated.server import SimulatedServer


@contextmanager
def served(unit: SimulatedPeer, path: Path) -> Iterator[VirtualLine]:
    """Serve a unit at `path`; gives its line, which keeps what went by."""
    line = VirtualLine(unit, unit.baud, start_s=time.monotonic())
    line.record = True
    with SimulatedServer(line, path):
        yield line


def transcript(line: VirtualLine) -> str:
    """Return what went by, one line for each turn: > to the unit, < from it."""
    turns: list[tuple[str, bytes]] = []
    for _, way, data in line.traffic:
        if turns and turns[-1][0] == way:
            turns[-1] = (way, turns[-1][1] + data)
        else:
            turns.append((way, data))
    return "\n".join(f"{way} {data.hex(' ').upper()}" for way, data in turns)
