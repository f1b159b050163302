"""Angles: the one place where they are wrapped."""

import math


def wrap_rad(angle_rad: float) -> float:
    """Return the same direction in [-π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
