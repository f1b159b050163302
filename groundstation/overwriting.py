"""Files that a command reads are never those that it writes."""

from collections.abc import Iterable
from pathlib import Path

from groundstation.errors import InputError


def refuse_overwriting(read: Iterable[Path | None], written: Iterable[Path], option: str = "--out") -> None:
    """Raise `InputError` where a file to write is one to read, by whatever name; None is nothing to read.

    ``option`` is the one that names what is written.
    """
    given = [path for path in read if path is not None]
    for path in written:
        if any(_same(path, one) for one in given):
            raise InputError(str(path), got="a file that is read", wanted=f"another {option}")


def refuse_existing(files: Iterable[Path]) -> None:
    """Raise `InputError` where a file to write is there already."""
    for path in files:
        if path.exists():
            raise InputError(str(path), got="a file that is there already", wanted="another --out")


def _same(one: Path, other: Path) -> bool:
    if one.resolve() == other.resolve():
        return True
    try:
        return one.samefile(other)
    except OSError:
        return False
