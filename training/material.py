"""What windows are drawn from: sprites and backgrounds of train worlds and clips, made once and kept in a folder."""

import functools
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.box import Box
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.errors import InputError, os_words
from groundstation.files.channel_weights import read_weights
from groundstation.simulation.traffic import TrafficSpec
from groundstation.simulation.traffic.bird_spec import BirdSpec
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from training.backgrounds import Background, clip_backgrounds, world_background
from training.filmed_targets import filmed_targets
from training.kinds import surroundings_kinds, world_kinds
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

    @property
    def without(self) -> frozenset[str]:
        """All kinds that are left out."""
        return frozenset((*self.without_families, *self.without_sceneries, *self.without_skies))


def make_material(
    request: MaterialRequest,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    workers: int = 1,
) -> Material:
    """Draw sprites and backgrounds; the same request gives the same material, with any number of processes."""
    made: list[Material] = []
    make = partial(_world_material, request)
    with ExitStack() as stack:
        if workers > 1:
            # what is compiled once is there in each process
            make(0)
            pool = stack.enter_context(multiprocessing.get_context("fork").Pool(workers))
            found: Iterable[Material] = pool.imap(make, range(request.worlds))
        else:
            found = map(make, range(request.worlds))
        for each in found:
            made.append(each)
            progress(len(made), request.worlds)
    if request.clips is not None:
        clips = tuple(clip_backgrounds(request.clips))
        made.append(Material(aircraft=(), birds=(), backgrounds=clips))
    return joined(made)


@functools.cache
def _studio() -> SpriteStudio:
    return SpriteStudio()


@functools.cache
def _channel(weights: Path) -> LearnedChannel:
    return LearnedChannel(read_weights(weights, None))


def _world_material(request: MaterialRequest, number: int) -> Material:
    """Return what one world gives: views, birds, and where it is among those, a background and pictures."""
    world, studio = draw_world(seed_of(WorldSet.TRAIN, request.first + number)), _studio()
    generator = np.random.default_rng([world.seed, _STREAM])
    left_out = request.without
    aircraft: list[Sprite | None] = []
    if world.airframe.family.value not in left_out:
        aircraft = [studio.aircraft(world, generator) for _ in range(_VIEWS_PER_WORLD)]
    birds = [studio.bird(spec, world.scenery, generator) for spec in _birds(world.traffic) for _ in range(_BIRD_VIEWS)]
    backgrounds: list[Background] = []
    if number < request.scenes and not left_out.intersection(surroundings_kinds(world)):
        backgrounds.append(world_background(world, generator))
    filmed: list[RecordedTarget] = []
    if number < request.filmed and not left_out.intersection(world_kinds(world)):
        film = np.random.default_rng([world.seed, _FILM_STREAM])
        channel = None if request.mined_with is None else _channel(request.mined_with)
        filmed = list(filmed_targets(world, request.pictures, film, channel))
    return Material(
        aircraft=tuple(sprite for sprite in aircraft if sprite is not None),
        birds=tuple(sprite for sprite in birds if sprite is not None),
        backgrounds=tuple(backgrounds),
        filmed=tuple(filmed),
    )


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


def without_kinds(material: Material, kinds: frozenset[str]) -> Material:
    """Return what of a material shows none of these kinds of airframe, scenery and sky."""
    return Material(
        aircraft=tuple(each for each in material.aircraft if not kinds.intersection(each.kinds)),
        birds=material.birds,
        backgrounds=tuple(each for each in material.backgrounds if not kinds.intersection(each.kinds)),
        filmed=tuple(each for each in material.filmed if not kinds.intersection(each.kinds)),
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
        raise InputError(str(folder), got=os_words(fault), wanted="material that `groundstation train` made") from fault
    return Material(aircraft=sprites[0], birds=sprites[1], backgrounds=backgrounds, filmed=filmed)


def _sprite_arrays(sprites: tuple[Sprite, ...]) -> Iterator[tuple[str, Any]]:
    for k, sprite in enumerate(sprites):
        # a level is enough; sprites are many
        yield f"{k:06d}.light", np.rint(sprite.light * (1.0, 1.0, 1.0, 255.0)).clip(0, 255).astype(np.uint8)
        yield f"{k:06d}.nose", np.array([*sprite.nose_px, float(sprite.nose_hidden)])
        yield f"{k:06d}.kinds", np.array(" ".join(sprite.kinds))


def _sprites(file: Any) -> Iterator[Sprite]:
    for k in range(len(file.files) // 3):
        light = file[f"{k:06d}.light"].astype(np.float32) / np.array((1.0, 1.0, 1.0, 255.0), np.float32)
        u, v, hidden = file[f"{k:06d}.nose"]
        yield Sprite(
            light=light,
            mask=light[:, :, 3] >= 0.5,
            nose_px=np.array([u, v]),
            nose_hidden=bool(hidden),
            kinds=_kinds(file, k),
        )


def _background_arrays(backgrounds: tuple[Background, ...]) -> Iterator[tuple[str, Any]]:
    for k, each in enumerate(backgrounds):
        box = each.occupied
        corners = (np.nan,) * 4 if box is None else (box.x0, box.y0, box.x1, box.y1)
        yield f"{k:06d}.image", each.image
        yield f"{k:06d}.box", np.array([*corners, float(each.drawn)])
        yield f"{k:06d}.kinds", np.array(" ".join(each.kinds))


def _backgrounds(file: Any) -> Iterator[Background]:
    for k in range(len(file.files) // 3):
        x0, y0, x1, y1, drawn = file[f"{k:06d}.box"]
        box = None if np.isnan(x0) else Box(float(x0), float(y0), float(x1), float(y1))
        yield Background(image=file[f"{k:06d}.image"], occupied=box, drawn=bool(drawn), kinds=_kinds(file, k))


def _kinds(file: Any, number: int) -> tuple[str, ...]:
    return tuple(str(file[f"{number:06d}.kinds"]).split())
