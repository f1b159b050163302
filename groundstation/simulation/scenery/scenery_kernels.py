"""Compiled picture of the surroundings by direction: sky, clouds, sun, hills, ring of trees and ground, all in haze.

Colours are B, G, R as a camera with gain 1 shows them, 0 to 255. Each pattern is a sum of lattice noises of falling
wavelength, faded out where it is finer than what a pixel covers, and each edge is softened by that, so the picture is
free of aliasing whatever its density. Columns are the outer loop, since skyline and ring depend on the azimuth alone;
what depends on the elevation alone is computed once for all columns. What draws a pixel is one function to the
compiler: to hand the tones' hundred numbers from one to the next took a third of the time.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.simulation.occlusion_kernels import DEPTH_STEP_M, NO_OBJECT
from groundstation.simulation.scenery.ground_kernels import ground
from groundstation.simulation.scenery.noise_kernels import glow, layers, layers_within, mix, noise, smooth, step
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


class ViewRow(NamedTuple):
    """One elevation, of which ``sine`` and ``cosine`` are, and what all pixels of it share.

    ``up`` is the elevation of the sky there, not below 0, with its sine and cosine, ``zenith`` the zenith's share of
    its colour, ``sky_clear`` what haze leaves of it. ``distance`` m is that of the ground, ``ground_clear`` the same
    of its colour.
    """

    elevation: float
    sine: float
    cosine: float
    up: float
    up_sine: float
    up_cosine: float
    zenith: float
    sky_clear: float
    distance: float
    ground_clear: float


@njit(cache=True, nogil=True)
def row_at(tones: Tones, elevation: float, eye: FloatArray) -> ViewRow:
    """Return what all pixels of an elevation, rad, share."""
    sky = tones.sky
    up = max(elevation, 0.0)
    zenith = 1.0 - np.exp(-up / sky.gradient)
    sky_clear = 1.0
    if sky.haze_top > 0.0:
        sky_clear = np.exp(-sky.haze_top / (sky.extinction * max(np.sin(up), 1e-3)))
    distance, ground_clear = 0.0, 1.0
    if elevation < 0.0:
        distance = min(max(eye[2], 0.2) / np.tan(-elevation), _FAR_M)
        ground_clear = np.exp(-distance / sky.extinction)
    sine, cosine = np.sin(elevation), np.cos(elevation)
    return ViewRow(elevation, sine, cosine, up, np.sin(up), np.cos(up), zenith, sky_clear, distance, ground_clear)


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


@njit(cache=True, nogil=True, forceinline=True)
def _cosine_to_sun(sky: SkyTones, column: ViewColumn, sine: float, cosine: float) -> float:
    """Return it for an elevation of this sine and cosine."""
    return cosine * (column.sine * sky.sun.x + column.cosine * sky.sun.y) + sine * sky.sun.z


@njit(cache=True, nogil=True, forceinline=True)
def _fade(sky: SkyTones, glare: float, clear: float, c: FloatArray) -> None:
    """Replace all but a clear share of a colour by the haze's; ``glare`` is the sun's there."""
    more = 0.5 * glare if sky.glow > 0.0 else 0.0
    mix(c, 1.0 - clear, sky.air.b + more, sky.air.g + more, sky.air.r + more)


@njit(cache=True, nogil=True, forceinline=True)
def _clouds(sky: SkyTones, column: ViewColumn, row: ViewRow, pixel: float, seed: int, colour: FloatArray) -> float:
    """Lay clouds over the sky; return how much of it they hide."""
    # below, where they would be drawn out into streaks, they fade
    near_horizon = smooth((row.up - sky.clouds_from) / 0.1)
    if near_horizon <= 0.0:
        return 0.0
    # a layer of clouds at height 1, seen under the elevation
    far = 1.0 / max(row.up_sine, 0.035)
    if sky.relief > 0.0:
        # cumulus clouds are as high as wide: the layer is bent so that they are not elongated
        far = 1.0 / (row.up_sine + _HEAPS)
    x, y = far * column.sine * row.up_cosine, far * column.cosine * row.up_cosine
    covered = pixel * far * far if sky.relief > 0.0 else 0.0
    # no cloud, and without relief all cloud, needs no finer noise
    none = 0.45 - 0.75 * sky.cover
    all_cloud = np.inf if sky.relief > 0.0 else none + sky.softness
    thick = layers_within(x, y, sky.size, covered, 6, seed + 11, none, all_cloud) + 0.5
    cloud = smooth((thick - 0.95 + 0.75 * sky.cover) / sky.softness)
    share = sky.opacity * cloud * near_horizon
    if share <= 0.0:
        return 0.0
    b, g, r = sky.cloud.b, sky.cloud.g, sky.cloud.r
    if sky.relief > 0.0:
        # thicker towards the sun than here: in its own shade
        towards = 0.12 * sky.size
        other = layers(x + towards * sky.sun.x, y + towards * sky.sun.y, sky.size, covered, 4, seed + 11) + 0.5
        dark = sky.relief * smooth(0.45 + 0.8 * (thick - 0.95 + 0.75 * sky.cover) + 2.2 * (other - thick))
        b += dark * (sky.cloud_base.b - b)
        g += dark * (sky.cloud_base.g - g)
        r += dark * (sky.cloud_base.r - r)
    mix(colour, share, b, g, r)
    return share


@njit(cache=True, nogil=True, forceinline=True)
def _sky(
    sky: SkyTones, column: ViewColumn, row: ViewRow, glare: float, pixel: float, seed: int, colour: FloatArray
) -> None:
    colour[0], colour[1], colour[2] = sky.horizon.b, sky.horizon.g, sky.horizon.r
    mix(colour, row.zenith, sky.zenith.b, sky.zenith.g, sky.zenith.r)
    hidden = _clouds(sky, column, row, pixel, seed, colour)
    clear = row.sky_clear
    if sky.haze_top > 0.0:
        level_glare = glare
        if row.elevation < 0.0 and sky.glow > 0.0:
            level_glare = glow(_cosine_to_sun(sky, column, row.up_sine, row.up_cosine), sky.glow)
        _fade(sky, level_glare, clear, colour)
    if sky.glow > 0.0:
        more = glare * (1.0 - 0.7 * hidden) * (0.5 + 0.5 * clear)
        for k in range(3):
            colour[k] += more
        cosine = _cosine_to_sun(sky, column, row.sine, row.cosine)
        # some 8 deg from the sun there is none of its disc
        if sky.disc and (cosine > 0.99 or pixel > 0.1):
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
        cosine = _cosine_to_sun(sky, column, np.sin(-elevation), np.cos(-elevation))
        off = np.arccos(min(max(cosine, -1.0), 1.0))
        glitter = gloss * sky.glow * np.exp(-((off / 0.35) ** 2)) * smooth(0.5 + 2.5 * pattern)
        for k in range(3):
            c[k] += glitter


@njit(cache=True, nogil=True, forceinline=True)
def radiance(
    tones: Tones,
    tables: Tables,
    column: ViewColumn,
    row: ViewRow,
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
    elevation, height = row.elevation, max(eye[2], 0.2)
    glare = glow(_cosine_to_sun(sky, column, row.sine, row.cosine), sky.glow) if sky.glow > 0.0 else 0.0
    foot = -height / column.trees_m
    if elevation > -pixel or elevation > max(column.hill, column.tree_top) + pixel:
        _sky(sky, column, row, glare, pixel, seed, c)
        # on the standard site, where hills end below the horizon, there is sky down to them
        if elevation > max(column.hill, column.tree_top) + pixel and (elevation >= 0.0 or skyline.hills_m == 0.0):
            return False
        shade = layers(column.azimuth, elevation * 4.0, 0.03, pixel, 5, seed + 73)
        for k in range(3):
            soil[k] = skyline.hills[k] + skyline.hills_fine[k] * shade
        if skyline.hills_m > 0.0:
            _fade(sky, glare, np.exp(-skyline.hills_m / sky.extinction), soil)
        mix(c, step(column.hill - elevation, pixel), soil[0], soil[1], soil[2])
    if elevation < 0.0:
        distance = row.distance
        x, y = eye[0] + distance * column.sine, eye[1] + distance * column.cosine
        across, along = distance * pixel, min((distance * distance + height * height) / height * pixel, _FAR_M)
        gloss = ground(tones, tables, x, y, column.sine, column.cosine, across, along, soil, top)
        if gloss > 0.0:
            waves = layers(x, y, 7.0, np.sqrt(across * along), 4, seed + 111)
            _mirror(sky, column, elevation, gloss, waves, soil)
        _fade(sky, glare, row.ground_clear, soil)
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
            _fade(sky, glare, np.exp(-column.trees_m / sky.extinction), soil)
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
    rows = [row_at(tones, place[1] - (corner[0] + row) / density, eye) for row in range(out.shape[0])]
    for column_number in range(out.shape[1]):
        column = column_at(tones, place[0] + (corner[1] + column_number) / density, pixel, eye)
        near = min(column.trees_m / DEPTH_STEP_M, NO_OBJECT - 1.0)
        for row in range(out.shape[0]):
            colour[:] = 0.0
            solid = radiance(tones, tables, column, rows[row], pixel, eye, colour, room)
            depth[row, column_number] = np.uint16(near) if solid else np.uint16(NO_OBJECT)
            if grey:
                light = 0.114 * colour[0] + 0.587 * colour[1] + 0.299 * colour[2]
                colour[0] = colour[1] = colour[2] = light
            for k in range(3):
                out[row, column_number, k] = np.uint8(min(max(colour[k] + 0.5, 0.0), 255.0))
