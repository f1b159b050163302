"""The Chan-Vese level set: two constant intensities divided by a contour of short length.

Energy (docs/derivation.md, Chan & Vese 2001)::

    F(φ, c1, c2) = μ ∫|∇H(φ)| + ν ∫H(φ) + λ1 ∫(u − c1)² H(φ) + λ2 ∫(u − c2)² (1 − H(φ))
    φ_t = δ_ε(φ) [μ div(∇φ/|∇φ|) − ν − λ1 (u − c1)² + λ2 (u − c2)²],  δ_ε(φ) = ε / (π (ε² + φ²))

Numerics: the length term is linearised and taken at the new time for the pixel itself (Getreuer, IPOL 2012),
which keeps large steps stable. ``evolve_full`` visits each pixel in each iteration; it is the oracle.
``evolve`` holds φ within ±`PHI_LIMIT` and skips every pixel that sits at a limit together with its
neighbours and is pushed further into it: nothing would move there, so the narrow band is exact.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

PHI_LIMIT = 3.0
# added to |∇φ|² so that a flat φ can still move: next to nothing for the oracle, a slope of 0.1 for the band
_FLAT_ORACLE = 1e-12
_FLAT_BAND = 1e-2
_AT_REST = 0.02  # a change of φ per iteration that still counts as motion


@njit(cache=True)
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


@njit(cache=True, inline="always")
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


@njit(cache=True)
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


@njit(cache=True)
def start(u: NDArray[np.float32], inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the level set after one unbounded data step from the contour of ``inside``.

    Inside counts what stands out there: c1 is the mean of its brighter half, c2 the mean outside.
    """
    m_in, m_out, n_in, n_out = 0.0, 0.0, 0, 0
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            if inside[i, j]:
                m_in += u[i, j]
                n_in += 1
            else:
                m_out += u[i, j]
                n_out += 1
    mean_in, c2 = m_in / max(n_in, 1), m_out / max(n_out, 1)
    m_high, n_high = 0.0, 0
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            if inside[i, j] and u[i, j] > mean_in:
                m_high += u[i, j]
                n_high += 1
    c1 = m_high / n_high if n_high else 1.0
    phi = np.empty(u.shape, np.float32)
    middle = 0.5 * (c1 + c2)
    gain = 8.0 * PHI_LIMIT * (1.0 if c1 > c2 else 0.0)
    for i in range(u.shape[0]):
        for j in range(u.shape[1]):
            phi[i, j] = min(max(gain * (u[i, j] - middle), -PHI_LIMIT), PHI_LIMIT)
    return phi


@njit(cache=True, inline="always")
def _frozen(
    u: NDArray[np.float32], phi: NDArray[np.float32], i: int, j: int, terms: tuple[float, float, float, float, float]
) -> bool:
    """Return whether a pixel rests at a limit, with its neighbours, and is pushed further into it."""
    h, w = u.shape
    value = phi[i, j]
    if -PHI_LIMIT < value < PHI_LIMIT:
        return False
    nu, lambda1, lambda2, c1, c2 = terms
    drive = -nu - lambda1 * (u[i, j] - c1) ** 2 + lambda2 * (u[i, j] - c2) ** 2
    if (drive > 0) != (value > 0):
        return False
    return (
        phi[i, max(j - 1, 0)] == value
        and phi[i, min(j + 1, w - 1)] == value
        and phi[max(i - 1, 0), j] == value
        and phi[min(i + 1, h - 1), j] == value
    )


@njit(cache=True)
def _scan(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    terms: tuple[float, float, float, float, float],
    band: NDArray[np.int32],
    marked: NDArray[np.bool_],
    count: int,
) -> int:
    """Append to the band every pixel of the grid that can move and is not in it; returns the new count."""
    h, w = u.shape
    for i in range(h):
        for j in range(w):
            if not marked[i, j] and not _frozen(u, phi, i, j, terms):
                band[count] = i * w + j
                marked[i, j] = True
                count += 1
    return count


@njit(cache=True)
def _renew(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    terms: tuple[float, float, float, float, float],
    band: NDArray[np.int32],
    marked: NDArray[np.bool_],
    count: int,
) -> int:
    """Drop the pixels that froze and take up the neighbours of those that move; returns the new count."""
    h, w = u.shape
    kept = 0
    for k in range(count):
        i, j = band[k] // w, band[k] % w
        if _frozen(u, phi, i, j, terms):
            marked[i, j] = False
        else:
            band[kept] = band[k]
            kept += 1
    moving = kept
    for k in range(moving):
        i, j = band[k] // w, band[k] % w
        for step in range(4):
            a = min(max(i + (step == 0) - (step == 1), 0), h - 1)
            b = min(max(j + (step == 2) - (step == 3), 0), w - 1)
            if not marked[a, b] and not _frozen(u, phi, a, b, terms):
                marked[a, b] = True
                band[kept] = a * w + b
                kept += 1
    return kept


@njit(cache=True)
def evolve(
    u: NDArray[np.float32],
    phi: NDArray[np.float32],
    weights: tuple[float, float, float, float],
    eps: float,
    dt: float,
    iterations: int,
    stop_fraction: float,
    stop_after: int,
) -> int:
    """Evolve φ in place, held within ±`PHI_LIMIT`, touching only the pixels that can move.

    It has come to rest when φ moves at fewer than ``stop_fraction`` of the pixels inside, ``stop_after`` times
    running. Then the whole grid is looked over once more with the means reached, so that no region is forgotten.
    """
    mu, nu, lambda1, lambda2 = weights
    h, w = u.shape
    n, inside, total = 0, 0.0, 0.0
    for i in range(h):
        for j in range(w):
            phi[i, j] = min(max(phi[i, j], -PHI_LIMIT), PHI_LIMIT)
            total += u[i, j]
            if phi[i, j] > 0:
                inside += u[i, j]
                n += 1
    band = np.empty(h * w, np.int32)
    marked = np.zeros((h, w), np.bool_)
    count = 0
    quiet = 0
    fresh = True
    for iteration in range(iterations):
        c1, c2 = inside / max(n, 1), (total - inside) / max(h * w - n, 1)
        terms = (nu, lambda1, lambda2, c1, c2)
        before = count
        count = _scan(u, phi, terms, band, marked, count) if fresh else _renew(u, phi, terms, band, marked, count)
        if fresh and quiet >= stop_after and count - before <= stop_fraction * n:
            return iteration
        fresh = False
        changed = 0
        for k in range(count):
            i, j = band[k] // w, band[k] % w
            old, value = phi[i, j], u[i, j]
            drive = -nu - lambda1 * (value - c1) ** 2 + lambda2 * (value - c2) ** 2
            new = min(max(_step(phi, i, j, drive, mu, eps, dt, _FLAT_BAND), -PHI_LIMIT), PHI_LIMIT)
            phi[i, j] = new
            changed += abs(new - old) > _AT_REST
            if (new > 0) != (old > 0):
                sign = 1 if new > 0 else -1
                n += sign
                inside += sign * value
        quiet = quiet + 1 if changed <= stop_fraction * n else 0
        fresh = quiet >= stop_after
    return iterations


@njit(cache=True)
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
