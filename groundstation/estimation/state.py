"""Layout of the filter's state vector.

Order: target position and velocity (runway frame, m and m/s), pan and tilt of each turning station (rad), pan and
tilt rates of each turning station (rad/s): 6 + 4 N states, 14 for two stations (the paper's Equation 4). Fixed
stations have no angle states. They are followed by two states per station for the time-correlated error of the target
point, in sigmas (`groundstation.estimation.motion`), and by the carried errors of calibration and clocks
(`groundstation.estimation.parameters`), where the configuration has them.
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
    any station to its slice of two: the time-correlated error of its target point. ``parameters`` maps the name of a
    calibration or clock error to its index.
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
        """Position and velocity, six states."""
        return slice(self.position.start, self.velocity.stop)

    @property
    def moving(self) -> slice:
        """Dynamic states: target, angles, rates and offsets."""
        return slice(0, self.size - len(self.parameters))

    @property
    def constant(self) -> slice:
        """Constant states: the errors of calibration and clocks."""
        return slice(self.size - len(self.parameters), self.size)


# a dozen per epoch: not frozen, since frozen ones take twice as long to create
@dataclass(slots=True, eq=False)
class EkfState:
    """Snapshot of the complete filter state; read-only."""

    time_s: float | None
    first_s: float | None
    has_target: bool
    imm: list[FloatArray]
    read: frozenset[str]
    newest_reference_s: float
    references_refused: int
    reference_contradicted: bool
    provisional: ProvisionalTrack | None
    starts_taken_back: int
    watch: ClockMonitor
    contributed_s: Mapping[str, float]
    width_s: float | None


# types of the fields of `EkfState`, in their order
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
    """Return the layout for turning stations, carried errors and stations with correlated errors, in this order."""
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
