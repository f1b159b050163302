"""Access to a camera image by windows in colour, with a list of the windows that were read.

A camera delivers more pixels than the program uses. A picture notes which windows were read; a recorder stores only
these, and a picture of which only some parts were recorded is read through the same interface.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.box import Box, clip, contains, intersection, shift
from groundstation.errors import GroundstationError

# pixels around a raw pixel that OpenCV's demosaicing reads; even, so that the colour pattern keeps its phase
_BAYER_REACH = 4
# grey level shown where no pixels were recorded
_MISSING_GREY = 40


class PictureError(GroundstationError):
    """Pixels were requested that this picture does not have."""


class BayerPattern(StrEnum):
    """Colours of a sensor's upper left four pixels, row by row, by their names in GenICam."""

    RG = "BayerRG8"
    GR = "BayerGR8"
    GB = "BayerGB8"
    BG = "BayerBG8"


# OpenCV names a pattern by the colours of its second row, second and third column
_TO_BGR = {
    BayerPattern.RG: cv2.COLOR_BayerBG2BGR,
    BayerPattern.GR: cv2.COLOR_BayerGB2BGR,
    BayerPattern.GB: cv2.COLOR_BayerGR2BGR,
    BayerPattern.BG: cv2.COLOR_BayerRG2BGR,
}


class Picture(ABC):
    """One picture of ``size_px`` (w, h).

    Attributes
    ----------
    pattern : order of a raw picture's colours, None where it is grey or already in colour.
    read : the windows that have been read.
    whole_read : whether the whole picture has been read.
    """

    def __init__(self, size_px: tuple[int, int], pattern: BayerPattern | None = None) -> None:
        self.size_px = size_px
        self.pattern = pattern
        self.read: list[Box[int]] = []
        self.whole_read = False

    def window(self, window: Box[int]) -> tuple[ImageArray, tuple[int, int]]:
        """Return the part of a window inside the picture, (h, w, 3) uint8 BGR, and its corner (x, y).

        The array must not be written to. Raises `PictureError` if no part is inside, or the part was not recorded.
        """
        clipped = clip(window, self.size_px)
        if clipped is None:
            w, h = self.size_px
            raise PictureError(f"window {tuple(window)} of a picture of {w} × {h} px: no part of it is inside")
        self.read.append(clipped)
        return self._pixels(clipped), (clipped.x0, clipped.y0)

    @property
    def has_all(self) -> bool:
        """Whether every window of it can be read."""
        return True

    def available(self, window: Box[int]) -> Box[int] | None:
        """Return the part of a window that can be read, the largest of several; None if there is none."""
        return clip(window, self.size_px)

    def whole(self) -> ImageArray:
        """Return all of it, (h, w, 3) uint8 BGR, which must not be written to."""
        self.whole_read = True
        return self._pixels(Box(0, 0, *self.size_px))

    def preview(self) -> ImageArray:
        """Return all of it for display, (h, w, 3) uint8 BGR; this is not counted as reading."""
        return self._pixels(Box(0, 0, *self.size_px))

    def preview_of(self, window: Box[int]) -> ImageArray:
        """Return a window for display, which `available` returned; like `preview` not counted as reading."""
        return self._pixels(window)

    @abstractmethod
    def _pixels(self, window: Box[int]) -> ImageArray:
        """Return a window that lies inside."""

    @abstractmethod
    def recordable(self, window: Box[int]) -> "PicturePart":
        """Return the pixels from the camera that must be recorded so that this window can be read again."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PicturePart:
    """A part of a picture as the camera delivered it: ``pixels`` (h, w) raw or (h, w, 3) BGR, its corner at (x, y)."""

    x: int
    y: int
    pixels: ImageArray

    @property
    def box(self) -> Box[int]:
        """The part's place in the picture."""
        h, w = self.pixels.shape[:2]
        return Box(self.x, self.y, self.x + w, self.y + h)


class BgrPicture(Picture):
    """A picture (h, w, 3) uint8 that is in colour already."""

    def __init__(self, image: ImageArray) -> None:
        super().__init__((image.shape[1], image.shape[0]))
        self._image = image

    def _pixels(self, window: Box[int]) -> ImageArray:
        return self._image[window.slices]

    def recordable(self, window: Box[int]) -> PicturePart:
        """Return a copy of the window."""
        return PicturePart(x=window.x0, y=window.y0, pixels=self._image[window.slices].copy())


class RawPicture(Picture):
    """A sensor's raw picture (h, w) uint8: grey where ``pattern`` is None, else converted to colour when it is read."""

    def __init__(self, raw: ImageArray, pattern: BayerPattern | None) -> None:
        super().__init__((raw.shape[1], raw.shape[0]), pattern)
        self._raw = raw

    def _pixels(self, window: Box[int]) -> ImageArray:
        part = _around(window, self.size_px, self.pattern)
        return _in_colour(self._raw[part.slices], part, window, self.pattern)

    def recordable(self, window: Box[int]) -> PicturePart:
        """Return a copy of the raw window with the pixels around it that demosaicing needs."""
        part = _around(window, self.size_px, self.pattern)
        return PicturePart(x=part.x0, y=part.y0, pixels=self._raw[part.slices].copy())


class PartialPicture(Picture):
    """A picture of which only parts were recorded.

    Parameters
    ----------
    parts : the parts recorded; raw (h, w), or (h, w, 3) BGR.
    pattern : of raw parts; None for grey ones.
    """

    def __init__(self, size_px: tuple[int, int], parts: Sequence[PicturePart], pattern: BayerPattern | None) -> None:
        super().__init__(size_px, pattern)
        self._parts = parts

    @property
    def recorded_windows(self) -> list[Box[int]]:
        """The boxes of the recorded parts."""
        return [part.box for part in self._parts]

    @property
    def has_all(self) -> bool:
        """Whether one part is the whole picture."""
        return Box(0, 0, *self.size_px) in self.recorded_windows

    def available(self, window: Box[int]) -> Box[int] | None:
        """Return the part of a window that was recorded, the largest of several; None if there is none."""
        wanted = clip(window, self.size_px)
        if wanted is None:
            return None
        found = None
        for part in self._parts:
            readable = _in_reach(part.box, self.size_px, self.pattern if part.pixels.ndim == 2 else None)
            both = intersection(wanted, readable)
            if both is not None and (found is None or both.area > found.area):
                found = both
        return found

    def _pixels(self, window: Box[int]) -> ImageArray:
        for part in self._parts:
            raw = part.pixels.ndim == 2
            needed = _around(window, self.size_px, self.pattern) if raw else window
            if contains(part.box, needed):
                pixels = part.pixels[shift(needed, -part.x, -part.y).slices]
                return _in_colour(pixels, needed, window, self.pattern) if raw else pixels
        have = ", ".join(f"{p.pixels.shape[1]}×{p.pixels.shape[0]} at ({p.x}, {p.y})" for p in self._parts) or "nothing"
        raise PictureError(f"window {tuple(window)} of a recorded picture: it holds {have}")

    def preview(self) -> ImageArray:
        """Return the recorded parts in their places, on grey."""
        w, h = self.size_px
        shown = np.full((h, w, 3), _MISSING_GREY, dtype=np.uint8)
        for part in self._parts:
            raw = part.pixels.ndim == 2
            shown[part.box.slices] = _in_colour(part.pixels, part.box, part.box, self.pattern) if raw else part.pixels
        return shown

    def recordable(self, window: Box[int]) -> PicturePart:
        """Return the recorded part that holds a window."""
        for part in self._parts:
            if contains(part.box, window):
                return part
        raise PictureError(f"window {tuple(window)} of a recorded picture lies in none of its parts")


def as_picture(image: ImageArray | Picture) -> Picture:
    """Return a picture; an array (h, w, 3) BGR becomes one."""
    return image if isinstance(image, Picture) else BgrPicture(image)


def _in_reach(part: Box[int], size_px: tuple[int, int], pattern: BayerPattern | None) -> Box[int]:
    """Return the box of a raw part that can be demosaiced from pixels of the part alone."""
    if pattern is None:
        return part
    x0, y0 = (v + _BAYER_REACH if v > 0 else 0 for v in part[:2])
    x1, y1 = (v - _BAYER_REACH if v < size else v for v, size in zip(part[2:], size_px, strict=True))
    return Box(x0, y0, x1, y1)


def _around(window: Box[int], size_px: tuple[int, int], pattern: BayerPattern | None) -> Box[int]:
    """Return a window with the pixels around it that demosaicing reads, from an even row and column on."""
    if pattern is None:
        return window
    x0, y0 = (max((v - _BAYER_REACH) // 2 * 2, 0) for v in window[:2])
    x1, y1 = (min(v + _BAYER_REACH, size) for v, size in zip(window[2:], size_px, strict=True))
    return Box(x0, y0, x1, y1)


def _in_colour(raw: ImageArray, place: Box[int], window: Box[int], pattern: BayerPattern | None) -> ImageArray:
    """Return a window in colour from the raw pixels of ``place``, which holds it."""
    code = cv2.COLOR_GRAY2BGR if pattern is None else _TO_BGR[pattern]
    colour = np.asarray(cv2.cvtColor(np.ascontiguousarray(raw), code), np.uint8)
    return colour[shift(window, -place.x0, -place.y0).slices]
