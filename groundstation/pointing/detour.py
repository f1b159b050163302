"""The way of a head round zones that its lens is kept out of: where to turn next, and where to wait.

Over a grid of the angles that the head can reach, Dijkstra's shortest way from the goal to everywhere; the head makes
for the last point of its way that it can get to in a straight line.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from groundstation.arrays import FloatArray
from groundstation.pointing.keep_out import ClosedZones

_STEP_RAD = math.radians(3.0)
_ALONG_RAD = math.radians(0.5)
# the Sun moves a quarter of a degree in that time
_KEPT_S = 60.0
_PUSHES = 30
_NEAR_RAD = math.radians(0.02)
_SLOPE_RAD = 1e-4
# pan and tilt of an axis without limits; and how far ways are planned on any, a turn and a half to either side
_WITHOUT_LIMITS_RAD = np.array([math.pi, 0.5 * math.pi])
_FURTHEST_RAD = 3.0 * math.pi


@dataclass(frozen=True, slots=True, kw_only=True)
class Detour:
    """The next waypoint: ``angles_rad`` (2,) pan and tilt; ``reaches`` is whether it is the goal."""

    angles_rad: FloatArray
    reaches: bool


class DetourPlanner:
    """Finds the ways of one head.

    Parameters
    ----------
    lows_rad, highs_rad : (2,) of pan and tilt, within which it may be sent; infinite for an axis without limits.
    margin_rad : how far from the zones it is kept.
    """

    def __init__(self, lows_rad: FloatArray, highs_rad: FloatArray, margin_rad: float) -> None:
        # readings of a unit whose zero is aside, or that turns further than once round, go beyond half a turn
        self._lows = np.where(np.isfinite(lows_rad), np.maximum(lows_rad, -_FURTHEST_RAD), -_WITHOUT_LIMITS_RAD)
        self._highs = np.where(np.isfinite(highs_rad), np.minimum(highs_rad, _FURTHEST_RAD), _WITHOUT_LIMITS_RAD)
        self._margin = margin_rad
        counts = [max(math.ceil((b - a) / _STEP_RAD), 1) + 1 for a, b in zip(self._lows, self._highs, strict=True)]
        pan, tilt = (np.linspace(a, b, n) for a, b, n in zip(self._lows, self._highs, counts, strict=True))
        self._shape = (len(pan), len(tilt))
        self._nodes = np.stack(np.meshgrid(pan, tilt, indexing="ij"), axis=-1).reshape(-1, 2)
        self._tree: tuple[float, int, FloatArray] | None = None

    def next(self, t_s: float, zones: ClosedZones, here: FloatArray, wanted: FloatArray) -> Detour:
        """Return where to turn at a time from angles (2,), so as to get to others, or as near as one may."""
        goal = self._allowed(zones, wanted, here)
        reaches = bool(np.all(np.abs(goal - wanted) <= _NEAR_RAD))
        if self.sees(zones, here, goal):
            return Detour(angles_rad=goal, reaches=reaches)
        inside = zones.at((float(here[0]), float(here[1]))) < self._margin
        start = self._allowed(zones, here, wanted) if inside else here
        if inside and np.any(np.abs(start - here) > _NEAR_RAD):
            # out first, then on
            return Detour(angles_rad=start, reaches=False)
        return Detour(angles_rad=self._round(t_s, zones, here, goal), reaches=False)

    def sees(self, zones: ClosedZones, here: FloatArray, there: FloatArray) -> bool:
        """Return whether the straight way between angles (2,) keeps the margin."""
        count = max(math.ceil(float(np.abs(there - here).max()) / _ALONG_RAD), 1) + 1
        return zones.way_is_clear(here + np.linspace(0.0, 1.0, count)[:, None] * (there - here), self._margin)

    def _allowed(self, zones: ClosedZones, wanted: FloatArray, rather: FloatArray) -> FloatArray:
        """Return the angles nearest to those wanted at which the lens keeps the margin, by steepest ascent.

        From the very middle of a zone, where every way out is the same, towards ``rather``.
        """
        at = np.clip(wanted, self._lows, self._highs)
        for _ in range(_PUSHES):
            short = self._margin - zones.at((float(at[0]), float(at[1])))
            if short <= 0.0:
                return at
            slope = slope_of(zones, at)
            size = float(slope @ slope)
            if size < 1e-6:
                off = rather - at
                slope, size = (off / np.linalg.norm(off) if np.any(off) else np.array([0.0, 1.0])), 1.0
            at = np.clip(at + (short + 0.1 * _NEAR_RAD) / size * slope, self._lows, self._highs)
        return self._free_node(zones, wanted)

    def _free(self, zones: ClosedZones) -> FloatArray:
        clear = zones.clearance(self._nodes[:, 0], self._nodes[:, 1])
        return np.asarray(clear >= self._margin + 0.5 * _STEP_RAD)

    def _free_node(self, zones: ClosedZones, near: FloatArray) -> FloatArray:
        free = np.flatnonzero(self._free(zones))
        if not len(free):
            return near
        return np.asarray(self._nodes[free[np.argmin(np.sum((self._nodes[free] - near) ** 2, axis=1))]])

    def _round(self, t_s: float, zones: ClosedZones, here: FloatArray, goal: FloatArray) -> FloatArray:
        """Return the last node of the shortest path that is reached in a straight line; ``here`` without a path."""
        end = int(np.argmin(np.sum((self._nodes - self._free_node(zones, goal)) ** 2, axis=1)))
        if self._tree is None or self._tree[1] != end or not 0.0 <= t_s - self._tree[0] < _KEPT_S:
            self._tree = (t_s, end, self._ways_to(zones, end))
        towards = self._tree[2]
        off = np.sum((self._nodes - here) ** 2, axis=1)
        for first in np.argsort(off)[:9]:
            if (first != end and towards[first] < 0) or not self.sees(zones, here, self._nodes[first]):
                continue
            node = int(first)
            while node != end and self.sees(zones, here, self._nodes[int(towards[node])]):
                node = int(towards[node])
            return np.asarray(self._nodes[node])
        return here

    def _ways_to(self, zones: ClosedZones, end: int) -> FloatArray:
        """Return for each node the next one on its path to ``end``, negative where there is none."""
        free = self._free(zones)
        number = np.arange(len(self._nodes)).reshape(self._shape)
        pairs = []
        for a, b in ((1, 0), (0, 1), (1, 1), (1, -1)):
            one = number[: self._shape[0] - a, max(-b, 0) : self._shape[1] - max(b, 0)]
            other = number[a:, max(b, 0) : self._shape[1] - max(-b, 0)]
            pairs.append(np.stack([one.ravel(), other.ravel()]))
        links = np.concatenate(pairs, axis=1)
        links = links[:, free[links[0]] & free[links[1]]]
        lengths = np.linalg.norm(self._nodes[links[0]] - self._nodes[links[1]], axis=1)
        graph = coo_array((lengths, (links[0], links[1])), shape=(len(self._nodes),) * 2).tocsr()
        _, before = dijkstra(graph, directed=False, indices=end, return_predecessors=True)
        return np.asarray(before)


def slope_of(zones: ClosedZones, at: FloatArray) -> FloatArray:
    """Return the gradient (2,) of the clearance over pan and tilt."""
    pan = at[0] + np.array([1.0, -1.0, 0.0, 0.0]) * _SLOPE_RAD
    tilt = at[1] + np.array([0.0, 0.0, 1.0, -1.0]) * _SLOPE_RAD
    values = zones.clearance(pan, tilt)
    return np.array([values[0] - values[1], values[2] - values[3]]) / (2.0 * _SLOPE_RAD)
