"""Folders that a command makes for its results, and takes away again where it is ended before there are any."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from groundstation.errors import InputError, os_words


def make_folder(folder: Path) -> None:
    """Make a folder and those above it; raises `InputError` where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        got = "a file" if isinstance(fault, FileExistsError) else os_words(fault)
        raise InputError(str(folder), got=got, wanted="a folder that can be written") from fault


@contextlib.contextmanager
def removed_if_empty(folder: Path) -> Iterator[None]:
    """Delete a folder at the end if it was not there at the start and is empty."""
    existed = folder.exists()
    try:
        yield
    finally:
        if not existed:
            with contextlib.suppress(OSError):
                folder.rmdir()
