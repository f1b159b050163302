"""The parts of a picture to record: windows that cover every window the detector read."""

from collections.abc import Sequence

from groundstation.picture import Window

# more parts than this are replaced by their bounding box
MAX_PARTS = 8


def merge_windows(windows: Sequence[Window]) -> list[Window]:
    """Return windows that cover all those given, largest first; two are merged if this adds no pixels."""
    parts: list[Window] = []
    for window in dict.fromkeys(windows):
        parts = _joined(parts, window)
    if len(parts) > MAX_PARTS:
        parts = [_around(parts)]
    return sorted(parts, key=_area, reverse=True)


def _joined(parts: list[Window], window: Window) -> list[Window]:
    """Return the parts with one more window, merged repeatedly while this adds no pixels."""
    apart = list(parts)
    grew = True
    while grew:
        grew = False
        for part in apart:
            both = _around([part, window])
            if _area(both) <= _area(part) + _area(window):
                apart.remove(part)
                window, grew = both, True
                break
    return [*apart, window]


def _around(windows: Sequence[Window]) -> Window:
    return (
        min(w[0] for w in windows),
        min(w[1] for w in windows),
        max(w[2] for w in windows),
        max(w[3] for w in windows),
    )


def _area(window: Window) -> int:
    return (window[2] - window[0]) * (window[3] - window[1])
