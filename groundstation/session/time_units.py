"""Units in which times are stored by mistake, where a session wants seconds."""

import math

# each in seconds
TIME_UNITS_S = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
# rows of pictures and of readings are closer, in seconds
_MOST_APART_S = 1.0
# heads are read less often than 200 times a second; a log that is sparse has readings some seconds apart
_LEAST_APART_S = 0.005
# pictures in another unit take at least this share of the time of the readings
_LEAST_SHARE = 0.1


def unit_hint(first_s: float, second_s: float, from_s: float, to_s: float) -> str:
    """Return in which unit two times that follow each other would be of a span; nothing where they do not look so."""
    if second_s - first_s < _MOST_APART_S:
        return ""
    for unit, in_s in TIME_UNITS_S.items():
        if from_s - _MOST_APART_S <= first_s * in_s <= to_s and (second_s - first_s) * in_s < _MOST_APART_S:
            return f", which would be {first_s * in_s:.4g} s if its times were in {unit}"
    return ""


def picture_unit_hint(readings_s: tuple[float, float], from_s: float, to_s: float) -> str:
    """Return in which unit the pictures' times would be among readings; nothing where they do not look so.

    ``readings_s`` are the first and the last reading, which lie outside of the pictures' span.
    """
    first_s, last_s = readings_s
    for unit, in_s in TIME_UNITS_S.items():
        among = from_s * in_s <= last_s and first_s <= to_s * in_s
        if among and (to_s - from_s) * in_s >= _LEAST_SHARE * (last_s - first_s):
            return f", among which the pictures would be if their times were in {unit}"
    return ""


def spacing_hint(apart_s: float) -> str:
    """Return in which unit times that are always so far apart, s, would be those of readings; nothing where none."""
    if not _MOST_APART_S < apart_s < math.inf:
        return ""
    for unit, in_s in TIME_UNITS_S.items():
        if _LEAST_APART_S <= apart_s * in_s < _MOST_APART_S:
            return f"{apart_s:.4g} s apart and more, {apart_s * in_s:.4g} s if its times are in {unit}"
    return ""
