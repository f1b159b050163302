"""Compiled colours of the ground: its surface, fields, patches, the runway and its markings."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.simulation.scenery.noise_kernels import (
    lattice,
    layers,
    layers_within,
    mix,
    noise,
    smooth,
    within,
)
from groundstation.simulation.scenery.tones import (
    FIRST_PATCH,
    GROUND,
    RUNWAY,
    FieldTones,
    RunwayTones,
    Tables,
    Tones,
)

# fields of some two hectares, outside the runway's strip
_FIELD_X_M, _FIELD_Y_M, _STRIP_M = 130.0, 170.0, 60.0
_CLOUD_SHADOW_M = 420.0


@njit(cache=True, nogil=True)
def _surface(
    table: np.ndarray, k: int, x: float, y: float, covered: float, mean: float, seed: int, c: FloatArray
) -> None:
    """Set the colour of surface k at (x, y) m in its own axes; a pixel covers at most and on average so many m."""
    row = table[k]
    wide = 0.0
    if row.wide_g > 0.0:
        wide = layers(x, y, row.wide_m, covered, 4, seed + 31)
    fine = layers(x, row.along * y, row.fine_m, mean, 5, seed + 41)
    c[0] = row.base_b + row.wide_b * wide + row.fine_b * fine
    c[1] = row.base_g + row.wide_g * wide + row.fine_g * fine
    c[2] = row.base_r + row.wide_r * wide + row.fine_r * fine
    if row.stripe > 0.0:
        pitch = row.stripe_m
        fade = 1.0 / (1.0 + 9.0 * (covered / pitch) ** 2)
        factor = 1.0 + row.stripe * fade * np.sin(2.0 * np.pi * x / pitch + 2.0 * fine)
        for n in range(3):
            c[n] *= factor


@njit(cache=True, nogil=True, forceinline=True)
def _fields(fields: FieldTones, x: float, y: float, covered: float, seed: int, c: FloatArray) -> None:
    """Lay distant fields over the ground."""
    iy = int(np.floor(y / _FIELD_Y_M))
    ix = int(np.floor(x / _FIELD_X_M + 3.0 * lattice(iy, 7, seed + 95)))
    kind, strength = lattice(ix, iy, seed + 96), 0.4 + 0.6 * lattice(ix, iy, seed + 97)
    away = smooth((abs(x) - _STRIP_M) / 25.0)
    share = fields.mosaic * strength * away / (1.0 + (covered / _FIELD_Y_M) ** 2)
    if kind < 0.4:
        mix(c, share, fields.crop.b, fields.crop.g, fields.crop.r)
    elif kind < 0.65:
        mix(c, share, fields.stubble.b, fields.stubble.g, fields.stubble.r)
    elif kind < 0.8:
        mix(c, share, fields.ploughed.b, fields.ploughed.g, fields.ploughed.r)


@njit(cache=True, nogil=True)
def _patch_share(patches: np.ndarray, k: int, u: float, v: float, width_u: float, width_v: float, seed: int) -> float:
    """Return which share of a pixel at (u, v) m in the patch's axes lies within it."""
    ragged = patches[k].ragged
    if abs(u) > patches[k].half_width + ragged + width_u or abs(v) > patches[k].half_length + ragged + width_v:
        return 0.0
    if ragged > 0.0:
        cell = 6.0 * ragged
        u += ragged * 1.6 * layers(u, v, cell, width_v, 4, seed + 101)
        v += ragged * 1.6 * layers(u, v, cell, width_u, 4, seed + 107)
    half_u, half_v = patches[k].half_width, patches[k].half_length
    return within(u, -half_u, half_u, width_u) * within(v, -half_v, half_v, width_v)


@njit(cache=True, nogil=True)
def _paint(way: RunwayTones, x: float, y: float, covered_x: float, covered_y: float) -> float:
    """Return which share of a pixel on the runway is painted."""
    half = way.half
    edge = way.edge_line * within(abs(x), half - 2.0 * way.edge_width, half - way.edge_width, covered_x)
    phase = y - way.dash_from - way.dash_every * np.floor((y - way.dash_from) / way.dash_every)
    # dashes that a pixel covers several of are an even grey
    dash = within(phase, 0.0, way.dash, covered_y) if covered_y < way.dash_every else way.dash / way.dash_every
    middle = way.centre_line * within(x, -way.dash_half_width, way.dash_half_width, covered_x) * dash
    end_of_aim = way.aim + way.aim_length
    block = within(abs(x), 0.3 * half, 0.62 * half, covered_x) * within(y, way.aim, end_of_aim, covered_y)
    bars = 0.0
    for k in range(4):
        low = (0.12 + 0.2 * k) * half
        bars += within(abs(x), low, low + 0.11 * half, covered_x)
    bars *= within(y, way.end - 10.0, way.end - 3.0, covered_y) + within(
        y, way.start + 3.0, way.start + 10.0, covered_y
    )
    return min(edge + middle + way.aim_blocks * block + way.end_bars * bars, 1.0)


@njit(cache=True, nogil=True, forceinline=True)
def _runway(
    table: np.ndarray,
    way: RunwayTones,
    x: float,
    y: float,
    covered_x: float,
    covered_y: float,
    seed: int,
    c: FloatArray,
    top: FloatArray,
) -> None:
    """Lay the runway over the ground."""
    half = way.half
    along = within(y, way.start, way.end, covered_y)
    paved = along * within(x, -half, half, covered_x)
    if paved <= 0.0:
        return
    mean = np.sqrt(covered_x * covered_y)
    _surface(table, RUNWAY, x, y, max(covered_x, covered_y), mean, seed + 10, top)
    if way.tyre_marks > 0.0:
        zone = smooth((y - way.aim + 40.0) / 30.0) * smooth((way.aim + 110.0 - y) / 60.0)
        wheels = smooth(1.0 - abs(abs(x) - 0.3 * half) / (0.35 * half))
        dark = way.tyre_marks * zone * wheels * (0.35 + 0.65 * noise(x * 3.0, y * 0.02, seed + 53))
        mix(top, dark, 0.4 * top[0], 0.4 * top[1], 0.4 * top[2])
    mix(c, paved, top[0], top[1], top[2])
    paint = _paint(way, x, y, covered_x, covered_y)
    if way.wear > 0.0 and paint > 0.0:
        gone = smooth((layers(x, 0.4 * y, 0.8, mean, 4, seed + 57) + 0.9 * way.wear - 0.35) / 0.3)
        paint *= 1.0 - way.wear * (0.4 + 0.6 * gone)
    mix(c, paved * paint, way.paint.b, way.paint.g, way.paint.r)


@njit(cache=True, nogil=True, forceinline=True)
def ground(
    tones: Tones,
    tables: Tables,
    x: float,
    y: float,
    sine: float,
    cosine: float,
    across: float,
    along: float,
    c: FloatArray,
    top: FloatArray,
) -> float:
    """Set the colour of the ground at (x, y) m, seen along (sine, cosine); return how much sky it mirrors, 0 to 1.

    A pixel covers ``across`` and ``along`` m of it, across and along the view; ``top`` (3,) is room to work in.
    """
    seed, surfaces, patches = tones.seed, tables.surfaces, tables.patches
    turned = abs(sine)
    covered_x, covered_y = across + turned * (along - across), along + turned * (across - along)
    covered, mean = max(covered_x, covered_y), np.sqrt(covered_x * covered_y)
    _surface(surfaces, GROUND, x, y, covered, mean, seed, c)
    gloss = surfaces[GROUND].gloss
    if tones.fields.mosaic > 0.0:
        _fields(tones.fields, x, y, covered, seed, c)
    for k in range(len(patches)):
        dx, dy = x - patches[k].x, y - patches[k].y
        u, v = dx * patches[k].cosine - dy * patches[k].sine, dx * patches[k].sine + dy * patches[k].cosine
        aligned = abs(sine * patches[k].sine + cosine * patches[k].cosine)
        width_u, width_v = across + (1.0 - aligned) * (along - across), along + (1.0 - aligned) * (across - along)
        share = _patch_share(patches, k, u, v, width_u, width_v, seed + 7 * k)
        if share > 0.0:
            _surface(surfaces, FIRST_PATCH + k, u, v, covered, mean, seed + 7 * k + 200, top)
            mix(c, share, top[0], top[1], top[2])
            gloss += share * (surfaces[FIRST_PATCH + k].gloss - gloss)
    _runway(surfaces, tones.runway, x, y, covered_x, covered_y, seed, c, top)
    if abs(x) < tones.runway.half and tones.runway.start < y < tones.runway.end:
        gloss = 0.0
    if tones.fields.cloud_shadow > 0.0:
        edge = 0.5 - tones.sky.cover
        thick = layers_within(x, y, _CLOUD_SHADOW_M, covered, 4, seed + 91, edge - 0.08, edge + 0.08) + 0.5
        dark = tones.fields.cloud_shadow * smooth((thick - 1.0 + tones.sky.cover) / 0.16 + 0.5)
        mix(c, dark, 0.0, 0.0, 0.0)
    return gloss
