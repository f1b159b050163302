"""Lines that come over and over: the first is said at once, the rest are counted and said together now and then."""

import re
from collections.abc import Callable
from dataclasses import dataclass

# a station may have a digit in its name, so only these count as numbers
_NUMBER = re.compile(r"\d+\.\d+")


@dataclass(slots=True)
class _Kind:
    """Since when lines of a kind are held back, how many, and the newest of them."""

    since_s: float
    held: int = 0
    newest_s: float = 0.0
    newest: str = ""


class LogThrottle:
    """Passes lines on, of each kind one in ``every_s``; lines that differ in their decimals alone are of a kind.

    Parameters
    ----------
    say : takes a time in s and a line.
    every_s : so long after a line was said those of its kind are held back; what was held is then said in one.

    Time is that of the lines: the same lines give the same log.
    """

    def __init__(self, say: Callable[[float, str], None], every_s: float = 5.0) -> None:
        self._say, self._every_s = say, every_s
        self._kinds: dict[str, _Kind] = {}

    def take(self, t_s: float, line: str) -> None:
        """Say a line, or hold it back."""
        self.pass_time(t_s)
        kind = self._kinds.get(_NUMBER.sub("#", line))
        if kind is None:
            self._kinds[_NUMBER.sub("#", line)] = _Kind(since_s=t_s)
            self._say(t_s, line)
            return
        kind.held += 1
        kind.newest_s, kind.newest = t_s, line

    def pass_time(self, t_s: float) -> None:
        """Say what has been held back long enough."""
        for key, kind in list(self._kinds.items()):
            if t_s < kind.since_s + self._every_s:
                continue
            if kind.held:
                self._together(kind)
                self._kinds[key] = _Kind(since_s=t_s)
            else:
                del self._kinds[key]

    def finish(self) -> None:
        """Say all that is held back."""
        for kind in self._kinds.values():
            if kind.held:
                self._together(kind)
        self._kinds.clear()

    def _together(self, kind: _Kind) -> None:
        more = f" ({kind.held} like it since {kind.since_s:.1f} s)" if kind.held > 1 else ""
        self._say(kind.newest_s, kind.newest + more)
