"""Access to a camera image by windows in colour, with a record of the windows that were read.

A station's cameras deliver more than anyone looks at. Whoever wants pixels asks for a window; what was asked for is
noted, so that a recorder can keep exactly that, and a picture of which only that was kept can be looked at again.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.errors import GroundstationError

Window = tuple[int, int, int, int]
"""x0, y0, x1, y1 in px; the last column and row are not part of it."""

# what OpenCV's demosaicing looks at beside a pixel; even, so that the pattern of colours stays in step
_BAYER_REACH = 4
# the grey of what was not kept
_NOT_KEPT = 40


class PictureError(GroundstationError):
    """Pixels were asked for that this picture does not have."""


class BayerPattern(StrEnum):
    """Colours of a sensor's upper-left four pixels, by row: the names of GenICam."""

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
    """One picture of ``size_px`` (w, h); ``read`` tells the windows that have been looked at, ``whole_read`` if all.

    ``pattern`` is the order of a raw picture's colours, None where it is grey or in colour already.
    """

    def __init__(self, size_px: tuple[int, int], pattern: BayerPattern | None = None) -> None:
        self.size_px = size_px
        self.pattern = pattern
        self.read: list[Window] = []
        self.whole_read = False

    def window(self, window: Window) -> tuple[ImageArray, tuple[int, int]]:
        """Return the part of a window inside the picture, (h, w, 3) uint8 BGR, and its corner (x, y).

        Not to be written to. Raises `PictureError` where nothing of it is inside, or it was not kept.
        """
        clipped = clip(window, self.size_px)
        if clipped is None:
            w, h = self.size_px
            raise PictureError(f"window {window} of a picture of {w} × {h} px: nothing of it is inside")
        self.read.append(clipped)
        return self._pixels(clipped), (clipped[0], clipped[1])

    @property
    def has_all(self) -> bool:
        """Whether every window of it can be looked at."""
        return True

    def available(self, window: Window) -> Window | None:
        """Return the part of a window that can be looked at, the largest where there are several; None if none can."""
        return clip(window, self.size_px)

    def whole(self) -> ImageArray:
        """Return all of it, (h, w, 3) uint8 BGR; not to be written to."""
        self.whole_read = True
        return self._pixels((0, 0, *self.size_px))

    def glance(self) -> ImageArray:
        """Return all of it for a person's eyes, (h, w, 3) uint8 BGR: it decides nothing, and is not noted."""
        return self._pixels((0, 0, *self.size_px))

    @abstractmethod
    def _pixels(self, window: Window) -> ImageArray:
        """Return a window that lies inside."""

    @abstractmethod
    def kept(self, window: Window) -> "Kept":
        """Return what has to be kept to give this window again, as the camera gave it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kept:
    """A part of a picture as the camera gave it: ``pixels`` (h, w) raw or (h, w, 3) BGR, its corner at (x, y)."""

    x: int
    y: int
    pixels: ImageArray


class BgrPicture(Picture):
    """A picture (h, w, 3) uint8 that is in colour already."""

    def __init__(self, image: ImageArray) -> None:
        super().__init__((image.shape[1], image.shape[0]))
        self._image = image

    def _pixels(self, window: Window) -> ImageArray:
        x0, y0, x1, y1 = window
        return self._image[y0:y1, x0:x1]

    def kept(self, window: Window) -> Kept:
        """Return a copy of the window."""
        x0, y0, x1, y1 = window
        return Kept(x=x0, y=y0, pixels=self._image[y0:y1, x0:x1].copy())


class RawPicture(Picture):
    """A sensor's raw picture (h, w) uint8: grey where ``pattern`` is None, else in colour once someone looks."""

    def __init__(self, raw: ImageArray, pattern: BayerPattern | None) -> None:
        super().__init__((raw.shape[1], raw.shape[0]), pattern)
        self._raw = raw

    def _pixels(self, window: Window) -> ImageArray:
        part = _around(window, self.size_px, self.pattern)
        return _in_colour(self._raw[part[1] : part[3], part[0] : part[2]], part, window, self.pattern)

    def kept(self, window: Window) -> Kept:
        """Return a copy of the raw window, with what its colours need beside it."""
        x0, y0, x1, y1 = _around(window, self.size_px, self.pattern)
        return Kept(x=x0, y=y0, pixels=self._raw[y0:y1, x0:x1].copy())


class PartialPicture(Picture):
    """A picture of which only parts were kept.

    Parameters
    ----------
    parts : what was kept; raw parts (h, w), or (h, w, 3) BGR.
    pattern : of raw parts; None for grey ones.
    """

    def __init__(self, size_px: tuple[int, int], parts: Sequence[Kept], pattern: BayerPattern | None) -> None:
        super().__init__(size_px, pattern)
        self._parts = parts

    @property
    def kept_windows(self) -> list[Window]:
        """The parts that were kept."""
        return [(p.x, p.y, p.x + p.pixels.shape[1], p.y + p.pixels.shape[0]) for p in self._parts]

    @property
    def has_all(self) -> bool:
        """Whether one part is the whole picture."""
        return (0, 0, *self.size_px) in self.kept_windows

    def available(self, window: Window) -> Window | None:
        """Return the part of a window that was kept, the largest where there are several; None if none was."""
        wanted = clip(window, self.size_px)
        if wanted is None:
            return None
        found = None
        for part, kept in zip(self._parts, self.kept_windows, strict=True):
            readable = _in_reach(kept, self.size_px, self.pattern if part.pixels.ndim == 2 else None)
            both = _overlap(wanted, readable)
            if both is not None and (found is None or _area(both) > _area(found)):
                found = both
        return found

    def _pixels(self, window: Window) -> ImageArray:
        for part in self._parts:
            raw = part.pixels.ndim == 2
            needed = _around(window, self.size_px, self.pattern) if raw else window
            x0, y0 = needed[0] - part.x, needed[1] - part.y
            x1, y1 = needed[2] - part.x, needed[3] - part.y
            if x0 >= 0 and y0 >= 0 and x1 <= part.pixels.shape[1] and y1 <= part.pixels.shape[0]:
                pixels = part.pixels[y0:y1, x0:x1]
                return _in_colour(pixels, needed, window, self.pattern) if raw else pixels
        have = ", ".join(f"{p.pixels.shape[1]}×{p.pixels.shape[0]} at ({p.x}, {p.y})" for p in self._parts) or "nothing"
        raise PictureError(f"window {window} of a recorded picture: it holds {have}")

    def glance(self) -> ImageArray:
        """Return the parts that were kept, in their places, on grey."""
        w, h = self.size_px
        shown = np.full((h, w, 3), _NOT_KEPT, dtype=np.uint8)
        for part, window in zip(self._parts, self.kept_windows, strict=True):
            x0, y0, x1, y1 = window
            raw = part.pixels.ndim == 2
            shown[y0:y1, x0:x1] = _in_colour(part.pixels, window, window, self.pattern) if raw else part.pixels
        return shown

    def kept(self, window: Window) -> Kept:
        """Return the part that holds a window."""
        for part in self._parts:
            inside = part.x <= window[0] and part.y <= window[1]
            if inside and part.x + part.pixels.shape[1] >= window[2] and part.y + part.pixels.shape[0] >= window[3]:
                return part
        raise PictureError(f"window {window} of a recorded picture is not among what was kept")


def as_picture(image: ImageArray | Picture) -> Picture:
    """Return a picture; an array (h, w, 3) BGR becomes one."""
    return image if isinstance(image, Picture) else BgrPicture(image)


def grown(window: Window, by_px: int) -> Window:
    """Return a window with a margin; it may reach beyond the picture."""
    return window[0] - by_px, window[1] - by_px, window[2] + by_px, window[3] + by_px


def clip(window: Window, size_px: tuple[int, int]) -> Window | None:
    """Return the part of a window inside a picture (w, h); None where there is none."""
    return _overlap(window, (0, 0, *size_px))


def _overlap(a: Window, b: Window) -> Window | None:
    x0, y0 = max(a[0], b[0]), max(a[1], b[1])
    x1, y1 = min(a[2], b[2]), min(a[3], b[3])
    return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None


def _area(window: Window) -> int:
    return (window[2] - window[0]) * (window[3] - window[1])


def _in_reach(kept: Window, size_px: tuple[int, int], pattern: BayerPattern | None) -> Window:
    """Return what can be seen in colour of a raw part: all but what leans on pixels that were not kept."""
    if pattern is None:
        return kept
    x0, y0 = (v + _BAYER_REACH if v > 0 else 0 for v in kept[:2])
    x1, y1 = (v - _BAYER_REACH if v < size else v for v, size in zip(kept[2:], size_px, strict=True))
    return x0, y0, x1, y1


def _around(window: Window, size_px: tuple[int, int], pattern: BayerPattern | None) -> Window:
    """Return the window with what its colours need beside it, on even rows and columns."""
    if pattern is None:
        return window
    x0, y0 = (max((v - _BAYER_REACH) // 2 * 2, 0) for v in window[:2])
    x1, y1 = (min(v + _BAYER_REACH, size) for v, size in zip(window[2:], size_px, strict=True))
    return x0, y0, x1, y1


def _in_colour(raw: ImageArray, place: Window, window: Window, pattern: BayerPattern | None) -> ImageArray:
    """Return a window in colour from the raw pixels of ``place``, which holds it."""
    code = cv2.COLOR_GRAY2BGR if pattern is None else _TO_BGR[pattern]
    colour = np.asarray(cv2.cvtColor(np.ascontiguousarray(raw), code), np.uint8)
    x0, y0 = window[0] - place[0], window[1] - place[1]
    return colour[y0 : y0 + window[3] - window[1], x0 : x0 + window[2] - window[0]]
