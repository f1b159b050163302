"""The check, made before a command starts, that it overwrites none of the files it reads.

Inputs and outputs of a command are declared with its arguments (`groundstation.cli.path_arguments`). Files are compared
by their identity on the disk, so that links and other spellings of a path are recognised.
"""

import errno
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from groundstation.errors import InputError
from groundstation.files.image_header import IMAGE_SUFFIXES

_Identity = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A file that is written, or with ``names`` a folder in which files of these names (patterns) are.

    ``option`` names it to the user.
    """

    path: Path
    option: str = "--out"
    names: tuple[str, ...] = ()


def refuse_overwriting(read: Iterable[Path | None], written: Iterable[Output]) -> None:
    """Raise `InputError` if an output would replace an input, or two outputs are one file.

    For an input folder all its own files count, and the pictures in its folders. An output folder may contain inputs
    if nothing is written under their names; it must not be an input folder. None stands for no input.
    """
    given = [path for path in read if path is not None]
    outputs = list(written)
    # most outputs do not exist yet and need no further check
    replaced = [(output, found) for output in outputs for found in _replaced(output)]
    sources = {identity for path in given for identity in _sources(path)} if replaced else set[_Identity]()
    for output, path in replaced:
        if _identity(path) in sources:
            raise InputError(str(path), got="a file that is read", wanted=f"another {output.option}")
    for output in outputs:
        if any(_same(output.path, path) for path in given if output.names or not path.is_dir()):
            what = "a folder" if output.path.is_dir() else "a file"
            raise InputError(str(output.path), got=f"{what} that is read", wanted=f"another {output.option}")
    _refuse_twice(outputs)


def leads_to_itself(path: Path) -> bool:
    """Return whether a path cannot be followed, since a link on it leads back to itself."""
    try:
        path.stat()
    except OSError as fault:
        return fault.errno == errno.ELOOP
    except ValueError:
        # of a text that no path can have
        return False
    return False


def refuse_existing(files: Iterable[Path]) -> None:
    """Raise `InputError` if a file to write already exists."""
    for path in files:
        if path.exists():
            raise InputError(str(path), got="a file that is there already", wanted="another --out")


def _refuse_twice(outputs: Sequence[Output]) -> None:
    """Raise `InputError` where two options name one file to write."""
    files = [output for output in outputs if not output.names and not _is_device(output.path)]
    for number, output in enumerate(files):
        for other in files[:number]:
            if _same(output.path, other.path):
                got = f"a file that {other.option} names, too"
                raise InputError(str(output.path), got=got, wanted=f"another {output.option}")


def _replaced(output: Output) -> Iterator[Path]:
    """Yield the regular files that an output may replace."""
    if not output.names:
        if output.path.is_file():
            yield output.path
        return
    if output.path.is_dir():
        for path in output.path.iterdir():
            if path.is_file() and any(fnmatch(path.name, name) for name in output.names):
                yield path


def _sources(path: Path) -> Iterator[_Identity]:
    """Yield the identities on the disk of the files that are read where a path is given."""
    if not path.is_dir():
        yield from _known(path)
        return
    for inside in path.iterdir():
        if not inside.is_dir():
            yield from _known(inside)
            continue
        for picture in inside.iterdir():
            if picture.suffix.lower() in IMAGE_SUFFIXES:
                yield from _known(picture)


def _known(path: Path) -> Iterator[_Identity]:
    identity = _identity(path)
    if identity is not None:
        yield identity


def _identity(path: Path) -> _Identity | None:
    """Return device and inode number of a regular file; None for other or missing files."""
    try:
        status = path.stat()
    except OSError:
        return None
    return (status.st_dev, status.st_ino) if stat.S_ISREG(status.st_mode) else None


def _is_device(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()


def _same(one: Path, other: Path) -> bool:
    if _is_device(one):
        return False
    # a loop of links, which `Path.resolve` refuses, is a fault of the file that is then opened
    if os.path.realpath(one) == os.path.realpath(other):
        return True
    try:
        return one.samefile(other)
    except OSError:
        return False
