"""Specification of a drawn flight: the manoeuvre, its place, the aircraft's speed and angles, wind."""

import math
from dataclasses import dataclass
from enum import StrEnum

from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.drawn_flights.way_point import WayPoint, check_way_points
from groundstation.simulation.parameter_checks import require

MAX_BANK_RAD = math.radians(35.0)
# a radius that was rounded in a file may bank the aircraft by so much more
_BANK_TOLERANCE_RAD = math.radians(0.05)


class FlightKind(StrEnum):
    """Kind of the manoeuvre."""

    LANDING = "landing"
    GO_AROUND = "go-around"
    TOUCH_AND_GO = "touch-and-go"
    TAKE_OFF_TOWARDS = "take-off-towards"
    TAKE_OFF_AWAY = "take-off-away"
    CIRCUIT = "circuit"
    LOW_PASS = "low-pass"
    PATH = "path"


# a path is given, never drawn
DRAWN_KINDS = tuple(kind for kind in FlightKind if kind is not FlightKind.PATH)


class CircuitSide(StrEnum):
    """On which side of the runway, seen from the stations, a circuit is flown."""

    LEFT = "left"
    RIGHT = "right"


# of a flight
SHORTEST_S, LONGEST_S = 2.0, 300.0
# lowest and highest value of each number; wider than the draws, for files with other values
_RANGES: dict[str, tuple[float, float]] = {
    "duration_s": (SHORTEST_S, LONGEST_S),
    "span_m": (0.2, 40.0),
    "rest_height_m": (0.0, 5.0),
    "wheels_behind_nose_m": (0.0, 20.0),
    "speed_m_s": (5.0, 60.0),
    "event_s": (0.0, 300.0),
    "event_y_m": (-500.0, 5000.0),
    "offset_x_m": (-200.0, 200.0),
    "glide_rad": (0.0, math.radians(20.0)),
    "climb_rad": (0.0, math.radians(30.0)),
    "normal_acceleration_m_s2": (0.5, 8.0),
    "lowest_m": (0.0, 500.0),
    "level_s": (0.0, 300.0),
    "touch_down_speed_share": (0.6, 1.0),
    "sink_m_s": (0.0, 3.0),
    "braking_m_s2": (0.3, 8.0),
    "thrust_m_s2": (0.5, 10.0),
    "incidence_rad": (math.radians(-5.0), math.radians(15.0)),
    "flare_incidence_rad": (0.0, math.radians(20.0)),
    "crab_rad": (math.radians(-30.0), math.radians(30.0)),
    "gust_m_s2": (0.0, 2.0),
    "wobble_rad": (0.0, math.radians(6.0)),
    "circuit_radius_m": (5.0, 2000.0),
    "circuit_turn_rad": (math.radians(10.0), math.radians(360.0)),
    "circuit_height_m": (1.0, 500.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSpec:
    """One flight; lengths of the runway frame in m, times from the flight's beginning in s.

    What a kind does not need is left at its default and ignored.

    Attributes
    ----------
    kind : the manoeuvre.
    duration_s : how long it is flown.
    span_m : the aircraft's wing span.
    rest_height_m : height of the nose above the runway at rest.
    wheels_behind_nose_m : distance from the main wheels (or skids) forward to the nose.
    speed_m_s : over ground, on the approach and in the climb.
    event_s : when the aircraft touches down (landing, touch-and-go), is lowest (go-around), is level (low pass),
        releases its brakes (take-off) or begins its turn (circuit).
    event_y_m : where its wheels are then; of a circuit, where its turn ends.
    offset_x_m : how far to the right of the runway's middle its track is.
    away : a low pass leads away from the stations instead of towards them.
    glide_rad : slope of the descent.
    climb_rad : slope of the climb.
    normal_acceleration_m_s2 : largest acceleration of flare and pull-up.
    lowest_m : height of the wheels at the lowest point of go-around and low pass.
    level_s : length of a low pass's level part and of a touch-and-go's roll.
    touch_down_speed_share : of ``speed_m_s``, left after the flare.
    sink_m_s : rate of descent at touch-down.
    braking_m_s2 : largest deceleration of the roll.
    thrust_m_s2 : largest acceleration of the take-off run.
    incidence_rad : of the body to the path in the air.
    flare_incidence_rad : the same at touch-down and lift-off.
    crab_rad : the body's yaw, nose to the right positive, from a track along the runway, made by crosswind.
    gust_m_s2 : one sigma of the gusts' sideways acceleration.
    wobble_rad : one sigma of the roll that gusts cause; pitch and yaw have half of it.
    circuit_side : where the circuit is flown.
    circuit_radius_m : of its turn.
    circuit_turn_rad : angle of the turn, which ends along the runway, towards the stations.
    circuit_height_m : height of the wheels until the turn ends and the descent begins.
    way_points : of a path: where the nose is at which time; ``crab_rad``, ``incidence_rad`` and wobble are added to
        the angles that follow from it.
    """

    kind: FlightKind = FlightKind.LANDING
    duration_s: float = 20.0
    span_m: float = 2.3
    rest_height_m: float = 0.4
    wheels_behind_nose_m: float = 0.7
    speed_m_s: float = 18.0
    event_s: float = 12.0
    event_y_m: float = 130.0
    offset_x_m: float = 0.0
    away: bool = False
    glide_rad: float = math.radians(3.5)
    climb_rad: float = math.radians(10.0)
    normal_acceleration_m_s2: float = 3.0
    lowest_m: float = 3.0
    level_s: float = 3.0
    touch_down_speed_share: float = 0.9
    sink_m_s: float = 0.3
    braking_m_s2: float = 3.0
    thrust_m_s2: float = 4.0
    incidence_rad: float = math.radians(4.0)
    flare_incidence_rad: float = math.radians(7.0)
    crab_rad: float = 0.0
    gust_m_s2: float = 0.0
    wobble_rad: float = 0.0
    circuit_side: CircuitSide = CircuitSide.LEFT
    circuit_radius_m: float = 60.0
    circuit_turn_rad: float = math.pi
    circuit_height_m: float = 40.0
    way_points: tuple[WayPoint, ...] = ()

    def __post_init__(self) -> None:
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            within = math.isfinite(value) and low <= value <= high
            require(within, f"FlightSpec: {name}", got=value, wanted=f"a number from {low:g} to {high:g}")
        if self.kind is FlightKind.PATH:
            check_way_points(self.way_points, self.duration_s)
            return
        inside = self.event_s <= self.duration_s
        wanted = f"at most duration_s = {self.duration_s:g}"
        require(inside, "FlightSpec: event_s", got=self.event_s, wanted=wanted)
        if self.kind in (FlightKind.LANDING, FlightKind.TOUCH_AND_GO):
            fastest = self.speed_m_s * self.touch_down_speed_share * math.sin(self.glide_rad)
            wanted = f"at most {fastest:g} m/s, the rate of descent of the glide at touch-down speed"
            require(self.sink_m_s <= fastest, "FlightSpec: sink_m_s", got=self.sink_m_s, wanted=wanted)
        if self.kind is FlightKind.CIRCUIT:
            least = self.speed_m_s**2 / (GRAVITY_M_S2 * math.tan(MAX_BANK_RAD))
            wanted = f"at least {least:.2f} m, which takes {math.degrees(MAX_BANK_RAD):g}° of bank"
            flyable = self.bank_rad <= MAX_BANK_RAD + _BANK_TOLERANCE_RAD
            require(flyable, "FlightSpec: circuit_radius_m", got=self.circuit_radius_m, wanted=wanted)

    @property
    def bank_rad(self) -> float:
        """Bank of the circuit's coordinated turn, rad: tan(bank) = v² / (g r)."""
        return math.atan2(self.speed_m_s**2, GRAVITY_M_S2 * self.circuit_radius_m)
