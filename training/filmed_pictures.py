"""Whole pictures of train worlds with boxes around what flies in them: what the proposal network learns from."""

import io
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.composites.clip_segments import read_frames, read_segments
from groundstation.box import Box
from groundstation.errors import InputError, os_words
from groundstation.simulation.drawn_flights import build_flight
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.render_world import built_stations, rendered_cameras
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from training.filming import LabelledShot, as_coded, film_badly_aimed, filming_moment, is_visible
from training.kinds import world_kinds

_STREAM = 603
_STORED_QUALITY = 97
# every so manyth frame of a clip
_FRAME_STEP = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilmedPicture:
    """A picture as a JPEG file's bytes, which is what thousands of them have room for.

    Attributes
    ----------
    jpeg : bytes.
    aircraft, birds : (n, 4) corners x0, y0, x1, y1 of the boxes around them, px.
    unclear : (n, 4) boxes around aircraft that are hidden, or too faint to be learned.
    kinds : of airframe, scenery and sky.
    """

    jpeg: bytes
    aircraft: FloatArray
    birds: FloatArray
    unclear: FloatArray
    kinds: tuple[str, ...]

    def image(self) -> ImageArray:
        """Return the picture (h, w, 3) BGR."""
        return np.asarray(cv2.imdecode(np.frombuffer(self.jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureRequest:
    """Which train worlds are filmed, by number, and how many pictures of each are taken."""

    worlds: int = 600
    first: int = 0
    pictures: int = 6


def make_pictures(
    request: PictureRequest,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    workers: int = 1,
) -> list[FilmedPicture]:
    """Film; the same request gives the same pictures, with any number of processes."""
    made: list[FilmedPicture] = []
    film = partial(_world_pictures, request)
    with ExitStack() as stack:
        if workers > 1:
            # what is compiled once is there in each process
            film(0)
            pool = stack.enter_context(multiprocessing.get_context("fork").Pool(workers))
            found: Iterable[list[FilmedPicture]] = pool.imap(film, range(request.worlds))
        else:
            found = map(film, range(request.worlds))
        for number, pictures in enumerate(found, 1):
            made += pictures
            progress(number, request.worlds)
    return made


def _world_pictures(request: PictureRequest, number: int) -> list[FilmedPicture]:
    world = draw_world(seed_of(WorldSet.TRAIN, request.first + number))
    generator = np.random.default_rng([world.seed, _STREAM])
    flown = build_flight(world.flight, world.seed)
    cameras = list(rendered_cameras(world, built_stations(world), flown).values())
    kinds = world_kinds(world)
    found = []
    for _ in range(request.pictures):
        camera = cameras[int(generator.integers(len(cameras)))]
        t_s = filming_moment(flown, camera, generator)
        filmed = film_badly_aimed(camera, t_s, flown.position(np.array([t_s]))[0], generator)
        if filmed is not None:
            found.append(_picture(filmed, kinds, generator))
    return found


def _picture(filmed: LabelledShot, kinds: tuple[str, ...], generator: np.random.Generator) -> FilmedPicture:
    image = as_coded(filmed.shot.picture.whole(), generator)
    hidden = filmed.target_box is not None and not is_visible(filmed.shot)
    stored = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _STORED_QUALITY])[1]
    return FilmedPicture(
        jpeg=stored.tobytes(),
        aircraft=_corners(box for box in filmed.aircraft_boxes if not (hidden and box is filmed.target_box)),
        birds=_corners(filmed.bird_boxes),
        unclear=_corners([filmed.target_box] if hidden and filmed.target_box is not None else []),
        kinds=kinds,
    )


def _corners(boxes: Iterable[Box[int] | Box[float]]) -> FloatArray:
    return np.array([[b.x0, b.y0, b.x1, b.y1] for b in boxes], np.float64).reshape(-1, 4)


def clip_pictures(folder: Path) -> list[FilmedPicture]:
    """Return frames of the real clips that may be learned from, with their labelled boxes.

    Raises `SessionError` where the folder has none.
    """
    found = []
    for segment in read_segments(folder, WorldSet.TRAIN):
        for place, image in enumerate(read_frames(segment)):
            if place % _FRAME_STEP == 0:
                box = segment.boxes[place]
                stored = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _STORED_QUALITY])[1]
                found.append(
                    FilmedPicture(
                        jpeg=stored.tobytes(),
                        aircraft=_corners([] if box is None else [box]),
                        birds=_corners([]),
                        unclear=_corners([]),
                        kinds=(),
                    )
                )
    return found


def save_pictures(pictures: Iterable[FilmedPicture], path: Path) -> None:
    """Write a file from which `load_pictures` reads the same again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {}
    for k, each in enumerate(pictures):
        arrays[f"{k:06d}.jpeg"] = np.frombuffer(each.jpeg, np.uint8)
        arrays[f"{k:06d}.kinds"] = np.array(" ".join(each.kinds))
        for name in ("aircraft", "birds", "unclear"):
            arrays[f"{k:06d}.{name}"] = getattr(each, name)
    content = io.BytesIO()
    np.savez(content, **arrays)
    path.write_bytes(content.getvalue())


def load_pictures(path: Path) -> list[FilmedPicture]:
    """Read what `save_pictures` wrote. Raises `InputError` where it is not there."""
    try:
        with np.load(path) as file:
            return list(_pictures(file))
    except (OSError, KeyError, ValueError) as fault:
        raise InputError(str(path), got=os_words(fault), wanted="pictures that `groundstation train` made") from fault


def _pictures(file: "np.lib.npyio.NpzFile") -> Iterator[FilmedPicture]:
    for k in range(len(file.files) // 5):
        yield FilmedPicture(
            jpeg=file[f"{k:06d}.jpeg"].tobytes(),
            aircraft=file[f"{k:06d}.aircraft"],
            birds=file[f"{k:06d}.birds"],
            unclear=file[f"{k:06d}.unclear"],
            kinds=tuple(str(file[f"{k:06d}.kinds"]).split()),
        )
