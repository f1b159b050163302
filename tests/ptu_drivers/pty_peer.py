"""A simulated unit behind a pseudo terminal, in real time: for clients that know nothing of us."""

import os
import pty
import select
import threading
import time
import tty
from collections import deque
from types import TracebackType
from typing import Protocol, Self

from ptu_drivers.transport import BITS_PER_CHARACTER


class _Unit(Protocol):
    baud: int

    def receive(self, t_s: float, byte: int, baud: int) -> None: ...

    def send(self, until_s: float) -> list[tuple[float, int, int]]: ...

    def next_s(self) -> float: ...


class PtyPeer:
    """Serves a unit at `path` until left; `traffic` has what went by: ("<" from the unit or ">" to it, bytes)."""

    def __init__(self, unit: _Unit) -> None:
        self.unit = unit
        self.traffic: list[tuple[str, bytes]] = []
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._arriving: deque[tuple[float, int]] = deque()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def transcript(self) -> str:
        """Return what went by, one line for each turn: > to the unit, < from it."""
        turns: list[tuple[str, bytes]] = []
        for way, data in self.traffic:
            if turns and turns[-1][0] == way:
                turns[-1] = (way, turns[-1][1] + data)
            else:
                turns.append((way, data))
        return "\n".join(f"{way} {data.hex(' ').upper()}" for way, data in turns)

    def _serve(self) -> None:
        while not self._stop.is_set():
            due_s = min(self.unit.next_s(), self._arriving[0][0] if self._arriving else float("inf"))
            wait_s = min(0.01, max(0.0, due_s - time.monotonic()))
            if select.select([self._master], [], [], wait_s)[0]:
                data = os.read(self._master, 256)
                self.traffic.append((">", data))
                # a pseudo terminal hands everything over at once; on a line each byte takes its time
                at_s = max(time.monotonic(), self._arriving[-1][0] if self._arriving else 0.0)
                for i, byte in enumerate(data, start=1):
                    self._arriving.append((at_s + i * BITS_PER_CHARACTER / self.unit.baud, byte))
            while self._arriving and self._arriving[0][0] <= time.monotonic():
                self.unit.receive(*self._arriving.popleft(), self.unit.baud)
            sent = bytes(byte for _, byte, _ in self.unit.send(time.monotonic()))
            if sent:
                self.traffic.append(("<", sent))
                os.write(self._master, sent)
