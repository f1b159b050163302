"""The filter's state vector: which number stands where, defined once.

Order: target position and velocity (runway frame, m and m/s), then for each turning station its pan and
tilt (rad), then for each its pan and tilt rates (rad/s): 6 + 4 N numbers, 14 for two stations (the
paper's Equation 4). A fixed station has no angles to estimate and takes no place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLayout:
    """Named slices of the state vector.

    ``angles`` and ``rates`` map the name of a turning station to its slice of two: pan, tilt.
    """

    position: slice
    velocity: slice
    angles: Mapping[str, slice]
    rates: Mapping[str, slice]
    size: int

    @property
    def target(self) -> slice:
        """Position and velocity together, six numbers."""
        return slice(self.position.start, self.velocity.stop)


def state_layout(turning_stations: Sequence[str]) -> StateLayout:
    """Return the layout for these turning stations, in this order."""
    n = len(turning_stations)
    first_rate = 6 + 2 * n
    return StateLayout(
        position=slice(0, 3),
        velocity=slice(3, 6),
        angles={name: slice(6 + 2 * i, 8 + 2 * i) for i, name in enumerate(turning_stations)},
        rates={name: slice(first_rate + 2 * i, first_rate + 2 * i + 2) for i, name in enumerate(turning_stations)},
        size=6 + 4 * n,
    )
