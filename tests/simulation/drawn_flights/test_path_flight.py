"""Flights along way points: the path goes through them, angles are given or follow from the path."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from groundstation.errors import ConfigError, ScenarioError
from groundstation.files.toml_table import TomlTable
from groundstation.simulation.drawn_flights import FlightKind, FlightSpec, WayPoint, build_flight
from groundstation.simulation.drawn_flights.way_point import check_way_points
from groundstation.simulation.specification_table import read_specification, specification_table
from tests.complaints import complaint

REST_M = 0.4


def line(**angles: float) -> tuple[WayPoint, ...]:
    """Return a straight descent towards the stations at 15 m/s and 1 m/s."""
    return tuple(WayPoint(t_s=t, x_m=2.0, y_m=300.0 - 15.0 * t, z_m=25.0 - t, **angles) for t in (0.0, 2.0, 5.0, 8.0))


def path(points: tuple[WayPoint, ...], **changes: float) -> FlightSpec:
    spec = FlightSpec(kind=FlightKind.PATH, duration_s=8.0, rest_height_m=REST_M, incidence_rad=0.0, way_points=points)
    return replace(spec, **changes)  # type: ignore[arg-type]


def degrees(spec: FlightSpec, t_s: float) -> list[float]:
    """Return yaw, pitch and bank at a time."""
    return [math.degrees(angle) for angle in build_flight(spec, 0).angles(t_s).tolist()]


def test_the_path_goes_through_its_way_points() -> None:
    points = tuple(
        WayPoint(t_s=0.9 * k, x_m=math.sin(k), y_m=200.0 + 13.0 * k, z_m=1.0 + 0.3 * k * k) for k in range(10)
    )
    flight = build_flight(path(points), 0)
    times = np.array([p.t_s for p in points[:-1]])
    assert flight.position(times) == pytest.approx(np.array([[p.x_m, p.y_m, p.z_m] for p in points[:-1]]), abs=1e-4)
    assert flight.span_s == (0.0, 8.0)


def test_angles_follow_from_the_path() -> None:
    assert degrees(path(line()), 4.0) == pytest.approx([180.0, math.degrees(math.atan2(-1.0, 15.0)), 0.0], abs=1e-3)
    crabbed = path(line(), crab_rad=math.radians(6.0), incidence_rad=math.radians(4.0))
    assert degrees(crabbed, 4.0)[:2] == pytest.approx([186.0, 4.0 + math.degrees(math.atan2(-1.0, 15.0))], abs=1e-3)


def test_a_turn_to_the_right_banks_to_the_right() -> None:
    radius_m, rate = 100.0, 0.15
    around = tuple(
        WayPoint(t_s=t, x_m=-radius_m * math.cos(rate * t), y_m=300.0 + radius_m * math.sin(rate * t), z_m=30.0)
        for t in np.arange(0.0, 8.5, 0.5).tolist()
    )
    bank = math.degrees(math.atan2(radius_m * rate**2, 9.81))
    assert degrees(path(around), 4.0) == pytest.approx([math.degrees(0.6), 0.0, bank], abs=0.05)


def test_given_angles_are_flown() -> None:
    given = {"yaw_rad": math.radians(171.0), "pitch_rad": math.radians(5.0), "bank_rad": math.radians(-8.0)}
    assert degrees(path(line(**given)), 3.0) == pytest.approx([171.0, 5.0, -8.0], abs=1e-6)


def test_an_aircraft_that_stands_points_where_it_will_go() -> None:
    rolling = tuple(
        WayPoint(t_s=t, x_m=0.0, y_m=40.0 + 1.5 * max(t - 3.0, 0.0) ** 2, z_m=REST_M)
        for t in np.arange(0.0, 8.5, 0.5).tolist()
    )
    flight = build_flight(path(rolling), 0)
    yaw = flight.angles(np.linspace(0.0, 8.0, 50))[:, 0]
    assert np.abs(np.degrees(yaw)).max() < 0.1
    assert flight.position(np.linspace(0.0, 8.0, 200))[:, 2].min() >= REST_M


def test_a_path_survives_its_file() -> None:
    for spec in (path(line()), path(line(yaw_rad=math.radians(171.3)))):
        table = TomlTable(specification_table(spec), "world.toml", ConfigError)
        assert read_specification(FlightSpec, table) == spec


def later(points: tuple[WayPoint, ...], by_s: float) -> tuple[WayPoint, ...]:
    return tuple(replace(point, t_s=point.t_s + by_s) for point in points)


@pytest.mark.parametrize(
    ("make", "reported"),
    [
        (lambda: path(line()[:3]), "way_points: got 3; wanted at least 4"),
        (lambda: path(line()[::-1]), "t_s: got 5; wanted later than 8"),
        (lambda: path(later(line(), 1.0)), "t_s: got 1 to 9; wanted times from 0 or before to duration_s = 8"),
        (lambda: path((*line()[:3], *line(yaw_rad=1.0)[3:])), "yaw_deg: got 1 of 4; wanted one at each way point"),
        (lambda: WayPoint(t_s=0.0, x_m=math.nan, y_m=0.0, z_m=0.0), "WayPoint: x_m: got nan"),
        (
            lambda: check_way_points([WayPoint(t_s=float(t), x_m=0.0, y_m=0.0, z_m=1.0) for t in range(4)], 3.0),
            "yaw_deg: got none; wanted one at each way point of a path that leads back",
        ),
    ],
)
def test_what_is_no_path_is_refused(make: Callable[[], object], reported: str) -> None:
    assert reported in complaint(ScenarioError, make)
