"""What the network is trained on: sprites, windows with their truth, and material that is read back the same."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.errors import InputError
from groundstation.files.channel_weights import channel_weights
from groundstation.simulation.traffic import TrafficSpec, traffic_bodies
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import World
from groundstation.sources.true_silhouettes import TrueSilhouette
from training.backgrounds import Background, world_background
from training.filmed_targets import filmed_targets
from training.filming import BodyLabel, label_of
from training.kinds import world_kinds
from training.material import (
    Material,
    MaterialRequest,
    joined,
    load_material,
    make_material,
    save_material,
    without_kinds,
)
from training.mined_places import false_place
from training.recorded_windows import labelled_picture, recorded_window, target_in, target_window
from training.sprites import SPRITE_PX, SpriteStudio
from training.windows import WindowDrawer

SKY = Background(
    image=np.full((240, 320, 3), (230, 190, 150), np.uint8), occupied=None, drawn=True, kinds=("meadow", "clear")
)


@pytest.fixture(scope="module")
def material() -> Material:
    generator, studio = np.random.default_rng(5), SpriteStudio()
    worlds = [draw_world(seed) for seed in (1, 4, 9)]
    aircraft = [studio.aircraft(world, generator) for world in worlds for _ in range(2)]
    specs = [(bird, world.scenery) for world in worlds for bird in world.traffic.birds][:2]
    birds = [studio.bird(spec, scenery, generator) for spec, scenery in specs]
    return Material(
        aircraft=tuple(sprite for sprite in aircraft if sprite is not None),
        birds=tuple(sprite for sprite in birds if sprite is not None),
        backgrounds=(SKY, Background(image=SKY.image, occupied=Box(100.0, 80.0, 180.0, 140.0), drawn=False)),
        filmed=tuple(filmed_targets(draw_world(1), 3, np.random.default_rng(2))),
    )


def test_a_sprite_holds_its_aircraft_and_its_nose(material: Material) -> None:
    assert len(material.aircraft) == 6
    for sprite in material.aircraft:
        height, width = sprite.light.shape[:2]
        assert max(height, width) <= SPRITE_PX
        assert sprite.light[:, :, 3].max() == pytest.approx(1.0, abs=1e-3)
        assert np.all(sprite.light[:, :, 3] >= 0.0)
        assert np.all(sprite.light[:, :, :3] <= 256.0 * sprite.light[:, :, 3:] + 1e-3)
        u, v = sprite.nose_px
        assert -2.0 <= u <= width + 1.0
        assert -2.0 <= v <= height + 1.0
        assert 20.0 < sprite.width_px <= SPRITE_PX


def test_a_window_is_the_same_for_the_same_generator_and_its_truth_fits(material: Material) -> None:
    drawer = WindowDrawer(material.aircraft, material.birds, material.backgrounds)
    widths, with_nose = [], 0
    for seed in range(60):
        window, again = (drawer.draw(np.random.default_rng(seed)) for _ in range(2))
        np.testing.assert_array_equal(window.image, again.image)
        np.testing.assert_array_equal(window.aircraft, again.aircraft)
        assert window.image.shape == (WINDOW_PX[1], WINDOW_PX[0], 3)
        assert np.all(window.aircraft + window.other <= 1.0 + 1e-3)
        assert np.all(window.aircraft >= 0.0)
        columns = np.flatnonzero((window.aircraft > 0.3).any(axis=0))
        if columns.size:
            widths.append(columns[-1] - columns[0] + 1)
        if np.all(np.isfinite(window.nose_px)):
            with_nose += 1
    assert 0.5 * TARGET_PX < np.median(widths) < 1.5 * TARGET_PX
    assert with_nose > 25


def test_a_clips_own_aircraft_is_never_in_a_background(material: Material, rng: np.random.Generator) -> None:
    image = np.full((240, 320, 3), 200, np.uint8)
    image[80:140, 100:180] = 0
    own = Background(image=image, occupied=Box(100.0, 80.0, 180.0, 140.0), drawn=False)
    drawer = WindowDrawer(material.aircraft, material.birds, [own])
    for _ in range(40):
        part = drawer._crop((48, 64), rng)
        assert part.image.min() >= 180


def test_material_is_read_back_the_same(material: Material, tmp_path: Path) -> None:
    save_material(material, tmp_path)
    found = load_material(tmp_path)
    assert [len(part) for part in (found.aircraft, found.birds, found.backgrounds)] == [6, len(material.birds), 2]
    for one, two in zip(material.aircraft, found.aircraft, strict=True):
        # levels are kept to a half
        np.testing.assert_allclose(one.light[:, :, :3], two.light[:, :, :3], atol=0.51)
        np.testing.assert_allclose(one.light[:, :, 3], two.light[:, :, 3], atol=0.003)
        np.testing.assert_array_equal(one.nose_px, two.nose_px)
        assert one.kinds == two.kinds
    assert [each.kinds for each in found.backgrounds] == [each.kinds for each in material.backgrounds]
    assert len(found.filmed) == len(material.filmed) > 0
    for drawn, read in zip(material.filmed, found.filmed, strict=True):
        for name in ("image", "cover", "other", "middle_px", "width_px", "nose_px", "kinds", "around_target"):
            np.testing.assert_array_equal(getattr(drawn, name), getattr(read, name))
    assert found.backgrounds[0].occupied is None
    assert found.backgrounds[1].occupied == Box(100.0, 80.0, 180.0, 140.0)
    with pytest.raises(InputError, match="material"):
        load_material(tmp_path / "none")


def test_a_drawn_background_shows_a_scene() -> None:
    found = world_background(draw_world(3), np.random.default_rng(1))
    assert found.drawn
    assert found.image.shape[2] == 3
    assert found.image.std() > 1.0


@pytest.mark.parametrize("width_px", [12.0, 44.0, 150.0])
def test_a_recorded_target_has_its_silhouette_where_it_is_seen(width_px: float, rng: np.random.Generator) -> None:
    side = round(4 * width_px)
    image = np.full((side, side, 3), 200, np.uint8)
    low, high = round(1.5 * width_px), round(2.5 * width_px)
    rows = slice(2 * side // 4 - 2, 2 * side // 4 + 2)
    image[rows, low:high] = 20
    silhouette = TrueSilhouette(x=low, y=rows.start, mask=np.ones((4, high - low), dtype=bool))
    nose = np.array([low + 0.0, 2.0 * side / 4.0 - 0.5])
    target = target_in(labelled_picture(image, silhouette), silhouette.centre_px, width_px, nose)
    checked = 0
    for _ in range(10):
        window = recorded_window(target, rng)
        dark = window.image.mean(axis=2) < 0.5 * (window.image.max() + float(window.image.min()))
        seen = window.aircraft > 0.5
        if seen.sum() > 30:
            assert (dark & seen).sum() > 0.6 * seen.sum()
            columns = np.flatnonzero(seen.any(axis=0))
            # mirrored or not, it is at an end
            if np.isfinite(window.nose_px[0]) and columns[0] > 0 and columns[-1] < WINDOW_PX[0] - 1:
                # to half a pixel of the picture, and one of the window
                assert np.abs(columns[[0, -1]] - window.nose_px[0]).min() < 1.5 + 0.9 * TARGET_PX / width_px
                checked += 1
    assert checked > 2


def test_filmed_targets_are_where_they_are_labelled() -> None:
    world = draw_world(13)
    found = list(filmed_targets(world, 8, np.random.default_rng(7)))
    # fewer pictures are the first of more
    again = list(filmed_targets(world, 5, np.random.default_rng(7)))
    own, elsewhere = ([each for each in found if each.around_target is on] for on in (True, False))
    assert len(elsewhere) >= len(own) > 3
    assert len(again) > 4
    for one, other in zip(found[: len(again)], again, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
    for target in own:
        seen = target.cover >= 128
        share = seen / seen.sum()
        rows, columns = np.indices(share.shape)
        centre = np.array([(share * columns).sum(), (share * rows).sum()])
        assert np.hypot(*(centre - target.middle_px)) < 1.0
        assert np.hypot(*(centre - target.nose_px)) < 0.8 * target.width_px
        assert target.cover.shape == target.image.shape[:2]
    # some windows elsewhere show nothing
    assert any(not target.cover.any() for target in elsewhere)


def test_materials_are_joined(material: Material) -> None:
    both = joined([material, material])
    for name in ("aircraft", "birds", "backgrounds", "filmed"):
        assert len(getattr(both, name)) == 2 * len(getattr(material, name))


def test_a_mined_place_is_one_that_the_channel_mistakes_and_the_target_is_not_there() -> None:
    """A picture with two aircraft, one of them labelled: the other one is what the channel is wrong about."""
    world = draw_world(4)
    sprite = next(
        found
        for seed in range(9)
        if (found := SpriteStudio().aircraft(world, np.random.default_rng(seed))) is not None and found.width_px > 60.0
    )
    image = np.full((480, 640, 3), (230, 190, 150), np.uint8)
    h, w = sprite.light.shape[:2]
    for x in (40, 480):
        part = image[200 : 200 + h, x : x + w].astype(np.float32)
        image[200 : 200 + h, x : x + w] = part * (1.0 - sprite.light[:, :, 3:]) + sprite.light[:, :, :3]
    channel = LearnedChannel(channel_weights())
    cover, mined = np.zeros(image.shape[:2], np.uint8), []
    cover[200 : 200 + h, 40 : 40 + w] = 255
    for seed in range(20):
        place = false_place(channel, image, cover, np.random.default_rng(seed))
        again = false_place(channel, image, cover, np.random.default_rng(seed))
        assert (place is None) == (again is None)
        if place is not None and again is not None:
            np.testing.assert_array_equal(place[0], again[0])
            mined.append(place[0])
    assert len(mined) >= 10
    other = Box(480.0, 200.0, 480.0 + w, 200.0 + h)
    assert all(other.x0 - 8 <= u <= other.x1 + 8 and other.y0 - 8 <= v <= other.y1 + 8 for u, v in mined)
    # an even sky shows nothing to be mistaken
    assert false_place(channel, np.full((480, 640, 3), 180, np.uint8), cover, np.random.default_rng(1)) is None


def test_traffic_is_learned_as_what_it_is() -> None:
    """Expected: birds are others, another aircraft in the air is an aircraft, a car is background."""
    drawn = cache(draw_world)

    def worlds() -> Iterator[World]:
        return (drawn(seed) for seed in range(40))

    spec = TrafficSpec(
        birds=next(w.traffic.birds for w in worlds() if w.traffic.birds),
        aircraft=next(w.traffic.aircraft for w in worlds() if w.traffic.aircraft),
        roads=next(w.traffic.roads for w in worlds() if any(road.cars for road in w.traffic.roads)),
    )
    labels = [label_of(body, 1.0) for body in traffic_bodies(spec)]
    birds, cars = len(spec.birds), sum(len(road.cars) for road in spec.roads)
    assert labels == [BodyLabel.OTHER] * birds + [BodyLabel.AIRCRAFT] * len(spec.aircraft) + [None] * cars
    assert birds
    assert cars


def test_birds_in_a_picture_are_labelled_and_a_window_is_around_one() -> None:
    flocked = next(world for seed in range(60) if len((world := draw_world(seed)).traffic.birds) > 3)
    found = list(filmed_targets(flocked, 8, np.random.default_rng(3)))
    around_birds = [each for each in found if not each.around_target and _at_middle(each.other, each.middle_px) > 0]
    assert around_birds
    for target in found:
        assert target.cover.shape == target.other.shape == target.image.shape[:2]
        assert set(target.kinds) == set(world_kinds(flocked))
        # what hides a body takes its share of the pixel away
        assert (target.cover.astype(int) + target.other <= 255 + 2).all()
    for target in around_birds:
        window = target_window(target, TARGET_PX, np.array(WINDOW_PX) / 2.0 - 0.5)
        assert window.other.max() > 0.0


def _at_middle(plane: np.ndarray, middle: np.ndarray) -> int:
    u, v = np.rint(middle).astype(int)
    return int(plane[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3].max())


def test_material_does_not_depend_on_the_number_of_processes() -> None:
    request = MaterialRequest(worlds=3, first=20, scenes=1, filmed=2, pictures=2)
    one, two = (make_material(request, workers=workers) for workers in (1, 2))
    assert len(one.aircraft) > 20
    for name in ("aircraft", "birds", "backgrounds", "filmed"):
        pairs = zip(getattr(one, name), getattr(two, name), strict=True)
        for first, second in pairs:
            picture = "light" if name in ("aircraft", "birds") else "image"
            np.testing.assert_array_equal(getattr(first, picture), getattr(second, picture))
            assert first.kinds == second.kinds


def test_what_shows_a_kind_is_left_out_of_a_material(material: Material) -> None:
    family = material.aircraft[0].kinds[0]
    left = without_kinds(material, frozenset({family}))
    assert 0 < len(left.aircraft) < len(material.aircraft)
    assert all(family not in each.kinds for each in (*left.aircraft, *left.filmed))
    assert len(left.birds) == len(material.birds)
    # frames of clips have no kind
    assert [each.drawn for each in without_kinds(material, frozenset({"meadow"})).backgrounds] == [False]
