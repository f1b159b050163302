"""Crops of pictures with what the proposal network is to say of each cell: an aircraft's or a bird's middle, or none.

A crop is the picture reduced so far that one of its aircraft is as wide as the network is made for, or by any factor.
An aircraft that is far too wide or too narrow there is background: another level of the picture's pyramid shows it.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.proposal_finder import CELL_PX, MIDDLE_WIDTH_PX, WIDTHS_PX, network_input
from training.filmed_pictures import FilmedPicture

CROP_PX = 256
CELLS = CROP_PX // CELL_PX
# share of the crops around aircraft, around birds, and the rest anywhere
_AIRCRAFT_SHARE, _BIRD_SHARE = 0.6, 0.15
_BIRD_WIDTHS_PX = (5.0, 26.0)
_LEAST_BIRD_PX = 4.0
# crops anywhere are reduced by 2 to the power of this; none is by more, or enlarged by more than the other
_REDUCTIONS, _MOST_REDUCTION, _LARGEST = (-0.3, 4.0), 16.0, 1.25
# of a crop, how far its middle is from what it is around
_OFF = 0.42
_ON_PICTURE_SHARE = 0.8
# widths outside those learned by these factors are background, and in between neither
_TOO_NARROW, _TOO_WIDE = 0.55, 1.7
# an aircraft that covers fewer rows shows nothing of its shape
_LEAST_ROWS = 1.5
# one sigma of a middle's mark, of the width and px, and the mark from which place and width are learned
_MARK_SHARE, _LEAST_MARK_PX, _NEAR = 0.22, 3.0, 0.45
_MARGIN_PX = 6.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledCrop:
    """A crop.

    Attributes
    ----------
    planes : (3, 256, 256) what the network sees, zero beyond the picture.
    marks : (2, 32, 32) of aircraft and birds: 1 in the cell of a middle, less around it.
    counts : (2, 32, 32) whether a cell is learned.
    places : (3, 32, 32) binary logarithm of the width over the middle one, and where from a cell's middle in cells.
    near : (32, 32) whether these are learned.
    """

    planes: Float32Array
    marks: Float32Array
    counts: Float32Array
    places: Float32Array
    near: Float32Array


def crops_of(picture: FilmedPicture, count: int, generator: np.random.Generator) -> list[LabelledCrop]:
    """Draw so many crops of a picture."""
    image = picture.image()
    found: list[LabelledCrop] = []
    while len(found) < count:
        crop = _crop(image, picture, generator)
        if crop is not None:
            found.append(crop)
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _CropPart:
    """Where a part of the picture, ``box``, lies in the crop: ``x``, ``y``, and crop px a picture px, each way."""

    box: Box[int]
    x: int
    y: int
    size: tuple[int, int]

    def placed(self, corners: FloatArray) -> FloatArray:
        """Return corners (4,) in the crop."""
        zoom = np.array([self.size[0] / self.box.w, self.size[1] / self.box.h])
        low = np.array([self.box.x0, self.box.y0])
        return np.concatenate([(corners[:2] - low) * zoom, (corners[2:] - low) * zoom]) + [self.x, self.y] * 2


def _crop(image: ImageArray, picture: FilmedPicture, generator: np.random.Generator) -> LabelledCrop | None:
    part = _part(image.shape[1::-1], picture, generator)
    if part is None:
        return None
    pixels = image[part.box.y0 : part.box.y1, part.box.x0 : part.box.x1]
    reduced = part.size[0] < part.box.w
    way = cv2.INTER_AREA if reduced else cv2.INTER_LINEAR
    pixels = _in_other_light(np.asarray(cv2.resize(pixels, part.size, interpolation=way), np.uint8), generator)
    planes = np.zeros((3, CROP_PX, CROP_PX), np.float32)
    w, h = min(part.size[0], CROP_PX - part.x), min(part.size[1], CROP_PX - part.y)
    planes[:, part.y : part.y + h, part.x : part.x + w] = network_input(pixels)[:, :h, :w]
    crop = _labelled(planes, Box(part.x, part.y, part.x + w, part.y + h), part, picture)
    return _mirrored(crop) if float(generator.uniform()) < 0.5 else crop


def _part(size_px: tuple[int, int], picture: FilmedPicture, generator: np.random.Generator) -> _CropPart | None:
    """Draw what a crop shows of a picture (w, h); None where that is next to nothing."""
    share = float(generator.uniform())
    around, widths = None, WIDTHS_PX
    if len(picture.aircraft) and share < _AIRCRAFT_SHARE:
        around = picture.aircraft[int(generator.integers(len(picture.aircraft)))]
    elif len(picture.birds) and share < _AIRCRAFT_SHARE + _BIRD_SHARE:
        around, widths = picture.birds[int(generator.integers(len(picture.birds)))], _BIRD_WIDTHS_PX
    size = np.array(size_px, np.float64)
    if around is None:
        zoom, middle = 2.0 ** -float(generator.uniform(*_REDUCTIONS)), generator.uniform(0.0, 1.0, 2) * size
    else:
        width = math.exp(float(generator.uniform(*np.log(widths))))
        zoom, middle = width / max(around[2] - around[0], 3.0), 0.5 * (around[:2] + around[2:])
    zoom = min(max(zoom, 1.0 / _MOST_REDUCTION), _LARGEST)
    side = CROP_PX / zoom
    corner = middle + generator.uniform(-_OFF, _OFF, 2) * side - 0.5 * side
    # most crops go no further beyond the picture than they must
    limited = np.clip(corner, np.minimum(0.0, size - side), np.maximum(0.0, size - side))
    corner = np.where(generator.uniform(size=2) < _ON_PICTURE_SHARE, limited, corner)
    low = np.maximum(np.floor(corner), 0.0)
    high = np.minimum(np.floor(corner) + math.ceil(side), size)
    if np.any(high - low < CELL_PX / zoom):
        return None
    box = Box(int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    x, y = np.minimum(np.rint((low - np.floor(corner)) * zoom), CROP_PX - 1.0).astype(int)
    return _CropPart(
        box=box,
        x=int(x),
        y=int(y),
        size=(max(round(box.w * zoom), CELL_PX), max(round(box.h * zoom), CELL_PX)),
    )


def _in_other_light(image: ImageArray, generator: np.random.Generator) -> ImageArray:
    """Return a picture in mist, in other light, out of focus, with more noise, or grey; now and then each."""
    levels = image.astype(np.float32)
    if float(generator.uniform()) < 0.25:
        mist = float(generator.uniform(0.0, 0.6))
        levels = (1.0 - mist) * levels + mist * float(generator.uniform(110.0, 235.0))
    levels *= math.exp(float(generator.normal(0.0, 0.2)))
    if float(generator.uniform()) < 0.1:
        levels = np.asarray(cv2.GaussianBlur(levels, (0, 0), float(generator.uniform(0.4, 1.0))), np.float32)
    if float(generator.uniform()) < 0.4:
        sigma = math.exp(float(generator.uniform(math.log(0.5), math.log(7.0))))
        levels += sigma * generator.standard_normal((*levels.shape[:2], 1), dtype=np.float32)
        levels += 0.5 * sigma * generator.standard_normal(levels.shape, dtype=np.float32)
    if float(generator.uniform()) < 0.2:
        levels[:] = levels.mean(axis=2, keepdims=True)
    elif float(generator.uniform()) < 0.3:
        levels *= np.exp(generator.normal(0.0, 0.06, 3)).astype(np.float32)
    return np.asarray(np.clip(np.rint(levels), 0.0, 255.0), np.uint8)


def _labelled(planes: Float32Array, shown: Box[int], part: _CropPart, picture: FilmedPicture) -> LabelledCrop:
    """Return a crop with its labels; ``shown`` is the part of it that the picture covers."""
    rows, columns = (np.mgrid[0:CELLS, 0:CELLS] + 0.5) * CELL_PX
    covered = (columns >= shown.x0) & (columns < shown.x1) & (rows >= shown.y0) & (rows < shown.y1)
    marks, counts = np.zeros((2, CELLS, CELLS), np.float32), np.tile(covered.astype(np.float32), (2, 1, 1))
    places, near = np.zeros((3, CELLS, CELLS), np.float32), np.zeros((CELLS, CELLS), np.float32)
    learned: list[tuple[int, FloatArray]] = []
    unclear = [part.placed(box) for box in picture.unclear]
    for kind, boxes in enumerate((picture.aircraft, picture.birds)):
        for box in boxes:
            at = part.placed(box)
            wanted = is_learned(at, shown, bird=kind == 1)
            if wanted:
                learned.append((kind, at))
            elif wanted is None:
                unclear.append(at)
    for at in unclear:
        inside = (columns > at[0] - _MARGIN_PX) & (columns < at[2] + _MARGIN_PX)
        counts[:, inside & (rows > at[1] - _MARGIN_PX) & (rows < at[3] + _MARGIN_PX)] = 0.0
    for kind, at in learned:
        middle, width = 0.5 * (at[:2] + at[2:]), at[2] - at[0]
        sigma = max(_MARK_SHARE * width, _LEAST_MARK_PX)
        mark = np.exp(-0.5 * ((columns - middle[0]) ** 2 + (rows - middle[1]) ** 2) / sigma**2)
        row, column = (min(int(value // CELL_PX), CELLS - 1) for value in middle[::-1])
        mark[row, column] = 1.0
        marks[kind] = np.maximum(marks[kind], mark)
        counts[kind, row, column] = 1.0
        if kind == 0:
            close = mark > _NEAR
            places[0][close] = math.log2(width / MIDDLE_WIDTH_PX)
            places[1][close] = ((middle[0] - columns) / CELL_PX)[close]
            places[2][close] = ((middle[1] - rows) / CELL_PX)[close]
            near[close] = 1.0
    return LabelledCrop(planes=planes, marks=marks, counts=counts, places=places, near=near)


def is_learned(at: FloatArray, shown: Box[int], *, bird: bool) -> bool | None:
    """Return whether what is in a box (4,) of a crop is learned; None where it is to count neither way."""
    middle, width = 0.5 * (at[:2] + at[2:]), float(at[2] - at[0])
    inside = shown.x0 <= middle[0] < shown.x1 and shown.y0 <= middle[1] < shown.y1
    if bird:
        return True if inside and _LEAST_BIRD_PX <= width <= WIDTHS_PX[1] else None
    if inside and not _TOO_NARROW * WIDTHS_PX[0] <= width <= _TOO_WIDE * WIDTHS_PX[1]:
        return False
    seen = inside and WIDTHS_PX[0] <= width <= WIDTHS_PX[1] and at[3] - at[1] >= _LEAST_ROWS
    return True if seen else None


def _mirrored(crop: LabelledCrop) -> LabelledCrop:
    places = np.ascontiguousarray(crop.places[:, :, ::-1])
    places[1] *= -1.0
    planes, marks, counts, near = (
        np.ascontiguousarray(each[..., ::-1]) for each in (crop.planes, crop.marks, crop.counts, crop.near)
    )
    return LabelledCrop(planes=planes, marks=marks, counts=counts, places=places, near=near)
