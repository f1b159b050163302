"""Files that appear under their own name only when they are whole."""

import os
from collections.abc import Callable
from pathlib import Path

from groundstation.errors import InputError


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file under another name, sync it, and give it its own: a reader finds all of it or the file before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(draft)
        descriptor = os.open(draft, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def write_text_whole(path: Path, text: str) -> None:
    """Write a text as `write_whole` does, with line ends as they are; raises `InputError` if that is not possible."""
    write_bytes_whole(path, text.encode("utf-8"))


def write_bytes_whole(path: Path, content: bytes) -> None:
    """Write bytes as `write_whole` does; raises `InputError` if that is not possible."""
    try:
        write_whole(path, lambda draft: draft.write_bytes(content))
    except OSError as fault:
        raise InputError(str(path), got=str(fault.strerror), wanted="a file that can be written") from fault
