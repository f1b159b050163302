"""The progress of a run as one line on the terminal."""

from types import TracebackType
from typing import Never, TextIO

from tqdm import tqdm


class ProgressLine:
    """A progress bar; if the stream is no terminal, lines at a low rate."""

    def __init__(self, stream: TextIO, label: str, unit: str = "pair") -> None:
        self._stream = stream
        self._unit = unit
        self._label = label
        self._terminal = stream.isatty()
        self._bar: tqdm[Never] | None = None
        # what stands there until there is something to count; a first run compiles for some seconds
        self._waiting = f"{label}: preparing …" if self._terminal else ""

    def __enter__(self) -> "ProgressLine":
        self._stream.write(self._waiting)
        self._stream.flush()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._wipe()
        if self._bar is not None:
            self._bar.close()

    def update(self, done: int, total: int | None) -> None:
        """Show ``done`` of ``total``; None if the total is unknown."""
        self._wipe()
        bar = self._bar
        if bar is None:
            bar = self._bar = tqdm(
                total=total,
                desc=self._label,
                unit=self._unit,
                file=self._stream,
                mininterval=0.1 if self._terminal else 10.0,
                dynamic_ncols=self._terminal,
            )
        bar.update(done - bar.n)

    def _wipe(self) -> None:
        """Clear the line shown before the first update."""
        if self._waiting:
            self._stream.write("\r" + " " * len(self._waiting) + "\r")
            self._waiting = ""
