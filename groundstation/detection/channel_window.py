"""The window of the learned channel: a part of a picture, resampled to the target size that the network expects."""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.picture import Picture

WINDOW_PX = (128, 96)
# width of the target in it; the network was trained with the logarithm of it off by 0.25 (1 sigma)
TARGET_PX = 44.0
# pixels around a window that interpolation reads
_RIM_PX = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChannelWindow:
    """A window and where it is.

    Attributes
    ----------
    image : (96, 128, 3) uint8 BGR; what is outside the picture repeats its border.
    scale : window pixels per picture pixel.
    origin_px : (2,) the middle of the window's first pixel, in the picture.
    """

    image: ImageArray
    scale: float
    origin_px: FloatArray

    def to_picture(self, points: FloatArray) -> FloatArray:
        """Return where points (n, 2) of the window are in the picture."""
        return np.asarray(self.origin_px + points / self.scale)

    def from_picture(self, points: FloatArray) -> FloatArray:
        """Return where points (n, 2) of the picture are in the window."""
        return np.asarray((points - self.origin_px) * self.scale)


def channel_window(picture: Picture, centre_px: FloatArray, span_px: float) -> ChannelWindow | None:
    """Return the window around a point (2,) for a target ``span_px`` wide; None where the picture has no part of it."""
    scale = TARGET_PX / span_px
    half = 0.5 * np.array(WINDOW_PX) / scale
    low, high = np.floor(centre_px - half).astype(int) - _RIM_PX, np.ceil(centre_px + half).astype(int) + 1 + _RIM_PX
    w, h = picture.size_px
    if low[0] >= w or low[1] >= h or high[0] <= 0 or high[1] <= 0:
        return None
    part, corner = picture.window(Box(int(low[0]), int(low[1]), int(high[0]), int(high[1])))
    origin = centre_px - 0.5 * (np.array(WINDOW_PX) - 1.0) / scale
    step, place = np.full(2, 1.0 / scale), origin - np.array(corner)
    if scale < 1.0:
        # the mean of all pixels that fall into one; then a shift is left, and what the rounded size is off
        size = max(round(part.shape[1] * scale), 1), max(round(part.shape[0] * scale), 1)
        ratio = np.array(size) / np.array(part.shape[1::-1])
        part = np.asarray(cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8)
        place, step = (place + 0.5) * ratio - 0.5, step * ratio
    move = np.array([[step[0], 0.0, place[0]], [0.0, step[1], place[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    image = cv2.warpAffine(part, move, WINDOW_PX, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return ChannelWindow(image=np.asarray(image, np.uint8), scale=scale, origin_px=origin)
