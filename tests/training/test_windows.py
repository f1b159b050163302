"""What the network is trained on: sprites, windows with their truth, and material that is read back the same."""

from pathlib import Path

import numpy as np
import pytest

import training.material
from groundstation.box import Box
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.errors import InputError
from groundstation.files.channel_weights import WEIGHTS, channel_weights
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import World
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from groundstation.sources.true_silhouettes import TrueSilhouette
from training.backgrounds import Background, world_background
from training.filmed_targets import filmed_targets
from training.material import Material, MaterialRequest, joined, load_material, save_material
from training.mined_places import false_place
from training.recorded_windows import recorded_window, target_in
from training.sprites import SPRITE_PX, SpriteStudio
from training.windows import WindowDrawer

SKY = Background(image=np.full((240, 320, 3), (230, 190, 150), np.uint8), occupied=None, drawn=True)


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
    assert len(found.filmed) == len(material.filmed) > 0
    for drawn, read in zip(material.filmed, found.filmed, strict=True):
        for name in ("image", "cover", "middle_px", "width_px", "nose_px"):
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
    target = target_in(image, silhouette, silhouette.centre_px, width_px, nose)
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
    world = draw_world(11)
    found = list(filmed_targets(world, 12, np.random.default_rng(7)))
    again = list(filmed_targets(world, 12, np.random.default_rng(7)))
    own, elsewhere = found[::2], found[1::2]
    assert len(own) == len(elsewhere) > 3
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
    for target in own:
        share = target.cover / target.cover.sum(dtype=np.float64)
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
    sprite = next(
        found
        for seed in range(9)
        if (found := SpriteStudio().aircraft(draw_world(4), np.random.default_rng(seed))) is not None
        and found.width_px > 60.0
    )
    image = np.full((480, 640, 3), (230, 190, 150), np.uint8)
    h, w = sprite.light.shape[:2]
    for x in (40, 480):
        part = image[200 : 200 + h, x : x + w].astype(np.float32)
        image[200 : 200 + h, x : x + w] = part * (1.0 - sprite.light[:, :, 3:]) + sprite.light[:, :, :3]
    channel = LearnedChannel(channel_weights())
    own, mined = Box(40.0, 200.0, 40.0 + w, 200.0 + h), []
    for seed in range(20):
        place = false_place(channel, image, own, np.random.default_rng(seed))
        again = false_place(channel, image, own, np.random.default_rng(seed))
        assert (place is None) == (again is None)
        if place is not None and again is not None:
            np.testing.assert_array_equal(place[0], again[0])
            mined.append(place[0])
    assert len(mined) >= 10
    other = Box(480.0, 200.0, 480.0 + w, 200.0 + h)
    assert all(other.x0 - 8 <= u <= other.x1 + 8 and other.y0 - 8 <= v <= other.y1 + 8 for u, v in mined)
    # an even sky shows nothing to be mistaken
    assert false_place(channel, np.full((480, 640, 3), 180, np.uint8), own, np.random.default_rng(1)) is None


def test_only_pictures_without_others_in_the_air_are_mined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Birds and other aircraft are not labelled: a place where the channel sees them is not one without aircraft."""
    mined: dict[int, bool] = {}

    def filmed(world: World, *_: object) -> list[object]:
        mined[world.seed] = _[2] is not None
        return []

    monkeypatch.setattr(training.material, "filmed_targets", filmed)
    monkeypatch.setattr(SpriteStudio, "aircraft", lambda *_: None)
    monkeypatch.setattr(SpriteStudio, "bird", lambda *_: None)
    request = MaterialRequest(worlds=12, first=20, scenes=0, filmed=12, mined_with=WEIGHTS)
    training.material.make_material(request)
    worlds = [draw_world(seed_of(WorldSet.TRAIN, number)) for number in range(20, 32)]
    assert list(mined) == [world.seed for world in worlds]
    for world in worlds:
        alone = not (world.traffic.birds or world.traffic.flocks or world.traffic.aircraft)
        assert mined[world.seed] is alone
    assert len(set(mined.values())) == 2
