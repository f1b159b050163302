"""Profiles of each kind of flight: speed, slope, rate of turn, incidence and crab over time."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from groundstation.simulation.drawn_flights.flight_spec import CircuitSide, FlightKind, FlightSpec
from groundstation.simulation.drawn_flights.profile import Profile, Ramp, inverse_smooth_step

# headings of the track, clockwise from +y as seen from above
TOWARDS_RAD, AWAY_RAD = math.pi, 0.0
# no change of slope is quicker, s
_QUICKEST_S = 0.8
# the legs' springs take up the last sink; no velocity steps
_SPRINGS_S = 0.25
_ROTATION_S = 1.0
_LOWERING_S = 1.2
# the brakes are used so long after touch-down, with all wheels on the ground
_BRAKES_AFTER_S = 0.7
# crosswind is taken out within the last seconds of the flare, and taken up again after lift-off
_ALIGNING_S, _ALIGNED_BEFORE_S = 1.5, 0.1
_TURNING_INTO_WIND_S = 2.0
# of the climb's speed: the stall's speed times 1.1 over times 1.3
_LIFT_OFF_SHARE = 0.85
# rate of roll into and out of a turn: mean of a light aircraft's, rad/s
_ROLL_RAD_S = math.radians(25.0)
_STRAIGHT, _WHOLE = Profile(first=0.0), Profile(first=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvre:
    """The profiles of a flight, and where it is at one time; runway frame.

    Attributes
    ----------
    speed : m/s. ``slope`` : rad, up positive. ``turn_rate`` : rad/s, right positive. ``incidence`` : rad.
    crab : share of the crab angle that is flown.
    heading_rad : the track's first direction, clockwise from +y.
    anchor_s : when the wheels are at ``anchor_y_m``. ``height_s`` : when they are at ``height_m``.
    """

    speed: Profile
    slope: Profile
    incidence: Profile
    turn_rate: Profile = _STRAIGHT
    crab: Profile = _WHOLE
    heading_rad: float = TOWARDS_RAD
    anchor_s: float
    anchor_y_m: float
    height_s: float
    height_m: float = 0.0


def manoeuvre_of(spec: FlightSpec) -> Manoeuvre:
    """Return what a flight does."""
    return _MANOEUVRES[spec.kind](spec)


def _pull(spec: FlightSpec, change_rad: float) -> float:
    """Return how long a change of slope takes, s."""
    return max(_QUICKEST_S, 1.5 * spec.speed_m_s * abs(change_rad) / spec.normal_acceleration_m_s2)


@dataclass(frozen=True, slots=True, kw_only=True)
class _TouchDown:
    """The ramps of a glide, its flare and the lowering of the nose; the speed at touch-down, m/s."""

    slope: tuple[Ramp, ...]
    speed: Ramp
    incidence: tuple[Ramp, ...]
    crab: Ramp
    speed_m_s: float


def _touch_down(spec: FlightSpec) -> _TouchDown:
    touched = spec.event_s
    slow = spec.speed_m_s * spec.touch_down_speed_share
    sinking_rad = math.asin(spec.sink_m_s / slow)
    flare_s = _pull(spec, spec.glide_rad - sinking_rad)
    flared = touched - _SPRINGS_S
    risen = spec.flare_incidence_rad - spec.incidence_rad
    return _TouchDown(
        slope=(
            Ramp(start_s=flared - flare_s, length_s=flare_s, change=spec.glide_rad - sinking_rad),
            Ramp(start_s=flared, length_s=_SPRINGS_S, change=sinking_rad),
        ),
        speed=Ramp(start_s=flared - flare_s, length_s=flare_s + _SPRINGS_S, change=slow - spec.speed_m_s),
        incidence=(
            Ramp(start_s=flared - flare_s, length_s=flare_s, change=risen),
            Ramp(start_s=touched + 0.1, length_s=_LOWERING_S, change=-spec.flare_incidence_rad),
        ),
        crab=Ramp(start_s=touched - _ALIGNED_BEFORE_S - _ALIGNING_S, length_s=_ALIGNING_S, change=-1.0),
        speed_m_s=slow,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _LiftOff:
    """The ramps of a rotation and the climb after it."""

    slope: Ramp
    incidence: tuple[Ramp, ...]
    crab: Ramp


def _lift_off(spec: FlightSpec, rotation_s: float) -> _LiftOff:
    lifted = rotation_s + 0.5 * _ROTATION_S
    climb_s = _pull(spec, spec.climb_rad)
    settled = spec.incidence_rad - spec.flare_incidence_rad
    return _LiftOff(
        slope=Ramp(start_s=lifted, length_s=climb_s, change=spec.climb_rad),
        incidence=(
            Ramp(start_s=rotation_s, length_s=_ROTATION_S, change=spec.flare_incidence_rad),
            Ramp(start_s=lifted + 0.5 * climb_s, length_s=climb_s, change=settled),
        ),
        crab=Ramp(start_s=lifted + 0.5, length_s=_TURNING_INTO_WIND_S, change=1.0),
    )


def _landing(spec: FlightSpec) -> Manoeuvre:
    down = _touch_down(spec)
    braking_s = 1.5 * down.speed_m_s / spec.braking_m_s2
    brakes = Ramp(start_s=spec.event_s + _BRAKES_AFTER_S, length_s=braking_s, change=-down.speed_m_s)
    return Manoeuvre(
        speed=Profile(first=spec.speed_m_s, ramps=(down.speed, brakes)),
        slope=Profile(first=-spec.glide_rad, ramps=down.slope),
        incidence=Profile(first=spec.incidence_rad, ramps=down.incidence),
        crab=Profile(first=1.0, ramps=(down.crab,)),
        anchor_s=spec.event_s,
        anchor_y_m=spec.event_y_m,
        height_s=spec.event_s,
    )


def _touch_and_go(spec: FlightSpec) -> Manoeuvre:
    down, up = _touch_down(spec), _lift_off(spec, spec.event_s + spec.level_s)
    gain = spec.speed_m_s - down.speed_m_s
    length_s = max(spec.level_s + _ROTATION_S, 1.5 * gain / spec.thrust_m_s2)
    thrust = Ramp(start_s=spec.event_s + 0.3, length_s=length_s, change=gain)
    return Manoeuvre(
        speed=Profile(first=spec.speed_m_s, ramps=(down.speed, thrust)),
        slope=Profile(first=-spec.glide_rad, ramps=(*down.slope, up.slope)),
        incidence=Profile(first=spec.incidence_rad, ramps=(*down.incidence, *up.incidence)),
        crab=Profile(first=1.0, ramps=(down.crab, up.crab)),
        anchor_s=spec.event_s,
        anchor_y_m=spec.event_y_m,
        height_s=spec.event_s,
    )


def _go_around(spec: FlightSpec) -> Manoeuvre:
    change = spec.glide_rad + spec.climb_rad
    pull_s = _pull(spec, change)
    # the slope is zero, and the aircraft lowest, at event_s
    level = inverse_smooth_step(spec.glide_rad / change) if change > 0.0 else 0.5
    pull = Ramp(start_s=spec.event_s - level * pull_s, length_s=pull_s, change=change)
    return Manoeuvre(
        speed=Profile(first=spec.speed_m_s),
        slope=Profile(first=-spec.glide_rad, ramps=(pull,)),
        incidence=Profile(first=spec.incidence_rad),
        anchor_s=spec.event_s,
        anchor_y_m=spec.event_y_m,
        height_s=spec.event_s,
        height_m=spec.lowest_m,
    )


def _low_pass(spec: FlightSpec) -> Manoeuvre:
    out_s, up_s = _pull(spec, spec.glide_rad), _pull(spec, spec.climb_rad)
    return Manoeuvre(
        speed=Profile(first=spec.speed_m_s),
        slope=Profile(
            first=-spec.glide_rad,
            ramps=(
                Ramp(start_s=spec.event_s - out_s, length_s=out_s, change=spec.glide_rad),
                Ramp(start_s=spec.event_s + spec.level_s, length_s=up_s, change=spec.climb_rad),
            ),
        ),
        incidence=Profile(first=spec.incidence_rad),
        heading_rad=AWAY_RAD if spec.away else TOWARDS_RAD,
        anchor_s=spec.event_s,
        anchor_y_m=spec.event_y_m,
        height_s=spec.event_s,
        height_m=spec.lowest_m,
    )


def _take_off(spec: FlightSpec) -> Manoeuvre:
    run_s = 1.5 * spec.speed_m_s / spec.thrust_m_s2
    up = _lift_off(spec, spec.event_s + inverse_smooth_step(_LIFT_OFF_SHARE) * run_s)
    away = spec.kind is FlightKind.TAKE_OFF_AWAY
    return Manoeuvre(
        speed=Profile(first=0.0, ramps=(Ramp(start_s=spec.event_s, length_s=run_s, change=spec.speed_m_s),)),
        slope=Profile(first=0.0, ramps=(up.slope,)),
        incidence=Profile(first=0.0, ramps=up.incidence),
        crab=Profile(first=0.0, ramps=(up.crab,)),
        heading_rad=AWAY_RAD if away else TOWARDS_RAD,
        anchor_s=spec.event_s,
        anchor_y_m=spec.event_y_m,
        height_s=spec.event_s,
    )


def circuit_end_s(spec: FlightSpec) -> float:
    """Return when a circuit's turn has ended and its wings are level again, s."""
    return spec.event_s + _turn_s(spec) + _roll_s(spec)


def _turn_s(spec: FlightSpec) -> float:
    return spec.circuit_turn_rad * spec.circuit_radius_m / spec.speed_m_s


def _roll_s(spec: FlightSpec) -> float:
    """Return how long it takes to roll into the turn, s; the two halves of a short turn do not overlap."""
    return min(max(0.5, spec.bank_rad / _ROLL_RAD_S), _turn_s(spec))


def _circuit(spec: FlightSpec) -> Manoeuvre:
    # on the left, a right turn leads to the runway's middle
    sense = 1.0 if spec.circuit_side is CircuitSide.LEFT else -1.0
    rate = sense * spec.speed_m_s / spec.circuit_radius_m
    turn_s, roll_s = _turn_s(spec), _roll_s(spec)
    descent_s = _pull(spec, spec.glide_rad)
    return Manoeuvre(
        speed=Profile(first=spec.speed_m_s),
        slope=Profile(
            first=0.0, ramps=(Ramp(start_s=spec.event_s + turn_s, length_s=descent_s, change=-spec.glide_rad),)
        ),
        incidence=Profile(first=spec.incidence_rad),
        turn_rate=Profile(
            first=0.0,
            ramps=(
                Ramp(start_s=spec.event_s, length_s=roll_s, change=rate),
                Ramp(start_s=spec.event_s + turn_s, length_s=roll_s, change=-rate),
            ),
        ),
        heading_rad=TOWARDS_RAD - sense * spec.circuit_turn_rad,
        anchor_s=circuit_end_s(spec),
        anchor_y_m=spec.event_y_m,
        height_s=spec.event_s,
        height_m=spec.circuit_height_m,
    )


_MANOEUVRES: dict[FlightKind, Callable[[FlightSpec], Manoeuvre]] = {
    FlightKind.LANDING: _landing,
    FlightKind.GO_AROUND: _go_around,
    FlightKind.TOUCH_AND_GO: _touch_and_go,
    FlightKind.TAKE_OFF_TOWARDS: _take_off,
    FlightKind.TAKE_OFF_AWAY: _take_off,
    FlightKind.CIRCUIT: _circuit,
    FlightKind.LOW_PASS: _low_pass,
}
