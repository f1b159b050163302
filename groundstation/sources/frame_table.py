"""frames.csv: the frame of each camera in each pair, and its exposure time."""

from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.session import Session
from groundstation.session.folder import frames_table
from groundstation.sources.row_times import RowTimes

_MAX_FRAMES = 50_000_000
_MISSING = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTable:
    """frames.csv: ``index`` (n,), ``line`` (n,), and per station session times (n,), NaN inside where missing.

    ``numbers`` (n,) are the frames' numbers in each station's own video, −1 where it has none. ``fault`` is the
    fault that ended the reading early, if any; the rows before it are usable.
    """

    index: NDArray[np.int64]
    line: NDArray[np.int64]
    stamps_s: dict[str, FloatArray]
    numbers: dict[str, NDArray[np.int64]]
    fault: SessionError | None

    def epoch_times(self) -> FloatArray:
        """Return the mean stamp of each epoch (n,); an epoch without any frame has infinity."""
        stamps = np.array(list(self.stamps_s.values()))
        count = np.isfinite(stamps).sum(axis=0)
        return np.where(count > 0, np.nansum(stamps, axis=0) / np.maximum(count, 1), np.inf)

    def last_times(self) -> FloatArray:
        """Return the latest stamp of each epoch (n,); an epoch without any frame has minus infinity."""
        return np.nan_to_num(np.array(list(self.stamps_s.values())), nan=-np.inf).max(axis=0)

    def rows(self, chosen: MaskArray) -> "FrameTable":
        """Return the rows where ``chosen`` (n,) is true."""
        return FrameTable(
            index=self.index[chosen],
            line=self.line[chosen],
            stamps_s={n: s[chosen] for n, s in self.stamps_s.items()},
            numbers={n: s[chosen] for n, s in self.numbers.items()},
            fault=self.fault,
        )


def read_frames(session: Session) -> FrameTable:
    """Read frames.csv; a fault in it ends the reading and is returned with the rows before it.

    Where a time goes back because the one before is far ahead, rows end before that one.

    Raises `SessionError` if the file or a column is missing.
    """
    names = session.rig.names
    table = frames_table(session)
    clocks = {s.name: session.camera_clock(s) for s in session.rig.stations}
    # arrays of machine numbers: hours of frames stay small
    index, lines = array("q"), array("q")
    stamps = {n: array("d") for n in names}
    numbers = {n: array("q") for n in names}
    numbered = [n for n in names if f"{n}_index" in table.columns]
    last = dict.fromkeys(names, -1)
    newest = {n: RowTimes() for n in names}
    usable, fault = None, None
    try:
        for row in table:
            number = _index(table, row, index[-1] if index else None)
            own = {n: table.optional_number(row, f"{n}_t_s") for n in names}
            for n, t in own.items():
                if t is not None:
                    usable = newest[n].row if newest[n].is_ahead_of(t) else None
                    table.check_later(row, f"{n}_t_s", t, newest[n].newest_s)
            of_row = dict.fromkeys(names, number)
            for n in numbered:
                of_row[n] = -1
                if own[n] is not None:
                    of_row[n] = last[n] = _whole(table, row, f"{n}_index", last[n])
            for n in names:
                numbers[n].append(of_row[n])
            for n, t in own.items():
                if t is not None:
                    newest[n].add(t, len(index))
                stamps[n].append(_MISSING if t is None else clocks[n].session_from_device(t))
            index.append(number)
            lines.append(row.line)
    except SessionError as error:
        fault = error
    usable = len(index) if usable is None else usable
    return FrameTable(
        index=np.array(index, dtype=np.int64)[:usable],
        line=np.array(lines, dtype=np.int64)[:usable],
        stamps_s={n: np.array(s, dtype=np.float64)[:usable] for n, s in stamps.items()},
        numbers={n: np.array(k, dtype=np.int64)[:usable] for n, k in numbers.items()},
        fault=fault,
    )


def own_numbers(session: Session) -> dict[str, dict[int, int]]:
    """Return each station's frame numbers in its own pictures, by the pair's, where frames.csv has a column for them.

    Raises `SessionError` if frames.csv or a column is missing.
    """
    columns = frames_table(session).columns
    numbered = [n for n in session.rig.names if f"{n}_index" in columns]
    if not numbered:
        return {}
    table = read_frames(session)
    pairs = table.index.tolist()
    return {n: {k: own for k, own in zip(pairs, table.numbers[n].tolist(), strict=True) if own >= 0} for n in numbered}


def _index(table: CsvTable, row: Row, before: int | None) -> int:
    """Return a row's number, which must be greater than that of the row before."""
    return _whole(table, row, "index", -1 if before is None else before)


def _whole(table: CsvTable, row: Row, column: str, before: int) -> int:
    """Return a whole number greater than the one before."""
    number = table.number(row, column)
    if not before < number <= _MAX_FRAMES or number != int(number):
        wanted = "a whole number from 0" if before < 0 else f"a whole number above {before}"
        got = f"{column} = {quoted(row.text[column].strip())}"
        raise table.fault(row.line, got=got, wanted=wanted if number < _MAX_FRAMES else f"at most {_MAX_FRAMES}")
    return int(number)
