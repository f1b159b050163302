"""Places of pictures where a trained channel sees a possible aircraft and there is none: what it learns most from."""

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, channel_window
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.picture import as_picture

# windows of a picture that are looked at
_TRIES = 24
_WIDTHS_PX = (10.0, 300.0)
# log odds from which a place is worth learning: more than one in nine, as the channel states them
_LEAST_ODDS = -2.1
# levels: windows that vary less are an even sky, in which the search does not look either
_FLAT = 1.0
# a window shows neither aircraft nor bird if there is none within this share of its size around its middle
_APART = 0.6


def false_place(
    channel: LearnedChannel, image: ImageArray, cover: ImageArray, generator: np.random.Generator
) -> tuple[FloatArray, float] | None:
    """Return a point (2,) and a target width, px, where a channel sees an aircraft and the picture has none.

    ``cover`` (h, w) is zero where the picture shows neither aircraft nor birds. Returns None where no drawn window is
    mistaken.
    """
    picture, best, found = as_picture(image), _LEAST_ODDS, None
    size = np.array(image.shape[1::-1], np.float64)
    for _ in range(_TRIES):
        width = float(np.exp(generator.uniform(*np.log(_WIDTHS_PX))))
        centre = generator.uniform(0.0, 1.0, 2) * (size - 1.0)
        window = channel_window(picture, centre, width)
        if window is None or float(window.image.std()) < _FLAT or _covered(cover, centre, width):
            continue
        odds = channel.maps(window.image).aircraft
        row, column = np.unravel_index(int(np.argmax(odds)), odds.shape)
        if float(odds[row, column]) > best:
            place = window.to_picture(np.array([column, row], np.float64))
            if np.all(place >= 0.0) and np.all(place <= size - 1.0):
                best, found = float(odds[row, column]), (place, width)
    return found


def _covered(cover: ImageArray, centre: FloatArray, width_px: float) -> bool:
    """Return whether anything of a cover (h, w) is within a window around a point (2,), or near it."""
    half = _APART * np.array(WINDOW_PX) * width_px / TARGET_PX
    low = np.maximum(np.floor(centre - half), 0.0).astype(int)
    high = np.ceil(centre + half).astype(int) + 1
    return bool(cover[low[1] : high[1], low[0] : high[0]].any())
