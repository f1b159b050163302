"""The parts of a picture to record: windows that cover every window the detector read."""

from collections.abc import Sequence
from functools import reduce

from groundstation.box import Box, union

# more parts than this are replaced by their bounding box
MAX_PARTS = 8


def merge_windows(windows: Sequence[Box[int]]) -> list[Box[int]]:
    """Return windows that cover all those given, largest first; two are merged if this adds no pixels."""
    parts: list[Box[int]] = []
    for window in dict.fromkeys(windows):
        parts = _joined(parts, window)
    if len(parts) > MAX_PARTS:
        parts = [reduce(union, parts)]
    return sorted(parts, key=lambda part: part.area, reverse=True)


def _joined(parts: list[Box[int]], window: Box[int]) -> list[Box[int]]:
    """Return the parts with one more window, merged repeatedly while this adds no pixels."""
    apart = list(parts)
    grew = True
    while grew:
        grew = False
        for part in apart:
            both = union(part, window)
            if both.area <= part.area + window.area:
                apart.remove(part)
                window, grew = both, True
                break
    return [*apart, window]
