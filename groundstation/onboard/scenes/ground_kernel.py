"""Rays of a picture to colours of the ground, compiled; each texture is averaged over the pixel's footprint."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, MaskArray

_OCTAVES = 7
# columns of a patch, and what it lies on, see `ground.PATCH`
_CX, _CY, _AX, _AY, _HALF_WIDTH, _HALF_LENGTH, _RED = range(7)
_OPACITY, _MOTTLE, _PERIOD, _SHARE, _UPON = range(9, 14)
_RUNWAY, _ON_RUNWAY = 1.0, 2.0


class Illumination(NamedTuple):
    """How a scene is lit: colours (3,) of the sun's light, of the haze and of the zenith, and the rest of `Light`."""

    sun: FloatArray
    haze: FloatArray
    zenith: FloatArray
    visibility_m: float
    cloud_shadow: float
    skyline_rad: float
    fall: float
    own_lamp: float
    cloud_across_m: float
    cloud_along_m: float


class GroundTexture(NamedTuple):
    """Size of the fields' patchwork, m, 0 for none; the texture as a share of the reflectance."""

    field_m: float
    grain: float


class Footprint(NamedTuple):
    """How the ground point of a pixel moves with the pixel (u, v), m per px."""

    x_by_u: float
    y_by_u: float
    x_by_v: float
    y_by_v: float


@njit(cache=True, nogil=True, inline="always")
def _lattice(i: int, j: int, seed: int) -> float:
    """Return a number in −1 … 1 that belongs to a corner of the lattice."""
    h = (i * 374761393 + j * 668265263 + seed * 974634777) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 32767.5 - 1.0


@njit(cache=True, nogil=True)
def value_noise(x: float, y: float, seed: int) -> float:
    """Return smooth noise in −1 … 1 with a lattice of 1."""
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    sx, sy = fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy)
    a, b = _lattice(i, j, seed), _lattice(i + 1, j, seed)
    c, d = _lattice(i, j + 1, seed), _lattice(i + 1, j + 1, seed)
    return (a + sx * (b - a)) * (1.0 - sy) + (c + sx * (d - c)) * sy


@njit(cache=True, nogil=True)
def _texture(x: float, y: float, fx: float, fy: float, first: float, octaves: int, seed: int) -> float:
    """Return octaves of noise from wavelength ``first`` m down, each faded by the footprint (fx, fy) m."""
    total, amplitude, wave = 0.0, 0.5, first
    for k in range(octaves):
        blur = (fx * fx + fy * fy) / (wave * wave)
        if blur > 4.0:
            break
        total += amplitude * math.exp(-1.2 * blur) * value_noise(x / wave, y / wave, seed + k)
        amplitude *= 0.72
        wave *= 0.42
    return total


@njit(cache=True, nogil=True, inline="always")
def _covered(x: float, f: float, half: float) -> float:
    """Return which share of [x − f/2, x + f/2] lies in [−half, half]."""
    low, high = max(x - 0.5 * f, -half), min(x + 0.5 * f, half)
    return max(high - low, 0.0) / f


@njit(cache=True, nogil=True)
def _tufts(x: float, y: float, fx: float, fy: float, cell: float, seed: int) -> float:
    """Return what bushes and stones, one in most cells of ``cell`` m, change of the reflectance, as a share."""
    i, j = math.floor(x / cell), math.floor(y / cell)
    radius = cell * (0.06 + 0.05 * (_lattice(i, j, seed) + 1.0))
    cx = cell * (i + 0.5 + 0.25 * _lattice(i, j, seed + 1))
    cy = cell * (j + 0.5 + 0.25 * _lattice(i, j, seed + 2))
    tone = _lattice(i, j, seed + 3)
    dx, dy = x - cx, y - cy
    if max(fx, fy) > radius:
        # too small to have a shape: a box of the same area, so that its share of the footprint is simple
        inside = _covered(dx, fx, 0.89 * radius) * _covered(dy, fy, 0.89 * radius)
    else:
        away = math.sqrt(dx * dx + dy * dy) + 1e-9
        ragged = radius * (1.0 + 0.35 * value_noise(x / radius * 1.7, y / radius * 1.7, seed + 4))
        width = (abs(dx) * fx + abs(dy) * fy) / away + 0.3 * radius
        inside = min(max((ragged - away) / width + 0.5, 0.0), 1.0)
    return inside * (tone - 0.4) * 0.5


@njit(cache=True, nogil=True, inline="always")
def _dashed(y: float, period: float, share: float) -> float:
    """Return the length painted between 0 and y."""
    whole = math.floor(y / period)
    return (whole * share + min(y / period - whole, share)) * period


@njit(cache=True, nogil=True)
def _mark_near(x: float, y: float, footprint: Footprint, columns: FloatArray, near: MaskArray) -> None:
    """Write which patches may lie under a pixel's footprint about (x, y) m; ``columns``: the patches, transposed.

    Most patches are far from most pixels, and this test, without a branch, is several at a time.
    """
    # no direction sees more of the footprint than this; the rest is far above rounding
    widest = abs(footprint.x_by_u) + abs(footprint.x_by_v) + abs(footprint.y_by_u) + abs(footprint.y_by_v)
    margin = 0.5 * widest * (1.0 + 1e-9) + 1e-6
    for k in range(near.size):
        dx, dy = x - columns[0, k], y - columns[1, k]
        along = abs(dx * columns[2, k] + dy * columns[3, k])
        across = abs(dx * columns[3, k] - dy * columns[2, k])
        near[k] = (along <= columns[5, k] + margin) & (across <= columns[4, k] + margin)


@njit(cache=True, nogil=True, inline="always")
def _patch_covered(dx: float, dy: float, footprint: Footprint, p: FloatArray) -> float:
    """Return which share of a pixel's footprint, (dx, dy) m from a patch's middle, the patch covers."""
    along = dx * p[_AX] + dy * p[_AY]
    across = dx * p[_AY] - dy * p[_AX]
    f_along = (
        abs(footprint.x_by_u * p[_AX] + footprint.y_by_u * p[_AY])
        + abs(footprint.x_by_v * p[_AX] + footprint.y_by_v * p[_AY])
        + 1e-6
    )
    f_across = (
        abs(footprint.x_by_u * p[_AY] - footprint.y_by_u * p[_AX])
        + abs(footprint.x_by_v * p[_AY] - footprint.y_by_v * p[_AX])
        + 1e-6
    )
    covered = _covered(across, f_across, p[_HALF_WIDTH]) * _covered(along, f_along, p[_HALF_LENGTH])
    if p[_PERIOD] > 0.0 and covered > 0.0:
        covered *= (
            _dashed(along + 0.5 * f_along, p[_PERIOD], p[_SHARE])
            - _dashed(along - 0.5 * f_along, p[_PERIOD], p[_SHARE])
        ) / f_along
    return covered


@njit(cache=True, nogil=True)
def _ground_colour(
    x: float,
    y: float,
    footprint: Footprint,
    patches: FloatArray,
    base: FloatArray,
    near: MaskArray,
    fields: GroundTexture,
    seed: int,
    runway: FloatArray,
    out: FloatArray,
) -> None:
    """Fill the reflectance (3,) of the ground that a pixel covers about (x, y) m.

    ``near`` (patches,): the patches that may lie under the pixel, from `_mark_near`. ``runway`` (3,) is overwritten:
    the reflectance of the part of the pixel that is runway. Paint, slabs and repairs cover that part and none of the
    ground next to it: laid one after the other over the whole pixel, those that share the runway's edge would move it
    outwards.
    """
    fx, fy = abs(footprint.x_by_u) + abs(footprint.x_by_v), abs(footprint.y_by_u) + abs(footprint.y_by_v)
    grain = _texture(x, y, fx, fy, 24.0, _OCTAVES, seed)
    fx, fy = fx + 1e-6, fy + 1e-6
    grain += _tufts(x, y, fx, fy, 5.0, seed + 51) / 0.45 + _tufts(x, y, fx, fy, 19.0, seed + 61) / 0.45
    mix = 0.5
    if fields.field_m > 0.0:
        mix = min(max(0.5 + 1.4 * value_noise(x / fields.field_m, y / (1.6 * fields.field_m), seed + 91), 0.0), 1.0)
    for c in range(3):
        out[c] = (base[0, c] * (1.0 - mix) + base[1, c] * mix) * (1.0 + fields.grain * grain)
    paved = 0.0
    # one for all patches of a pixel, and many lie on each other; none for a pixel of bare ground
    mottle, textured = 0.0, False
    for k in range(patches.shape[0]):
        if not near[k]:
            continue
        p = patches[k]
        alpha = _patch_covered(x - p[_CX], y - p[_CY], footprint, p)
        if alpha <= 0.0 or (p[_UPON] == _ON_RUNWAY and paved <= 0.0):
            continue
        if p[_UPON] == _ON_RUNWAY:
            alpha = min(alpha / paved, 1.0)
        alpha *= p[_OPACITY]
        shade = 1.0
        if p[_MOTTLE] > 0.0:
            if not textured:
                mottle, textured = _texture(x + 311.0, y - 77.0, fx, fy, 6.0, 4, seed + 17), True
            shade += p[_MOTTLE] * 2.0 * mottle
        if p[_UPON] == _RUNWAY:
            paved = alpha
        for c in range(3):
            new = p[_RED + c] * shade
            if p[_UPON] == _ON_RUNWAY:
                change = alpha * (new - runway[c])
                runway[c] += change
                out[c] += paved * change
            else:
                runway[c] = new
                out[c] += alpha * (new - out[c])


@njit(cache=True, nogil=True)
def _footprint(rays: FloatArray, i: int, j: int, rotation: FloatArray, camera: FloatArray, point: FloatArray) -> bool:
    """Write where the rays of a pixel and of its neighbours to the right and below meet the ground, (3, 2) m.

    Returns False where one of them does not. At the last row or column the neighbour is the one before.
    """
    h, w = rays.shape[:2]
    i1, j1 = (i + 1 if i + 1 < h else i - 1), (j + 1 if j + 1 < w else j - 1)
    for k in range(3):
        ax = rays[i, j, 0] if k == 0 else (rays[i, j1, 0] if k == 1 else rays[i1, j, 0])
        ay = rays[i, j, 1] if k == 0 else (rays[i, j1, 1] if k == 1 else rays[i1, j, 1])
        dz = rotation[2, 0] * ax + rotation[2, 1] * ay + rotation[2, 2]
        if dz > -1e-4:
            return False
        reach = -camera[2] / dz
        point[k, 0] = camera[0] + reach * (rotation[0, 0] * ax + rotation[0, 1] * ay + rotation[0, 2])
        point[k, 1] = camera[1] + reach * (rotation[1, 0] * ax + rotation[1, 1] * ay + rotation[1, 2])
    return True


@njit(cache=True, nogil=True)
def render_ground(
    rays: FloatArray,
    rotation: FloatArray,
    camera: FloatArray,
    patches: FloatArray,
    base: FloatArray,
    light: Illumination,
    fields: GroundTexture,
    seed: int,
    out: FloatArray,
) -> None:
    """Fill ``out`` (h, w, 3) with linear colours.

    ``rays`` (h, w, 2) normalised camera rays; ``rotation`` threshold_from_camera.
    """
    h, w = out.shape[:2]
    colour, runway = np.empty(3), np.empty(3)
    ray, point = np.empty(3), np.empty((3, 2))
    columns, near = np.ascontiguousarray(patches.T), np.empty(patches.shape[0], np.bool_)
    for i in range(h):
        for j in range(w):
            rx, ry = rays[i, j, 0], rays[i, j, 1]
            for c in range(3):
                ray[c] = rotation[c, 0] * rx + rotation[c, 1] * ry + rotation[c, 2]
            size = math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            rise = ray[2] / size
            if rise >= -0.002:
                azimuth = math.atan2(ray[0], ray[1])
                skyline = light.skyline_rad * max(0.6 + value_noise(azimuth * 14.0, 3.3, seed + 5), 0.0)
                wooded = rise > -0.002 and rise < skyline
                up = min(max(rise, 0.0) * 3.0, 1.0)
                for c in range(3):
                    if wooded:
                        out[i, j, c] = 0.75 * light.haze[c] + 0.25 * light.sun[c] * base[0, c]
                    else:
                        out[i, j, c] = light.haze[c] * (1.0 - up) + light.zenith[c] * up
                continue
            if not _footprint(rays, i, j, rotation, camera, point):
                for c in range(3):
                    out[i, j, c] = light.haze[c]
                continue
            x, y = point[0]
            footprint = Footprint(point[1, 0] - x, point[1, 1] - y, point[2, 0] - x, point[2, 1] - y)
            _mark_near(x, y, footprint, columns, near)
            _ground_colour(x, y, footprint, patches, base, near, fields, seed, runway, colour)
            distance = math.sqrt((x - camera[0]) ** 2 + (y - camera[1]) ** 2 + camera[2] ** 2)
            cloud = 1.0 - light.cloud_shadow * min(
                max(0.5 + 1.6 * value_noise(x / light.cloud_across_m, y / light.cloud_along_m, seed + 33), 0.0), 1.0
            )
            own = light.own_lamp * (60.0 / max(distance, 20.0)) ** 2
            clear = math.exp(-distance / light.visibility_m)
            fall = 1.0 + light.fall * (j / w - 0.5)
            for c in range(3):
                lit = colour[c] * (light.sun[c] * cloud * fall + own)
                out[i, j, c] = lit * clear + light.haze[c] * (1.0 - clear)


@njit(cache=True, nogil=True)
def add_lamps(
    out: FloatArray, pixels: FloatArray, distances: FloatArray, colours: FloatArray, power: float, spread_px: float
) -> None:
    """Add the points of light (n, 2) px, distances (n,) m, colours (n, 3) to a picture (h, w, 3)."""
    h, w = out.shape[:2]
    reach = int(4.0 * spread_px) + 1
    for k in range(pixels.shape[0]):
        u, v = pixels[k]
        if not (-reach < u < w + reach and -reach < v < h + reach):
            continue
        strength = power / (distances[k] * distances[k])
        for i in range(max(int(v) - reach, 0), min(int(v) + reach + 1, h)):
            for j in range(max(int(u) - reach, 0), min(int(u) + reach + 1, w)):
                away = ((j - u) ** 2 + (i - v) ** 2) / (2.0 * spread_px * spread_px)
                glow = strength * math.exp(-away) / (6.283185 * spread_px * spread_px)
                for c in range(3):
                    out[i, j, c] += glow * colours[k, c]
