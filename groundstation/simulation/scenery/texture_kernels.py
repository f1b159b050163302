"""Compiled textures of objects: walls with windows, roofs, fences, trees and edges of forests."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.simulation.scenery.noise_kernels import lattice, layers, step, within

PLAIN, WALL, ROOF, ROUND, FOREST, CONIFERS, TREE, CONIFER, FENCE, HEDGE, SHADOW = range(11)
_STOREY_M, _BAY_M = 2.9, 3.0
_POST_EVERY_M, _POST_M, _RAIL_M = 2.5, 0.1, 0.035


@njit(cache=True, nogil=True)
def _windows(u: float, v: float, height: float, covered: float) -> float:
    """Return which share of a pixel on a wall is window."""
    if covered > 1.5 or height < 2.2:
        return 0.16 if height >= 2.2 else 0.0
    bay, storey = u - _BAY_M * np.floor(u / _BAY_M), v - _STOREY_M * np.floor(v / _STOREY_M)
    if v > height - 0.4:
        return 0.0
    return within(bay, 0.95, 2.15, covered) * within(storey, 0.95, 2.25, covered)


@njit(cache=True, nogil=True)
def _tree_tops(u: float, height: float, spacing: float, pointed: bool, seed: int) -> float:
    """Return how high the trees of a wall of them reach at u, m."""
    top = (0.42 if pointed else 0.60) * height
    middle = int(np.floor(u / spacing))
    for k in range(middle - 1, middle + 2):
        tall = height * (0.70 + 0.30 * lattice(k, 3, seed))
        off = abs(u - (k + 0.5 + 0.6 * (lattice(k, 5, seed) - 0.5)) * spacing)
        if pointed:
            top = max(top, tall - 2.4 * off)
        else:
            radius = spacing * (0.60 + 0.35 * lattice(k, 9, seed))
            if off < radius:
                top = max(top, tall - radius + np.sqrt(radius * radius - off * off))
    return top


@njit(cache=True, nogil=True)
def _leaves(light: float, colour: FloatArray, second: FloatArray, c: FloatArray) -> None:
    share = min(max(light, 0.0), 1.15)
    for n in range(3):
        c[n] = second[n] + share * (colour[n] - second[n])


@njit(cache=True, nogil=True)
def _tree_wall(
    pointed: bool,
    u: float,
    v: float,
    height: float,
    covered: float,
    seed: int,
    colour: FloatArray,
    second: FloatArray,
    c: FloatArray,
) -> float:
    spacing = (0.26 if pointed else 0.50) * height
    frayed = 0.07 * height * layers(u, v, 0.12 * height, covered, 4, seed + 1)
    top = _tree_tops(u, height, spacing, pointed, seed) + frayed
    leaves = layers(u, v, 0.22 * height, covered, 5, seed + 2)
    own = lattice(int(np.floor(u / spacing)), 11, seed) - 0.5
    _leaves(0.15 + 0.65 * v / max(top, 0.1) + 0.9 * leaves + 0.25 * own, colour, second, c)
    return step(top - v, covered + 0.02 * height)


@njit(cache=True, nogil=True)
def _tree(
    pointed: bool,
    u: float,
    v: float,
    size: FloatArray,
    covered: float,
    seed: int,
    colour: FloatArray,
    second: FloatArray,
    c: FloatArray,
) -> float:
    """Set the colour of a single tree; the sun is on the side of rising u."""
    width, height = size[0], size[1]
    aside = u - 0.5 * width
    frayed = layers(u, v, 0.22 * width, covered, 4, seed + 1)
    leaves = layers(u, v, 0.30 * width, covered, 5, seed + 2)
    trunk = within(abs(aside), -1.0, 0.022 * height, covered) if v < 0.5 * height else 0.0
    if pointed:
        half = 0.5 * width * (1.0 - v / height) * (1.0 + 0.9 * frayed)
        crown = step(half - abs(aside), covered + 0.02 * width) * step(v - 0.07 * height, covered)
        light = 0.35 + 0.35 * v / height + 0.3 * aside / width + 1.0 * leaves
    else:
        middle, high = 0.60 * height, 0.40 * height
        radius = np.sqrt((2.0 * aside / width) ** 2 + ((v - middle) / high) ** 2)
        crown = step((0.92 + 0.5 * frayed - radius) * 0.5 * width, covered + 0.03 * width)
        light = 0.45 + 0.35 * (v - middle) / high + 0.4 * aside / width + 1.0 * leaves
    _leaves(light, colour, second, c)
    if trunk > crown:
        for n in range(3):
            c[n] = 0.55 * second[n]
    return max(crown, trunk)


@njit(cache=True, nogil=True)
def _fence(u: float, v: float, height: float, covered: float) -> float:
    phase = u - _POST_EVERY_M * np.floor(u / _POST_EVERY_M)
    posts = within(phase, 1.0, 1.0 + _POST_M, covered) if covered < _POST_EVERY_M else _POST_M / _POST_EVERY_M
    rails = 0.0
    for k in range(3):
        middle = (0.30 + 0.32 * k) * height
        rails += within(v, middle - 0.5 * _RAIL_M, middle + 0.5 * _RAIL_M, covered)
    return min(posts + rails, 1.0)


@njit(cache=True, nogil=True)
def texture(
    kind: int,
    u: float,
    v: float,
    size: FloatArray,
    covered: float,
    seed: int,
    colour: FloatArray,
    second: FloatArray,
    c: FloatArray,
) -> float:
    """Set the colour (3,) of a face at (u, v) m, of which a pixel covers so many; return its opacity, 0 to 1."""
    if kind == SHADOW:
        c[:] = 0.0
        return 1.0
    if kind in (FOREST, CONIFERS):
        return _tree_wall(kind == CONIFERS, u, v, size[1], covered, seed, colour, second, c)
    if kind in (TREE, CONIFER):
        return _tree(kind == CONIFER, u, v, size, covered, seed, colour, second, c)
    if kind == HEDGE:
        leaves = layers(u, v, 1.1, covered, 4, seed)
        _leaves(0.3 + 0.5 * v / size[1] + leaves, colour, second, c)
        return step(size[1] * (0.85 + 0.3 * layers(u, 0.0, 1.6, covered, 3, seed + 1)) - v, covered + 0.05)
    if kind == ROUND:
        share = u / size[0]
        for n in range(3):
            c[n] = colour[n] + share * (second[n] - colour[n])
        return 1.0
    factor = 1.0 + 0.16 * layers(u, 0.6 * v, 3.0, covered, 4, seed)
    if kind == ROOF and covered < 0.6:
        factor += 0.06 * np.sin(2.0 * np.pi * v / 0.35) / (1.0 + 40.0 * covered * covered)
    window = _windows(u, v, size[1], covered) if kind == WALL else 0.0
    for n in range(3):
        c[n] = factor * colour[n]
        c[n] += window * (second[n] - c[n])
    return _fence(u, v, size[1], covered) if kind == FENCE else 1.0
