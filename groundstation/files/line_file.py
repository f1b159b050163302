"""A text file of lines that grows with the run and holds whole lines only, whatever ends the run."""

import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType


class LineFile:
    """Lines wait in memory until `flush` brings them to the file; an older file is replaced.

    What the disk does not take is kept: a flush that failed may be repeated, and nothing is written twice. The file
    always ends with a whole line, and is removed where the disk takes none. Raises `OSError`, which names the file.
    """

    def __init__(self, path: Path) -> None:
        self._raw = path.open("wb", buffering=0)
        self._path = path
        # a pipe or a terminal has no positions
        self._regular = path.is_file()
        # offset in the file, and the lines that come after it; replaced together, so that an interrupt finds both
        self._state: tuple[int, list[str]] = (0, [])

    def __enter__(self) -> "LineFile":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def closed(self) -> bool:
        """Whether it has been closed."""
        return self._raw.closed

    def write(self, line: str) -> None:
        """Add a line, or several, with their ends."""
        self._state[1].append(line)

    def flush(self) -> None:
        """Bring all lines to the file."""
        base, lines = self._state
        data = "".join(lines).encode()
        # an interrupted flush has written a part
        done = self._raw.tell() - base if self._regular else 0
        try:
            while done < len(data):
                done += self._raw.write(data[done:])
        except OSError as fault:
            self._cut(base, data)
            raise OSError(fault.errno, fault.strerror, str(self._path)) from fault
        self._state = (base + len(data), [])

    def close(self) -> None:
        """Flush and close; may be called twice. It is closed also where the disk does not take the last lines."""
        if self._raw.closed:
            return
        try:
            self.flush()
        finally:
            empty = self._regular and bool(self._state[1]) and self._raw.tell() == 0
            self._raw.close()
            if empty:
                self._path.unlink(missing_ok=True)

    def _cut(self, base: int, data: bytes) -> None:
        """End the file after its last whole line."""
        if not self._regular:
            return
        with suppress(OSError):
            whole = base + data.rfind(b"\n", 0, self._raw.tell() - base) + 1
            os.ftruncate(self._raw.fileno(), whole)
            self._raw.seek(whole)
