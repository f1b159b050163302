"""Drawn flights: physical limits, attitude consistent with the track, places within a ground station's view."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from groundstation.errors import ConfigError, ScenarioError
from groundstation.files.toml_table import TomlTable
from groundstation.simulation.attitude import GRAVITY_M_S2
from groundstation.simulation.drawn_flights import (
    DRAWN_KINDS,
    CircuitSide,
    DrawnFlight,
    FlightKind,
    FlightSpec,
    build_flight,
    draw_flight,
)
from groundstation.simulation.drawn_flights.manoeuvre import circuit_end_s
from groundstation.simulation.drawn_flights.profile import inverse_smooth_step, smooth_step
from groundstation.simulation.specification_table import read_specification, rounded, specification_table
from groundstation.simulation.trajectory import OrientedTrajectory
from tests.complaints import complaint

DURATION_S = 20.0
T = np.linspace(0.0, DURATION_S, 1001)
COARSE = T[::10]
KINDS = DRAWN_KINDS
ON_WHEELS = (FlightKind.LANDING, FlightKind.TOUCH_AND_GO, FlightKind.TAKE_OFF_AWAY, FlightKind.TAKE_OFF_TOWARDS)


def drawn(seed: int, kind: FlightKind) -> FlightSpec:
    generator = np.random.default_rng([seed, 7])
    span_m = generator.uniform(1.2, 6.0)
    return draw_flight(generator, span_m, 0.16 * span_m, DURATION_S, (kind,))


@lru_cache
def flights(kind: FlightKind) -> tuple[DrawnFlight, ...]:
    return tuple(build_flight(drawn(seed, kind), seed) for seed in range(30))


def quiet(kind: FlightKind, seed: int = 3, **changes: object) -> DrawnFlight:
    return build_flight(replace(drawn(seed, kind), gust_m_s2=0.0, wobble_rad=0.0, **changes), seed)  # type: ignore[arg-type]


def axes(flight: DrawnFlight, t_s: np.ndarray) -> np.ndarray:
    """Return the body's axes (n, 3, 3) in the runway frame, a column each: forward, right, down."""
    return np.array([flight.attitude(float(t)) for t in t_s])


def wheels(flight: DrawnFlight, t_s: np.ndarray = COARSE) -> np.ndarray:
    spec = flight.spec
    to_nose = np.array([spec.wheels_behind_nose_m, 0.0, -spec.rest_height_m])
    return flight.position(t_s) - axes(flight, t_s) @ to_nose


@pytest.mark.parametrize("kind", KINDS)
def test_no_flight_breaks_physical_limits(kind: FlightKind) -> None:
    """Expected of 210 flights: below 1.5 g, slower than 1.05 of their speed and its gusts, never under the runway."""
    for flight in flights(kind):
        spec = flight.spec
        velocity = flight.velocity(T)
        acceleration = np.gradient(velocity, T, axis=0)
        assert np.linalg.norm(acceleration, axis=1).max() < 1.5 * GRAVITY_M_S2
        assert np.linalg.norm(velocity, axis=1).max() < spec.speed_m_s + 8.0 * spec.gust_m_s2 + 0.5
        assert flight.position(T)[:, 2].min() > spec.rest_height_m - 1e-4
        assert wheels(flight)[:, 2].min() > -1e-3
        assert 10.0 <= spec.speed_m_s <= 35.0
        assert 9.5 <= spec.speed_m_s / math.sqrt(spec.span_m) <= 14.5


@pytest.mark.parametrize("kind", KINDS)
def test_position_and_velocity_belong_together(kind: FlightKind) -> None:
    for flight in flights(kind)[:5]:
        middle, half_s = T[1:-1] + 0.003, 5e-4
        slope = (flight.position(middle + half_s) - flight.position(middle - half_s)) / (2.0 * half_s)
        assert np.abs(flight.velocity(middle) - slope).max() <= 0.02
        assert np.abs(np.diff(flight.velocity(T), axis=0)).max() < 1.5 * GRAVITY_M_S2 * (T[1] - T[0])


@pytest.mark.parametrize("kind", KINDS)
def test_the_stations_see_it(kind: FlightKind) -> None:
    """Expected: in front of the stations all the time, within 800 m, mostly within 45° of the runway's direction."""
    ahead = []
    for flight in flights(kind):
        x, y, z = flight.position(T).T
        assert y.min() > 15.0
        assert np.hypot(x, y).max() < 800.0
        assert z.max() < 100.0
        ahead.append(np.mean(np.abs(x) < y))
    assert np.mean(ahead) > 0.7


@pytest.mark.parametrize("kind", KINDS)
def test_the_attitude_is_a_rotation(kind: FlightKind) -> None:
    for flight in flights(kind)[:10]:
        body = axes(flight, T[::20])
        assert body @ body.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (len(body), 1, 1)), abs=1e-12)
        assert np.linalg.det(body) == pytest.approx(1.0)
        # wings and belly: nothing flies upside down
        assert body[:, 2, 2].max() < -0.7
        assert isinstance(flight, OrientedTrajectory)


def yaw_from_track(flight: DrawnFlight, t_s: float) -> float:
    """Return how far the nose points to the right of the track, rad."""
    forward, track = flight.attitude(t_s)[:, 0], flight.velocity(np.array([t_s]))[0]
    return math.atan2(forward[0] * track[1] - forward[1] * track[0], forward[:2] @ track[:2])


@pytest.mark.parametrize("crab_deg", [-15.0, 0.0, 8.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_crab_is_the_one_asked_for(kind: FlightKind, crab_deg: float) -> None:
    flight = quiet(kind, crab_rad=math.radians(crab_deg))
    moment = {
        FlightKind.CIRCUIT: circuit_end_s(flight.spec) + 0.2,
        FlightKind.TAKE_OFF_AWAY: 19.0,
        FlightKind.TAKE_OFF_TOWARDS: 19.0,
    }.get(kind, 1.0)
    assert math.degrees(yaw_from_track(flight, moment)) == pytest.approx(crab_deg, abs=0.15)


def test_an_aircraft_is_aligned_when_it_touches() -> None:
    flight = quiet(FlightKind.LANDING, crab_rad=math.radians(12.0))
    assert yaw_from_track(flight, flight.spec.event_s) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_the_bank_is_that_of_a_coordinated_turn(seed: int) -> None:
    """Expected: bank = atan(v² / (g r)), with r and the side from the track itself."""
    flight = quiet(FlightKind.CIRCUIT, seed=seed, crab_rad=0.0)
    spec = flight.spec
    middle = 0.5 * (spec.event_s + circuit_end_s(spec))
    (vx, vy, _), dt = flight.velocity(np.array([middle]))[0], 0.05
    around = flight.velocity(np.array([middle - dt, middle + dt]))
    ax, ay, _ = (around[1] - around[0]) / (2.0 * dt)
    speed = math.hypot(vx, vy)
    curvature = (ax * vy - ay * vx) / speed**3
    assert abs(curvature) == pytest.approx(1.0 / spec.circuit_radius_m, rel=0.02)
    body = flight.attitude(middle)
    bank = math.atan2(body[2, 1], body[2, 2])
    # right of the track is +, and so is the right wing down: its axis then points below the horizon
    assert math.pi - abs(bank) == pytest.approx(math.atan(speed**2 * abs(curvature) / GRAVITY_M_S2), abs=0.01)
    assert math.pi - abs(bank) == pytest.approx(spec.bank_rad, abs=0.01)
    assert np.sign(-body[2, 1]) == np.sign(curvature)
    assert (spec.circuit_side is CircuitSide.LEFT) == (curvature > 0.0)
    assert np.sign(flight.position(np.array([0.0]))[0, 0]) == (-1.0 if curvature > 0.0 else 1.0)


def test_the_nose_rises_by_slope_and_incidence() -> None:
    flight = quiet(FlightKind.LOW_PASS)
    spec = flight.spec
    pitch = [math.asin(flight.attitude(t)[2, 0]) for t in (0.5, spec.event_s + 0.5, 19.9)]
    glide, level, climb = -spec.glide_rad, 0.0, spec.climb_rad
    assert pitch == pytest.approx([slope + spec.incidence_rad for slope in (glide, level, climb)], abs=1e-3)


def test_a_landing_touches_where_and_as_it_was_asked_for() -> None:
    flight = quiet(FlightKind.LANDING, event_s=11.0, event_y_m=123.0, sink_m_s=0.25)
    path, spec = wheels(flight, T), flight.spec
    down = int(np.searchsorted(T, 11.0))
    assert path[down, 1] == pytest.approx(123.0, abs=0.05)
    assert path[down:, 2] == pytest.approx(0.0, abs=1e-3)
    before = int(np.searchsorted(T, 10.7))
    assert (path[before + 1, 2] - path[before, 2]) / (T[1] - T[0]) == pytest.approx(-0.25, abs=0.02)
    assert path[before, 2] > 0.03
    # in the flare the nose is up
    assert flight.attitude(10.9)[2, 0] > math.sin(0.8 * spec.flare_incidence_rad)


@pytest.mark.parametrize("kind", ON_WHEELS)
def test_wheels_are_level_on_the_runway(kind: FlightKind) -> None:
    for flight in flights(kind)[:10]:
        path, body = wheels(flight), axes(flight, COARSE)
        rolling = path[:, 2] < 1e-4
        assert rolling.any()
        assert np.abs(body[rolling, 2, 1]).max() < 1e-3
        # on three wheels but for the rotation and the lowering of the nose
        assert body[rolling, 2, 0].min() > -1e-6
        assert kind is FlightKind.TOUCH_AND_GO or body[rolling, 2, 0].min() < 1e-6


def test_a_go_around_is_lowest_at_its_event() -> None:
    flight = quiet(FlightKind.GO_AROUND, lowest_m=2.5, event_y_m=300.0)
    path = wheels(flight, T)
    lowest = int(np.argmin(path[:, 2]))
    assert T[lowest] == pytest.approx(flight.spec.event_s, abs=0.05)
    assert path[lowest, 1:] == pytest.approx([300.0, 2.5], abs=1.5)
    assert path[lowest, 2] == pytest.approx(2.5, abs=1e-2)


def test_gusts_have_their_size_in_the_air_and_none_on_the_ground() -> None:
    spec = replace(drawn(1, FlightKind.LANDING), gust_m_s2=0.8, wobble_rad=math.radians(2.0))
    calm = build_flight(replace(spec, gust_m_s2=0.0, wobble_rad=0.0), 0)
    rolls, moved = [], []
    for seed in range(12):
        flight = build_flight(spec, seed)
        rolls.append(flight.angles(T[:300])[:, 2])
        moved.append(flight.position(T) - calm.position(T))
    # roll has the wobble's size, and what holds the path against gusts besides
    assert 1.5 < math.degrees(np.std(rolls)) < 6.0
    assert 0.5 < np.std(np.array(moved)[:, :300, 0]) < 4.0
    assert np.abs(np.array(moved)[:, spec.event_s + 0.1 < T, 0]).max() < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_flight(kind: FlightKind) -> None:
    spec = drawn(4, kind)
    assert spec == drawn(4, kind)
    assert spec != drawn(5, kind)
    one, two, other = (build_flight(spec, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.position(T), two.position(T))
    assert np.array_equal(one.attitude(7.0), two.attitude(7.0))
    assert not np.array_equal(one.position(T), other.position(T))


@pytest.mark.parametrize("kind", KINDS)
def test_flights_survive_their_file(kind: FlightKind) -> None:
    """Expected: with the six digits of a file, every drawn flight is still one, and is read as it was written."""
    for seed in range(100):
        spec = rounded(drawn(seed, kind))
        assert read_specification(FlightSpec, TomlTable(specification_table(spec), "w", ConfigError)) == spec


def test_circuits_are_flown_on_both_sides() -> None:
    left = [drawn(seed, FlightKind.CIRCUIT).circuit_side is CircuitSide.LEFT for seed in range(100)]
    assert 30 < sum(left) < 70


def test_every_kind_is_drawn() -> None:
    generator = np.random.default_rng(0)
    kinds = {draw_flight(generator, 2.3, 0.4).kind for _ in range(100)}
    assert kinds == set(KINDS)


@pytest.mark.parametrize("duration_s", [4.0, 60.0])
def test_other_durations_are_flown(duration_s: float) -> None:
    generator = np.random.default_rng(1)
    for kind in KINDS:
        flight = build_flight(draw_flight(generator, 2.3, 0.4, duration_s, (kind,)), 0)
        assert flight.span_s == (0.0, duration_s)


def test_a_smooth_step_is_inverted() -> None:
    shares = np.linspace(0.0, 1.0, 11)
    assert [inverse_smooth_step(float(v)) for v in smooth_step(shares)] == pytest.approx(shares, abs=1e-7)


@pytest.mark.parametrize(
    ("make", "reported"),
    [
        (lambda: FlightSpec(speed_m_s=100.0), "speed_m_s: got 100.0; wanted a number from 5 to 60"),
        (lambda: FlightSpec(glide_rad=math.nan), "glide_rad: got nan"),
        (lambda: FlightSpec(event_s=21.0), "event_s: got 21.0; wanted at most duration_s = 20"),
        (lambda: FlightSpec(sink_m_s=2.5), "sink_m_s: got 2.5; wanted at most 0.98"),
        (lambda: FlightSpec(kind=FlightKind.CIRCUIT, circuit_radius_m=30.0), "wanted at least 47.17 m"),
        (lambda: draw_flight(np.random.default_rng(0), -1.0, 0.1), "span_m: got -1.0"),
        (lambda: draw_flight(np.random.default_rng(0), 2.0, 0.1, kinds=()), "kinds: got none"),
        (lambda: build_flight(FlightSpec(), -1), "seed: got -1"),
        (
            lambda: build_flight(FlightSpec(kind=FlightKind.CIRCUIT, event_s=1.0, circuit_height_m=2.0), 0),
            "under the runway",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused(make: Callable[[], object], reported: str) -> None:
    assert reported in complaint(ScenarioError, make)
