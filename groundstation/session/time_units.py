"""Units in which times are stored by mistake, where a session wants seconds."""

# each in seconds
TIME_UNITS_S = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
# rows of pictures and of readings are closer, in seconds
_MOST_APART_S = 1.0


def unit_hint(first_s: float, second_s: float, from_s: float, to_s: float) -> str:
    """Return in which unit two times that follow each other would be of a span; nothing where they do not look so."""
    if second_s - first_s < _MOST_APART_S:
        return ""
    for unit, in_s in TIME_UNITS_S.items():
        if from_s - _MOST_APART_S <= first_s * in_s <= to_s and (second_s - first_s) * in_s < _MOST_APART_S:
            return f", which would be {first_s * in_s:.4g} s if its times were in {unit}"
    return ""
