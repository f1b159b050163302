"""Pictures of a drawn night: stars drawn out by the sky's motion, noise, hot pixels, satellites, aircraft lights."""

import numpy as np
from scipy.special import erf

from calibration.stars.simulated.star_field import StarField
from groundstation.arrays import FloatArray, ImageArray

# grey levels of 8 bits
_BACKGROUND = 12.0
_READ_NOISE = 2.0
_GAIN = 0.5
_SPREAD_PX = 0.9
_HALF = 7
_HOT_PIXELS = 60
_SATELLITE_SHARE, _AIRCRAFT_SHARE = 0.15, 0.1
_PARTS = 7


def hot_pixel_map(size_px: tuple[int, int], random: np.random.Generator) -> FloatArray:
    """Return what a sensor's hot pixels add to each picture (h, w), grey levels."""
    w, h = size_px
    hot = np.zeros((h, w))
    hot[random.integers(0, h, _HOT_PIXELS), random.integers(0, w, _HOT_PIXELS)] = random.uniform(20, 220, _HOT_PIXELS)
    return hot


def render_stars(field: StarField, drift_px: FloatArray, hot: FloatArray, random: np.random.Generator) -> ImageArray:
    """Return a picture (h, w) of 8 bits.

    ``drift_px`` (2,) is by how much stars move in the exposure, about the places of ``field``; ``hot`` (h, w) the
    sensor's own levels.
    """
    h, w = hot.shape
    light = np.full((h, w), _BACKGROUND)
    parts = np.linspace(-0.5, 0.5, _PARTS)
    drawn_out = field.pixel_px[:, None, :] + parts[:, None] * drift_px
    _add_spots(light, drawn_out.reshape(-1, 2), np.repeat(field.flux / _PARTS, _PARTS))
    if random.uniform() < _SATELLITE_SHARE:
        _add_trail(light, random.uniform(0, (w, h)), random.uniform(-400, 400, 2), 40.0, 400)
    if random.uniform() < _AIRCRAFT_SHARE:
        _add_trail(light, random.uniform(0, (w, h)), random.uniform(-90, 90, 2), 900.0, 4)
    noisy = random.poisson(light / _GAIN) * _GAIN + random.normal(0.0, _READ_NOISE, (h, w)) + hot
    return np.asarray(np.clip(np.round(noisy), 0, 255), dtype=np.uint8)


def _add_trail(light: FloatArray, start: FloatArray, way: FloatArray, flux: float, count: int) -> None:
    """Add ``count`` spots on a line, px."""
    parts = np.linspace(0.0, 1.0, count)
    _add_spots(light, start + parts[:, None] * way, np.full(count, flux))


def _add_spots(light: FloatArray, places_px: FloatArray, flux: FloatArray) -> None:
    """Add points' light (n,) at (n, 2), integrated over pixels, in place; what lies outside is lost."""
    h, w = light.shape
    middle = np.rint(places_px)
    off = middle[:, :, None] + np.arange(-_HALF, _HALF + 1) - places_px[:, :, None]
    across, along = _share(off[:, 0]), _share(off[:, 1])
    # a picture has thousands: the error function of all of them at once, then each onto the picture
    for k, (column, row) in enumerate(middle.astype(np.int64).tolist()):
        left, top = max(column - _HALF, 0), max(row - _HALF, 0)
        right, bottom = min(column + _HALF + 1, w), min(row + _HALF + 1, h)
        if left >= right or top >= bottom:
            continue
        own_columns = across[k, left - column + _HALF : right - column + _HALF]
        own_rows = along[k, top - row + _HALF : bottom - row + _HALF]
        light[top:bottom, left:right] += flux[k] * (own_rows[:, None] * own_columns)


def _share(off: FloatArray) -> FloatArray:
    """Return a pixel's share of a Gaussian, at distances from its middle."""
    width = np.sqrt(2.0) * _SPREAD_PX
    return np.asarray(0.5 * (erf((off + 0.5) / width) - erf((off - 0.5) / width)))
