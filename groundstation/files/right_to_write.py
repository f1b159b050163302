"""The check, made before a command starts, that the places it writes to can be written.

A long command would otherwise report it after its work.
"""

import errno
import os
import stat
from pathlib import Path

from groundstation.errors import InputError


def require_right_to_write(path: Path, wanted: str) -> None:
    """Raise `InputError` where the user may not write to a file or folder, or may not make it.

    What is there and is of the wrong kind is left to the command. ``wanted`` says what was wanted there.
    """
    mode = _mode(path)
    if mode is None:
        _require_folder(_nearest(path), path, wanted)
    elif stat.S_ISDIR(mode):
        _require_folder(path, path, wanted)
    elif not os.access(path, os.W_OK) and not (stat.S_ISREG(mode) and _is_open(path.parent)):
        # a file that is replaced whole needs no right of its own
        raise InputError(str(path), got=_words(path), wanted=wanted)


def _require_folder(folder: Path, path: Path, wanted: str) -> None:
    """Raise `InputError` where no file of ``path`` can be made in a folder that is there."""
    if stat.S_ISDIR(_mode(folder) or 0) and not _is_open(folder):
        raise InputError(str(path), got=f"{_words(folder)} in {folder}", wanted=wanted)


def _nearest(path: Path) -> Path:
    """Return the nearest of the folders above a path that is there."""
    above = Path(os.path.realpath(path)).parents
    return next((folder for folder in above if _mode(folder) is not None), above[-1])


def _mode(path: Path) -> int | None:
    """Return the kind of what a path leads to; None where there is nothing, or nothing can be seen."""
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return None


def _is_open(folder: Path) -> bool:
    return os.access(folder, os.W_OK | os.X_OK)


def _words(place: Path) -> str:
    """Return why a place cannot be written, in the operating system's words."""
    try:
        sealed = bool(os.statvfs(place).f_flag & os.ST_RDONLY)
    except OSError:
        sealed = False
    return os.strerror(errno.EROFS if sealed else errno.EACCES)
