"""Training windows: a sprite over a background as a camera would show it, with the truth of each pixel.

A window has the size in which the network is run, `WINDOW_PX`, with a target about `TARGET_PX` wide. It is composed at
the camera's own resolution, so that small targets are blurred by enlargement and large ones sharpened by reduction, as
at run time.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.simulation.render_primitives import motion_blur_kernel
from training.backgrounds import Background
from training.sprites import Sprite

# native widths of targets, px: from the least that counts as visible to where windows are reduced enough
_NATIVE_PX = (8.0, 260.0)
# of the logarithm of the width in the window over the expected one, as the filter's prediction of it errs at worst
_SIZE_SIGMA, _MOST_SIZE = 0.25, 0.55
# composed at most so finely; beyond, a reduced window shows neither noise nor blur
_FINEST = 1.5
_TARGET_SHARE, _BIRD_SHARE, _HIDDEN_SHARE, _GREY_SHARE, _CODED_SHARE = 0.75, 0.4, 0.12, 0.3, 0.6
_PAINTED_SHARE = 0.2
_OFFSET_SIGMA, _MOST_OFFSET = 0.13, 0.42
_TRIES = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledWindow:
    """A window and its truth.

    Attributes
    ----------
    image : (96, 128, 3) uint8 BGR.
    aircraft, other : (96, 128) float32, the share of each pixel that the target, and birds, cover.
    nose_px : (2,) x, y of the nose in the window; NaN where there is none, or it is outside.
    kinds : of airframe, scenery and sky that it shows, where they are known.
    """

    image: ImageArray
    aircraft: Float32Array
    other: Float32Array
    nose_px: FloatArray
    kinds: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Laid:
    """A layer at the camera's resolution: ``light`` (h, w, 4) blurred, ``cover`` (h, w) sharp, nose (2,)."""

    light: Float32Array
    cover: Float32Array
    nose_px: FloatArray


class WindowDrawer:
    """Draws windows from sprites and backgrounds; the same generator's state gives the same window."""

    def __init__(self, aircraft: Sequence[Sprite], birds: Sequence[Sprite], backgrounds: Sequence[Background]) -> None:
        self._aircraft, self._birds, self._backgrounds = aircraft, birds, backgrounds

    def draw(self, generator: np.random.Generator) -> LabelledWindow:
        """Draw one window."""
        native = math.exp(float(generator.uniform(*np.log(_NATIVE_PX))))
        size = math.exp(min(max(float(generator.normal(0.0, _SIZE_SIGMA)), -_MOST_SIZE), _MOST_SIZE))
        scale = min(native / (TARGET_PX * size), _FINEST)
        shape = math.ceil(WINDOW_PX[1] * scale), math.ceil(WINDOW_PX[0] * scale)
        background = self._crop(shape, generator)
        canvas = background.image.astype(np.float32)
        blur = float(generator.uniform(0.35, 1.3)) * min(scale, 1.0)
        motion = _motion(generator) * min(scale, 1.0)
        aircraft, other = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        nose = np.full(2, np.nan)
        kinds = background.kinds
        layers: list[tuple[bool, _Laid]] = []
        present = bool(self._aircraft) and float(generator.uniform()) < _TARGET_SHARE
        if present:
            sprite = self._aircraft[int(generator.integers(len(self._aircraft)))]
            kinds = (*kinds, *sprite.kinds)
            layers.append((True, _laid(sprite, TARGET_PX * size * scale, shape, canvas, (blur, motion), generator)))
        if self._birds and float(generator.uniform()) < (_BIRD_SHARE if present else 0.6):
            sprite = self._birds[int(generator.integers(len(self._birds)))]
            width = TARGET_PX * scale * math.exp(float(generator.uniform(math.log(0.12), math.log(1.4))))
            layers.insert(
                int(generator.integers(len(layers) + 1)),
                (False, _laid(sprite, width, shape, canvas, (blur, motion), generator)),
            )
        for own, layer in layers:
            canvas *= 1.0 - layer.light[:, :, 3:]
            canvas += layer.light[:, :, :3]
            left = 1.0 - layer.cover
            aircraft, other = aircraft * left, other * left
            if own:
                aircraft, nose = aircraft + layer.cover, layer.nose_px
            else:
                other = other + layer.cover
        if present and float(generator.uniform()) < _HIDDEN_SHARE:
            self._hide(canvas, aircraft, other, generator)
        image = _exposed(canvas, background.drawn, scale, generator)
        small = cv2.resize(image, WINDOW_PX, interpolation=cv2.INTER_AREA if scale > 1.0 else cv2.INTER_LINEAR)
        nose = (nose + 0.5) / scale - 0.5
        return LabelledWindow(
            image=np.asarray(small, np.uint8),
            aircraft=_reduced(aircraft),
            other=_reduced(other),
            nose_px=nose if in_window(nose) else np.full(2, np.nan),
            kinds=kinds,
        )

    def _crop(self, shape: tuple[int, int], generator: np.random.Generator) -> Background:
        """Return a part of a background of this shape, away from its own aircraft, mirrored or not."""
        for _ in range(_TRIES):
            whole = self._backgrounds[int(generator.integers(len(self._backgrounds)))]
            height, width = whole.image.shape[:2]
            rows, columns = min(shape[0], height), min(shape[1], width)
            y, x = int(generator.integers(height - rows + 1)), int(generator.integers(width - columns + 1))
            taken = whole.occupied
            if taken is not None and x < taken.x1 and taken.x0 < x + columns and y < taken.y1 and taken.y0 < y + rows:
                continue
            part = whole.image[y : y + rows, x : x + columns]
            if part.shape[:2] != shape:
                room = (0, shape[0] - rows, 0, shape[1] - columns)
                part = np.asarray(cv2.copyMakeBorder(part, *room, cv2.BORDER_REFLECT_101), np.uint8)
            if float(generator.uniform()) < 0.5:
                part = part[:, ::-1]
            image = np.ascontiguousarray(part)
            return Background(image=image, occupied=None, drawn=whole.drawn, kinds=whole.kinds)
        return Background(image=np.full((*shape, 3), 180, np.uint8), occupied=None, drawn=True)

    def _hide(
        self, canvas: Float32Array, aircraft: Float32Array, other: Float32Array, generator: np.random.Generator
    ) -> None:
        """Put a post, or the edge of something larger, before the target: a strip of another background."""
        height, width = aircraft.shape
        strip = self._crop((height, width), generator).image
        thick = max(1, round(width * math.exp(float(generator.uniform(math.log(0.015), math.log(0.25))))))
        start = int(generator.integers(-thick // 2, width))
        columns = slice(max(start, 0), max(start + thick, 1))
        shade = float(generator.uniform(0.25, 1.0))
        canvas[:, columns] = shade * strip[:, columns]
        aircraft[:, columns] = 0.0
        other[:, columns] = 0.0


def in_window(place: FloatArray) -> bool:
    """Return whether a point (2,) is inside a window; NaN is not."""
    return bool(np.all(place > -0.5) and place[0] < WINDOW_PX[0] - 0.5 and place[1] < WINDOW_PX[1] - 0.5)


def _motion(generator: np.random.Generator) -> FloatArray:
    """Return how far a body moves while it is exposed, (2,) native px."""
    if float(generator.uniform()) < 0.65:
        return np.zeros(2)
    turn = float(generator.uniform(0.0, math.tau))
    return np.asarray(float(generator.exponential(2.0)) * np.array([math.cos(turn), math.sin(turn)]))


def _laid(
    sprite: Sprite,
    width_px: float,
    shape: tuple[int, int],
    canvas: Float32Array,
    blurs: tuple[float, FloatArray],
    generator: np.random.Generator,
) -> _Laid:
    """Return a sprite this wide at a drawn place of a canvas, in drawn light, hazed by what is around it."""
    zoom = max(width_px / max(sprite.width_px, 1.0), 2.0 / min(sprite.light.shape[:2]))
    light = sprite.light
    way = cv2.INTER_AREA if zoom < 1.0 else cv2.INTER_LINEAR
    size = max(round(light.shape[1] * zoom), 2), max(round(light.shape[0] * zoom), 2)
    light = np.asarray(cv2.resize(light, size, interpolation=way), np.float32)
    ratio = np.array(size) / np.array(sprite.light.shape[1::-1])
    nose = (sprite.nose_px + 0.5) * ratio - 0.5
    if float(generator.uniform()) < 0.5:
        light = np.ascontiguousarray(light[:, ::-1])
        nose = np.array([size[0] - 1.0 - nose[0], nose[1]])
    rows, columns = shape
    offsets = np.clip(generator.normal(0.0, _OFFSET_SIGMA, 2), -_MOST_OFFSET, _MOST_OFFSET)
    middle = (0.5 + offsets) * (columns, rows)
    corner = np.floor(middle - 0.5 * np.array(size)).astype(int)
    whole = np.zeros((rows, columns, 4), np.float32)
    x0, y0 = np.maximum(corner, 0)
    x1, y1 = np.minimum(corner + size, (columns, rows))
    if x1 > x0 and y1 > y0:
        whole[y0:y1, x0:x1] = light[y0 - corner[1] : y1 - corner[1], x0 - corner[0] : x1 - corner[0]]
    cover = whole[:, :, 3].copy()
    around = canvas[max(y0, 0) : max(y1, 1), max(x0, 0) : max(x1, 1)].reshape(-1, 3)
    air = around.mean(axis=0) if around.size else np.full(3, 180.0, np.float32)
    haze = float(generator.uniform(0.0, 0.9)) ** 2.0
    gain = math.exp(float(generator.normal(0.0, 0.25)))
    # now and then a paint that no world has
    painted = float(generator.uniform()) < _PAINTED_SHARE
    tint = np.exp(generator.normal(0.0, 0.35 if painted else 0.04, 3)).astype(np.float32)
    whole[:, :, :3] = np.minimum(gain * tint * whole[:, :, :3], 255.0 * whole[:, :, 3:])
    whole[:, :, :3] = (1.0 - haze) * whole[:, :, :3] + haze * air * whole[:, :, 3:]
    blur_px, motion_px = blurs
    if float(np.hypot(*motion_px)) > 0.25:
        whole = np.asarray(cv2.filter2D(whole, -1, motion_blur_kernel(motion_px), borderType=cv2.BORDER_CONSTANT))
    if blur_px > 0.2:
        whole = np.asarray(cv2.GaussianBlur(whole, (0, 0), blur_px, borderType=cv2.BORDER_CONSTANT))
    return _Laid(light=whole, cover=cover, nose_px=nose + corner)


def _exposed(canvas: Float32Array, drawn: bool, scale: float, generator: np.random.Generator) -> ImageArray:
    """Return a canvas as a camera reads it: exposure, noise, now and then grey, now and then coded."""
    gain = math.exp(float(generator.normal(0.0, 0.15)))
    # a thin mist over everything, or a lens against the light
    veil = float(generator.uniform(0.0, 0.6)) if float(generator.uniform()) < 0.25 else 0.0
    levels = gain * ((1.0 - veil) * canvas + veil * float(generator.uniform(120.0, 230.0)))
    if float(generator.uniform()) < _GREY_SHARE:
        levels[:] = (levels @ np.array([0.114, 0.587, 0.299], np.float32))[:, :, None]
    strongest = 8.0 if drawn else 4.0
    sigma = math.exp(float(generator.uniform(math.log(0.3), math.log(strongest))))
    if scale >= _FINEST:
        sigma *= 0.5
    levels += sigma * generator.standard_normal((*levels.shape[:2], 1), dtype=np.float32)
    levels += 0.5 * sigma * generator.standard_normal(levels.shape, dtype=np.float32)
    image = np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8)
    if float(generator.uniform()) < _CODED_SHARE:
        quality = int(generator.integers(25, 96))
        image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
    return np.asarray(image, np.uint8)


def _reduced(cover: Float32Array) -> Float32Array:
    """Return shares of pixels in the window's resolution."""
    larger = cover.shape[1] > WINDOW_PX[0]
    small = cv2.resize(cover, WINDOW_PX, interpolation=cv2.INTER_AREA if larger else cv2.INTER_LINEAR)
    return np.asarray(np.clip(small, 0.0, 1.0), np.float32)
