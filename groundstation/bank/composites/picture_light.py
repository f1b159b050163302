"""The light in a clip: colours of its sky and its ground, how clear the sky is, and where in the picture it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray, MaskArray
from groundstation.bank.composites.linear_light import light_of
from groundstation.detection.skyline import CELL_PX, sky_cells

_SPREAD_PX = 5
# saturation of a sky that is overcast, and of one that is clear
_GREY_SKY, _BLUE_SKY = 0.08, 0.3
# a picture with less ground shows none
_LEAST_GROUND = 0.04
_LUMINANCE = np.array([0.114, 0.587, 0.299])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureLight:
    """Light that a clip shows.

    Attributes
    ----------
    sky_bgr : (3,) light of the sky, 1 at level 255.
    ground_bgr : (3,) of the ground, None where the clip shows none.
    clearness : 0 for an overcast sky, 1 for a blue one.
    """

    sky_bgr: FloatArray
    ground_bgr: FloatArray | None
    clearness: float

    @property
    def sky_luminance(self) -> float:
        """Grey of the sky's light."""
        return float(self.sky_bgr @ _LUMINANCE)


def sky_mask(image: ImageArray) -> MaskArray:
    """Return which cells of `CELL_PX` px of a picture (h, w, 3) are sky."""
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    fine = grey.astype(np.float32)
    spread = cv2.blur(np.abs(fine - cv2.blur(fine, (_SPREAD_PX, _SPREAD_PX))), (_SPREAD_PX, _SPREAD_PX))
    return sky_cells(grey, np.asarray(spread, np.float32), None)


def is_sky(sky: MaskArray, pixel_px: FloatArray) -> bool:
    """Return whether a pixel (2,) is on a cell of sky; outside the picture the nearest cell is used."""
    rows, columns = sky.shape
    row, column = int(pixel_px[1] // CELL_PX), int(pixel_px[0] // CELL_PX)
    return bool(sky[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)])


def skyline_row(sky: MaskArray) -> float | None:
    """Return the row, px, at which the sky ends in the middle one of the columns; None without ground."""
    if float(sky.mean()) > 1.0 - _LEAST_GROUND:
        return None
    return float(CELL_PX * np.median(sky.sum(axis=0)))


def picture_light(frames: Sequence[ImageArray], skies: Sequence[MaskArray]) -> PictureLight:
    """Measure the light in some frames (h, w, 3) of one clip, of which ``skies`` are the masks."""
    sky, ground = [], []
    for frame, mask in zip(frames, skies, strict=True):
        cells = cv2.resize(light_of(frame), mask.shape[::-1], interpolation=cv2.INTER_AREA)
        sky.append(cells[mask] if mask.any() else cells.reshape(-1, 3))
        ground.append(cells[~mask])
    sky_bgr = np.concatenate(sky).mean(axis=0).astype(np.float64)
    below = np.concatenate(ground)
    cells_seen = sum(mask.size for mask in skies)
    ground_bgr = below.mean(axis=0).astype(np.float64) if len(below) >= _LEAST_GROUND * cells_seen else None
    levels = sky_bgr ** (1.0 / 2.2)
    saturation = 1.0 - float(levels.min() / max(float(levels.max()), 1e-6))
    clearness = float(np.clip((saturation - _GREY_SKY) / (_BLUE_SKY - _GREY_SKY), 0.0, 1.0))
    return PictureLight(sky_bgr=sky_bgr, ground_bgr=ground_bgr, clearness=clearness)
