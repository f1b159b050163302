"""The world files that come with the project can be read, and their flights flown."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.drawn_flights import FlightKind, build_flight
from groundstation.simulation.world.world_file import load_world

FILES = sorted((Path(__file__).parents[3] / "benchmarks" / "worlds").glob("*.toml"))


def test_there_are_world_files() -> None:
    assert [path.stem for path in FILES] == ["landing-clutter", "takeoff-away"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_rebuilt_world_flies_its_way_points(path: Path) -> None:
    world = load_world(path)
    assert world.flight.kind is FlightKind.PATH
    flight, points = build_flight(world.flight, world.seed), world.flight.way_points
    inside = [p for p in points if p.t_s <= world.flight.duration_s]
    flown = flight.position(np.array([p.t_s for p in inside]))
    stated = np.array([[p.x_m, p.y_m, p.z_m] for p in inside])
    assert np.abs(flown - stated).max() < 0.02
    # the aircraft is on its wheels where its path rolls
    assert build_airframe(world.airframe).rest_height_m == pytest.approx(world.flight.rest_height_m, abs=0.03)
