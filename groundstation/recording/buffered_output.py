"""The recorder's file: data that cannot be written are kept and retried, so a full disk leaves no gap."""

import os
from pathlib import Path
from typing import IO, Protocol

from groundstation.errors import InputError, os_words


class RawOutput(Protocol):
    """The raw output: an unbuffered file, or a test's replacement."""

    def write(self, data: memoryview, /) -> int | None:
        """Write some of the data; returns the number of bytes written."""

    def fileno(self) -> int:
        """Return the file's descriptor."""

    def close(self) -> None:
        """Close the file."""


def new_file(path: Path) -> RawOutput:
    """Open a file that does not exist yet, unbuffered; raises `InputError` if there is one, or it cannot be made."""
    try:
        raw = path.open("xb", buffering=0)
        _sync_folder(path.parent)
    except FileExistsError as fault:
        raise InputError(str(path), got="a file that exists", wanted="a new one: recordings are kept") from fault
    except OSError as fault:
        missing = not path.parent.exists()
        wanted = f"a file in a folder that is there: {path.parent} is not" if missing else "a file that can be made"
        raise InputError(str(path), got=os_words(fault), wanted=wanted) from fault
    return raw


def _sync_folder(folder: Path) -> None:
    """Sync the folder entry to the disk; without it the file does not survive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class BufferedOutput:
    """Holds what is written until `commit` has brought all of it to the file.

    A commit that fails halfway goes on where it stopped, so the file is always a beginning of what was written.
    """

    def __init__(self, raw: RawOutput) -> None:
        self._raw = raw
        self._waiting = bytearray()
        self._written = 0
        self._synced = 0

    @property
    def waiting_bytes(self) -> int:
        """Number of bytes not yet in the file."""
        return len(self._waiting)

    @property
    def written_bytes(self) -> int:
        """Number of bytes in the file."""
        return self._written

    def write(self, data: bytes | bytearray | memoryview) -> int:
        """Keep bytes for the next commit."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Return the position of the next byte."""
        return self._written + len(self._waiting)

    def flush(self) -> None:
        """Do nothing: `commit` writes to the file."""

    def commit(self) -> None:
        """Write all pending bytes to the file; raises `OSError` on failure, after which it may be retried."""
        done = 0
        try:
            with memoryview(self._waiting) as data:
                while done < len(data):
                    step = self._raw.write(data[done:])
                    if not step:
                        raise OSError("the file takes no more")
                    done += step
        finally:
            self._written += done
            del self._waiting[:done]

    def sync(self) -> None:
        """Sync the file to the disk (fsync); raises `OSError`."""
        if self._synced < self._written:
            written = self._written
            os.fdatasync(self._raw.fileno())
            self._synced = written

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


def as_stream(output: BufferedOutput) -> IO[bytes]:
    """Return it as the file object of a container's writer: with write, tell and flush only."""
    return output  # type: ignore[return-value]
