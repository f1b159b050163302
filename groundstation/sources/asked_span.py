"""The part of a session that was asked for, in words."""

import math


def asked_span(from_s: float, to_s: float) -> str:
    """Return the description of a requested time span, whose ends may be infinite."""
    if to_s == math.inf:
        return f"from {from_s:.13g} s on"
    return f"up to {to_s:.13g} s" if from_s == -math.inf else f"from {from_s:.13g} to {to_s:.13g} s"
