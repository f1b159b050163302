"""Compiled picture of the surroundings by direction: sky, clouds, hills, trees, meadow and runway.

Colours are B, G, R as a camera with gain 1 shows them, 0 to 255. Each pattern is a sum of lattice noises of falling
wavelength, faded out where it is finer than what a pixel covers, and each edge is softened by that, so the picture is
free of aliasing whatever its density.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray

TREES_M = 520.0
_EDGE_MARK_M, _DASH_M, _DASH_EVERY_M = 0.18, 6.0, 14.0
_HAZE_M = 3500.0
_FAR_M = 60_000.0
_HALF_WIDTH, _START, _END, _AIM_MARK = 0, 1, 2, 3  # order of the runway, m


@njit(cache=True, nogil=True)
def _lattice(ix: int, iy: int, seed: int) -> float:
    """Return a number of 0 to 1 that belongs to a point of the lattice."""
    h = (ix * 0x1F1F1F1F + iy * 0x5BD1E995 + seed * 0x27D4EB2F) & 0xFFFFFFFF
    h ^= h >> 15
    h = (h * 0x2C1B3C6D) & 0xFFFFFFFF
    h ^= h >> 12
    h = (h * 0x297A2D39) & 0xFFFFFFFF
    h ^= h >> 15
    return h / 4294967296.0


@njit(cache=True, nogil=True)
def noise(x: float, y: float, seed: int) -> float:
    """Return smooth noise of 0 to 1 with wavelength of about 2 in x and y."""
    fx, fy = np.floor(x), np.floor(y)
    ix, iy = int(fx), int(fy)
    a, b = x - fx, y - fy
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    low = (1.0 - a) * _lattice(ix, iy, seed) + a * _lattice(ix + 1, iy, seed)
    high = (1.0 - a) * _lattice(ix, iy + 1, seed) + a * _lattice(ix + 1, iy + 1, seed)
    return (1.0 - b) * low + b * high


@njit(cache=True, nogil=True)
def _layers(x: float, y: float, cell: float, covered: float, count: int, seed: int) -> float:
    """Return a sum of noises around 0, each of half the cell of the one before, faded where pixels cover it."""
    total, weight = 0.0, 1.0
    for k in range(count):
        ratio = covered / cell
        if ratio > 2.0:
            break
        fade = 1.0 / (1.0 + 4.0 * ratio * ratio)
        total += weight * fade * (noise(x / cell, y / cell, seed + k) - 0.5)
        weight *= 0.62
        cell *= 0.5
    return total


@njit(cache=True, nogil=True)
def _step(value: float, width: float) -> float:
    """Return a step at 0 that takes a width: 0 before, 1 after."""
    return min(max(value / max(width, 1e-9) + 0.5, 0.0), 1.0)


@njit(cache=True, nogil=True)
def _within(value: float, low: float, high: float, width: float) -> float:
    """Return which share of a width around a value lies between two edges."""
    return max(_step(value - low, width) - _step(value - high, width), 0.0)


@njit(cache=True, nogil=True)
def _smooth(value: float) -> float:
    v = min(max(value, 0.0), 1.0)
    return v * v * (3.0 - 2.0 * v)


@njit(cache=True, nogil=True)
def _mix(colour: FloatArray, share: float, b: float, g: float, r: float) -> None:
    colour[0] += share * (b - colour[0])
    colour[1] += share * (g - colour[1])
    colour[2] += share * (r - colour[2])


@njit(cache=True, nogil=True)
def _sky(azimuth: float, elevation: float, cover: float, seed: int, colour: FloatArray) -> None:
    up = max(elevation, 0.0)
    share = 1.0 - np.exp(-up / 0.30)
    colour[0], colour[1], colour[2] = 222.0, 213.0, 203.0
    _mix(colour, share, 203.0, 158.0, 118.0)
    # a layer of clouds at height 1, seen under the elevation
    far = 1.0 / max(np.sin(up), 0.035)
    x, y = far * np.sin(azimuth) * np.cos(up), far * np.cos(azimuth) * np.cos(up)
    thick = _layers(x, y, 3.0, 0.0, 6, seed + 11) + 0.5
    # below, where they would be drawn out into streaks, they fade
    near_horizon = _smooth((up - 0.03) / 0.1)
    cloud = _smooth((thick - 0.95 + 0.75 * cover) / 0.45)
    _mix(colour, 0.75 * cloud * near_horizon, 226.0, 224.0, 222.0)


@njit(cache=True, nogil=True)
def _ground(
    x: float, y: float, covered_x: float, covered_y: float, runway: FloatArray, seed: int, c: FloatArray
) -> None:
    """Set the colour of the ground at (x, y) m, of which a pixel covers so much along x and y."""
    covered = max(covered_x, covered_y)
    wide = _layers(x, y, 90.0, covered, 4, seed + 31)
    fine = _layers(x, y, 4.0, np.sqrt(covered_x * covered_y), 5, seed + 41)
    c[0], c[1], c[2] = (
        62.0 + 16.0 * wide + 34.0 * fine,
        98.0 + 26.0 * wide + 46.0 * fine,
        84.0 + 40.0 * wide + 40.0 * fine,
    )
    half, start, end, aim = runway[_HALF_WIDTH], runway[_START], runway[_END], runway[_AIM_MARK]
    along = _within(y, start, end, covered_y)
    paved = along * _within(x, -half, half, covered_x)
    if paved <= 0.0:
        return
    tar = 100.0 + 26.0 * _layers(x, 0.25 * y, 2.0, np.sqrt(covered_x * covered_y), 5, seed + 51)
    _mix(c, paved, tar + 4.0, tar + 1.0, tar - 1.0)
    edge = _within(abs(x), half - 2.0 * _EDGE_MARK_M, half - _EDGE_MARK_M, covered_x)
    phase = y - _DASH_EVERY_M * np.floor(y / _DASH_EVERY_M)
    # dashes that a pixel covers several of are an even grey
    dash = _within(phase, 0.0, _DASH_M, covered_y) if covered_y < _DASH_EVERY_M else _DASH_M / _DASH_EVERY_M
    middle = _within(x, -0.1, 0.1, covered_x) * dash
    block = _within(abs(x), 0.3 * half, 0.62 * half, covered_x) * _within(y, aim, aim + 9.0, covered_y)
    bars = 0.0
    for k in range(4):
        low = (0.12 + 0.2 * k) * half
        bars += _within(abs(x), low, low + 0.11 * half, covered_x)
    bars *= _within(y, end - 10.0, end - 3.0, covered_y) + _within(y, start + 3.0, start + 10.0, covered_y)
    _mix(c, paved * min(edge + middle + block + bars, 1.0), 205.0, 206.0, 207.0)


@njit(cache=True, nogil=True)
def radiance(
    azimuth: float,
    elevation: float,
    pixel: float,
    eye: FloatArray,
    runway: FloatArray,
    cover: float,
    seed: int,
    c: FloatArray,
) -> None:
    """Set the colour (3,) that is seen from ``eye`` (3,) m under a direction, rad, by a pixel of so many rad.

    Azimuth is from +y towards +x. ``runway`` is half width, start, end and aim mark, m.
    """
    height = max(eye[2], 0.2)
    tree_top = -1.0
    # trees stand in clumps on a circle around the runway; seen from aside they stand elsewhere
    around = azimuth + (eye[0] * np.cos(azimuth) - eye[1] * np.sin(azimuth)) / TREES_M
    clump = _smooth((noise(around * 16.0, 0.0, seed + 61) - 0.55) / 0.12)
    if clump > 0.0:
        crown = 0.55 + 0.9 * _layers(around * TREES_M, 0.0, 7.0, pixel * TREES_M, 6, seed + 62)
        tree_top = (12.0 * clump * crown - height) / TREES_M
    foot = -height / TREES_M
    hill = (
        0.010
        + 0.014 * _layers(azimuth, 0.0, 0.35, pixel, 7, seed + 71)
        + 0.006 * _layers(azimuth, 3.0, 0.05, pixel, 4, seed + 72)
    )
    if elevation > max(hill, tree_top) + pixel:
        _sky(azimuth, elevation, cover, seed, c)
        return
    _sky(azimuth, elevation, cover, seed, c)
    shade = _layers(azimuth, elevation * 4.0, 0.03, pixel, 5, seed + 73)
    _mix(c, _step(hill - elevation, pixel), 150.0 + 14.0 * shade, 146.0 + 16.0 * shade, 128.0 + 16.0 * shade)
    if elevation < 0.0:
        distance = min(height / np.tan(-elevation), _FAR_M)
        x, y = eye[0] + distance * np.sin(azimuth), eye[1] + distance * np.cos(azimuth)
        across, along = distance * pixel, min((distance * distance + height * height) / height * pixel, _FAR_M)
        turned = abs(np.sin(azimuth))
        ground = np.empty(3)
        _ground(x, y, across + turned * (along - across), along + turned * (across - along), runway, seed, ground)
        _mix(ground, 1.0 - np.exp(-distance / _HAZE_M), 176.0, 172.0, 158.0)
        _mix(c, _step(-elevation, pixel), ground[0], ground[1], ground[2])
    if tree_top > foot:
        leaves = _layers(around * TREES_M, elevation * TREES_M, 4.0, pixel * TREES_M, 5, seed + 81)
        inside = min(_step(tree_top - elevation, pixel), _step(elevation - foot, pixel))
        _mix(c, inside, 58.0 + 44.0 * leaves, 72.0 + 56.0 * leaves, 58.0 + 48.0 * leaves)


@njit(cache=True, nogil=True)
def bake(
    first: FloatArray,
    density: float,
    eye: FloatArray,
    runway: FloatArray,
    cover: float,
    seed: int,
    grey: bool,
    out: ImageArray,
) -> None:
    """Fill a panorama (h, w, 3); pixel (0, 0) is at azimuth and elevation ``first``, rows go down, density px/rad."""
    colour = np.empty(3)
    for row in range(out.shape[0]):
        elevation = first[1] - row / density
        for column in range(out.shape[1]):
            radiance(first[0] + column / density, elevation, 1.0 / density, eye, runway, cover, seed, colour)
            if grey:
                light = 0.114 * colour[0] + 0.587 * colour[1] + 0.299 * colour[2]
                colour[0] = colour[1] = colour[2] = light
            for k in range(3):
                out[row, column, k] = np.uint8(min(max(colour[k] + 0.5, 0.0), 255.0))
