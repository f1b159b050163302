"""Files and folders that are there whole or not at all: written under another name, which is changed at the end.

An interrupt, a full disk or a power cut leaves what stood under the final name before.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from groundstation.errors import InputError, os_words


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield the path of a draft to write; it is synced and gets its name ``path`` when the context ends.

    A draft is removed where the context ends by an error or an interrupt. Raises `OSError`, which names the file.
    """
    # the suffix stays: libraries choose a format by it
    draft = path.with_name(f".{os.getpid()}.part.{path.name}")
    try:
        yield draft
        descriptor = os.open(draft, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        draft.replace(path)
    except OSError as fault:
        if fault.errno is None or fault.filename not in (None, str(draft)):
            raise
        # a failed write names no file, and a draft's name says nothing to a user
        raise OSError(fault.errno, fault.strerror, str(path)) from fault
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file at once, text in UTF-8 with its line ends as they are; raises `OSError`."""
    data = content.encode() if isinstance(content, str) else content
    if path.exists() and not path.is_file():
        # a pipe or a terminal is not replaced, and takes no name
        path.write_bytes(data)
        return
    with whole_file(path) as draft:
        draft.write_bytes(data)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a draft folder, empty; it gets its name ``path`` when the context ends, in place of an empty folder.

    It is removed with what is in it where the context ends by an error or an interrupt. Raises `OSError`.
    """
    final = Path(os.path.realpath(path))
    draft = final.with_name(f".{os.getpid()}.part.{final.name}")
    try:
        draft.mkdir(parents=True)
        yield draft
        if final.is_dir():
            final.rmdir()
        draft.rename(final)
    except OSError as fault:
        named = Path(os.fsdecode(fault.filename)) if isinstance(fault.filename, str | bytes) else None
        if fault.errno is None or named is None or not named.is_relative_to(draft):
            raise
        # a draft's name says nothing to a user
        raise OSError(fault.errno, fault.strerror, str(path / named.relative_to(draft))) from fault
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def write_text_whole(path: Path, text: str) -> None:
    """Write a text as `write_whole` does, its folder too; raises `InputError` if that is not possible."""
    write_bytes_whole(path, text.encode("utf-8"))


def write_bytes_whole(path: Path, content: bytes) -> None:
    """Write bytes as `write_whole` does, their folder too; raises `InputError` if that is not possible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be written") from fault
