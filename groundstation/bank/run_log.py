"""The log of runs of the test set: one row for each, so that how often it was looked at is known."""

import csv
from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import InputError, os_words

COLUMNS = ("date", "commit", "version", "first", "sessions", "hit", "wrong", "misleading", "rows_sha256")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedRun:
    """One run: date (ISO 8601, UTC), commit and version, first world and number, pooled figures, hash of the rows."""

    date: str
    commit: str
    version: str
    first: int
    sessions: int
    hit: str
    wrong: str
    misleading: str
    rows_sha256: str


def require_log(path: Path) -> None:
    """Raise `InputError` unless a file is a log of runs, or can become one."""
    if not path.parent.is_dir():
        raise InputError(str(path), got="no such folder", wanted="a file in a folder that exists")
    if not path.exists():
        return
    try:
        with path.open(encoding="utf-8", newline="") as file:
            head = next(csv.reader(file), [])
    except (OSError, ValueError, csv.Error) as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a log of runs that can be read") from fault
    if tuple(head) != COLUMNS:
        raise InputError(str(path), got=f"the columns {', '.join(head)[:80]}", wanted=", ".join(COLUMNS))


def append_run(path: Path, run: LoggedRun) -> None:
    """Append one row; writes the head of a new file."""
    require_log(path)
    new = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        writer.writerow([getattr(run, name) for name in COLUMNS])
