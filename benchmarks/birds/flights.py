"""Flights of birds across a labelled aircraft: drawn at random from a seed, and composited over the frames."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from birds.cutting import Box, Flock, sky_around
from groundstation.arrays import FloatArray, ImageArray

_SMOOTH_FRAMES = 15
_LEAD_FRAMES, _AFTER_FRAMES, _LEAST_AFTER = (30, 60), 45, 30
_MISS_PX = 40.0
_LEAST_RELATIVE_PX = 2.0  # a frame: a slower one keeps the aircraft company
_CLEAR_PX = 4.0  # between the boxes when the tracker is started
_DARKER, _DARKEST = (1.0, 1.7), 0.15
_CRISP, _BLUR_PX = 1.5, 0.7  # beyond this enlargement edges are sharpened, and blurred again as a lens does
_MOST_ENLARGED = 5.0
_TRIES = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """One bird across one aircraft.

    Attributes
    ----------
    clip : the aircraft's.
    first, crossing, last : frames: the tracker's start, the one in which bird and aircraft are closest, the end.
    places : middle of the bird (u, v) in px of each frame from ``first``, (n, 2).
    speed_px : its speed, px a frame: past the aircraft where ``with_camera``, across the picture otherwise.
    miss_px : how far off the middle of the aircraft's box it passes.
    size_ratio : its length as a multiple of the aircraft's.
    with_camera : whether the bird shares the aircraft's motion through the picture (pan and shake of the camera).
    flock, first_sprite, mirrored, darker : the bird and how it is drawn.
    """

    clip: str
    first: int
    crossing: int
    last: int
    places: FloatArray
    speed_px: float
    miss_px: float
    size_ratio: float
    with_camera: bool
    flock: Flock
    first_sprite: int
    mirrored: bool
    darker: float

    def place(self, frame: int) -> tuple[float, float]:
        """Return the middle of the bird (u, v) in a frame."""
        u, v = self.places[frame - self.first]
        return float(u), float(v)


def draw_flight(
    generator: np.random.Generator,
    flocks: list[Flock],
    segment: tuple[str, int, int],
    boxes: dict[int, Box],
    speed_px: tuple[float, float],
    size_ratio: tuple[float, float],
) -> Flight | None:
    """Return a flight within a segment (clip, first and last frame); None without enough space for one."""
    clip, begin, end = segment
    for _ in range(_TRIES):
        ratio, speed = float(generator.uniform(*size_ratio)), float(generator.uniform(*speed_px))
        miss, angle = float(generator.uniform(0.0, _MISS_PX)), float(generator.uniform(0.0, 2 * math.pi))
        with_camera = bool(generator.integers(2))
        lead = int(generator.integers(_LEAD_FRAMES[0], _LEAD_FRAMES[1] + 1))
        fit = _fit(flocks, ratio * max(boxes[begin][2:] if begin in boxes else (0.0,)))
        flock = fit[int(generator.integers(len(fit)))]
        sprite, darker = int(generator.integers(len(flock.sprites))), float(generator.uniform(*_DARKER))
        if end - begin < lead + _LEAST_AFTER:
            continue
        crossing = int(generator.integers(begin + lead, end - _LEAST_AFTER + 1))
        first = crossing - lead
        if any(f not in boxes for f in range(first, end + 1)):
            continue
        middles = _middles(boxes, begin, end)
        path = middles[first - begin :] if with_camera else np.tile(middles[crossing - begin], (end - first + 1, 1))
        along = np.array([math.cos(angle), math.sin(angle)])
        steps = np.arange(len(path))[:, None] - lead
        places = path + speed * steps * along + miss * np.array([-along[1], along[0]])
        off = places - middles[first - begin :]
        if float(np.hypot(*(off[lead + 1] - off[lead]))) < _LEAST_RELATIVE_PX:
            continue
        # an aircraft is about as long as its loose box
        size = ratio * max(boxes[crossing][2:])
        apart = [not _near(boxes[first + k], places[k], size) for k in range(len(places))]
        if not all(apart[: min(5, lead)]):
            continue
        touching = [k for k, clear in enumerate(apart) if not clear]
        over = touching[-1] + 1 if touching else lead + 1
        if over + _LEAST_AFTER > len(places):
            continue
        return Flight(
            clip=clip,
            first=first,
            crossing=crossing,
            last=min(first + over + _AFTER_FRAMES, end),
            places=places,
            speed_px=speed,
            miss_px=miss,
            size_ratio=ratio,
            with_camera=with_camera,
            flock=flock,
            first_sprite=sprite,
            mirrored=bool(along[0] < 0),
            darker=darker,
        )
    return None


def _fit(flocks: list[Flock], length_px: float) -> list[Flock]:
    """Return the birds that need not be enlarged much to a length, at least the largest three."""
    largest = sorted(flocks, key=lambda f: -f.length_px)
    return [f for k, f in enumerate(largest) if k < 3 or _MOST_ENLARGED * f.length_px >= length_px]


def _middles(boxes: dict[int, Box], begin: int, end: int) -> FloatArray:
    """Return the smoothed middles (n, 2) of the labelled boxes."""
    nearest = (f if f in boxes else min(boxes, key=lambda b, f=f: abs(b - f)) for f in range(begin, end + 1))
    raw = np.array([_middle(boxes[f]) for f in nearest])
    half = min(_SMOOTH_FRAMES, len(raw)) // 2
    padded = np.pad(raw, ((half, half), (0, 0)), mode="edge")
    kernel = np.full(2 * half + 1, 1.0 / (2 * half + 1))
    return np.stack([np.convolve(padded[:, k], kernel, mode="valid") for k in (0, 1)], axis=1)


def _middle(box: Box) -> tuple[float, float]:
    return box[0] + 0.5 * box[2], box[1] + 0.5 * box[3]


def _near(box: Box, place: FloatArray, size: float) -> bool:
    u, v = _middle(box)
    reach = 0.5 * size + _CLEAR_PX
    return bool(abs(place[0] - u) < 0.5 * box[2] + reach and abs(place[1] - v) < 0.5 * box[3] + reach)


@dataclass(kw_only=True, eq=False)
class Painter:
    """Paints the bird of one flight over frames.

    ``length_px`` is the bird's usual length; ``sky`` (3,) the local sky's colour, whose light the bird lacks.
    """

    flight: Flight
    length_px: float
    sky: FloatArray

    def paint(self, image: ImageArray, frame: int) -> tuple[ImageArray, Box | None]:
        """Return the frame with the bird in front, and the box of its visible part, None if it is invisible."""
        flight = self.flight
        sprite = flight.flock.sprite(flight.first_sprite + frame - flight.first)
        scale = self.length_px / flight.flock.length_px
        h, w = sprite.alpha.shape
        half = math.ceil(0.5 * scale * max(h, w)) + 4
        u, v = flight.place(frame)
        x0, y0 = round(u) - half, round(v) - half
        side = 2 * half + 1
        mirror = -1.0 if flight.mirrored else 1.0
        matrix = np.array(
            [
                [mirror * scale, 0.0, u - x0 - mirror * scale * 0.5 * (w - 1)],
                [0.0, scale, v - y0 - scale * 0.5 * (h - 1)],
            ]
        )
        source = sprite.alpha
        if scale < 1.0:
            source = cv2.GaussianBlur(source, (0, 0), 0.5 * math.sqrt(1.0 / scale**2 - 1.0) + 0.1)
        alpha = cv2.warpAffine(source, matrix, (side, side), flags=cv2.INTER_CUBIC if scale > 1.0 else cv2.INTER_LINEAR)
        if scale > _CRISP:
            alpha = cv2.GaussianBlur(np.clip(0.5 + (alpha - 0.5) * scale, 0.0, 1.0), (0, 0), _BLUR_PX)
        alpha = np.clip(alpha, 0.0, 1.0)
        left, top = max(x0, 0), max(y0, 0)
        right, bottom = min(x0 + side, image.shape[1]), min(y0 + side, image.shape[0])
        if right <= left or bottom <= top:
            return image, None
        part = alpha[top - y0 : bottom - y0, left - x0 : right - x0, None]
        rows, columns = np.nonzero(part[:, :, 0] > 0.3)
        if len(rows) == 0:
            return image, None
        share = np.clip(1.0 - flight.darker * (1.0 - flight.flock.colour), _DARKEST, 0.95)
        painted = image.copy()
        window = image[top:bottom, left:right]
        blended = (1.0 - part) * window + part * (share * self.sky)
        painted[top:bottom, left:right] = np.clip(np.round(blended), 0, 255).astype(np.uint8)
        x, y = left + int(columns.min()), top + int(rows.min())
        return painted, (x, y, int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)


def local_sky(image: ImageArray, box: Box) -> FloatArray:
    """Return the colour (3,) of the sky around a box."""
    return np.asarray(np.median(sky_around(image, box).reshape(-1, 3), axis=0))
