"""Birds cut out of clips by their contrast against the sky around them, with soft edges, frame after frame."""

import csv
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray

Box = tuple[float, float, float, float]

_RING_PX = 10  # of sky around a labelled box
_NOISE_SIGMAS, _LEAST_CONTRAST = 4.0, 8.0  # grey levels
_LEAST_CORE = 25.0  # grey levels: a fainter bird is no bird that can be cut out
_BEYOND_PX = 12  # how far the labelled boxes may lag behind a bird
_LEAST_PIXELS = 6
_CORE_SHARE = 0.7
_GAP, _LEAST_FRAMES = 2, 6
_OTHER_SIZE, _STEP_PX = 2.5, 8.0  # how a bird may differ from the frame before


@dataclass(frozen=True, kw_only=True, eq=False)
class Sprite:
    """One silhouette: ``alpha`` (h, w) from 0 to 1, and its core's colour (3,) as a share of the sky's."""

    alpha: FloatArray
    colour: FloatArray

    @cached_property
    def length_px(self) -> float:
        """The longer side of the area that is more than half opaque."""
        rows, columns = np.nonzero(self.alpha > 0.5)
        return float(max(np.ptp(rows), np.ptp(columns)) + 1) if len(rows) else 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Flock:
    """A bird through consecutive frames of its clip."""

    clip: str
    sprites: tuple[Sprite, ...]

    @cached_property
    def length_px(self) -> float:
        """The bird's usual length."""
        return float(np.median([s.length_px for s in self.sprites]))

    @property
    def colour(self) -> FloatArray:
        """The core's usual colour (3,) as a share of the sky's."""
        return np.asarray(np.median([s.colour for s in self.sprites], axis=0))

    def sprite(self, k: int) -> Sprite:
        """Return the bird in frame ``k``; the film runs to and fro."""
        n = len(self.sprites)
        k %= max(2 * n - 2, 1)
        return self.sprites[k if k < n else 2 * n - 2 - k]


def read_boxes(folder: Path) -> dict[str, dict[int, Box]]:
    """Return the labelled boxes of each clip by frame."""
    boxes: dict[str, dict[int, Box]] = {}
    with (folder / "boxes.csv").open() as file:
        for r in csv.DictReader(file):
            if r["x"]:
                box = (float(r["x"]), float(r["y"]), float(r["w"]), float(r["h"]))
                boxes.setdefault(r["clip"], {})[int(r["frame"])] = box
    return boxes


def sky_around(image: ImageArray, box: Box) -> FloatArray:
    """Return the sky behind a box and its ring, (h, w, 3): a plane through the ring's pixels for each channel."""
    x0, y0, x1, y1 = window_of(image, box)
    window = image[y0:y1, x0:x1].astype(np.float64)
    h, w = window.shape[:2]
    y, x = np.mgrid[0:h, 0:w]
    inner = np.zeros((h, w), bool)
    inner[_RING_PX : h - _RING_PX, _RING_PX : w - _RING_PX] = True
    columns = np.stack([np.ones(h * w), x.ravel() / w, y.ravel() / h], axis=1)
    grey = window.mean(axis=2)
    ring = ~inner & (np.abs(grey - np.median(grey[~inner])) < 25.0)
    solved, *_ = np.linalg.lstsq(columns[ring.ravel()], window.reshape(-1, 3)[ring.ravel()], rcond=None)
    return np.asarray((columns @ solved).reshape(h, w, 3))


def window_of(image: ImageArray, box: Box) -> tuple[int, int, int, int]:
    """Return x0, y0, x1, y1 of a box and its ring inside a picture."""
    h, w = image.shape[:2]
    x, y, bw, bh = box
    x0, y0 = max(int(x) - _RING_PX, 0), max(int(y) - _RING_PX, 0)
    return x0, y0, min(int(x + bw) + _RING_PX + 1, w), min(int(y + bh) + _RING_PX + 1, h)


def contrast_of(image: ImageArray, box: Box, sky: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the difference of each pixel of a box and its ring from their sky, in grey levels, and those off it."""
    x0, y0, x1, y1 = window_of(image, box)
    difference = (image[y0:y1, x0:x1] - sky).mean(axis=2)
    ring = np.concatenate([difference[:_RING_PX].ravel(), difference[-_RING_PX:].ravel()])
    noise = 1.4826 * float(np.median(np.abs(ring - np.median(ring))))
    return difference, np.abs(difference) > max(_NOISE_SIGMAS * noise, _LEAST_CONTRAST)


def length_in(image: ImageArray, box: Box) -> float:
    """Return the length in px of what stands out in a loose box, at least 3; of an even box three quarters of it."""
    _, mask = contrast_of(image, box, sky_around(image, box))
    count, _, table, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    middle = 0.5 * np.array([mask.shape[1], mask.shape[0]])
    best = None
    for k in range(1, count):
        off = float(np.hypot(*((centres[k] - middle) / (0.35 * middle))))
        worth = float(table[k, cv2.CC_STAT_AREA]) * np.exp(-0.5 * off**2)
        if best is None or worth > best[0]:
            best = (worth, float(max(table[k, cv2.CC_STAT_WIDTH], table[k, cv2.CC_STAT_HEIGHT])))
    loose = max(box[2], box[3])
    return 0.75 * loose if best is None else min(max(best[1], 3.0), loose)


@dataclass(frozen=True, kw_only=True, eq=False)
class BirdCutout:
    """A bird cut out of a frame: the sprite and its middle (u, v) there."""

    sprite: Sprite
    middle: tuple[float, float]


def cut_out(image: ImageArray, box: Box, before: tuple[float, float] | None = None) -> BirdCutout | None:
    """Return the dark bird around a labelled box, of several the one nearest to its position ``before``.

    None without enough contrast, or where it is cut.
    """
    box = (box[0] - _BEYOND_PX, box[1] - _BEYOND_PX, box[2] + 2 * _BEYOND_PX, box[3] + 2 * _BEYOND_PX)
    x0, y0, x1, y1 = window_of(image, box)
    sky = sky_around(image, box)
    difference, mask = contrast_of(image, box, sky)
    mask &= difference < 0
    # wings hang on thin shoulders
    joined = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    count, labels, table, centres = cv2.connectedComponentsWithStats(joined, connectivity=8)
    if count < 2:
        return None
    worth = table[1:, cv2.CC_STAT_AREA].astype(np.float64)
    if before is not None:
        away = np.hypot(*(centres[1:] + np.array([x0, y0]) - np.array(before)).T)
        worth *= np.exp(-0.5 * (away / _STEP_PX) ** 2)
    k = 1 + int(np.argmax(worth))
    x, y, w, h, _ = (int(v) for v in table[k])
    inside = mask & (labels == k)
    core = float(np.percentile(-difference[inside], 80))
    clipped = x < 2 or y < 2 or x + w > mask.shape[1] - 2 or y + h > mask.shape[0] - 2
    if clipped or np.count_nonzero(inside) < _LEAST_PIXELS or core < _LEAST_CORE:
        return None
    # soft edges: a pixel half as dark as the core is half bird
    alpha = np.where(labels == k, np.clip(-difference / core, 0.0, 1.0), 0.0)
    ratio = image[y0:y1, x0:x1] / np.maximum(sky, 1.0)
    colour = np.asarray(ratio[inside & (-difference >= _CORE_SHARE * core)].mean(axis=0))
    sprite = Sprite(alpha=alpha[y - 1 : y + h + 1, x - 1 : x + w + 1], colour=colour)
    return BirdCutout(sprite=sprite, middle=(float(centres[k][0]) + x0, float(centres[k][1]) + y0))


def read_flocks(folder: Path, only: str = "") -> list[Flock]:
    """Return every run of frames, 6 or more, in which a clip shows a bird that can be cut out.

    Only of clips whose names hold ``only``.
    """
    flocks: list[Flock] = []
    for clip, boxes in sorted(read_boxes(folder).items()):
        if only not in clip:
            continue
        video = cv2.VideoCapture(str(folder / f"{clip}.mp4"))
        run: list[Sprite] = []
        last: BirdCutout | None = None
        missed = 0
        for frame in range(max(boxes) + 1):
            if not video.grab():
                break
            cut = None
            if (box := boxes.get(frame)) is not None:
                picture = np.asarray(video.retrieve()[1], np.uint8)
                cut = cut_out(picture, box, None if last is None else last.middle)
            other = cut is not None and last is not None and not _goes_on(last, cut)
            missed = missed + 1 if cut is None else 0
            if missed > _GAP or other:
                flocks += _flock(clip, run)
                run, last = [], None
            if cut is not None:
                run.append(cut.sprite)
                last = cut
        flocks += _flock(clip, run)
        video.release()
    return flocks


def _goes_on(old: BirdCutout, new: BirdCutout) -> bool:
    """Return whether two cuts show one bird: about as long, and not far away."""
    ratio = (old.sprite.length_px + 2.0) / (new.sprite.length_px + 2.0)
    step = np.hypot(old.middle[0] - new.middle[0], old.middle[1] - new.middle[1])
    return bool(1 / _OTHER_SIZE < ratio < _OTHER_SIZE and step < 3 * _STEP_PX)


def _flock(clip: str, run: list[Sprite]) -> list[Flock]:
    return [Flock(clip=clip, sprites=tuple(run))] if len(run) >= _LEAST_FRAMES else []
