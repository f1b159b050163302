"""The narrow band of the level set: which pixels may still move, and where each of them goes.

φ is held within ±`PHI_LIMIT`: a pixel at a limit among its like, pushed further into it, rests.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

PHI_LIMIT = 3.0
_FLAT_BAND = 1e-2  # added to |∇φ|² so that a flat φ can still move: a slope of 0.1
AT_REST = 0.02  # a change of φ per iteration that still counts as motion


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def limited_step(
    phi: NDArray[np.float32], i: int, j: int, drive: np.float32, mu: np.float32, eps: np.float32, dt: np.float32
) -> np.float32:
    """Return the new φ of one pixel, held within the limits; single precision throughout."""
    h, w = phi.shape
    centre = phi[i, j]
    left = phi[i, j - 1] if j > 0 else centre
    right = phi[i, j + 1] if j + 1 < w else centre
    above = phi[i - 1, j] if i > 0 else centre
    below = phi[i + 1, j] if i + 1 < h else centre
    dx, dy = np.float32(0.5) * (right - left), np.float32(0.5) * (below - above)
    along_x, along_y = np.float32(_FLAT_BAND) + dx * dx, np.float32(_FLAT_BAND) + dy * dy
    one = np.float32(1)
    a_right = one / np.sqrt(along_y + (right - centre) ** 2)
    a_left = one / np.sqrt(along_y + (centre - left) ** 2)
    a_below = one / np.sqrt(along_x + (below - centre) ** 2)
    a_above = one / np.sqrt(along_x + (centre - above) ** 2)
    rate = dt * eps / (np.float32(math.pi) * (eps * eps + centre * centre))
    pull = a_right * right + a_left * left + a_below * below + a_above * above
    new = (centre + rate * (mu * pull + drive)) / (one + rate * mu * (a_right + a_left + a_below + a_above))
    return min(max(new, np.float32(-PHI_LIMIT)), np.float32(PHI_LIMIT))


@njit(cache=True, nogil=True, fastmath=True)
def _resting_rows(
    u: NDArray[np.float32], phi: NDArray[np.float32], slope: np.float32, level: np.float32
) -> NDArray[np.bool_]:
    """Return the rows (h,) in which nothing can move.

    All of such a row is at one limit, as are the rows beside it, and pushed further into it.
    """
    h, w = phi.shape
    uniform, up, down = np.empty(h, np.bool_), np.empty(h, np.bool_), np.empty(h, np.bool_)
    for i in range(h):
        # counted, since the compiler works on many pixels at a time in a sum, but not in a search for the least
        other, pushed_up, first = np.int32(0), np.int32(0), phi[i, 0]
        for j in range(w):
            other += np.int32(phi[i, j] != first)
            pushed_up += np.int32(slope * u[i, j] + level > np.float32(0))
        uniform[i] = other == 0 and abs(first) >= np.float32(PHI_LIMIT)
        up[i], down[i] = pushed_up == w, pushed_up == 0
    resting = np.empty(h, np.bool_)
    for i in range(h):
        above, below, side = max(i - 1, 0), min(i + 1, h - 1), phi[i, 0]
        alike = uniform[above] and uniform[i] and uniform[below] and phi[above, 0] == side and phi[below, 0] == side
        resting[i] = alike and (up[i] if side > 0 else down[i])
    return resting


@njit(cache=True, nogil=True, fastmath=True)
def _may_move(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    i: int,
    drive: tuple[np.float32, np.float32, np.float32],
    found: NDArray[np.bool_],
) -> None:
    """Write which pixels of row i are off their limit, unlike a neighbour or pushed away from their side.

    All others are at a limit among their like and pushed further into it. The row's two ends are left as they are.
    """
    bend, slope, level = drive
    limit = np.float32(PHI_LIMIT)
    own, above, below = phi[i], phi[max(i - 1, 0)], phi[min(i + 1, phi.shape[0] - 1)]
    for j in range(1, u.shape[1] - 1):
        side, value = own[j], u[i, j]
        push = (bend * value + slope) * value + level
        alike = (own[j - 1] == side) & (own[j + 1] == side) & (above[j] == side) & (below[j] == side)
        found[j] = not (alike & (abs(side) >= limit) & ((push > 0) == (side > 0)))


@njit(cache=True, nogil=True, fastmath=True)
def collect(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    drive: tuple[np.float32, np.float32, np.float32],
    numerics: tuple[np.float32, np.float32, np.float32],
    queue: NDArray[np.int32],
) -> int:
    """Fill the queue with every pixel of the grid whose next step would move it; returns their count.

    ``drive`` is the data term as a parabola in u: curvature, slope, level; ``numerics`` are μ, ε and the step.
    """
    h, w = u.shape
    bend, slope, level = drive
    mu, eps, dt = numerics
    count = 0
    resting = _resting_rows(u, phi, slope, level) if bend == 0 else np.zeros(h, np.bool_)
    may_move = np.ones(w, np.bool_)
    for i in range(h):
        if resting[i]:
            continue
        _may_move(u, phi, i, drive, may_move)
        for j in range(w):
            if may_move[j]:
                value = u[i, j]
                push = (bend * value + slope) * value + level
                if abs(limited_step(phi, i, j, push, mu, eps, dt) - phi[i, j]) > np.float32(AT_REST):
                    queue[count] = i * w + j
                    count += 1
    return count


@njit(cache=True, nogil=True, inline="always")
def wake(place: int, h: int, w: int, waiting: NDArray[np.bool_], queue: NDArray[np.int32], count: int) -> int:
    """Append a pixel that moved and its four neighbours to the queue, once each; returns the new count."""
    i, j = place // w, place % w
    if not waiting[place]:
        waiting[place] = True
        queue[count] = place
        count += 1
    if j > 0 and not waiting[place - 1]:
        waiting[place - 1] = True
        queue[count] = place - 1
        count += 1
    if j + 1 < w and not waiting[place + 1]:
        waiting[place + 1] = True
        queue[count] = place + 1
        count += 1
    if i > 0 and not waiting[place - w]:
        waiting[place - w] = True
        queue[count] = place - w
        count += 1
    if i + 1 < h and not waiting[place + w]:
        waiting[place + w] = True
        queue[count] = place + w
        count += 1
    return count
