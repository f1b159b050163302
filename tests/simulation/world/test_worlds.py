"""Worlds drawn from a seed: their file gives them back, sets keep their kinds, and a session is rendered from one."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

from groundstation.errors import ConfigError
from groundstation.session import load_session
from groundstation.simulation.drawn_cameras import CameraSpec
from groundstation.simulation.picture_writer import PictureFormat
from groundstation.simulation.traffic import TrafficSpec
from groundstation.simulation.world.draw_world import (
    WITHHELD_FAMILIES,
    WITHHELD_SCENERIES,
    WITHHELD_SKIES,
    draw_world,
)
from groundstation.simulation.world.render_world import render_world
from groundstation.simulation.world.world import World, world_factors
from groundstation.simulation.world.world_file import FILE_NAME, load_world, world_text
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from groundstation.sources.visibility_table import read_visibility

NUMBERS = range(25)
# birds and cars
MIXED = 21


@lru_cache
def drawn(world_set: WorldSet) -> tuple[World, ...]:
    return tuple(draw_world(seed_of(world_set, k)) for k in NUMBERS)


@pytest.mark.parametrize("world_set", list(WorldSet))
def test_a_drawn_world_is_read_as_it_was_written(world_set: WorldSet, tmp_path: Path) -> None:
    path = tmp_path / FILE_NAME
    for world in drawn(world_set)[:8]:
        path.write_text(world_text(world))
        assert load_world(path) == world


def test_the_withheld_kinds_occur_in_the_test_set_alone() -> None:
    withheld = {kind.value for kind in (*WITHHELD_FAMILIES, *WITHHELD_SCENERIES, *WITHHELD_SKIES)}

    def kinds(world: World) -> set[str]:
        factors = world_factors(world)
        return {factors["airframe"], factors["scenery"], factors["sky"]}

    for world_set in (WorldSet.TRAIN, WorldSet.VALIDATE):
        assert all(withheld.isdisjoint(kinds(world)) for world in drawn(world_set))
    assert any(not withheld.isdisjoint(kinds(world)) for world in drawn(WorldSet.TEST))


def test_seeds_give_different_worlds_and_the_same_again() -> None:
    assert draw_world(5) == draw_world(5)
    assert len({world_text(replace(world, seed=0)) for world in drawn(WorldSet.TRAIN)}) == len(NUMBERS)


def small(seed: int) -> World:
    """A world of two seconds with small pictures without loss."""
    world = draw_world(seed, duration_s=2.0)
    camera = CameraSpec(image_size_px=(160, 120), focal_px=400.0, coding=PictureFormat.PNG)
    return replace(world, cameras=(camera,) * len(world.stations.stations), frame_hz=2.0)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*.*")}


def test_a_rendered_world_is_a_session_and_the_same_from_its_file(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    world = small(MIXED)
    assert world_factors(world)["traffic"] == "mixed"
    filmed = render_world(world, first)
    render_world(load_world(first / FILE_NAME), second)
    assert contents(first) == contents(second)
    session = load_session(first)
    visibility = read_visibility(session)
    assert visibility is not None
    assert len(visibility) == filmed.pairs * len(session.rig.names)
    assert all(0.0 <= row.share_seen <= 1.0 for row in visibility.values())


@pytest.mark.parametrize("coding", [PictureFormat.LOSSLESS, PictureFormat.JPEG])
def test_the_same_pictures_give_the_same_video(coding: PictureFormat, tmp_path: Path) -> None:
    world = small(MIXED)
    camera = replace(world.cameras[0], coding=coding)
    world = replace(world, cameras=(camera,) * len(world.cameras))
    for name in ("first", "second"):
        render_world(world, tmp_path / name)
    assert contents(tmp_path / "first") == contents(tmp_path / "second")


def test_a_world_of_a_file_without_traffic_has_none(tmp_path: Path) -> None:
    path = tmp_path / FILE_NAME
    world = draw_world(MIXED)
    text = world_text(replace(world, traffic=TrafficSpec()))
    path.write_text(text.replace("[traffic]\nbirds = []\nflocks = []\naircraft = []\nroads = []\n", ""))
    assert "traffic" not in path.read_text()
    assert load_world(path) == replace(world, traffic=TrafficSpec())
    assert world_factors(load_world(path))["traffic"] == "none"


def test_a_wrong_world_names_file_and_key(tmp_path: Path) -> None:
    path = tmp_path / FILE_NAME
    text = world_text(draw_world(0))
    path.write_text(text.replace("frame_hz = 10.0", 'frame_hz = "fast"'))
    with pytest.raises(ConfigError, match=r"world.toml: frame_hz: got 'fast'"):
        load_world(path)
    path.write_text(text.replace('format = "groundstation-world/1"', 'format = "other"'))
    with pytest.raises(ConfigError, match="format"):
        load_world(path)
