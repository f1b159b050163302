"""A MAVLink message as its name and fields, before a dialect encodes it."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkMessage:
    """``name`` as in the message definitions, in capitals; ``fields`` by their names, in the message's units."""

    name: str
    fields: Mapping[str, object]


# a MAVLink covariance: the upper right triangle, row by row, of position and angles (6, 6), or of a velocity
def upper_triangle(matrix: list[list[float]]) -> list[float]:
    """Return the upper right triangle of a square matrix, row by row."""
    return [row[k] for j, row in enumerate(matrix) for k in range(j, len(row))]
