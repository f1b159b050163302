"""The filter's state vector: which number stands where, defined once.

Order: target position and velocity (runway frame, m and m/s), then for each turning station its pan and
tilt (rad), then for each its pan and tilt rates (rad/s): 6 + 4 N numbers, 14 for two stations (the
paper's Equation 4). A fixed station has no angles to estimate and takes no place. Behind these stand, if any, two
numbers for each station's lasting error of the target point, in its sigmas (`groundstation.estimation.motion`), and the
errors of calibration and clocks that are carried along (`groundstation.estimation.parameters`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from groundstation.arrays import FloatArray
from groundstation.estimation.clock_monitor import ClockMonitor
from groundstation.estimation.provisional_track import ProvisionalTrack


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLayout:
    """Named slices of the state vector.

    ``angles`` and ``rates`` map the name of a turning station to its slice of two: pan, tilt; ``offsets`` the name of
    any station to its slice of two: how far its target point is off, and stays off for a while. ``parameters`` maps the
    name of a calibration or clock error to its place.
    """

    position: slice
    velocity: slice
    angles: Mapping[str, slice]
    rates: Mapping[str, slice]
    offsets: Mapping[str, slice]
    parameters: Mapping[str, int]
    size: int

    @property
    def target(self) -> slice:
        """Position and velocity together, six numbers."""
        return slice(self.position.start, self.velocity.stop)

    @property
    def moving(self) -> slice:
        """What changes by itself: target, angles, rates and offsets."""
        return slice(0, self.size - len(self.parameters))

    @property
    def constant(self) -> slice:
        """The errors of calibration and clocks."""
        return slice(self.size - len(self.parameters), self.size)


# a dozen for each pair of frames: not frozen, which would take making one twice as long
@dataclass(slots=True, eq=False)
class EkfState:
    """Everything that a filter is at one instant, to go back to; not to be written to."""

    time_s: float | None
    first_s: float | None
    has_target: bool
    bank: list[FloatArray]
    read: frozenset[str]
    newest_reference_s: float
    references_refused: int
    reference_contradicted: bool
    provisional: ProvisionalTrack | None
    starts_taken_back: int
    watch: ClockMonitor
    contributed_s: Mapping[str, float]
    width_s: float | None


# the fields of `EkfState`, in their order
EkfStateFields = tuple[
    float | None,
    float | None,
    bool,
    list[FloatArray],
    frozenset[str],
    float,
    int,
    bool,
    ProvisionalTrack | None,
    int,
    ClockMonitor,
    Mapping[str, float],
    float | None,
]


def state_layout(
    turning_stations: Sequence[str], parameters: Sequence[str] = (), offset_stations: Sequence[str] = ()
) -> StateLayout:
    """Return the layout for these turning stations, carried errors and stations with lasting errors, in this order."""
    n = len(turning_stations)
    first_rate, first_offset = 6 + 2 * n, 6 + 4 * n
    moving = first_offset + 2 * len(offset_stations)
    return StateLayout(
        position=slice(0, 3),
        velocity=slice(3, 6),
        angles={name: slice(6 + 2 * i, 8 + 2 * i) for i, name in enumerate(turning_stations)},
        rates={name: slice(first_rate + 2 * i, first_rate + 2 * i + 2) for i, name in enumerate(turning_stations)},
        offsets={name: slice(first_offset + 2 * i, first_offset + 2 * i + 2) for i, name in enumerate(offset_stations)},
        parameters={name: moving + k for k, name in enumerate(parameters)},
        size=moving + len(parameters),
    )
