"""Layers over a real picture: mixed in linear light, with the clip's noise where they cover, and coded as the clip is.

A coder blurs small details, colour more than grey, and adds ringing around them in the same block. Blocks that no
layer covers are unchanged, bit for bit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, ImageArray, IntArray
from groundstation.bank.composites.body_layer import BodyLayer
from groundstation.bank.composites.linear_light import levels_of, light_of
from groundstation.bank.composites.picture_noise import PictureNoise
from groundstation.simulation.render_primitives import overlap

# of JPEG with colour at half the resolution, and of H.264's macroblocks
BLOCK_PX = 16
# ripples and softness are then like those around the real aircraft of the clips of *train*, by eye
_QUALITY = 50
_GREY = np.array([0.114, 0.587, 0.299], np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LayeredPicture:
    """A picture (h, w, 3) with layers in it, and the matched filter's signal-to-noise ratio of the target's."""

    image: ImageArray
    snr: float


def layered(
    image: ImageArray,
    layers: Sequence[BodyLayer],
    target: BodyLayer | None,
    noise: PictureNoise,
    generator: np.random.Generator,
) -> LayeredPicture:
    """Return a picture with layers laid over it, far ones first; ``target`` is one of them."""
    light = light_of(image)
    covered = np.zeros(image.shape[:2], np.float32)
    change: Float32Array | None = None
    for layer in sorted(layers, key=lambda each: -each.away_m):
        both = overlap(layer.cover, layer.drawn.corner, covered, (0, 0))
        if both is None:
            continue
        own, there = both
        window, before = layer.drawn.cover[own], light[there].copy()
        light[there] = (1.0 - window[:, :, 3:]) * before + window[:, :, :3]
        covered[there] = 1.0 - (1.0 - covered[there]) * (1.0 - window[:, :, 3])
        if layer is target:
            change = np.zeros(covered.shape, np.float32)
            change[there] = (levels_of(light[there]) - levels_of(before)) @ _GREY
        elif change is not None:
            change[there] *= 1.0 - window[:, :, 3]
    snr = 0.0 if change is None else float(np.sqrt((change.astype(np.float64) ** 2).sum())) / noise.sigma
    if not covered.any():
        return LayeredPicture(image=image.copy(), snr=snr)
    part = _blocks(covered)
    share = covered[part][:, :, None]
    levels = levels_of(light[part]) + share * noise.draw(generator, share.shape[:2])[:, :, None]
    mixed = np.where(share > 0.0, np.clip(np.rint(levels), 0.0, 255.0).astype(np.uint8), image[part])
    out = image.copy()
    out[part] = _coded(mixed, np.ascontiguousarray(image[part]))
    return LayeredPicture(image=out, snr=snr)


def _blocks(covered: Float32Array) -> tuple[slice, slice]:
    """Return the rows and columns of the whole blocks that hold all covered pixels."""
    rows, columns = np.nonzero(covered)
    return _whole(rows), _whole(columns)


def _whole(places: IntArray) -> slice:
    """Return the span of whole blocks around rows or columns (n,)."""
    return slice(int(places.min()) // BLOCK_PX * BLOCK_PX, (int(places.max()) // BLOCK_PX + 1) * BLOCK_PX)


def _coded(mixed: ImageArray, image: ImageArray) -> ImageArray:
    """Return the picture after coding of the overlaid layers; the clip's own part is already coded.

    What coding does to the layers is the difference between the two pictures, both coded.
    """
    change = _through_coder(mixed).astype(np.int16) - _through_coder(image)
    return np.clip(image + change, 0, 255).astype(np.uint8)


def _through_coder(image: ImageArray) -> ImageArray:
    """Return a picture (h, w, 3) as JPEG with colour at half the resolution leaves it."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY,
        _QUALITY,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
    ]
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", image, options)[1], cv2.IMREAD_COLOR), np.uint8)
