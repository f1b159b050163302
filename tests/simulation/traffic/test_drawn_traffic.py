"""Drawn traffic is within its ranges and clear of objects, and its file restores it."""

import tomllib
from functools import lru_cache
from itertools import chain

import numpy as np
import pytest

from groundstation.errors import ConfigError, ScenarioError
from groundstation.files.toml_table import TomlTable
from groundstation.simulation.airframes.kinds import AirframeFamily
from groundstation.simulation.scenery import Scenery, draw_scenery
from groundstation.simulation.specification_table import read_specification, rounded, specification_table, toml_text
from groundstation.simulation.traffic import TrafficSpec, draw_traffic, traffic_kind, with_roads
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_spec import BirdSpec, FlockSpec
from groundstation.simulation.traffic.traffic_spec import CarSpec, RoadSpec
from tests.simulation.small_site import straight

SEEDS = range(80)
DURATION_S = 20.0
TIMES = np.linspace(0.0, DURATION_S, 81)
EYES = [np.array([-6.0, 0.0, 1.8]), np.array([6.0, 1.0, 2.5]), np.array([30.0, 120.0, 3.0])]
FLOWN = straight((0.0, 260.0, 14.0), (0.0, -18.0, -0.9))


def scenery(seed: int) -> Scenery:
    return draw_scenery(np.random.default_rng([seed, 1]))


def drawn(seed: int, families: tuple[AirframeFamily, ...] = tuple(AirframeFamily)) -> TrafficSpec:
    return draw_traffic(
        np.random.default_rng([seed, 2]),
        flown=FLOWN,
        eyes_m=EYES,
        scenery=scenery(seed),
        duration_s=DURATION_S,
        families=families,
    )


@lru_cache
def all_drawn() -> tuple[TrafficSpec, ...]:
    return tuple(drawn(seed) for seed in SEEDS)


def distances(path: ArcPath) -> np.ndarray:
    return np.array([np.linalg.norm(path.position(TIMES) - eye, axis=1) for eye in EYES])


def test_every_kind_of_traffic_occurs_and_none() -> None:
    assert {traffic_kind(t) for t in all_drawn()} == {"none", "birds", "aircraft", "cars", "mixed"}
    assert any(t.flocks for t in all_drawn())


def test_birds_are_of_birds_sizes_and_speeds_and_stay_above_the_ground() -> None:
    birds = [*chain(*(t.birds for t in all_drawn())), *(f.bird for t in all_drawn() for f in t.flocks)]
    assert len(birds) > 50
    for bird in birds:
        assert 0.3 <= bird.span_m <= 1.8
        assert 6.0 <= bird.path.speed_m_s <= 20.0
        assert 1.5 < bird.flap_hz < 17.0
        assert bird.path.position(TIMES)[:, 2].min() >= 1.5
        assert distances(bird.path).min() >= 6.0
    for flock in chain(*(t.flocks for t in all_drawn())):
        assert 4 <= len(flock.offsets_m) <= 18
        lowest = min(up for _, _, up in flock.offsets_m) - flock.sway_m
        assert flock.bird.path.position(TIMES)[:, 2].min() + lowest > 0.0


def test_some_birds_cross_the_line_of_sight_before_the_aircraft_and_some_behind_it() -> None:
    before, behind = 0, 0
    lines = FLOWN.position(TIMES)[None] - np.array(EYES)[:, None]
    away = np.linalg.norm(lines, axis=2)
    birds = list(chain(*(t.birds for t in all_drawn())))
    for bird in birds:
        towards = bird.path.position(TIMES)[None] - np.array(EYES)[:, None]
        cosine = np.einsum("ijk,ijk->ij", lines, towards) / (away * distances(bird.path))
        near = cosine > np.cos(np.radians(1.5))
        before += bool((near & (distances(bird.path) < away)).any())
        behind += bool((near & (distances(bird.path) > away)).any())
    assert before > 0.15 * len(birds)
    assert behind > 0.15 * len(birds)


def test_other_aircraft_are_light_ones_far_away() -> None:
    others = list(chain(*(t.aircraft for t in all_drawn())))
    assert others
    for other in others:
        assert 7.0 <= other.airframe.span_m <= 15.0
        assert 20.0 <= other.path.speed_m_s <= 60.0
        assert 800.0 <= distances(other.path).min() <= distances(other.path).max() <= 3000.0
        assert other.path.position(TIMES)[:, 2].min() >= 50.0
    only = (AirframeFamily.GLIDER, AirframeFamily.DELTA)
    allowed = {other.airframe.family for seed in range(40) for other in drawn(seed, only).aircraft}
    assert allowed == {AirframeFamily.GLIDER}


def test_cars_drive_on_their_road_clear_of_runway_and_objects() -> None:
    roads = [(seed, road) for seed, t in zip(SEEDS, all_drawn(), strict=True) for road in t.roads]
    assert len(roads) > 10
    for seed, road in roads:
        site = scenery(seed)
        for car in road.cars:
            assert 5.0 <= abs(car.speed_m_s) <= 20.0
            path = road.car_path(car).position(TIMES)
            across, along = on(path, road.x_m, road.y_m, road.heading_rad)
            assert np.abs(across).max() + 0.5 * car.width_m < 0.5 * road.width_m
            assert np.abs(along).max() <= 0.5 * road.length_m + 1e-6
            assert np.all(path[:, 2] == 0.0)
            alongside = (path[:, 1] > site.runway_from_y_m) & (path[:, 1] < site.runway_to_y_m)
            assert not np.any(alongside & (np.abs(path[:, 0]) < site.runway_half_width_m + 5.0))
            for thing in site.objects:
                if thing.kind != "wire":
                    right, ahead = np.abs(on(path, thing.x_m, thing.y_m, thing.heading_rad))
                    assert not np.any((right < 0.5 * thing.width_m) & (ahead < 0.5 * thing.length_m)), thing


def on(path: np.ndarray, x_m: float, y_m: float, heading_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points are to the right of a line and along it."""
    sine, cosine = np.sin(heading_rad), np.cos(heading_rad)
    x, y = path[:, 0] - x_m, path[:, 1] - y_m
    return x * cosine - y * sine, x * sine + y * cosine


def test_traffic_is_read_as_it_was_written_and_drawn_again_the_same() -> None:
    for seed, traffic in zip(SEEDS, all_drawn(), strict=True):
        if seed < 20:
            assert drawn(seed) == traffic
        short = rounded(traffic)
        table = tomllib.loads(toml_text(specification_table(short)))
        assert read_specification(TrafficSpec, TomlTable(table, "traffic.toml", ConfigError)) == short


def test_roads_are_laid_on_the_ground() -> None:
    road = RoadSpec(x_m=20.0, y_m=100.0, length_m=400.0, cars=(CarSpec(),))
    laid = with_roads(Scenery(), TrafficSpec(roads=(road,)))
    assert [(p.x_m, p.length_m, p.width_m) for p in laid.patches] == [(20.0, 400.0, 5.5)]
    assert with_roads(Scenery(), TrafficSpec()) == Scenery()


def test_oncoming_cars_keep_right() -> None:
    road = RoadSpec(x_m=20.0, y_m=100.0, length_m=400.0)
    assert road.car_path(CarSpec(speed_m_s=10.0)).place_m[0] > 20.0
    assert road.car_path(CarSpec(speed_m_s=-10.0)).place_m[0] < 20.0


def test_an_arc_moves_by_its_velocity() -> None:
    path = ArcPath(place_m=(3.0, 40.0, 12.0), at_s=2.0, heading_rad=0.7, climb_m_s=0.5, turn_rate_rad_s=-0.4)
    step = 1e-5
    slope = (path.position(TIMES + step) - path.position(TIMES - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, path.velocity(TIMES), atol=1e-6)
    np.testing.assert_allclose(path.position(np.array([2.0]))[0], (3.0, 40.0, 12.0))
    np.testing.assert_allclose([path.place_at(t) for t in TIMES.tolist()], path.position(TIMES), atol=1e-9)


def test_wrong_numbers_are_refused() -> None:
    path = ArcPath(place_m=(0.0, 50.0, 10.0))
    with pytest.raises(ScenarioError, match="BirdSpec: span_m: got 9"):
        BirdSpec(span_m=9.0, path=path)
    with pytest.raises(ScenarioError, match="FlockSpec: phases: got 1; wanted 2"):
        FlockSpec(bird=BirdSpec(path=path), offsets_m=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), phases=(0.0,))
    with pytest.raises(ScenarioError, match="CarSpec: speed_m_s"):
        CarSpec(speed_m_s=0.0)
