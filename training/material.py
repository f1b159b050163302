"""What windows are drawn from: sprites and backgrounds of train worlds and clips, made once and kept in a folder."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.box import Box
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.errors import InputError
from groundstation.files.channel_weights import read_weights
from groundstation.simulation.traffic import TrafficSpec
from groundstation.simulation.traffic.bird_spec import BirdSpec
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from training.backgrounds import Background, clip_backgrounds, world_background
from training.filmed_targets import filmed_targets
from training.recorded_windows import RecordedTarget, load_targets, save_targets
from training.sprites import Sprite, SpriteStudio

_STREAM, _FILM_STREAM = 601, 602
_VIEWS_PER_WORLD, _BIRDS_PER_WORLD = 12, 4
_BIRD_VIEWS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Material:
    """Sprites of aircraft and of birds, backgrounds, and targets filmed in worlds."""

    aircraft: tuple[Sprite, ...]
    birds: tuple[Sprite, ...]
    backgrounds: tuple[Background, ...]
    filmed: tuple[RecordedTarget, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class MaterialRequest:
    """What is made.

    Attributes
    ----------
    worlds : number of train worlds.
    first : number of the first of them.
    scenes : of so many of them a background is drawn.
    filmed : so many of them are filmed, ``pictures`` each.
    mined_with : weights whose mistakes in these pictures are learned, too; None for none.
    clips : folder of the real clips; None trains on drawn backgrounds alone.
    without_families, without_sceneries, without_skies : kinds that are left out, by name.
    """

    worlds: int = 600
    first: int = 0
    scenes: int = 240
    filmed: int = 200
    pictures: int = 20
    mined_with: Path | None = None
    clips: Path | None = None
    without_families: tuple[str, ...] = ()
    without_sceneries: tuple[str, ...] = ()
    without_skies: tuple[str, ...] = ()


def make_material(
    request: MaterialRequest, progress: Callable[[int, int], None] = lambda done, total: None
) -> Material:
    """Draw sprites and backgrounds; the same request gives the same material."""
    studio, aircraft, birds, backgrounds = SpriteStudio(), [], [], []
    filmed: list[RecordedTarget] = []
    channel = None if request.mined_with is None else LearnedChannel(read_weights(request.mined_with, None))
    for number in range(request.worlds):
        world = draw_world(seed_of(WorldSet.TRAIN, request.first + number))
        generator = np.random.default_rng([world.seed, _STREAM])
        family_left_out = world.airframe.family.value in request.without_families
        if not family_left_out:
            aircraft += [
                sprite for _ in range(_VIEWS_PER_WORLD) if (sprite := studio.aircraft(world, generator)) is not None
            ]
        for spec in _birds(world.traffic):
            birds += [
                sprite
                for _ in range(_BIRD_VIEWS)
                if (sprite := studio.bird(spec, world.scenery, generator)) is not None
            ]
        scenery, sky = world.scenery.drawn_scenery, world.scenery.drawn_sky
        left_out = (scenery is not None and scenery.value in request.without_sceneries) or (
            sky is not None and sky.value in request.without_skies
        )
        if number < request.scenes and not left_out:
            backgrounds.append(world_background(world, generator))
        if number < request.filmed and not (left_out or family_left_out):
            film = np.random.default_rng([world.seed, _FILM_STREAM])
            # what is not labelled must not be learned as background
            mining = None if _others_fly(world.traffic) else channel
            filmed += filmed_targets(world, request.pictures, film, mining)
        progress(number + 1, request.worlds)
    if request.clips is not None:
        backgrounds += clip_backgrounds(request.clips)
    return Material(aircraft=tuple(aircraft), birds=tuple(birds), backgrounds=tuple(backgrounds), filmed=tuple(filmed))


def _others_fly(traffic: TrafficSpec) -> bool:
    """Return whether a picture may show birds or another aircraft."""
    return bool(traffic.birds or traffic.flocks or traffic.aircraft)


def _birds(traffic: TrafficSpec) -> list[BirdSpec]:
    return [*traffic.birds, *(flock.bird for flock in traffic.flocks)][:_BIRDS_PER_WORLD]


def joined(materials: Sequence[Material]) -> Material:
    """Return what several materials hold together."""
    return Material(
        aircraft=tuple(sprite for each in materials for sprite in each.aircraft),
        birds=tuple(sprite for each in materials for sprite in each.birds),
        backgrounds=tuple(background for each in materials for background in each.backgrounds),
        filmed=tuple(target for each in materials for target in each.filmed),
    )


def save_material(material: Material, folder: Path) -> None:
    """Write a folder from which `load_material` reads the same again."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("aircraft", "birds"):
        np.savez(folder / f"{name}.npz", **dict(_sprite_arrays(getattr(material, name))))
    np.savez(folder / "backgrounds.npz", **dict(_background_arrays(material.backgrounds)))
    save_targets(material.filmed, folder / "filmed.npz")


def load_material(folder: Path) -> Material:
    """Read what `save_material` wrote. Raises `InputError` where it is not there."""
    try:
        with np.load(folder / "aircraft.npz") as aircraft, np.load(folder / "birds.npz") as birds:
            sprites = [tuple(_sprites(file)) for file in (aircraft, birds)]
        with np.load(folder / "backgrounds.npz") as file:
            backgrounds = tuple(_backgrounds(file))
        filmed = load_targets(folder / "filmed.npz")
    except (OSError, KeyError, ValueError) as fault:
        raise InputError(str(folder), got=str(fault), wanted="material that `groundstation train` made") from fault
    return Material(aircraft=sprites[0], birds=sprites[1], backgrounds=backgrounds, filmed=filmed)


def _sprite_arrays(sprites: tuple[Sprite, ...]) -> Iterator[tuple[str, Any]]:
    for k, sprite in enumerate(sprites):
        # a level is enough; sprites are many
        yield f"{k:06d}.light", np.rint(sprite.light * (1.0, 1.0, 1.0, 255.0)).clip(0, 255).astype(np.uint8)
        yield f"{k:06d}.nose", np.array([*sprite.nose_px, float(sprite.nose_hidden)])


def _sprites(file: Any) -> Iterator[Sprite]:
    for k in range(len(file.files) // 2):
        light = file[f"{k:06d}.light"].astype(np.float32) / np.array((1.0, 1.0, 1.0, 255.0), np.float32)
        u, v, hidden = file[f"{k:06d}.nose"]
        yield Sprite(light=light, mask=light[:, :, 3] >= 0.5, nose_px=np.array([u, v]), nose_hidden=bool(hidden))


def _background_arrays(backgrounds: tuple[Background, ...]) -> Iterator[tuple[str, Any]]:
    for k, each in enumerate(backgrounds):
        box = each.occupied
        corners = (np.nan,) * 4 if box is None else (box.x0, box.y0, box.x1, box.y1)
        yield f"{k:06d}.image", each.image
        yield f"{k:06d}.box", np.array([*corners, float(each.drawn)])


def _backgrounds(file: Any) -> Iterator[Background]:
    for k in range(len(file.files) // 2):
        x0, y0, x1, y1, drawn = file[f"{k:06d}.box"]
        box = None if np.isnan(x0) else Box(float(x0), float(y0), float(x1), float(y1))
        yield Background(image=file[f"{k:06d}.image"], occupied=box, drawn=bool(drawn))
