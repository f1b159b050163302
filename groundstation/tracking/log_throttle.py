"""Rate limiting of repeated log lines: the first is logged at once, repetitions are counted and summarised."""

import re
from collections.abc import Callable
from dataclasses import dataclass

# only decimals count as numbers, since station names may contain digits
_NUMBER = re.compile(r"\d+\.\d+")


@dataclass(slots=True)
class _Kind:
    """Lines of one kind that are held back: since when, how many, and the newest."""

    since_s: float
    held: int = 0
    newest_s: float = 0.0
    newest: str = ""


class LogThrottle:
    """Logs at most one line of each kind per ``every_s``; lines that only differ in decimal numbers are of one kind.

    Parameters
    ----------
    log : receives a time in s and a line.
    every_s : after a line, further ones of its kind are held back for this time and then logged as one summary.

    Times are those of the lines, so that the same lines give the same log.
    """

    def __init__(self, log: Callable[[float, str], None], every_s: float = 5.0) -> None:
        self._log, self._every_s = log, every_s
        self._kinds: dict[str, _Kind] = {}

    def take(self, t_s: float, line: str) -> None:
        """Log a line, or hold it back."""
        self.pass_time(t_s)
        kind = self._kinds.get(_NUMBER.sub("#", line))
        if kind is None:
            self._kinds[_NUMBER.sub("#", line)] = _Kind(since_s=t_s)
            self._log(t_s, line)
            return
        kind.held += 1
        kind.newest_s, kind.newest = t_s, line

    def pass_time(self, t_s: float) -> None:
        """Log the summaries that are due at ``t_s``."""
        for key, kind in list(self._kinds.items()):
            if t_s < kind.since_s + self._every_s:
                continue
            if kind.held:
                self._together(kind)
                self._kinds[key] = _Kind(since_s=t_s)
            else:
                del self._kinds[key]

    def finish(self) -> None:
        """Log all lines that are held back."""
        for kind in self._kinds.values():
            if kind.held:
                self._together(kind)
        self._kinds.clear()

    def _together(self, kind: _Kind) -> None:
        more = f" ({kind.held} like it since {kind.since_s:.1f} s)" if kind.held > 1 else ""
        self._log(kind.newest_s, kind.newest + more)
