"""ptu.csv as a stream of readings in session time, corrected by ``ptu_axes`` of the rig."""

import heapq
import math
from collections.abc import Iterator, Sequence

import numpy as np

from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.messages import PtuSample
from groundstation.rig.ptu_axes import AxisCorrection
from groundstation.session import Session
from groundstation.session.folder import ptu_table
from groundstation.session.time_units import picture_unit_hint, spacing_hint, unit_hint
from groundstation.sources.reading_gaps import ReadingGaps, gap_notes
from groundstation.sources.row_times import RowTimes

# no head turns further; thousandths of degrees and encoder counts are beyond it
_MOST_DEG = 3600.0
# one row has the readings of all stations, so their clocks differ by latencies
_CLOCKS_APART_S = 3600.0


class PtuReadings:
    """Streams ptu.csv in order of session time; a rig of fixed stations has no readings and needs no file.

    The readings are converted to angles: the only place where a replay applies ``ptu_axes`` of rig.toml.

    ``fault`` is the fault that ended the stream early, if any; ``newest_s`` the time of the last reading yielded.
    Raises `SessionError` on opening if the file or a column is missing.
    """

    def __init__(self, session: Session) -> None:
        self.fault: SessionError | None = None
        self.newest_s = -np.inf
        self._clocks = {s.name: session.ptu_clock(s) for s in session.rig.stations if not s.fixed}
        self._axes = {s.name: session.reading_axes(s) for s in session.rig.stations if not s.fixed}
        self._table = ptu_table(session)
        self._file = "" if self._table is None else self._table.path.name
        self._stream: Iterator[PtuSample] = iter(())
        self._next: PtuSample | None = None
        self._read_s = (np.inf, -np.inf)
        self._closest_s = np.inf
        self._gaps: dict[str, ReadingGaps] = {name: ReadingGaps() for name in self._clocks}

    def notes(self, span_s: tuple[float, float], most_apart_s: float) -> list[str]:
        """Return notes on stretches of a span without a reading among those handed out, longer than ``most_apart_s``.

        A fault that ended the stream speaks for what follows it.
        """
        to_s = span_s[1] if self.fault is None else min(span_s[1], self.newest_s)
        return gap_notes(self._gaps, self._file, (span_s[0], to_s), most_apart_s)

    def unit_fault(self) -> str:
        """Return what the spacing of the rows that were read says of the unit of their times; "" where nothing."""
        hint = spacing_hint(self._closest_s)
        return f"{self._file}: readings {hint}: wanted seconds" if hint else ""

    def start(self, from_s: float, to_s: float) -> None:
        """Seek the first reading at or after ``from_s``.

        Raises `SessionError` if there is none by ``to_s``: no frame would have an angle.
        """
        if self._table is None:
            return
        self._stream = self._readings(self._table, from_s)
        self._next = next(self._stream, None)
        if self._next is None or self._next.t_s > to_s:
            if self.fault is not None:
                raise self.fault
            first, last = self._read_s
            got = "no reading"
            if first <= last:
                got = f"readings from {first:.13g} to {last:.13g} s{picture_unit_hint(self._read_s, from_s, to_s)}"
            if self._next is not None:
                got = f"a first reading at {first:.13g} s{self._unit_hint(first, to_s)}"
                if self.fault is not None:
                    # times that go backwards
                    raise self.fault
            wanted = f"readings around the frames, {from_s:.13g} to {to_s:.13g} s of the session's clock"
            raise SessionError(self._table.path.name, got=got, wanted=wanted)

    def _unit_hint(self, first_s: float, to_s: float) -> str:
        """Return what the times would be in if they are not in seconds; nothing where they do not look so."""
        later = next((sample.t_s for sample in self._stream if sample.t_s > first_s), first_s)
        # the table may begin long before the part that is replayed
        return unit_hint(first_s, later, 0.0, to_s)

    def until(self, t_s: float) -> Iterator[PtuSample]:
        """Yield all readings not handed out yet, up to session time ``t_s``."""
        while self._next is not None and self._next.t_s <= t_s:
            self.newest_s = self._next.t_s
            self._gaps[self._next.station].add(self._next.t_s)
            yield self._next
            self._next = next(self._stream, None)

    def ended_before(self, t_s: float) -> bool:
        """Return whether a fault has ended the stream and all before it has been handed out, earlier than ``t_s``."""
        return self.fault is not None and self._next is None and self.newest_s < t_s

    def _require_one_time(self, table: CsvTable, line: int, row: Sequence[PtuSample]) -> None:
        """Raise `SessionError` if the stations' clocks spread the readings of a row."""
        if len(row) < 2:
            return
        first, *_, last = sorted(row, key=lambda sample: sample.t_s)
        if last.t_s - first.t_s > _CLOCKS_APART_S:
            got = f"{first.station} at {first.t_s:.13g} s and {last.station} at {last.t_s:.13g} s by their ptu_clock"
            raise table.fault(line, got=got, wanted=f"at most {_CLOCKS_APART_S:g} s between them")

    def _readings(self, table: CsvTable, from_s: float) -> Iterator[PtuSample]:
        waiting: list[tuple[float, int, PtuSample]] = []
        cells = {name: (f"{name}_pan_deg", f"{name}_tilt_deg", AxisCorrection(a)) for name, a in self._axes.items()}
        number = 0
        last_s = math.nan
        try:
            for row, row_s in _ordered_rows(table):
                # the first row has none before it
                self._closest_s = min(self._closest_s, row_s - last_s)
                last_s = row_s
                times = {name: clock.session_from_device(row_s) for name, clock in self._clocks.items()}
                # stations' clocks may differ; no reading of a later row can be earlier than the earliest of this one
                settled = min(times.values())
                self._read_s = (min(self._read_s[0], settled), max(self._read_s[1], *times.values()))
                # the whole row first: of a row at fault nothing is used
                samples = [_reading(table, row, name, t_s, *cells[name]) for name, t_s in times.items()]
                self._require_one_time(table, row.line, [sample for sample in samples if sample is not None])
                for sample in samples:
                    if sample is not None and sample.t_s >= from_s:
                        number += 1
                        heapq.heappush(waiting, (sample.t_s, number, sample))
                while waiting and waiting[0][0] <= settled:
                    yield heapq.heappop(waiting)[2]
        except SessionError as fault:
            self.fault = fault
        while waiting:
            yield heapq.heappop(waiting)[2]


def _ordered_rows(table: CsvTable) -> Iterator[tuple[Row, float]]:
    """Yield rows with their times, each once the next one is known to be later.

    Raises `SessionError` for a time that is not later than that of the row before, which is not yielded where it is the
    one out of order: readings would wait for its time, and the next row would never be read.
    """
    times = RowTimes()
    held: tuple[Row, float] | None = None
    fault: SessionError | None = None
    try:
        for row in table:
            t_s = table.number(row, "t_s")
            if times.is_ahead_of(t_s):
                held = None
            table.check_later(row, "t_s", t_s, times.newest_s)
            times.add(t_s)
            if held is not None:
                yield held
            held = row, t_s
    except SessionError as error:
        fault = error
    if held is not None:
        yield held
    if fault is not None:
        raise fault


def _reading(
    table: CsvTable, row: Row, name: str, t_s: float, pan_cell: str, tilt_cell: str, correction: AxisCorrection
) -> PtuSample | None:
    """Return one station's angles, or None where its cells are empty."""
    pan = table.optional_number(row, pan_cell)
    tilt = table.optional_number(row, tilt_cell)
    if pan is None and tilt is None:
        return None
    if pan is None or tilt is None:
        raise table.fault(row.line, got=f"only one of {name}'s two angles", wanted="pan and tilt, or neither")
    largest = max(pan, tilt, key=abs)
    if abs(largest) > _MOST_DEG:
        got = f"{name} at {largest:g} deg{_unit_words(pan, tilt)}"
        raise table.fault(row.line, got=got, wanted=f"angles in degrees, at most {_MOST_DEG:g} in size: ten turns")
    pan_rad, tilt_rad = correction.angles(math.radians(pan), math.radians(tilt))
    return PtuSample(t_s=t_s, station=name, pan_rad=pan_rad, tilt_rad=tilt_rad)


def _unit_words(pan: float, tilt: float) -> str:
    """Return what angles that no head has are likely to be."""
    return ", as of an encoder's counts, or thousandths of degrees" if pan.is_integer() and tilt.is_integer() else ""
