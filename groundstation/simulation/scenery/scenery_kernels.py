"""Compiled picture of the surroundings by direction: sky, clouds, sun, hills, ring of trees and ground, all in haze.

Colours are B, G, R as a camera with gain 1 shows them, 0 to 255. Each pattern is a sum of lattice noises of falling
wavelength, faded out where it is finer than what a pixel covers, and each edge is softened by that, so the picture is
free of aliasing whatever its density. Columns are the outer loop, since skyline and ring depend on the azimuth alone.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.simulation.occlusion_kernels import DEPTH_STEP_M, NO_OBJECT
from groundstation.simulation.scenery.ground_kernels import ground
from groundstation.simulation.scenery.noise_kernels import glow, layers, mix, noise, smooth, step
from groundstation.simulation.scenery.tones import SkylineTones, SkyTones, Tables, Tones

_FAR_M = 60_000.0
# how far the layer of clouds is bent up at the horizon, in its heights
_HEAPS = 0.18
_SUN_RADIUS_RAD = 0.00465


class ViewColumn(NamedTuple):
    """One azimuth: its sine and cosine, elevation of hills and tree tops, the ring's distance and place along it."""

    azimuth: float
    sine: float
    cosine: float
    hill: float
    tree_top: float
    trees_m: float
    around: float


@njit(cache=True, nogil=True)
def _ring(skyline: SkylineTones, azimuth: float, eye: FloatArray) -> tuple[float, float]:
    """Return how far the ring of trees is, m, and the position on it of a direction, rad."""
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    radius = skyline.trees_m
    if not skyline.solid:
        # seen from aside their directions differ
        return radius, azimuth + (eye[0] * cosine - eye[1] * sine) / radius
    ahead = eye[0] * sine + eye[1] * cosine
    inside = radius * radius - eye[0] * eye[0] - eye[1] * eye[1]
    if inside <= 0.0:
        return np.inf, azimuth
    distance = np.sqrt(ahead * ahead + inside) - ahead
    return distance, np.arctan2(eye[0] + distance * sine, eye[1] + distance * cosine)


@njit(cache=True, nogil=True)
def column_at(tones: Tones, azimuth: float, pixel: float, eye: FloatArray) -> ViewColumn:
    """Return what all pixels of an azimuth, rad, share."""
    skyline, seed = tones.skyline, tones.seed
    height = max(eye[2], 0.2)
    tree_top = -1.0
    trees_m, around = _ring(skyline, azimuth, eye)
    radius = skyline.trees_m
    clump = smooth((noise(around * 16.0, 0.0, seed + 61) - skyline.trees_gap) / 0.12)
    if skyline.trees_gap >= 1.0 or trees_m > _FAR_M:
        clump = 0.0
    if clump > 0.0:
        crown = 0.55 + 0.9 * layers(around * radius, 0.0, 7.0, pixel * radius, 6, seed + 62)
        tree_top = (skyline.trees_height * clump * crown - height) / trees_m
    hill = (
        skyline.hill
        + skyline.hill_relief * layers(azimuth, 0.0, 0.35, pixel, 7, seed + 71)
        + skyline.hill_detail * layers(azimuth, 3.0, 0.05, pixel, 4, seed + 72)
    )
    return ViewColumn(azimuth, np.sin(azimuth), np.cos(azimuth), hill, tree_top, trees_m, around)


@njit(cache=True, nogil=True)
def _cosine_to_sun(sky: SkyTones, column: ViewColumn, elevation: float) -> float:
    level = np.cos(elevation)
    return level * (column.sine * sky.sun.x + column.cosine * sky.sun.y) + np.sin(elevation) * sky.sun.z


@njit(cache=True, nogil=True)
def _fade(sky: SkyTones, column: ViewColumn, elevation: float, clear: float, c: FloatArray) -> None:
    """Replace all but a clear share of a colour by the haze's."""
    more = 0.5 * glow(_cosine_to_sun(sky, column, elevation), sky.glow) if sky.glow > 0.0 else 0.0
    mix(c, 1.0 - clear, sky.air.b + more, sky.air.g + more, sky.air.r + more)


@njit(cache=True, nogil=True)
def _clouds(sky: SkyTones, column: ViewColumn, up: float, pixel: float, seed: int, colour: FloatArray) -> float:
    """Lay clouds over the sky; return how much of it they hide."""
    # below, where they would be drawn out into streaks, they fade
    near_horizon = smooth((up - sky.clouds_from) / 0.1)
    if near_horizon <= 0.0:
        return 0.0
    # a layer of clouds at height 1, seen under the elevation
    far = 1.0 / max(np.sin(up), 0.035)
    if sky.relief > 0.0:
        # cumulus clouds are as high as wide: the layer is bent so that they are not elongated
        far = 1.0 / (np.sin(up) + _HEAPS)
    x, y = far * column.sine * np.cos(up), far * column.cosine * np.cos(up)
    covered = pixel * far * far if sky.relief > 0.0 else 0.0
    thick = layers(x, y, sky.size, covered, 6, seed + 11) + 0.5
    cloud = smooth((thick - 0.95 + 0.75 * sky.cover) / sky.softness)
    share = sky.opacity * cloud * near_horizon
    b, g, r = sky.cloud.b, sky.cloud.g, sky.cloud.r
    if sky.relief > 0.0 and share > 0.0:
        # thicker towards the sun than here: in its own shade
        towards = 0.12 * sky.size
        other = layers(x + towards * sky.sun.x, y + towards * sky.sun.y, sky.size, covered, 4, seed + 11) + 0.5
        dark = sky.relief * smooth(0.45 + 0.8 * (thick - 0.95 + 0.75 * sky.cover) + 2.2 * (other - thick))
        b += dark * (sky.cloud_base.b - b)
        g += dark * (sky.cloud_base.g - g)
        r += dark * (sky.cloud_base.r - r)
    mix(colour, share, b, g, r)
    return share


@njit(cache=True, nogil=True)
def _sky(sky: SkyTones, column: ViewColumn, elevation: float, pixel: float, seed: int, colour: FloatArray) -> None:
    up = max(elevation, 0.0)
    share = 1.0 - np.exp(-up / sky.gradient)
    colour[0], colour[1], colour[2] = sky.horizon.b, sky.horizon.g, sky.horizon.r
    mix(colour, share, sky.zenith.b, sky.zenith.g, sky.zenith.r)
    hidden = _clouds(sky, column, up, pixel, seed, colour)
    clear = 1.0
    if sky.haze_top > 0.0:
        clear = np.exp(-sky.haze_top / (sky.extinction * max(np.sin(up), 1e-3)))
        _fade(sky, column, up, clear, colour)
    if sky.glow > 0.0:
        cosine = _cosine_to_sun(sky, column, elevation)
        more = glow(cosine, sky.glow) * (1.0 - 0.7 * hidden) * (0.5 + 0.5 * clear)
        for k in range(3):
            colour[k] += more
        if sky.disc:
            angle = np.arccos(min(cosine, 1.0))
            # far brighter than white, so that thin haze leaves it white
            disc = 2000.0 * clear * (1.0 - hidden) ** 2 * step(_SUN_RADIUS_RAD - angle, pixel)
            for k in range(3):
                colour[k] += disc


@njit(cache=True, nogil=True)
def _mirror(sky: SkyTones, column: ViewColumn, elevation: float, gloss: float, pattern: float, c: FloatArray) -> None:
    """Mix what still or rippled water mirrors into its colour; the pattern is of its waves, around 0."""
    # waves tilt the mirror: on average the sky is seen some 8° higher
    up = -elevation + 0.14 + 0.1 * pattern
    share = 1.0 - np.exp(-max(up, 0.0) / sky.gradient)
    grazing = 0.35 + 0.65 * (1.0 - np.sin(-elevation)) ** 5
    b = sky.horizon.b + share * (sky.zenith.b - sky.horizon.b)
    g = sky.horizon.g + share * (sky.zenith.g - sky.horizon.g)
    r = sky.horizon.r + share * (sky.zenith.r - sky.horizon.r)
    mix(c, gloss * grazing, b, g, r)
    if sky.glow > 0.0:
        # a facet that shows the sun is tilted by half the angle between the mirrored ray and the sun
        off = np.arccos(min(max(_cosine_to_sun(sky, column, -elevation), -1.0), 1.0))
        glitter = gloss * sky.glow * np.exp(-((off / 0.35) ** 2)) * smooth(0.5 + 2.5 * pattern)
        for k in range(3):
            c[k] += glitter


@njit(cache=True, nogil=True)
def radiance(
    tones: Tones,
    tables: Tables,
    column: ViewColumn,
    elevation: float,
    pixel: float,
    eye: FloatArray,
    c: FloatArray,
    room: FloatArray,
) -> bool:
    """Set the colour (3,) seen from ``eye`` (3,) m by a pixel of so many rad; return whether it is solid trees.

    ``room`` (2, 3) is to work in.
    """
    sky, skyline, seed = tones.sky, tones.skyline, tones.seed
    soil, top = room[0], room[1]
    height = max(eye[2], 0.2)
    foot = -height / column.trees_m
    if elevation > -pixel or elevation > max(column.hill, column.tree_top) + pixel:
        _sky(sky, column, elevation, pixel, seed, c)
        # on the standard site, where hills end below the horizon, there is sky down to them
        if elevation > max(column.hill, column.tree_top) + pixel and (elevation >= 0.0 or skyline.hills_m == 0.0):
            return False
        shade = layers(column.azimuth, elevation * 4.0, 0.03, pixel, 5, seed + 73)
        for k in range(3):
            soil[k] = skyline.hills[k] + skyline.hills_fine[k] * shade
        if skyline.hills_m > 0.0:
            _fade(sky, column, elevation, np.exp(-skyline.hills_m / sky.extinction), soil)
        mix(c, step(column.hill - elevation, pixel), soil[0], soil[1], soil[2])
    if elevation < 0.0:
        distance = min(height / np.tan(-elevation), _FAR_M)
        x, y = eye[0] + distance * column.sine, eye[1] + distance * column.cosine
        across, along = distance * pixel, min((distance * distance + height * height) / height * pixel, _FAR_M)
        gloss = ground(tones, tables, x, y, column.sine, column.cosine, across, along, soil, top)
        if gloss > 0.0:
            waves = layers(x, y, 7.0, np.sqrt(across * along), 4, seed + 111)
            _mirror(sky, column, elevation, gloss, waves, soil)
        _fade(sky, column, elevation, np.exp(-distance / sky.extinction), soil)
        mix(c, step(-elevation, pixel), soil[0], soil[1], soil[2])
    if column.tree_top > foot:
        inside = min(step(column.tree_top - elevation, pixel), step(elevation - foot, pixel))
        if inside <= 0.0:
            return False
        radius = skyline.trees_m
        leaves = layers(column.around * radius, elevation * radius, 4.0, pixel * radius, 5, seed + 81)
        for k in range(3):
            soil[k] = skyline.trees[k] + skyline.trees_fine[k] * leaves
        if skyline.solid:
            _fade(sky, column, elevation, np.exp(-column.trees_m / sky.extinction), soil)
        mix(c, inside, soil[0], soil[1], soil[2])
        return skyline.solid and inside >= 0.5
    return False


@njit(cache=True, nogil=True)
def bake(
    place: FloatArray,
    corner: np.ndarray,
    eye: FloatArray,
    tones: Tones,
    tables: Tables,
    grey: bool,
    out: ImageArray,
    depth: np.ndarray,
) -> None:
    """Fill a part (h, w, 3) of a panorama and its depth (h, w) in `DEPTH_STEP_M`.

    ``place`` (3,): azimuth and elevation of the panorama's pixel (0, 0), from which rows go down, and px/rad.
    ``corner`` (2,): row and column of the part's first pixel.
    """
    colour, room = np.empty(3), np.empty((2, 3))
    density = place[2]
    pixel = 1.0 / density
    for column_number in range(out.shape[1]):
        column = column_at(tones, place[0] + (corner[1] + column_number) / density, pixel, eye)
        near = min(column.trees_m / DEPTH_STEP_M, NO_OBJECT - 1.0)
        for row in range(out.shape[0]):
            elevation = place[1] - (corner[0] + row) / density
            colour[:] = 0.0
            solid = radiance(tones, tables, column, elevation, pixel, eye, colour, room)
            depth[row, column_number] = np.uint16(near) if solid else np.uint16(NO_OBJECT)
            if grey:
                light = 0.114 * colour[0] + 0.587 * colour[1] + 0.299 * colour[2]
                colour[0] = colour[1] = colour[2] = light
            for k in range(3):
                out[row, column_number, k] = np.uint8(min(max(colour[k] + 0.5, 0.0), 255.0))
