"""Random draw of a flight: a kind, a speed that fits the span, and a place within the stations' view."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.drawn_flights.flight_spec import (
    DRAWN_KINDS,
    MAX_BANK_RAD,
    CircuitSide,
    FlightKind,
    FlightSpec,
)
from groundstation.simulation.drawn_flights.manoeuvre import circuit_end_s
from groundstation.simulation.parameter_checks import require, require_positive

# approach speed over √span: 15 to 22 m/s for 2.3 m, as Froude's law scales it, at light and heavy wing loadings
_SPEED_PER_ROOT_SPAN = (9.5, 14.5)
_SPEEDS_M_S = (10.0, 35.0)
# of low-winged and tail-heavy airframes alike, the main wheels are about a third of the span behind the nose
_WHEELS_PER_SPAN = (0.25, 0.4)
_GLIDE_DEG = (2.0, 8.0)
_CLIMB_DEG = (5.0, 15.0)
_CRAB_DEG = 15.0
_WIDEST_TURN_M = 180.0
# a model aircraft's propeller gives half of its weight
_MOST_THRUST_M_S2 = 5.0
# no flight ends nearer to the stations than this: they are on either side of the runway
_NEAREST_M = 35.0


def draw_flight(
    generator: np.random.Generator,
    span_m: float,
    rest_height_m: float,
    duration_s: float = 20.0,
    kinds: Sequence[FlightKind] = DRAWN_KINDS,
) -> FlightSpec:
    """Draw one of ``kinds``, all equally likely, for an aircraft of a span with its nose at rest at a height, m."""
    require_positive("draw_flight: span_m", span_m)
    require(len(kinds) > 0, "draw_flight: kinds", got="none", wanted="one or more")
    kind = kinds[int(generator.integers(len(kinds)))]
    low, high = (share * math.sqrt(span_m) for share in _SPEED_PER_ROOT_SPAN)
    incidence_deg = generator.uniform(2.0, 6.0)
    # every second flight has little wind across
    crab_deg = generator.uniform(-_CRAB_DEG, _CRAB_DEG) * (1.0 if generator.uniform() < 0.5 else 0.2)
    drawn = FlightSpec(
        kind=kind,
        duration_s=duration_s,
        span_m=span_m,
        rest_height_m=rest_height_m,
        wheels_behind_nose_m=span_m * generator.uniform(*_WHEELS_PER_SPAN),
        speed_m_s=float(np.clip(generator.uniform(low, high), *_SPEEDS_M_S)),
        event_s=0.0,
        offset_x_m=generator.uniform(-1.5, 1.5),
        glide_rad=math.radians(generator.uniform(*_GLIDE_DEG)),
        climb_rad=math.radians(generator.uniform(*_CLIMB_DEG)),
        normal_acceleration_m_s2=generator.uniform(2.0, 4.0),
        lowest_m=generator.uniform(1.0, 12.0),
        incidence_rad=math.radians(incidence_deg),
        flare_incidence_rad=math.radians(incidence_deg + generator.uniform(2.0, 5.0)),
        crab_rad=math.radians(crab_deg),
        gust_m_s2=generator.uniform(0.0, 0.9),
        wobble_rad=math.radians(generator.uniform(0.2, 2.0)),
        sink_m_s=0.0,
        circuit_radius_m=_WIDEST_TURN_M,
    )
    return _PLACED[kind](generator, drawn)


def _landing(generator: np.random.Generator, drawn: FlightSpec) -> FlightSpec:
    share = generator.uniform(0.85, 0.98)
    touched = share * drawn.speed_m_s
    braking = generator.uniform(2.0, 4.5)
    # what the roll takes, with its start unbraked
    roll_m = 0.7 * touched + 0.75 * touched**2 / braking
    return replace(
        drawn,
        event_s=drawn.duration_s * generator.uniform(0.5, 0.75),
        event_y_m=max(generator.uniform(100.0, 150.0), _NEAREST_M + roll_m),
        touch_down_speed_share=share,
        sink_m_s=_sink(generator, drawn, touched),
        braking_m_s2=braking,
    )


def _sink(generator: np.random.Generator, drawn: FlightSpec, touched_m_s: float) -> float:
    """Draw the rate of descent at touch-down: the flare takes away half of the glide's or more."""
    return min(generator.uniform(0.1, 0.7), 0.5 * touched_m_s * math.sin(drawn.glide_rad))


def _ahead(generator: np.random.Generator, drawn: FlightSpec, event_s: float, usual_m: tuple[float, float]) -> float:
    """Draw y of an event after which the aircraft flies on towards the stations until the end."""
    left_m = drawn.speed_m_s * (drawn.duration_s - event_s)
    return max(generator.uniform(*usual_m), _NEAREST_M + generator.uniform(0.0, 40.0) + left_m)


def _touch_and_go(generator: np.random.Generator, drawn: FlightSpec) -> FlightSpec:
    share = generator.uniform(0.85, 0.98)
    event_s = drawn.duration_s * generator.uniform(0.4, 0.6)
    return replace(
        drawn,
        event_s=event_s,
        event_y_m=_ahead(generator, drawn, event_s, (110.0, 180.0)),
        touch_down_speed_share=share,
        sink_m_s=_sink(generator, drawn, share * drawn.speed_m_s),
        level_s=generator.uniform(1.0, 3.0),
        thrust_m_s2=generator.uniform(2.0, 4.0),
    )


def _go_around(generator: np.random.Generator, drawn: FlightSpec) -> FlightSpec:
    event_s = drawn.duration_s * generator.uniform(0.45, 0.7)
    return replace(drawn, event_s=event_s, event_y_m=_ahead(generator, drawn, event_s, (90.0, 250.0)))


def _low_pass(generator: np.random.Generator, drawn: FlightSpec) -> FlightSpec:
    away = bool(generator.uniform() < 0.3)
    event_s = drawn.duration_s * (generator.uniform(0.1, 0.25) if away else generator.uniform(0.25, 0.45))
    y_m = _NEAREST_M + generator.uniform(0.0, 30.0) + drawn.speed_m_s * event_s
    return replace(
        drawn,
        away=away,
        event_s=event_s,
        event_y_m=y_m if away else _ahead(generator, drawn, event_s, (200.0, 300.0)),
        level_s=drawn.duration_s * generator.uniform(0.15, 0.4),
    )


def _take_off(generator: np.random.Generator, drawn: FlightSpec) -> FlightSpec:
    # a heavy aircraft needs its time; it shall be in the air for the last third, unless that takes a catapult
    least = 1.5 * drawn.speed_m_s / (0.6 * drawn.duration_s)
    thrust = max(generator.uniform(2.5, 4.5), min(least, _MOST_THRUST_M_S2))
    event_s = drawn.duration_s * generator.uniform(0.03, 0.15)
    flown_m = drawn.speed_m_s * max(drawn.duration_s - event_s - 0.75 * drawn.speed_m_s / thrust, 0.0)
    if drawn.kind is FlightKind.TAKE_OFF_AWAY:
        y_m = generator.uniform(25.0, 50.0)
    else:
        y_m = _NEAREST_M + generator.uniform(0.0, 60.0) + flown_m
    return replace(drawn, event_s=event_s, event_y_m=y_m, thrust_m_s2=thrust)


def _circuit(generator: np.random.Generator, drawn: FlightSpec) -> FlightSpec:
    speed = drawn.speed_m_s
    bank_rad = max(generator.uniform(math.radians(15.0), MAX_BANK_RAD), _bank_rad(speed, _WIDEST_TURN_M))
    radius_m = speed**2 / (GRAVITY_M_S2 * math.tan(min(bank_rad, MAX_BANK_RAD)))
    # the final is the rest of the flight after the turn; a wide turn is shortened
    longest_rad = 0.6 * drawn.duration_s * speed / radius_m
    turned = replace(
        drawn,
        event_s=drawn.duration_s * generator.uniform(0.05, 0.2),
        circuit_side=CircuitSide.LEFT if generator.uniform() < 0.5 else CircuitSide.RIGHT,
        circuit_radius_m=radius_m,
        circuit_turn_rad=min(math.radians(generator.uniform(90.0, 200.0)), longest_rad),
    )
    final_m = speed * max(drawn.duration_s - circuit_end_s(turned), 0.0)
    return replace(
        turned,
        event_y_m=max(generator.uniform(90.0, 200.0), _NEAREST_M + generator.uniform(0.0, 40.0) + final_m),
        # the descent begins while the wings are levelled, within two seconds of the end of the turn
        circuit_height_m=math.tan(drawn.glide_rad) * (final_m + 2.0 * speed) + generator.uniform(6.0, 30.0),
    )


def _bank_rad(speed_m_s: float, radius_m: float) -> float:
    return math.atan2(speed_m_s**2, GRAVITY_M_S2 * radius_m)


_PLACED: dict[FlightKind, Callable[[np.random.Generator, FlightSpec], FlightSpec]] = {
    FlightKind.LANDING: _landing,
    FlightKind.GO_AROUND: _go_around,
    FlightKind.TOUCH_AND_GO: _touch_and_go,
    FlightKind.TAKE_OFF_TOWARDS: _take_off,
    FlightKind.TAKE_OFF_AWAY: _take_off,
    FlightKind.CIRCUIT: _circuit,
    FlightKind.LOW_PASS: _low_pass,
}
