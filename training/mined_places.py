"""Places of pictures where a trained channel sees a possible aircraft and there is none: what it learns most from."""

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, channel_window
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.picture import as_picture

# windows of a picture that are looked at
_TRIES = 24
_WIDTHS_PX = (10.0, 300.0)
# log odds from which a place is worth learning
_LEAST_ODDS = -3.0
# a window is without the target if the target is out of it by more than this share of its size, less a half
_APART = 0.6


def false_place(
    channel: LearnedChannel, image: ImageArray, target: Box[float], generator: np.random.Generator
) -> tuple[FloatArray, float] | None:
    """Return a point (2,) and a target width, px, where a channel sees an aircraft and the picture has none.

    ``target`` is the box of the aircraft in the picture. Returns None where no drawn window is mistaken.
    """
    picture, best, found = as_picture(image), _LEAST_ODDS, None
    size = np.array(image.shape[1::-1], np.float64)
    for _ in range(_TRIES):
        width = float(np.exp(generator.uniform(*np.log(_WIDTHS_PX))))
        centre = generator.uniform(0.0, 1.0, 2) * (size - 1.0)
        window = channel_window(picture, centre, width)
        if window is None or _reaches(centre, width, target):
            continue
        odds = channel.maps(window.image).aircraft
        row, column = np.unravel_index(int(np.argmax(odds)), odds.shape)
        if float(odds[row, column]) > best:
            place = window.to_picture(np.array([column, row], np.float64))
            if np.all(place >= 0.0) and np.all(place <= size - 1.0):
                best, found = float(odds[row, column]), (place, width)
    return found


def _reaches(centre: FloatArray, width_px: float, target: Box[float]) -> bool:
    """Return whether a box is within a window around a point (2,), or near it."""
    half = _APART * np.array(WINDOW_PX) * width_px / TARGET_PX
    low, high = centre - half, centre + half
    return bool(low[0] < target.x1 and target.x0 < high[0] and low[1] < target.y1 and target.y0 < high[1])
