"""Algorithm 1: the runway's edges in one picture, without a prior position.

1. The response of each column: colours right and left of it, over the intersection of the regions of all angles.
2. The N highest local maxima of the squared difference (the paper's minima of −½(u − v)²).
3. For each, the best angle on a coarse grid, then on a fine one.
4. The energy of every pair, and the lowest one that is plausible as a runway.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.energy import spatially_variant


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeDetectionConfig:
    """Tuning of Algorithm 1.

    Attributes
    ----------
    candidates : N.
    half_angle_rad : half the range of angles off the vertical (the paper's θ of step 1a).
    angles : of the coarse grid; the fine one has as many between two of them.
    reach_m, least_reach_px : width of the regions next to a line.
    apart_m : least distance of two candidates.
    """

    candidates: int = 5
    half_angle_rad: float = math.radians(45.0)
    angles: int = 5
    reach_m: float = 6.0
    least_reach_px: float = 5.0
    apart_m: float = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectedPairs:
    """Pairs of edges, the lowest energy first: crossings (k, 4) px with the rows, their weighted energies (k,).

    Besides, of the search itself: response (w,) and candidates (n, 2) u, angle.
    """

    pairs_px: FloatArray
    energies: FloatArray
    response: FloatArray
    candidates: FloatArray

    @property
    def crossings_px(self) -> FloatArray:
        """Return the best pair, (4,)."""
        return np.asarray(self.pairs_px[0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoPair:
    """No pair of candidates could be the runway; the response (w,) and the candidates (n, 2) that there were."""

    response: FloatArray
    candidates: FloatArray


@njit(cache=True, nogil=True)
def response(image: ImageArray, rows: FloatArray, reach: float, half_angle: float, out: FloatArray) -> None:
    """Fill ``out`` (w,) with −½ |u − v|² of the intersection masks about the middle row; 0 at the borders."""
    h, w = image.shape[:2]
    first, last = max(math.ceil(rows[0]), 0), min(math.floor(rows[1]), h - 1)
    middle, slope = 0.5 * (rows[0] + rows[1]), math.tan(half_angle)
    right, left = np.zeros((w, 3)), np.zeros((w, 3))
    count = 0.0
    prefix = np.zeros((w + 1, 3))
    for row in range(first, last + 1):
        # where the regions of all angles overlap in this row: from |dy| tan θ to reach − |dy| tan θ
        start = round(abs(row - middle) * slope)
        end = round(reach) - start
        if end <= start:
            continue
        for j in range(w):
            for c in range(3):
                prefix[j + 1, c] = prefix[j, c] + image[row, j, c]
        count += end - start
        for j in range(w):
            if j - end < 0 or j + end >= w:
                continue
            for c in range(3):
                right[j, c] += prefix[j + end + 1, c] - prefix[j + start + 1, c]
                left[j, c] += prefix[j - start, c] - prefix[j - end, c]
    out[:] = 0.0
    if count > 0.0:
        for j in range(w):
            for c in range(3):
                out[j] -= 0.5 * ((right[j, c] - left[j, c]) / count / 255.0) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def line_energies(
    image: ImageArray, rows: FloatArray, columns: FloatArray, slopes: FloatArray, reaches: FloatArray, out: FloatArray
) -> None:
    """Fill ``out`` (n,) with Eq. 4 of lines through the middle row at ``columns`` (n,), slopes (n,) px per row.

    ``reaches`` (2,) are the regions' widths at the upper and the lower row, px along the row. Each row is summed up
    once, in whole grey levels, and all lines read the sums.
    """
    h, w = image.shape[:2]
    middle, height = 0.5 * (rows[0] + rows[1]), rows[1] - rows[0]
    out[:] = 0.0
    prefix = np.zeros((w + 1, 3), np.int32)
    first, last = max(math.ceil(rows[0]), 0), min(math.floor(rows[1]), h - 1)
    for row in range(first, last + 1):
        reach = max(round(reaches[0] + (reaches[1] - reaches[0]) * (row - rows[0]) / height), 1)
        b, g, r = np.int32(0), np.int32(0), np.int32(0)
        for j in range(w):
            b += image[row, j, 0]
            g += image[row, j, 1]
            r += image[row, j, 2]
            prefix[j + 1, 0], prefix[j + 1, 1], prefix[j + 1, 2] = b, g, r
        scale = 1.0 / (255.0 * reach)
        for i in range(columns.size):
            place = round(columns[i] + slopes[i] * (row - middle))
            if place - reach < 0 or place + reach >= w:
                continue
            for c in range(3):
                right = prefix[place + reach + 1, c] - prefix[place + 1, c]
                left = prefix[place, c] - prefix[place - reach, c]
                out[i] += ((right - left) * scale) ** 2
    for i in range(columns.size):
        out[i] *= -0.5 / max(last + 1 - first, 1)


def detect(
    image: ImageArray,
    rows_px: FloatArray,
    px_per_m: FloatArray,
    config: EdgeDetectionConfig,
    plausible: Callable[[FloatArray], float],
) -> DetectedPairs | NoPair:
    """Run Algorithm 1 between two rows.

    Parameters
    ----------
    px_per_m : (2,) pixels per metre across the runway at the upper and the lower row.
    plausible : weight of a pair's energy by its crossings (4,): 0 for what cannot be a runway, 1 for no objection.
    """
    reaches = np.maximum(config.reach_m * px_per_m, config.least_reach_px)
    profile = np.empty(image.shape[1])
    half_height = 0.5 * float(rows_px[1] - rows_px[0])
    response(image, rows_px, float(reaches.mean()), config.half_angle_rad, profile)
    apart = max(config.apart_m * float(px_per_m.mean()), 3.0)
    columns = lowest_minima(profile, config.candidates, apart)
    candidates = _angles(image, rows_px, columns, reaches, config)
    found: list[tuple[float, FloatArray]] = []
    grad, widths, normals = np.empty(4), np.empty((2, 2)), np.zeros(2)
    for a in candidates:
        for b in candidates:
            if a[0] >= b[0]:
                continue
            slopes = np.tan(np.array([a[1], b[1]]))
            ends = np.array([a[0], b[0]])[:, None] + slopes[:, None] * np.array([-half_height, half_height])
            if np.any(ends[1] - ends[0] < 2.0):
                continue
            weight = plausible(ends.ravel())
            if weight <= 0.0:
                continue
            widths[:] = reaches / np.hypot(1.0, slopes)[:, None]
            energy = weight * float(spatially_variant(image, ends.ravel(), rows_px, widths, normals, (24, 6), grad))
            if energy < 0.0:
                found.append((energy, ends.ravel()))
    if not found:
        return NoPair(response=profile, candidates=candidates)
    found.sort(key=lambda pair: pair[0])
    return DetectedPairs(
        pairs_px=np.array([ends for _, ends in found]),
        energies=np.array([energy for energy, _ in found]),
        response=profile,
        candidates=candidates,
    )


def lowest_minima(profile: FloatArray, count: int, apart: float) -> FloatArray:
    """Return where the ``count`` lowest local minima of a profile (w,) are, no two closer than ``apart``."""
    inner = profile[1:-1]
    places = 1 + np.flatnonzero((inner < 0.0) & (inner <= profile[:-2]) & (inner <= profile[2:]))
    chosen: list[int] = []
    for place in places[np.argsort(profile[places], kind="stable")]:
        if all(abs(place - other) >= apart for other in chosen):
            chosen.append(int(place))
        if len(chosen) == count:
            break
    return np.array(chosen, dtype=np.float64)


def _angles(
    image: ImageArray, rows: FloatArray, columns: FloatArray, reaches: FloatArray, config: EdgeDetectionConfig
) -> FloatArray:
    """Return each column (n,) with its best angle off the vertical, (n, 2): coarse grid first, then a fine one."""
    if columns.size == 0:
        return np.empty((0, 2))
    coarse = np.linspace(-config.half_angle_rad, config.half_angle_rad, config.angles)
    energies = np.empty(columns.size * coarse.size)
    lines = np.repeat(columns, coarse.size), np.tile(np.tan(coarse), columns.size)
    line_energies(image, rows, *lines, reaches, energies)
    spacing = coarse[1] - coarse[0]
    # the column is that of the middle row only to within the masks' width
    offsets = np.arange(-3.0, 4.0)
    fine, shifts, counts = [], [], []
    for column, angle in zip(columns, coarse[energies.reshape(columns.size, -1).argmin(axis=1)], strict=True):
        own = angle + spacing * np.linspace(-1.0, 1.0, 4 * config.angles + 1)
        own = own[np.abs(own) <= config.half_angle_rad + 1e-9]
        shifts.append(np.repeat(column + offsets, own.size))
        fine.append(np.tile(own, offsets.size))
        counts.append(shifts[-1].size)
    every, turned = np.concatenate(shifts), np.concatenate(fine)
    energies = np.empty(every.size)
    line_energies(image, rows, every, np.tan(turned), reaches, energies)
    ends = np.cumsum(counts)
    best = [end - count + int(energies[end - count : end].argmin()) for end, count in zip(ends, counts, strict=True)]
    return np.column_stack([every[best], turned[best]])
