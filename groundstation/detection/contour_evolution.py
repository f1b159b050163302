"""Steady state of the contour's remaining pixels: the side that each of them takes in the limit of the flow.

Without a limit φ grows as the cube root of time wherever its data term is not zero, since δ_ε falls as 1/φ². Its
shape is constant, φ_t ∝ φ · 1/t, so that in the end (Chan & Vese's flow, see chan_vese.py)::

    c φ³ = μ div(∇φ/|∇φ|) − ν − λ1 (u − c1)² + λ2 (u − c2)²

with any c > 0, since the length term is scale-free. A band at its limit has this shape except for its heights: all
driven pixels are equally high there, and a pixel with a weak data term follows its neighbours' heights.
These therefore get their heights in the limit, and the equation is solved pixel by pixel along the contour.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.detection.narrow_band import AT_REST, PHI_LIMIT, curvature_pull, limited_step

Drive = tuple[np.float32, np.float32, np.float32]

_MU, _NU, _LAMBDA1, _LAMBDA2 = 0, 1, 2, 3  # order of the weights
_DRIVE_AT_LIMIT = 0.25  # where c puts a φ of PHI_LIMIT: half a unit of u from the middle, with λ1 = λ2 = 1
_LEAST = 0.2  # the height of a pixel that its data drive to the other side
_LOOSE, _MOVES = 1.0, 0.02  # lower or moving pixels may still change sides
_STILL = 0.001
_MOST_SWEEPS = 60


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def means_of(n: int, inside: float, total: float, size: int, weights: NDArray[np.float32]) -> Drive:
    """Return −ν − λ1 (u − c1)² + λ2 (u − c2)² by powers of u: curvature, slope and level.

    ``n`` pixels of ``size`` are inside, ``inside`` and ``total`` the sums of u there and overall.
    ``weights`` (4,) are μ, ν, λ1, λ2.
    """
    nu, lambda1, lambda2 = weights[_NU], weights[_LAMBDA1], weights[_LAMBDA2]
    c1, c2 = np.float32(inside / max(n, 1)), np.float32((total - inside) / max(size - n, 1))
    slope = np.float32(2) * (lambda1 * c1 - lambda2 * c2)
    return lambda2 - lambda1, slope, lambda2 * c2 * c2 - lambda1 * c1 * c1 - nu


@njit(cache=True, nogil=True, fastmath=True)
def contour_flags(phi: NDArray[np.float32], i: int, flags: NDArray[np.bool_]) -> None:
    """Write which pixels of row i have a neighbour on the other side."""
    h, w = phi.shape
    own, above, below = phi[i], phi[max(i - 1, 0)], phi[min(i + 1, h - 1)]
    for j in range(w):
        flags[j] = ((above[j] > 0) != (own[j] > 0)) | ((below[j] > 0) != (own[j] > 0))
    for j in range(1, w):
        flags[j] |= (own[j - 1] > 0) != (own[j] > 0)
    for j in range(w - 1):
        flags[j] |= (own[j + 1] > 0) != (own[j] > 0)


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def crossed(rows: NDArray[np.int32], i: int, w: int) -> bool:
    """Return whether the contour may pass through row i: ``rows`` (h,) counts the pixels inside."""
    above, below = rows[max(i - 1, 0)], rows[min(i + 1, rows.size - 1)]
    return not ((rows[i] == 0 and above == 0 and below == 0) or (rows[i] == w and above == w and below == w))


@njit(cache=True, nogil=True, fastmath=True)
def _undecided(
    u: NDArray[np.float32], phi: NDArray[np.float32], i: int, drive: Drive, mu: np.float32, flags: NDArray[np.bool_]
) -> None:
    """Of the marked pixels of row i leave those that may change sides; mark also which are pushed away from theirs.

    Four neighbours pull with at most μ each: what its data hold more strongly stays.
    """
    bend, slope, level = drive
    most = np.float32(4) * mu
    for j in range(u.shape[1]):
        push = (bend * u[i, j] + slope) * u[i, j] + level
        flags[j] = (flags[j] & (abs(push) <= most)) | ((push > np.float32(0)) != (phi[i, j] > 0))


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def cube_root(value: np.float32) -> np.float32:
    """Return the cube root of a positive number to one in a thousand, in a quarter of the library's time."""
    # a third of the exponent, and one of Newton's steps
    root = np.int32(np.float32(value).view(np.int32) // 3 + 0x2A514067).view(np.float32)
    return (root + root + value / (root * root)) * np.float32(1.0 / 3.0)


@njit(cache=True, nogil=True, inline="always")
def _append(flags: NDArray[np.bool_], i: int, w: int, queue: NDArray[np.int32], count: int) -> int:
    """Append the marked pixels of row i to the queue; returns the new count. ``flags`` holds whole words of eight."""
    words = flags.view(np.uint64)
    for k in range(words.size):
        if words[k]:
            for j in range(8 * k, min(8 * k + 8, w)):
                if flags[j]:
                    queue[count] = i * w + j
                    count += 1
    return count


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def _raise(phi: NDArray[np.float32], u: NDArray[np.float32], i: int, j: int, drive: Drive) -> None:
    """Give a pixel the height that its data alone would."""
    bend, slope, level = drive
    value = u[i, j]
    push = (bend * value + slope) * value + level
    inside = phi[i, j] > 0
    height = np.float32(_LEAST)
    if (push > 0) == inside:
        height = max(cube_root(abs(push) * np.float32(PHI_LIMIT**3 / _DRIVE_AT_LIMIT)), height)
    phi[i, j] = height if inside else -height


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def _solved(phi: NDArray[np.float32], i: int, j: int, drive: np.float32, mu: np.float32) -> np.float32:
    """Return the φ of one pixel at which the equation holds, its neighbours as they are."""
    centre = phi[i, j]
    weight, pull = curvature_pull(phi, i, j)
    hold, aim = mu * weight, drive + mu * pull
    cube = np.float32(_DRIVE_AT_LIMIT / PHI_LIMIT**3)
    # monotonic: two of Newton's steps, and the next sweep continues from there
    for _ in range(2):
        square = cube * centre * centre
        centre = (np.float32(2) * square * centre + aim) / (np.float32(3) * square + hold)
    return centre


@njit(cache=True, nogil=True, fastmath=True)
def _contour_pixels(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    rows: NDArray[np.int32],
    drive: Drive,
    mu: np.float32,
    queue: NDArray[np.int32],
) -> int:
    """Write the pixels at the contour that their data leave undecided into ``queue``; return their number."""
    h, w = u.shape
    flags = np.zeros((w + 7) // 8 * 8, np.bool_)
    count = 0
    for i in range(h):
        if crossed(rows, i, w):
            contour_flags(phi, i, flags)
            _undecided(u, phi, i, drive, mu, flags)
            count = _append(flags, i, w, queue, count)
    return count


@njit(cache=True, nogil=True, fastmath=True)
def _raise_contour(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    queue: NDArray[np.int32],
    count: int,
    drive: Drive,
    mu: np.float32,
) -> int:
    """Set φ at ``count`` pixels in ``queue`` and round them to the height that their data alone give.

    Neighbours that the data hardly hold join the queue, and their own neighbours are set; returns the queue's length.
    """
    h, w = u.shape
    raised = np.zeros(h * w, np.bool_)
    for k in range(count):
        raised[queue[k]] = True
        _raise(phi, u, queue[k] // w, queue[k] % w, drive)
    bend, slope, level = drive
    of_contour = count
    for ring in range(2):
        first, last = (0, of_contour) if ring == 0 else (of_contour, count)
        for k in range(first, last):
            i, j = queue[k] // w, queue[k] % w
            for p, q in ((max(i - 1, 0), j), (min(i + 1, h - 1), j), (i, max(j - 1, 0)), (i, min(j + 1, w - 1))):
                if raised[p * w + q]:
                    continue
                raised[p * w + q] = True
                _raise(phi, u, p, q, drive)
                push = (bend * u[p, q] + slope) * u[p, q] + level
                if ring == 0 and abs(push) <= np.float32(4) * mu:
                    queue[count] = p * w + q
                    count += 1
    return count


@njit(cache=True, nogil=True, fastmath=True)
def evolve_contour(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    weights: NDArray[np.float32],
    sums: tuple[int, float, float],
    rows: NDArray[np.int32],
    lists: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_], NDArray[np.bool_]],
    fixed: bool = False,
) -> tuple[int, float, int]:
    """Put the contour's pixels on their steady-state side; returns the pixels inside, their sum of u, the visits.

    ``weights`` are μ, ν, λ1, λ2; ``sums`` the pixels inside, the sums of u over them and over all, ``rows`` (h,) the
    pixels inside by row (updated in place). ``lists`` are buffers for two lists of pixels, the marks of listed pixels
    (all false at the end), and of visited ones. With ``fixed``, ``u`` itself is the data term of each pixel.
    """
    h, w = u.shape
    n, inside, total = sums
    queue, after, waiting, seen = lists
    drive = (np.float32(0), np.float32(1), np.float32(0))
    if not fixed:
        drive = means_of(n, inside, total, h * w, weights)
    count = _contour_pixels(u, phi, rows, drive, weights[_MU], queue)
    count = _raise_contour(u, phi, queue, count, drive, weights[_MU])
    bend, slope, level = drive
    visits = 0
    for _ in range(_MOST_SWEEPS):
        if not fixed:
            bend, slope, level = means_of(n, inside, total, h * w, weights)
        coming, farthest = 0, np.float32(0)
        visits += count
        for k in range(count):
            place = queue[k]
            i, j = place // w, place % w
            old, value = phi[i, j], u[i, j]
            new = _solved(phi, i, j, (bend * value + slope) * value + level, weights[_MU])
            phi[i, j] = new
            seen[place] = True
            moved = abs(new - old)
            farthest = max(farthest, moved)
            if (abs(new) < np.float32(_LOOSE) or moved > np.float32(_MOVES)) and not waiting[place]:
                waiting[place] = True
                after[coming] = place
                coming += 1
            if (new > 0) != (old > 0):
                sign = 1 if new > 0 else -1
                n += sign
                rows[i] += sign
                inside += sign * value
                around = ((max(i - 1, 0), j), (min(i + 1, h - 1), j), (i, max(j - 1, 0)), (i, min(j + 1, w - 1)))
                for p, q in around:
                    if not waiting[p * w + q]:
                        waiting[p * w + q] = True
                        after[coming] = p * w + q
                        coming += 1
        for k in range(coming):
            waiting[after[k]] = False
        queue, after, count = after, queue, coming
        if farthest <= np.float32(_STILL):
            break
    return n, inside, visits


@njit(cache=True, nogil=True, fastmath=True)
def _pushed_up(u: NDArray[np.float32], i: int, drive: Drive) -> int:
    """Return how many pixels of row i their data push inside."""
    bend, slope, level = drive
    count = np.int32(0)
    for j in range(u.shape[1]):
        count += np.int32((bend * u[i, j] + slope) * u[i, j] + level > np.float32(0))
    return int(count)


@njit(cache=True, nogil=True)
def settle_driven(drive: NDArray[np.float32], phi: NDArray[np.float32], mu: float) -> None:
    """Do as `evolve_contour` where each pixel is driven by ``drive`` (h, w), whatever the others do."""
    h, w = phi.shape
    rows = np.zeros(h, np.int32)
    for i in range(h):
        for j in range(w):
            rows[i] += np.int32(phi[i, j] > 0)
    lists = (np.empty(h * w, np.int32), np.empty(h * w, np.int32), np.zeros(h * w, np.bool_), np.zeros(h * w, np.bool_))
    evolve_contour(
        drive, phi, np.array((mu, 0.0, 0.0, 0.0), np.float32), (int(rows.sum()), 0.0, 0.0), rows, lists, True
    )


@njit(cache=True, nogil=True, fastmath=True)
def _count_unsettled(u: NDArray[np.float32], phi: NDArray[np.float32], i: int, drive: Drive, mu: np.float32) -> int:
    """Return how many pixels of row i are pushed away from their side, or hardly held and not at a limit."""
    bend, slope, level = drive
    most, limit = np.float32(4) * mu, np.float32(PHI_LIMIT)
    count = np.int32(0)
    for j in range(u.shape[1]):
        push = (bend * u[i, j] + slope) * u[i, j] + level
        loose = (abs(phi[i, j]) < limit) & (abs(push) <= most)
        count += np.int32(loose | ((push > np.float32(0)) != (phi[i, j] > 0)))
    return int(count)


@njit(cache=True, nogil=True, fastmath=True)
def collect(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    drive: Drive,
    mu: np.float32,
    rows: NDArray[np.int32],
    queue: NDArray[np.int32],
) -> int:
    """Fill the queue with the pixels along the contour that may change sides; returns their count.

    So may those pushed away from their side, wherever they are, and those hardly held that are not at a limit.
    """
    h, w = u.shape
    count = 0
    limit = np.float32(PHI_LIMIT)
    flags = np.zeros((w + 7) // 8 * 8, np.bool_)
    for i in range(h):
        at_contour = crossed(rows, i, w)
        if not at_contour and _count_unsettled(u, phi, i, drive, mu) == 0:
            continue
        if at_contour:
            contour_flags(phi, i, flags)
        else:
            flags[:] = False
        for j in range(w):
            flags[j] |= abs(phi[i, j]) < limit
        _undecided(u, phi, i, drive, mu, flags)
        count = _append(flags, i, w, queue, count)
    return count


@njit(cache=True, nogil=True, fastmath=True)
def collect_unvisited(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    drive: Drive,
    numerics: tuple[np.float32, np.float32, np.float32],
    rows: NDArray[np.int32],
    seen: NDArray[np.bool_],
    queue: NDArray[np.int32],
) -> int:
    """Fill the queue with the pixels never visited that the means reached would move; returns their count."""
    h, w = u.shape
    bend, slope, level = drive
    mu, eps, dt = numerics
    count = 0
    flags = np.zeros((w + 7) // 8 * 8, np.bool_)
    for i in range(h):
        if (rows[i] == 0 or rows[i] == w) and _pushed_up(u, i, drive) == rows[i]:
            continue
        flags[:] = False
        _undecided(u, phi, i, drive, mu, flags)
        before, marked = count, _append(flags, i, w, queue, count)
        for k in range(before, marked):
            place = queue[k]
            j = place - i * w
            push = (bend * u[i, j] + slope) * u[i, j] + level
            if not seen[place] and abs(limited_step(phi, i, j, push, mu, eps, dt) - phi[i, j]) > np.float32(AT_REST):
                queue[count] = place
                count += 1
    return count
