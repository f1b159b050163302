"""The level set with region-scalable fitting, for light that is uneven even after flattening.

Inside and outside are each fitted by a mean that varies over the picture (Li, Kao, Gore & Ding, IEEE TIP 2008)::

    f1 = K∗(M u) / K∗M,   f2 = K∗((1 − M) u) / K∗(1 − M),   M = 1 where φ > 0, K a Gaussian of width σ
    local(x) = −λ1 e1 + λ2 e2,   e_i(x) = ∫ K(y − x) (u(x) − f_i(y))² dy = u² − 2u K∗f_i + K∗f_i²

and the level set is driven by ``share`` × local + (1 − ``share``) × global, the global term being Chan & Vese's;
a share below 1 keeps the contour from settling where one side has nothing to be fitted to.
"""

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.detection.chan_vese import region_means
from groundstation.detection.contour_evolution import settle_driven
from groundstation.detection.narrow_band import AT_REST, PHI_LIMIT, limited_step

Float32Array = NDArray[np.float32]
_SWEEPS = 3  # of the whole grid between two fits
_EMPTY = np.float32(1e-3)  # share of a Gaussian window below which its mean is not known


def drive_field(
    u: Float32Array, phi: Float32Array, weights: tuple[float, float, float, float], local: tuple[float, float]
) -> Float32Array:
    """Return what pushes φ up at each pixel besides the length term, (h, w).

    ``weights`` are μ, ν, λ1, λ2, ``local`` the share of the local term and its σ in px.
    """
    _, nu, lambda1, lambda2 = weights
    share, sigma = local
    c1, c2, _ = region_means(u, phi)
    inside = (phi > 0).astype(np.float32)
    e1 = _misfit(u, inside, sigma, c1)
    e2 = _misfit(u, np.float32(1) - inside, sigma, c2)
    near = lambda2 * e2 - lambda1 * e1
    far = lambda2 * (u - c2) ** 2 - lambda1 * (u - c1) ** 2
    return np.asarray(share * near + (1.0 - share) * far - nu, np.float32)


def _misfit(u: Float32Array, member: Float32Array, sigma: float, mean: float) -> Float32Array:
    """Return e(x) of one side; where the window holds nothing of that side, its overall mean stands in."""
    weight = _blur(member, sigma)
    fit = np.where(weight > _EMPTY, _blur(member * u, sigma) / np.maximum(weight, _EMPTY), np.float32(mean))
    return np.asarray(u * u - 2 * u * _blur(fit, sigma) + _blur(fit * fit, sigma), np.float32)


def _blur(values: Float32Array, sigma: float) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT), np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _sweep(drive: Float32Array, phi: Float32Array, mu: float, eps: float, dt: float, sweeps: int) -> tuple[int, int]:
    """Take some implicit steps under a fixed drive; returns the pixels that moved in the last, and those inside."""
    mu_f, eps_f, dt_f = np.float32(mu), np.float32(eps), np.float32(dt)
    limit = np.float32(PHI_LIMIT)
    moved, n = 0, 0
    for _ in range(sweeps):
        moved, n = 0, 0
        for i in range(phi.shape[0]):
            for j in range(phi.shape[1]):
                old = phi[i, j]
                if abs(old) >= limit and (drive[i, j] > 0) == (old > 0):
                    left, right = phi[i, max(j - 1, 0)], phi[i, min(j + 1, phi.shape[1] - 1)]
                    above, below = phi[max(i - 1, 0), j], phi[min(i + 1, phi.shape[0] - 1), j]
                    if left == old and right == old and above == old and below == old:
                        n += 1 if old > 0 else 0
                        continue
                new = limited_step(phi, i, j, drive[i, j], mu_f, eps_f, dt_f)
                phi[i, j] = new
                moved += 1 if abs(new - old) > np.float32(AT_REST) else 0
                n += 1 if new > 0 else 0
    return moved, n


def evolve_local(
    u: Float32Array,
    phi: Float32Array,
    weights: tuple[float, float, float, float],
    local: tuple[float, float],
    eps: float,
    dt: float,
    iterations: int,
    stop_fraction: float,
    stop_after: int,
) -> int:
    """Evolve φ (h, w) in place under the mixed local and global fit; returns the sweeps done.

    ``u`` is (h, w) in [0, 1], ``weights`` μ, ν, λ1, λ2, ``local`` the share of the local term in [0, 1] and its σ
    in px; the rest as in `chan_vese.evolve`, by whose rule it stops.
    """
    np.clip(phi, -PHI_LIMIT, PHI_LIMIT, out=phi)
    quiet, done = 0, 0
    while done < iterations:
        moved, n = _sweep(drive_field(u, phi, weights, local), phi, weights[0], eps, dt, _SWEEPS)
        done += _SWEEPS
        quiet = quiet + 1 if moved <= stop_fraction * n else 0
        if quiet >= stop_after:
            break
    # the last pixels go where the flow without limits takes them, as in `chan_vese.evolve`
    settle_driven(drive_field(u, phi, weights, local), phi, weights[0])
    return min(done, iterations)
