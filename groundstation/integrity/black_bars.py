"""Black bars at opposite borders of all pictures, as a converter adds them to make a picture's shape another.

A bar is of columns (or rows) that are black, each of one grey level, the same in all pictures, as wide as that on the
other side, and it ends at once: there a column's mean rises by more than neighbouring columns of a scene differ. Dark
skies have no such end, vignettes end gradually, and a dark sky above bright ground has no counterpart below.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray, MaskArray
from groundstation.messages import Event, Frame

# enough to see a scene change, spread over seconds
_EVERY_S, _LEAST_PICTURES, _MOST_PICTURES = 0.5, 8, 40
# black is 0, or 16 of a video that is read in another range; a codec adds some levels
_BLACKEST, _SAME_LEVELS = 24.0, 3.0
# the end of a bar: so many levels within so many px, half a block of a codec
_STEP, _WITHIN_PX = 12.0, 8
_LEAST_SHARE, _LEAST_PX, _MOST_SHARE, _UNEQUAL_PX = 0.01, 4, 0.4, 3
_EVERY_ROW = 4


class _Lines(NamedTuple):
    """Of each column or row, over all pictures: least and greatest mean, and the greatest deviation within one."""

    low: FloatArray
    high: FloatArray
    spread: FloatArray


class BlackBarsMonitor:
    """Looks at some of each station's pictures; ``stations`` are the names."""

    def __init__(self, stations: Iterable[str]) -> None:
        self._lines: dict[str, tuple[_Lines, _Lines]] = {}
        self._seen = dict.fromkeys(stations, 0)
        self._next_s: dict[str, float] = {}

    def watched(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, and look at the frames among them."""
        for event in events:
            if isinstance(event, Frame):
                self._add(event)
            yield event

    def _add(self, frame: Frame) -> None:
        name = frame.station
        waits = frame.t_s < self._next_s.get(name, -np.inf)
        if waits or self._seen.get(name, _MOST_PICTURES) >= _MOST_PICTURES or not frame.image.has_all:
            return
        self._next_s[name] = frame.t_s + _EVERY_S
        grey = _grey(frame.image.preview())
        found = (_lines(grey[::_EVERY_ROW], 0), _lines(grey[:, ::_EVERY_ROW], 1))
        before = self._lines.get(name)
        if before is not None and len(before[0].low) == len(found[0].low) and len(before[1].low) == len(found[1].low):
            found = (_merged(before[0], found[0]), _merged(before[1], found[1]))
        self._lines[name] = found
        self._seen[name] += 1

    def lines(self) -> list[str]:
        """Return a line on each station whose pictures have bars."""
        told = []
        for name, (columns, rows) in self._lines.items():
            if self._seen[name] < _LEAST_PICTURES:
                continue
            for where, bar in (("left and right", _bar(columns)), ("above and below", _bar(rows))):
                if bar:
                    told.append(
                        f"station {name}: black bars of {bar} px {where} in all pictures: has the video been fitted "
                        "into another shape since the lens was calibrated?"
                    )
        return told


def _grey(image: ImageArray) -> ImageArray:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def _lines(grey: ImageArray, axis: int) -> _Lines:
    mean = grey.mean(axis=axis)
    return _Lines(low=mean, high=mean, spread=grey.std(axis=axis))


def _merged(one: _Lines, other: _Lines) -> _Lines:
    return _Lines(
        low=np.minimum(one.low, other.low),
        high=np.maximum(one.high, other.high),
        spread=np.maximum(one.spread, other.spread),
    )


def _bar(lines: _Lines) -> int:
    """Return how wide the bars at both ends are, px; 0 where there are none."""
    black = (lines.high <= _BLACKEST) & (lines.high - lines.low <= _SAME_LEVELS) & (lines.spread <= _SAME_LEVELS)
    size = len(black)
    first, last = _length(black), _length(black[::-1])
    least, most = max(_LEAST_SHARE * size, _LEAST_PX), _MOST_SHARE * size
    if not least <= min(first, last) <= max(first, last) <= most or abs(first - last) > _UNEQUAL_PX:
        return 0
    # the end has to be seen in the picture in which the scene is darkest
    ends = (lines.low[first - 1 :], lines.low[::-1][last - 1 :])
    sharp = all(float(end[: _WITHIN_PX + 1].max() - end[0]) >= _STEP for end in ends)
    return (first + last) // 2 if sharp else 0


def _length(black: MaskArray) -> int:
    """Return how many lines are black from the first on."""
    return int(np.argmin(black)) if not black.all() else len(black)
