"""From a level set to one aircraft: connected regions, their grouping, and the choice among them.

A group is a strong region with the pieces that belong to it (a wing seen apart from the body). Groups are
judged by size, place and contrast; two that explain the prediction about equally well are ambiguous.
"""

import math
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

LabelArray = NDArray[np.int32]
Rows = dict[int, list[float]]
_MAX_REGIONS = 400
_MAX_SEEDS = 8
_LEAST_SHARE = 0.01

# columns of the table that `_measure` fills
_AREA, _MASS, _MASS_X, _MASS_Y, _X0, _Y0, _X1, _Y1, _PEAK, _RIM = range(10)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """Regions taken for one object; pixel positions are those of the working image.

    ``labels`` are the members' labels, ``box`` x0, y0, x1, y1 (exclusive), ``area`` px, ``mass`` the sum of
    contrast, ``centre`` (2,) the contrast-weighted centre, ``contrast`` the mean contrast in sigmas, ``rim``
    whether a member touches the working image's edge.
    """

    labels: tuple[int, ...]
    box: tuple[int, int, int, int]
    area: float
    mass: float
    centre: FloatArray
    contrast: float
    rim: bool

    @property
    def width(self) -> int:
        """Width of the box in px."""
        return self.box[2] - self.box[0]

    @property
    def height(self) -> int:
        """Height of the box in px."""
        return self.box[3] - self.box[1]


@njit(cache=True, nogil=True)
def _measure(labels: LabelArray, contrast: NDArray[np.float32], count: int) -> FloatArray:
    """Return the table of regions, (count, 10); row 0 is the background."""
    h, w = labels.shape
    table = np.zeros((count, 10))
    for k in range(count):
        table[k, _X0], table[k, _Y0] = w, h
    for i in range(h):
        for j in range(w):
            k = labels[i, j]
            if k == 0:
                continue
            row = table[k]
            c = contrast[i, j]
            row[_AREA] += 1
            row[_MASS] += c
            row[_MASS_X] += c * j
            row[_MASS_Y] += c * i
            row[_X0] = min(row[_X0], j)
            row[_Y0] = min(row[_Y0], i)
            row[_X1] = max(row[_X1], j + 1)
            row[_Y1] = max(row[_Y1], i + 1)
            row[_PEAK] = max(row[_PEAK], c)
            if i == 0 or j == 0 or i == h - 1 or j == w - 1:
                row[_RIM] = 1
    return table


@njit(cache=True, nogil=True)
def members_mask(labels: LabelArray, members: NDArray[np.int64], box: tuple[int, int, int, int]) -> NDArray[np.uint8]:
    """Return 1 where the box x0, y0, x1, y1 holds one of the member labels, else 0; uint8."""
    x0, y0, x1, y1 = box
    mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
    for i in range(y0, y1):
        for j in range(x0, x1):
            label = labels[i, j]
            if label > 0:
                for k in members:
                    if k == label:
                        mask[i - y0, j - x0] = 1
                        break
    return mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Regions:
    """All connected regions of one level set: ``labels`` (h, w) int32, ``table`` one row per label."""

    labels: LabelArray
    table: FloatArray


def find_regions(phi: NDArray[np.float32], contrast: NDArray[np.float32]) -> Regions:
    """Label the 8-connected regions of φ > 0 and measure them."""
    count, found = cv2.connectedComponents((phi > 0).astype(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    labels = cast(LabelArray, found)
    return Regions(labels=labels, table=_measure(labels, contrast, count))


def groups_around(
    regions: Regions,
    near: tuple[float, float],
    reach: float,
    span: float | None,
    tallest: float,
    min_peak: float,
    rim_is_open: tuple[bool, bool, bool, bool],
) -> list[Group]:
    """Return the groups whose seed lies within ``reach`` px of ``near``, strongest first.

    ``span`` bounds how wide a group may grow, ``tallest`` how high, as a share of that;
    ``rim_is_open`` says for the left, top, right and bottom edge
    whether the scene goes on beyond it (a region there is part of something larger).
    """
    h, w = regions.labels.shape
    order = (np.argsort(-regions.table[1:, _MASS])[:_MAX_REGIONS] + 1).tolist()
    # plain numbers: a look has a handful of regions, and every call on an array of ten costs more than the sum
    rows: Rows = {k: regions.table[k].tolist() for k in order if regions.table[k, _PEAK] >= min_peak}
    opened = {k for k, row in rows.items() if _touches(row, w, h, rim_is_open)}
    keep = [k for k in rows if k not in opened]
    groups: list[Group] = []
    seen: set[tuple[int, ...]] = set()
    for seed in keep:
        row = rows[seed]
        dx = max(row[_X0] - near[0], near[0] - row[_X1] + 1, 0.0)
        dy = max(row[_Y0] - near[1], near[1] - row[_Y1] + 1, 0.0)
        if math.hypot(dx, dy) > reach:
            continue
        # a seed stands for itself, too: what lies close by may be another object
        for members in (_grow(seed, keep, rows, span, tallest), (seed,)):
            if members not in seen:
                seen.add(members)
                groups.append(_group(members, rows))
        if len(groups) >= 2 * _MAX_SEEDS:
            break
    return groups


def _touches(row: list[float], w: int, h: int, edges: tuple[bool, bool, bool, bool]) -> bool:
    """Return whether a region touches an edge beyond which the scene goes on."""
    left, top, right, bottom = edges
    return (
        (left and row[_X0] <= 0) or (top and row[_Y0] <= 0) or (right and row[_X1] >= w) or (bottom and row[_Y1] >= h)
    )


def _grow(seed: int, keep: list[int], rows: Rows, span: float | None, tallest: float) -> tuple[int, ...]:
    """Return the seed's label with those of the pieces close enough to belong to it, sorted."""
    members = {seed}
    x0, y0, x1, y1 = rows[seed][_X0 : _Y1 + 1]
    mass = rows[seed][_MASS]
    largest = 1.25 * span if span is not None else 3.0 * max(x1 - x0, y1 - y0, 8.0)
    gap = max(2.0, 0.12 * (span if span is not None else max(x1 - x0, y1 - y0)))
    highest = max(tallest * largest, 8.0)
    changed = True
    while changed:
        changed = False
        for k in keep:
            row = rows[k]
            if k in members or row[_MASS] > mass or row[_MASS] < _LEAST_SHARE * mass:
                continue
            a0, b0, a1, b1 = row[_X0 : _Y1 + 1]
            apart = max(a0 - x1, x0 - a1, b0 - y1, y0 - b1, 0.0)
            # a speck belongs only if it all but touches; a severed wing may lie farther off
            if apart > max(2.0, min(gap, max(a1 - a0, b1 - b0))):
                continue
            left, top, right, bottom = min(x0, a0), min(y0, b0), max(x1, a1), max(y1, b1)
            if right - left > largest or bottom - top > highest:
                continue
            members.add(k)
            x0, y0, x1, y1 = left, top, right, bottom
            changed = True
    return tuple(sorted(members))


def _group(members: tuple[int, ...], rows: Rows) -> Group:
    """Sum up the members."""
    those = [rows[k] for k in members]
    mass, area = sum(r[_MASS] for r in those), sum(r[_AREA] for r in those)
    x, y = sum(r[_MASS_X] for r in those), sum(r[_MASS_Y] for r in those)
    return Group(
        labels=members,
        box=(
            int(min(r[_X0] for r in those)),
            int(min(r[_Y0] for r in those)),
            int(max(r[_X1] for r in those)),
            int(max(r[_Y1] for r in those)),
        ),
        area=area,
        mass=mass,
        centre=np.array([x, y]) / max(mass, 1e-9),
        contrast=mass / max(area, 1.0),
        rim=any(r[_RIM] > 0 for r in those),
    )
