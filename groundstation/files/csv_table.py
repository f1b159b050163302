"""Reading the session's CSV tables row by row, with errors that name file, line, column, got and wanted."""

import csv
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TextIO

from groundstation.errors import SessionError, os_words
from groundstation.files.text_file import TextFile, absence, is_utf16
from groundstation.files.toml_table import quoted, shown

MAX_COLUMNS = 400
# beyond this a number is a mistake, and products of such numbers would not stay finite
MAX_MAGNITUDE = 1e12
MAX_LINE_CHARACTERS = 65_536
MAX_NAME_CHARACTERS = 200
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
# how a ZIP file begins, and with it a workbook of a spreadsheet
_ZIP = "PK\x03\x04"


class Row(NamedTuple):
    """One row: ``line`` as an editor counts it, ``text`` the cells by column."""

    line: int
    text: dict[str, str]


class CsvTable:
    """One CSV file with a header line, streamed; nothing is kept.

    Parameters
    ----------
    path : the file.
    required : columns that must be there; others are left alone.

    Raises `SessionError` on opening if the file or a column is missing.
    """

    def __init__(self, path: TextFile, required: Sequence[str]) -> None:
        self.path = path
        if not path.is_file():
            raise SessionError(str(path), got=absence(path), wanted="a table with " + ", ".join(required))
        header = next(self._lines(), None)
        self.columns: tuple[str, ...] = () if header is None else tuple(name.strip() for name in header[1])
        self._require_text_with_commas(required)
        longest = max(map(len, self.columns), default=0)
        if longest > MAX_NAME_CHARACTERS:
            got, wanted = f"a column's name of {longest} characters", f"at most {MAX_NAME_CHARACTERS}"
            raise SessionError(f"{path.name}: line 1", got=got, wanted=wanted)
        for name in required:
            if name not in self.columns:
                have = shown(", ".join(self.columns[:12]), 200) if any(self.columns) else "nothing"
                raise SessionError(f"{path.name}: line 1", got=have, wanted=f"a column {name}")
        for name in self.columns:
            if name and self.columns.count(name) > 1:
                raise SessionError(
                    f"{path.name}: line 1", got=f"two columns {quoted(name)}", wanted="names that differ"
                )

    def _require_text_with_commas(self, required: Sequence[str]) -> None:
        """Raise `SessionError` for what a spreadsheet makes of a table in another format."""
        first = self.columns[0] if self.columns else ""
        where = f"{self.path.name}: line 1"
        if is_utf16(first.encode("utf-8", "surrogateescape")):
            raise SessionError(where, got="text in UTF-16", wanted="a table in UTF-8")
        if first.startswith(_ZIP):
            raise SessionError(self.path.name, got="a workbook or another ZIP file", wanted="a table saved as CSV")
        for separator, word in _SEPARATORS.items():
            names = [name.strip() for name in first.split(separator)]
            if len(self.columns) == 1 and len(names) > 1 and any(name in names for name in required):
                wanted = "commas between them, and points in numbers"
                raise SessionError(where, got=f"cells separated by {word}", wanted=wanted)

    def __iter__(self) -> Iterator[Row]:
        lines, columns = self._lines(), self.columns
        next(lines, None)
        for line, cells in lines:
            # the first cell nearly always decides
            if not (cells and cells[0].strip()) and not any(map(str.strip, cells)):
                continue
            if len(cells) != len(columns):
                raise self.fault(line, got=f"{len(cells)} cells", wanted=f"{len(columns)} as in the header")
            yield Row(line, dict(zip(columns, cells, strict=True)))

    def fault(self, line: int, *, got: str, wanted: str) -> SessionError:
        """Build (not raise) the error for one line."""
        return SessionError(f"{self.path.name}: line {line}", got=got, wanted=wanted)

    def number(self, row: Row, column: str) -> float:
        """Return a finite number; raises `SessionError` for anything else, including an empty cell."""
        value = self.optional_number(row, column)
        if value is None:
            raise self.fault(row.line, got=f"an empty {column}", wanted="a finite number")
        return value

    def optional_number(self, row: Row, column: str) -> float | None:
        """Return a finite number, or None for an empty cell."""
        text = row.text[column]
        try:
            value = float(text)
        except ValueError:
            if not text.strip():
                return None
            value = math.nan
        # Python reads 1_000 and digits of other scripts as numbers; no table means that
        is_plain = text.isascii() and "_" not in text
        # false for what is not a number
        if is_plain and -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
            return value
        if is_plain and math.isfinite(value):
            wanted = f"a number of at most {MAX_MAGNITUDE:g} in size"
            if column == "t_s" or column.endswith(("_t_s", "_utc_s")):
                wanted += ", in seconds: neither milliseconds nor nanoseconds"
        else:
            wanted = "a finite number"
        raise self.fault(row.line, got=f"{column} = {quoted(text.strip())}", wanted=wanted)

    def advance(self, row: Row, column: str, before: float | None) -> float:
        """Return a time that must be later than the row's before it."""
        t = self.number(row, column)
        self.check_later(row, column, t, before)
        return t

    def check_later(self, row: Row, column: str, t: float, before: float | None) -> None:
        """Raise `SessionError` unless ``t`` is later than ``before``."""
        if before is not None and t <= before:
            what = "the same time as" if t == before else "an earlier time than"
            got = f"{column} = {t:.15g}, {what} the row before"
            raise self.fault(row.line, got=got, wanted=f"later than {before:.15g}")

    def _lines(self) -> Iterator[tuple[int, list[str]]]:
        line = 0
        try:
            # bytes that are not UTF-8 stay in their cell, so that the error message names their row
            with self.path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as stream:
                reader = csv.reader(_bounded(stream, self.path), strict=True)
                for cells in reader:
                    line = reader.line_num
                    if len(cells) > MAX_COLUMNS:
                        raise self.fault(line, got=f"{len(cells)} columns", wanted=f"at most {MAX_COLUMNS}")
                    yield line, cells
        except csv.Error as error:
            raise self.fault(line + 1, got=f"no CSV ({shown(str(error))})", wanted="cells with commas") from error
        except OSError as error:
            raise SessionError(str(self.path), got=os_words(error), wanted="a file that can be read") from error


def _bounded(stream: TextIO, path: TextFile) -> Iterator[str]:
    """Pass lines on, and refuse one that is too long to be a row before it is all in memory."""
    number = 0
    while line := stream.readline(MAX_LINE_CHARACTERS + 1):
        number += 1
        if len(line) > MAX_LINE_CHARACTERS:
            wanted = f"lines of at most {MAX_LINE_CHARACTERS} characters"
            raise SessionError(f"{path.name}: line {number}", got="a longer line", wanted=wanted)
        yield line
