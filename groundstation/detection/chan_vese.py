"""The Chan-Vese level set: two constant intensities divided by a contour of short length.

Energy (docs/derivation.md, section 3; Chan & Vese 2001)::

    F(φ, c1, c2) = μ ∫|∇H(φ)| + ν ∫H(φ) + λ1 ∫(u − c1)² H(φ) + λ2 ∫(u − c2)² (1 − H(φ))
    φ_t = δ_ε(φ) [μ div(∇φ/|∇φ|) − ν − λ1 (u − c1)² + λ2 (u − c2)²],  δ_ε(φ) = ε / (π (ε² + φ²))

Numerics: the length term is linearised and taken at the new time for the pixel itself (Getreuer, IPOL 2012),
which keeps large steps stable. ``evolve_full`` visits each pixel in each iteration; it is the oracle.
``evolve`` holds φ within ±`PHI_LIMIT`, so that all but a narrow band along the contour rests at a limit, and
visits only what moved last and its neighbours: elsewhere nothing would change, so the narrow band is exact.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.detection.contour_evolution import Drive, collect, collect_unvisited, evolve_contour, means_of
from groundstation.detection.narrow_band import AT_REST, PHI_LIMIT, limited_step, wake

_FLAT_ORACLE = 1e-12  # added to |∇φ|² so that a flat φ can still move: next to nothing
_LEAST_INSIDE = 0.5  # of the level that the target is expected to reach
_ASLEEP = 0.01  # one that need not be followed up
_LOW, _FAR = 1.0, 0.3  # lower or faster pixels may soon change sides


@njit(cache=True, nogil=True)
def region_means(u: NDArray[np.float32], phi: NDArray[np.float32]) -> tuple[float, float, int]:
    """Return the means of ``u`` where φ > 0 and elsewhere, and the count of pixels inside."""
    inside, outside, n = 0.0, 0.0, 0
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            if phi[i, j] > 0:
                inside += u[i, j]
                n += 1
            else:
                outside += u[i, j]
    rest = u.size - n
    return inside / max(n, 1), outside / max(rest, 1), n


@njit(cache=True, nogil=True, inline="always")
def _step(
    phi: NDArray[np.float32], i: int, j: int, drive: float, mu: float, eps: float, dt: float, flat: float
) -> float:
    """Return the new φ of one pixel; borders repeat (no flux)."""
    h, w = phi.shape
    centre = phi[i, j]
    left, right = phi[i, max(j - 1, 0)], phi[i, min(j + 1, w - 1)]
    above, below = phi[max(i - 1, 0), j], phi[min(i + 1, h - 1), j]
    dx0, dy0 = 0.5 * (right - left), 0.5 * (below - above)
    a_right = 1.0 / math.sqrt(flat + (right - centre) ** 2 + dy0 * dy0)
    a_left = 1.0 / math.sqrt(flat + (centre - left) ** 2 + dy0 * dy0)
    a_below = 1.0 / math.sqrt(flat + dx0 * dx0 + (below - centre) ** 2)
    a_above = 1.0 / math.sqrt(flat + dx0 * dx0 + (centre - above) ** 2)
    rate = dt * eps / (math.pi * (eps * eps + centre * centre))
    pull = a_right * right + a_left * left + a_below * below + a_above * above
    return (centre + rate * (mu * pull + drive)) / (1.0 + rate * mu * (a_right + a_left + a_below + a_above))


@njit(cache=True, nogil=True)
def evolve_full(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    weights: tuple[float, float, float, float],
    eps: float,
    dt: float,
    iterations: int,
    stop_fraction: float,
    stop_after: int,
) -> int:
    """Evolve φ in place over the full grid without limits; returns the iterations done.

    ``weights`` are μ, ν, λ1, λ2; ``u`` is (h, w) in [0, 1].
    """
    mu, nu, lambda1, lambda2 = weights
    quiet = 0
    for iteration in range(iterations):
        c1, c2, n = region_means(u, phi)
        changed = 0
        for i in range(u.shape[0]):
            for j in range(u.shape[1]):
                drive = -nu - lambda1 * (u[i, j] - c1) ** 2 + lambda2 * (u[i, j] - c2) ** 2
                new = _step(phi, i, j, drive, mu, eps, dt, _FLAT_ORACLE)
                changed += (new > 0) != (phi[i, j] > 0)
                phi[i, j] = new
        quiet = quiet + 1 if changed <= stop_fraction * n else 0
        if quiet >= stop_after:
            return iteration + 1
    return iterations


@njit(cache=True, nogil=True, fastmath=True)
def start(u: NDArray[np.float32], inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the level set after one unbounded data step from the contour of ``inside``.

    Inside counts what stands out there: c1 is the mean of its brighter half, c2 the mean outside.
    """
    n_in, m_in, n_all, m_all = _sums(u, inside, np.float32(-1))
    mean_in, c2 = m_in / max(n_in, 1), (m_all - m_in) / max(n_all - n_in, 1)
    n_high, m_high, _, _ = _sums(u, inside, np.float32(mean_in))
    # a contour that misses the target holds nothing but noise, and half of that stands out, too
    c1 = max(m_high / n_high, _LEAST_INSIDE) if n_high else 1.0
    phi = np.empty(u.shape, np.float32)
    middle = np.float32(0.5 * (c1 + c2))
    gain, limit = np.float32(8.0 * PHI_LIMIT * (1.0 if c1 > c2 else 0.0)), np.float32(PHI_LIMIT)
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            phi[i, j] = min(max(gain * (u[i, j] - middle), -limit), limit)
    return phi


@njit(cache=True, nogil=True, fastmath=True)
def _sums(u: NDArray[np.float32], inside: NDArray[np.bool_], above: np.float32) -> tuple[int, float, int, float]:
    """Return the number and the sum of the pixels inside that are ``above`` a value, and of all."""
    n, total, everything = 0, 0.0, 0.0
    for i in range(u.shape[0]):
        row_n, row_total, row_all = 0, np.float32(0), np.float32(0)
        for j in range(u.shape[1]):
            value = u[i, j]
            counts = inside[i, j] & (value > above)
            row_n += counts
            row_total += value if counts else np.float32(0)
            row_all += value
        n += row_n
        total += float(row_total)
        everything += float(row_all)
    return n, total, u.size, everything


@njit(cache=True, nogil=True, fastmath=True)
def _clip(u: NDArray[np.float32], phi: NDArray[np.float32], rows: NDArray[np.int32]) -> tuple[int, float, float]:
    """Hold φ within its limits; return the pixels inside (also by row), the sum of u over them and over all."""
    limit = np.float32(PHI_LIMIT)
    n, inside, total = 0, 0.0, 0.0
    for i in range(u.shape[0]):
        row_n, row_inside, row_total = np.int32(0), np.float32(0), np.float32(0)
        for j in range(u.shape[1]):
            value = min(max(phi[i, j], -limit), limit)
            phi[i, j] = value
            row_total += u[i, j]
            row_inside += u[i, j] if value > 0 else np.float32(0)
            row_n += np.int32(value > 0)
        rows[i] = row_n
        n += int(row_n)
        inside += float(row_inside)
        total += float(row_total)
    return n, inside, total


@njit(cache=True, nogil=True, fastmath=True)
def _sweep(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    drive: Drive,
    step: tuple[np.float32, np.float32, np.float32],
    sums: tuple[int, float],
    rows: NDArray[np.int32],
    count: int,
    lists: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.bool_], NDArray[np.bool_]],
) -> tuple[int, float, int, int]:
    """Move φ by one time step at ``count`` listed pixels.

    ``step`` is μ, ε and the time step, ``sums`` the pixels inside and their sum of u; ``rows`` and ``lists`` as in
    `evolve_contour`. Returns the new sums, how many pixels moved noticeably, and the length of the next list.
    """
    h, w = u.shape
    bend, slope, level = drive
    mu, eps, dt = step
    n, inside = sums
    queue, after, waiting, seen = lists
    hold = np.float32(4) * mu
    changed, coming = 0, 0
    for k in range(count):
        place = queue[k]
        i, j = place // w, place % w
        old, value = phi[i, j], u[i, j]
        push = (bend * value + slope) * value + level
        # at its limit, and held there by more than four neighbours can pull
        if abs(push) > hold and abs(old) >= np.float32(PHI_LIMIT) and (push > 0) == (old > 0):
            continue
        new = limited_step(phi, i, j, push, mu, eps, dt)
        phi[i, j] = new
        seen[place] = True
        moved = abs(new - old)
        if moved > np.float32(AT_REST) and (abs(new) < np.float32(_LOW) or moved > np.float32(_FAR)):
            changed += 1
        if moved > np.float32(_ASLEEP):
            coming = wake(place, h, w, waiting, after, coming)
        if (new > 0) != (old > 0):
            sign = 1 if new > 0 else -1
            n += sign
            rows[i] += sign
            inside += sign * value
    return n, inside, changed, coming


@njit(cache=True, nogil=True, fastmath=True)
def evolve(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    weights: tuple[float, float, float, float],
    eps: float,
    dt: float,
    iterations: int,
    stop_fraction: float,
    stop_after: int,
    visits_per_px: float = 1e9,
) -> int:
    """Evolve φ in place, limited to ±`PHI_LIMIT`, touching only pixels that move and their neighbours.

    Returns the number of iterations. It has converged when φ changes at no more than ``stop_fraction`` of the pixels
    inside, ``stop_after`` times in a row. Then the contour's pixels take the side of their steady state without a limit
    (contour_evolution.py), and the whole grid is checked once more with the final means, so that no region is missed:
    the evolution continues wherever a pixel would still move. Where the means take scenery for the target, most of the
    picture moves for long; ``visits_per_px`` limits this, as visits to a pixel over the grid's pixels.
    """
    h, w = u.shape
    four = np.array(weights, np.float32)
    mu, eps_f, dt_f = four[0], np.float32(eps), np.float32(dt)
    rows = np.empty(h, np.int32)
    n, inside, total = _clip(u, phi, rows)
    queue, after = np.empty(h * w, np.int32), np.empty(h * w, np.int32)
    waiting, seen = np.zeros(h * w, np.bool_), np.zeros(h * w, np.bool_)
    quiet = 0
    left = visits_per_px * h * w
    count = collect(u, phi, means_of(n, inside, total, h * w, four), mu, rows, queue)
    for iteration in range(iterations):
        if quiet >= stop_after or count == 0:
            n, inside, visits = evolve_contour(u, phi, four, (n, inside, total), rows, (queue, after, waiting, seen))
            drive = means_of(n, inside, total, h * w, four)
            count = collect_unvisited(u, phi, drive, (mu, eps_f, dt_f), rows, seen, queue)
            if count <= stop_fraction * n:
                return iteration
            quiet, left = 0, left - visits
        left -= count
        if left < 0:
            return iteration
        drive = means_of(n, inside, total, h * w, four)
        n, inside, changed, coming = _sweep(
            u, phi, drive, (mu, eps_f, dt_f), (n, inside), rows, count, (queue, after, waiting, seen)
        )
        for k in range(coming):
            waiting[after[k]] = False
        queue, after, count = after, queue, coming
        quiet = quiet + 1 if changed <= stop_fraction * n else 0
    evolve_contour(u, phi, four, (n, inside, total), rows, (queue, after, waiting, seen))
    return iterations


@njit(cache=True, nogil=True)
def divide(
    u: NDArray[np.float32],
    inside: NDArray[np.bool_],
    weights: tuple[float, float, float, float],
    numerics: tuple[float, float],
    iterations: int,
    stop: tuple[float, int],
    visits_per_px: float,
) -> NDArray[np.float32]:
    """Return φ evolved from the contour of ``inside``; ``numerics`` are ε and the time step."""
    phi = start(u, inside)
    evolve(u, phi, weights, numerics[0], numerics[1], iterations, stop[0], stop[1], visits_per_px)
    return phi


@njit(cache=True, nogil=True)
def energy(
    u: NDArray[np.float32], phi: NDArray[np.float32], weights: tuple[float, float, float, float], eps: float
) -> float:
    """Return F with the smoothed H_ε(φ) and the means that minimise it."""
    mu, nu, lambda1, lambda2 = weights
    h, w = u.shape
    s_in, s_out, m_in, m_out = 0.0, 0.0, 0.0, 0.0
    for i in range(h):
        for j in range(w):
            hv = 0.5 * (1.0 + 2.0 / math.pi * math.atan(phi[i, j] / eps))
            s_in += hv
            s_out += 1.0 - hv
            m_in += hv * u[i, j]
            m_out += (1.0 - hv) * u[i, j]
    c1, c2 = m_in / max(s_in, 1e-12), m_out / max(s_out, 1e-12)
    value = 0.0
    for i in range(h):
        for j in range(w):
            hv = 0.5 * (1.0 + 2.0 / math.pi * math.atan(phi[i, j] / eps))
            gx = phi[i, min(j + 1, w - 1)] - phi[i, j]
            gy = phi[min(i + 1, h - 1), j] - phi[i, j]
            delta = eps / (math.pi * (eps * eps + phi[i, j] ** 2))
            value += mu * delta * math.sqrt(gx * gx + gy * gy) + nu * hv
            value += lambda1 * (u[i, j] - c1) ** 2 * hv + lambda2 * (u[i, j] - c2) ** 2 * (1.0 - hv)
    return value
