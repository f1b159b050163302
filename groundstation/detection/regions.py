"""From a level set to one aircraft: connected regions, their grouping, and the choice among them.

A group is a strong region with the pieces that belong to it (a wing separated from the body). Groups are
scored by size, position and contrast; two that explain the prediction about equally well are ambiguous.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.box import Box
from groundstation.detection.connected_components import LabelArray, connected_runs

_MAX_REGIONS = 400
_MAX_SEEDS = 8
_LEAST_SHARE = 0.01

# columns of the table that `_measure` fills
_AREA, _MASS, _MASS_X, _MASS_Y, _X0, _Y0, _X1, _Y1, _PEAK, _RIM = range(10)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """Regions taken for one object; pixel positions are those of the working image.

    ``belongs`` (count,) marks the labels of members, ``box`` contains them, ``area`` px,
    ``mass`` the sum of contrast, ``centre`` (2,) the contrast-weighted centre, ``contrast`` the mean contrast in
    sigmas, ``rim`` whether a member touches the working image's edge.
    """

    belongs: NDArray[np.bool_]
    box: Box[int]
    area: float
    mass: float
    centre: FloatArray
    contrast: float
    rim: bool

    @property
    def members(self) -> NDArray[np.int64]:
        """The members' labels (n,), in ascending order."""
        return np.flatnonzero(self.belongs)

    @property
    def labels(self) -> tuple[int, ...]:
        """The members' labels."""
        return tuple(self.members.tolist())

    @property
    def width(self) -> int:
        """Width of the box in px."""
        return self.box.w

    @property
    def height(self) -> int:
        """Height of the box in px."""
        return self.box.h


@njit(cache=True, nogil=True)
def _label(phi: NDArray[np.float32], contrast: NDArray[np.float32]) -> tuple[LabelArray, FloatArray]:
    """Return the labels of the 8-connected regions of φ > 0 and their table, (count, 10); row 0 is the background."""
    h, w = phi.shape
    runs, number, count = connected_runs(phi)
    labels, table = np.zeros((h, w), np.int32), np.zeros((count, 10))
    for k in range(count):
        table[k, _X0], table[k, _Y0] = w, h
    for k in range(runs.shape[0]):
        i, first, end = runs[k, 0], runs[k, 1], runs[k, 2]
        row = table[number[k]]
        for j in range(first, end):
            labels[i, j] = number[k]
            c = contrast[i, j]
            row[_MASS] += c
            row[_MASS_X] += c * j
            row[_MASS_Y] += c * i
            row[_PEAK] = max(row[_PEAK], c)
        row[_AREA] += end - first
        row[_X0], row[_X1] = min(row[_X0], first), max(row[_X1], end)
        row[_Y0], row[_Y1] = min(row[_Y0], i), i + 1
        if i == 0 or first == 0 or i == h - 1 or end == w:
            row[_RIM] = 1
    return labels, table


@njit(cache=True, nogil=True)
def soft_silhouette(
    labels: LabelArray, members: NDArray[np.int64], box: Box[int], u: NDArray[np.float32]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return where a box holds the members, 1 or 0, and ``u`` (h, w) there and one pixel around it."""
    x0, y0, x1, y1 = box
    h, w = y1 - y0, x1 - x0
    mask, soft = np.zeros((h, w), np.uint8), np.zeros((h, w), np.float32)
    # one place more than the largest member's, for all labels beyond
    other = members.max() + 1
    belongs = np.zeros(other + 1, np.uint8)
    for k in members:
        belongs[k] = 1
    for i in range(h):
        line, own = labels[y0 + i], mask[i]
        for j in range(w):
            own[j] = belongs[min(line[x0 + j], other)]
    near = np.zeros(w + 2, np.uint8)
    for i in range(h):
        above, own, below = mask[max(i - 1, 0)], mask[i], mask[min(i + 1, h - 1)]
        some = np.uint8(0)
        for j in range(w):
            near[j + 1] = above[j] | own[j] | below[j]
            some |= near[j + 1]
        if some == 0:
            continue
        line, out = u[y0 + i], soft[i]
        for j in range(w):
            out[j] = line[x0 + j] if (near[j] | near[j + 1] | near[j + 2]) != 0 else np.float32(0)
    return mask, soft


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Regions:
    """All connected regions of one level set: ``labels`` (h, w) int32, ``table`` one row per label.

    ``features`` caches the appearance features of its groups.
    """

    labels: LabelArray
    table: FloatArray
    features: dict[Group, FloatArray] = field(default_factory=dict)


def find_regions(phi: NDArray[np.float32], contrast: NDArray[np.float32]) -> Regions:
    """Label the 8-connected regions of φ > 0 and measure them."""
    labels, table = _label(phi, contrast)
    return Regions(labels=labels, table=table)


def groups_around(
    regions: Regions,
    near: tuple[float, float],
    reach: float,
    span: float | None,
    tallest: float,
    min_peak: float,
    rim_is_open: tuple[bool, bool, bool, bool],
) -> list[Group]:
    """Return the groups whose seed is within ``reach`` px of ``near``, strongest first.

    ``span`` limits the width of a group, ``tallest`` the height, as a share of that;
    ``rim_is_open`` is, for the left, top, right and bottom edge,
    whether the scene continues beyond it (a region there is part of something larger).
    """
    # of many regions the heaviest are enough
    order = np.argsort(-regions.table[1:, _MASS])[:_MAX_REGIONS] + 1
    reach_of = (near[0], near[1], reach)
    # unknown is NaN inside: a kernel has no None
    limits = (math.nan if span is None else span, tallest, min_peak)
    members, sums = _gather(regions.table, order, regions.labels.shape, reach_of, limits, rim_is_open)
    return [_group(those, row) for those, row in zip(members, sums.tolist(), strict=True)]


@njit(cache=True, nogil=True)
def _gather(
    table: FloatArray,
    order: NDArray[np.int64],
    shape: tuple[int, int],
    near: tuple[float, float, float],
    limits: tuple[float, float, float],
    rim_is_open: tuple[bool, bool, bool, bool],
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return the labels of each group, (g, count), and each group's sums in the columns of the table.

    ``near`` is the centre and radius of the search for seeds, ``limits`` the span (NaN if unknown), the greatest
    height as a share of it, and the contrast that a region must reach.
    """
    h, w = shape
    span, tallest, min_peak = limits
    near_x, near_y, reach = near
    left, top, right, bottom = rim_is_open
    keep = np.empty(order.size, np.int64)
    kept = 0
    for k in order:
        row = table[k]
        opened = (left and row[_X0] <= 0) or (top and row[_Y0] <= 0)
        opened = opened or (right and row[_X1] >= w) or (bottom and row[_Y1] >= h)
        if row[_PEAK] >= min_peak and not opened:
            keep[kept] = k
            kept += 1
    keep = keep[:kept]
    members = np.zeros((2 * _MAX_SEEDS + 1, table.shape[0]), np.bool_)
    count = 0
    for seed in keep:
        row = table[seed]
        dx = max(row[_X0] - near_x, near_x - row[_X1] + 1, 0.0)
        dy = max(row[_Y0] - near_y, near_y - row[_Y1] + 1, 0.0)
        if math.hypot(dx, dy) > reach:
            continue
        # a seed is also a group by itself: a near region may be another object
        for alone in (False, True):
            members[count, seed] = True
            if not alone:
                _grow(members[count], seed, keep, table, span, tallest)
            if _is_new(members, count):
                count += 1
            else:
                members[count] = False
        if count >= 2 * _MAX_SEEDS:
            break
    return members[:count], _sums(members[:count], table)


@njit(cache=True, nogil=True)
def _is_new(members: NDArray[np.bool_], n: int) -> bool:
    """Return whether row n differs from all before it."""
    for k in range(n):
        same = True
        for label in range(members.shape[1]):
            if members[k, label] != members[n, label]:
                same = False
                break
        if same:
            return False
    return True


@njit(cache=True, nogil=True)
def _grow(
    members: NDArray[np.bool_],
    seed: int | np.int64,
    keep: NDArray[np.int64],
    table: FloatArray,
    span: float,
    tallest: float,
) -> None:
    """Add the pieces that are close enough to a seed to belong to it."""
    x0, y0, x1, y1 = table[seed, _X0], table[seed, _Y0], table[seed, _X1], table[seed, _Y1]
    mass = table[seed, _MASS]
    known = not math.isnan(span)
    largest = 1.25 * span if known else 3.0 * max(x1 - x0, y1 - y0, 8.0)
    gap = max(2.0, 0.12 * (span if known else max(x1 - x0, y1 - y0)))
    highest = max(tallest * largest, 8.0)
    changed = True
    while changed:
        changed = False
        for k in keep:
            if members[k] or table[k, _MASS] > mass or table[k, _MASS] < _LEAST_SHARE * mass:
                continue
            a0, b0, a1, b1 = table[k, _X0], table[k, _Y0], table[k, _X1], table[k, _Y1]
            apart = max(a0 - x1, x0 - a1, b0 - y1, y0 - b1, 0.0)
            # a speck belongs only if it nearly touches; a separated wing may be farther away
            if apart > max(2.0, min(gap, max(a1 - a0, b1 - b0))):
                continue
            left, top, right, bottom = min(x0, a0), min(y0, b0), max(x1, a1), max(y1, b1)
            if right - left > largest or bottom - top > highest:
                continue
            members[k] = True
            x0, y0, x1, y1 = left, top, right, bottom
            changed = True


@njit(cache=True, nogil=True)
def _sums(members: NDArray[np.bool_], table: FloatArray) -> FloatArray:
    """Return the sums over the members of each group, in the columns of the table."""
    sums = np.zeros((members.shape[0], table.shape[1]))
    for g in range(members.shape[0]):
        own, first = sums[g], True
        for k in range(1, table.shape[0]):
            if not members[g, k]:
                continue
            row = table[k]
            for column in (_AREA, _MASS, _MASS_X, _MASS_Y):
                own[column] += row[column]
            for column in (_X0, _Y0):
                own[column] = row[column] if first else min(own[column], row[column])
            for column in (_X1, _Y1, _PEAK, _RIM):
                own[column] = max(own[column], row[column])
            first = False
    return sums


def _group(members: NDArray[np.bool_], sums: list[float]) -> Group:
    """Give a group's sums their names."""
    mass, area = sums[_MASS], sums[_AREA]
    heavy = max(mass, 1e-9)
    return Group(
        belongs=members,
        box=Box(int(sums[_X0]), int(sums[_Y0]), int(sums[_X1]), int(sums[_Y1])),
        area=area,
        mass=mass,
        centre=np.array([sums[_MASS_X] / heavy, sums[_MASS_Y] / heavy]),
        contrast=mass / max(area, 1.0),
        rim=sums[_RIM] > 0,
    )
