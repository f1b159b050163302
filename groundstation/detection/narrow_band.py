"""The narrow band of the level set: the pixels that may still change, and their new values.

φ is limited to ±`PHI_LIMIT`: a pixel at a limit among equal ones, driven further into it, does not change.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

PHI_LIMIT = 3.0
FLAT_BAND = 1e-2  # added to |∇φ|² so that a flat φ can still move: a slope of 0.1
AT_REST = 0.02  # a change of φ per iteration that still counts as motion


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def curvature_pull(phi: NDArray[np.float32], i: int, j: int) -> tuple[np.float32, np.float32]:
    """Return the sum of the four neighbours' weights in the curvature of one pixel, and their weighted φ."""
    h, w = phi.shape
    centre = phi[i, j]
    left = phi[i, j - 1] if j > 0 else centre
    right = phi[i, j + 1] if j + 1 < w else centre
    above = phi[i - 1, j] if i > 0 else centre
    below = phi[i + 1, j] if i + 1 < h else centre
    dx, dy = np.float32(0.5) * (right - left), np.float32(0.5) * (below - above)
    along_x, along_y = np.float32(FLAT_BAND) + dx * dx, np.float32(FLAT_BAND) + dy * dy
    one = np.float32(1)
    a_right = one / np.sqrt(along_y + (right - centre) ** 2)
    a_left = one / np.sqrt(along_y + (centre - left) ** 2)
    a_below = one / np.sqrt(along_x + (below - centre) ** 2)
    a_above = one / np.sqrt(along_x + (centre - above) ** 2)
    pull = a_right * right + a_left * left + a_below * below + a_above * above
    return a_right + a_left + a_below + a_above, pull


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def limited_step(
    phi: NDArray[np.float32], i: int, j: int, drive: np.float32, mu: np.float32, eps: np.float32, dt: np.float32
) -> np.float32:
    """Return the new φ of one pixel, held within the limits; single precision throughout."""
    centre = phi[i, j]
    weight, pull = curvature_pull(phi, i, j)
    rate = dt * eps / (np.float32(math.pi) * (eps * eps + centre * centre))
    new = (centre + rate * (mu * pull + drive)) / (np.float32(1) + rate * mu * weight)
    return min(max(new, np.float32(-PHI_LIMIT)), np.float32(PHI_LIMIT))


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
