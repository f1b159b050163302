"""The folder of one operation: new or empty before, and as it was before where nothing was operated."""

import contextlib
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from groundstation.errors import InputError, os_words
from groundstation.live.station_file import load_station


def operation_folder(out: Path | None, station: Path | None) -> Path:
    """Return the folder of an operation, which is still to be made: ``out``, or one below the station file's."""
    if out is None and station is not None:
        below = load_station(station).record
        if below is None:
            got = "no [record] folder in the station file"
            raise InputError("--out", got=got, wanted="a folder for what is recorded")
        out = below / datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
    if out is None:
        raise InputError("--out", got="none", wanted="a folder for what is recorded")
    require_free(out)
    return out


def require_free(out: Path) -> None:
    """Raise `InputError` unless a folder is new or empty."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(str(out), got="something that is there already", wanted="a new or empty folder")
    above = next(p for p in out.absolute().parents if p.exists())
    if not above.is_dir():
        raise InputError(str(out), got=f"{above}, a file", wanted="a folder that another one can be made in")


def written_files(out: Path) -> tuple[Path, ...]:
    """Return the files of a folder in order of name; one in which the disk took nothing is none."""
    return tuple(sorted(p for p in out.iterdir() if p.is_file() and not p.is_symlink() and p.stat().st_size > 0))


class StartingFolder:
    """The folder of an operation that starts. ``kept`` is whether there is something to keep in it."""

    def __init__(self, out: Path) -> None:
        self.kept = False
        self._out, self._was_there = out, out.is_dir()

    def keep(self) -> None:
        """Keep what is in it from now on, however the operation ends."""
        self.kept = True

    def restore(self) -> None:
        """Leave the folder as it was before the start."""
        _empty(self._out, remove=not self._was_there)


@contextlib.contextmanager
def removed_unless_started(out: Path) -> Iterator[StartingFolder]:
    """Yield the folder, to be told once there is something to keep; otherwise ``out`` is left as it was.

    So a device that is not there costs nothing but another start with the same command.
    """
    folder = StartingFolder(out)
    try:
        yield folder
    except BaseException as fault:
        if not folder.kept:
            folder.restore()
            if isinstance(fault, OSError) and fault.filename and Path(str(fault.filename)).is_relative_to(out):
                got, wanted = os_words(fault), "a folder that files can be made in"
                raise InputError(str(out), got=got, wanted=wanted) from fault
        raise


def _empty(out: Path, *, remove: bool) -> None:
    """Delete the files of a folder that was new or empty; whatever else there is stays, and so does the fault."""
    with contextlib.suppress(OSError):
        for path in out.iterdir():
            if path.is_symlink() or path.is_file():
                path.unlink()
        if remove:
            out.rmdir()
