"""The reference receiver in a thread of its own: sentences in, positions into the input queue and into a table.

A line that is gone is opened again and again. That positions stop, and that they come again, is reported once each.
"""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Protocol

from groundstation.errors import GroundstationError, LogError
from groundstation.live.head_worker import ItemSink
from groundstation.live.input_queue import DeviceLogLine
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.reference_fixes import ReferenceConverter
from groundstation.live.reference_line import ReceiverLine, open_reference_line
from groundstation.live.status_board import GONE_S, ReferenceState
from groundstation.messages import DgpsFix
from groundstation.session.logs.fixes import LogFix, LogOptions
from groundstation.session.logs.nmea_stream import NmeaStream
from groundstation.tracking.log_throttle import LogThrottle

# so long after the last byte nothing more of the same moment comes
_QUIET_S = 0.04
_AGAIN_S = 1.0
# a sender that is not allowed is reported so often
_REFUSED_EVERY_S = 10.0
# a line that hangs while it is opened is left behind after so long
_END_S = 0.3


class FixTable(Protocol):
    """Takes each position of the antenna."""

    def write(self, fix: DgpsFix) -> None:
        """Take one; never raises."""


class ReferenceWorker:
    """Listens to one receiver.

    Parameters
    ----------
    converter : converts a position to the runway frame and to the session's clock.
    input_queue : takes the positions for the filter, if it is to learn, and messages.
    table : takes all of them, None for nowhere.
    start_s : the session's time zero on ``clock``.
    clock, utc : the host's, monotonic and Unix time.
    connect : opens the line.
    """

    def __init__(
        self,
        device: ReferenceDevice,
        converter: ReferenceConverter,
        input_queue: ItemSink,
        table: FixTable | None,
        *,
        start_s: float,
        clock: Callable[[], float] = time.monotonic,
        utc: Callable[[], float] = time.time,
        connect: Callable[[ReferenceDevice], ReceiverLine] = open_reference_line,
    ) -> None:
        self.fixes = 0
        self.refused: Counter[str] = Counter()
        self.quality = ""
        self.newest_s = -math.inf
        self._device, self._converter, self._input_queue, self._table = device, converter, input_queue, table
        self._start_s, self._clock, self._utc, self._connect = start_s, clock, utc, connect
        self._stream = NmeaStream("DGPS", LogOptions(geoid_separation_m=device.geoid_separation_m))
        self._stop = threading.Event()
        self._trouble = ""
        self._strangers = 0
        self._throttle = LogThrottle(lambda _, text: self._log("warning", text), _REFUSED_EVERY_S)
        self._gone = False
        self._listening_since_s = self._now_s()
        self._adopted = 0
        self._thread = threading.Thread(target=self._work, name="dgps", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=_END_S)

    def state(self, now_s: float, rate_hz: float, contradicted: int = 0) -> ReferenceState:
        """Return how it does at session time ``now_s``; so many positions were ``contradicted`` by the track."""
        refused = ", ".join(f"{n} {why}" for why, n in self.refused.items() if n)
        if contradicted:
            refused = ", ".join(part for part in (refused, f"{contradicted} refused by the filter") if part)
        strangers = f"{self._strangers} datagrams of others refused" if self._strangers else ""
        note = ", ".join(
            part for part in (self.quality, refused, strangers, "" if self._device.learn else "not learnt") if part
        )
        age_s = now_s - self.newest_s
        return ReferenceState(
            name="DGPS",
            rate_hz=rate_hz,
            age_s=age_s,
            note=note,
            trouble=bool(refused or strangers),
            fixes=self.fixes,
            newest_s=self.newest_s,
        )

    # ------------------------------------------------------------------------------------ the thread
    def _now_s(self) -> float:
        return self._clock() - self._start_s

    def _work(self) -> None:
        while not self._stop.is_set():
            line = None
            try:
                line = self._connect(self._device)
                self._listen(line)
            except GroundstationError as fault:
                self._say_trouble(str(fault))
            except Exception as fault:  # noqa: BLE001 - the station goes on without a reference
                self._say_trouble(f"{type(fault).__name__}: {fault}")
            finally:
                if line is not None:
                    line.close()
            self._watch()
            self._stop.wait(_AGAIN_S)

    def _listen(self, line: ReceiverLine) -> None:
        while not self._stop.is_set():
            before = line.refused
            data = line.read(_QUIET_S)
            self._count_refused(line, line.refused - before)
            try:
                found = self._stream.feed(data, self._utc()) if data else self._stream.quiet(self._utc())
            except LogError as fault:
                self._say_trouble(str(fault))
                continue
            for fix in found:
                self._take(fix)
            self._watch()

    def _count_refused(self, line: ReceiverLine, more: int) -> None:
        """Count datagrams of senders that are not allowed, and say now and then that there are some."""
        self._throttle.pass_time(self._now_s())
        if more:
            self._strangers += more
            self._throttle.take(self._now_s(), f"{line.refused_sender} is not among its senders: datagrams refused")

    def _take(self, fix: LogFix) -> None:
        arrived_s = self._now_s()
        placed = self._converter.convert(fix, arrived_s)
        if self._converter.clock.adopted != self._adopted:
            self._adopted = self._converter.clock.adopted
            offset_s = self._converter.clock.offset_s
            text = f"its clock is {offset_s:+.1f} s off this machine's; taken from when its positions come"
            text = (
                f"{text}: set one of them, or clock_offset_s"
                if offset_s
                else "its clock has stepped, and is right again"
            )
            self._log("warning", text)
        if placed.antenna is not None and self._table is not None:
            self._table.write(placed.antenna)
        if placed.refusal is not None:
            self.refused[placed.refusal.value] += 1
        if placed.nose is None:
            return
        self.fixes += 1
        self.newest_s = arrived_s
        self.quality = fix.quality.value
        self._trouble = ""
        if self._gone:
            self._gone = False
            self._log("info", "there again")
        if self._device.learn:
            self._input_queue.put(placed.nose)

    def _watch(self) -> None:
        """Say it once if no position has come for long."""
        since_s = max(self.newest_s, self._listening_since_s)
        if not self._gone and self._now_s() - since_s > GONE_S:
            self._gone = True
            self._log("warning", f"gone: no position that can be used since {since_s:.1f} s")

    def _say_trouble(self, text: str) -> None:
        if text != self._trouble:
            self._trouble = text
            self._log("warning", f"{text}; it is tried again")

    def _log(self, level: str, text: str) -> None:
        self._input_queue.put(DeviceLogLine(t_s=self._now_s(), level=level, text=f"DGPS: {text}"))
