"""Parametric active contours: the snake, and the snake attracted by a gradient vector flow.

Kass, Witkin & Terzopoulos (IJCV 1988): a closed contour x(s) descends the energy

    E = ∫ ½ (α |x'|² + β |x''|²) − e(x) ds,    e = |∇(G_σ * u)|, scaled to 1 at its maximum

by x_t = α x'' − β x'''' + f(x), here semi-implicitly: (I + τ A) x_new = x + τ f(x), A the circulant matrix of
−α D² + β D⁴, D the difference of neighbouring points, ``spacing_px`` apart. The force is

- snake: f = ∇e, scaled to length 1 at its maximum; it reaches a few σ from an edge;
- GVF (Xu & Prince, IEEE TIP 1998): f = v/|v|, v the steady state of v_t = μ ∇²v − |∇e|² (v − ∇e), which extends the
  edges' force into flat regions and into concavities.

One contour stays one contour: it neither splits nor merges. The snakes are baselines of the level set.
"""

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.detection.config import SnakeConfig

Float32Array = NDArray[np.float32]
Points = NDArray[np.float64]

_KERNEL_PERIOD = 512
_KERNEL_TAIL = 1e-7
_RESAMPLE_EVERY = 4
_LEAST_POINTS = 8
_MOST_POINTS = 2048
_FLAT = 1e-12


def segment(
    u: Float32Array, inside: NDArray[np.bool_], config: SnakeConfig, stop: tuple[int, float, int], *, gvf: bool
) -> Float32Array:
    """Return +1 inside the contour at which the snake converges and −1 outside, (h, w) float32.

    Parameters
    ----------
    u : (h, w) float32 in [0, 1].
    inside : (h, w), the region whose outline is the initial contour; of several the largest.
    stop : most iterations, the fraction of the pixels inside that may change side, number of times in a row.
    gvf : whether the force is the gradient vector flow.
    """
    phi = np.full(u.shape, -1.0, np.float32)
    outline = _outline(inside)
    if len(outline) < 3:
        return phi
    force = gvf_force(u, config) if gvf else gradient_force(u, config)
    kernel = stiffness_kernel(config)
    points, _ = evolve(outline, force, kernel, (config.step, config.spacing_px), *stop)
    mask = np.zeros(u.shape, np.uint8)
    # four bits of sub-pixel corners
    cv2.fillPoly(mask, [np.round(16.0 * points).astype(np.int32)], 1, shift=4)
    phi[mask > 0] = 1.0
    return phi


def _outline(inside: NDArray[np.bool_]) -> Points:
    """Return the largest region's outline (n, 2), x and y in px."""
    contours, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2))
    return np.asarray(max(contours, key=cv2.contourArea).reshape(-1, 2), np.float64)


def edge_map(u: Float32Array, sigma_px: float) -> Float32Array:
    """Return |∇(G_σ * u)| scaled to 1 at its maximum, (h, w); zero where u is flat."""
    smooth = cv2.GaussianBlur(u, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    gy, gx = np.gradient(smooth)
    edges = np.hypot(gx, gy)
    return np.asarray(edges / max(float(edges.max()), 1e-6), np.float32)


def gradient_force(u: Float32Array, config: SnakeConfig) -> Float32Array:
    """Return the snake's force ∇e, (h, w, 2) x and y, length 1 at its maximum."""
    gy, gx = np.gradient(edge_map(u, config.sigma_px))
    strongest = max(float(np.hypot(gx, gy).max()), 1e-6)
    return np.ascontiguousarray(np.stack([gx, gy], axis=2) / strongest, np.float32)


def gvf_force(u: Float32Array, config: SnakeConfig) -> Float32Array:
    """Return the gradient vector flow's force v/|v|, (h, w, 2) x and y; zero where nothing pulls."""
    gy, gx = np.gradient(edge_map(u, config.sigma_px))
    v = np.ascontiguousarray(np.stack([gx, gy], axis=2), np.float32)
    diffuse(v, config.gvf_mu, config.gvf_iterations)
    length = np.hypot(v[:, :, 0], v[:, :, 1])
    return np.ascontiguousarray(v / np.maximum(length, _FLAT)[:, :, None], np.float32)


@njit(cache=True, nogil=True)
def diffuse(v: Float32Array, mu: float, iterations: int) -> None:
    """Let ∇e, (h, w, 2), flow in place by v_t = μ ∇²v − |∇e|² (v − ∇e) with unit steps; borders repeat."""
    h, w = v.shape[:2]
    start = v.copy()
    pinned = np.empty((h, w), np.float32)
    for i in range(h):
        for j in range(w):
            pinned[i, j] = v[i, j, 0] ** 2 + v[i, j, 1] ** 2
    old = v.copy()
    rate = np.float32(mu)
    for _ in range(iterations):
        old[:] = v
        for i in range(h):
            above, below = max(i - 1, 0), min(i + 1, h - 1)
            for j in range(w):
                left, right = max(j - 1, 0), min(j + 1, w - 1)
                for c in range(2):
                    centre = old[i, j, c]
                    around = old[above, j, c] + old[below, j, c] + old[i, left, c] + old[i, right, c]
                    pull = pinned[i, j] * (centre - start[i, j, c])
                    v[i, j, c] = centre + rate * (around - np.float32(4.0) * centre) - pull


def stiffness_kernel(config: SnakeConfig) -> Points:
    """Return the middle row (2k + 1,) of (I + τA)⁻¹ on an endless contour.

    A is circulant, so its inverse is a convolution, and on a closed contour of n points the same kernel
    wrapped around; it is cut where less than 1e-7 of it is left.
    """
    # eigenvalues of −D² and D⁴
    second = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(_KERNEL_PERIOD) / _KERNEL_PERIOD)
    spectrum = 1.0 / (1.0 + config.step * (config.tension * second + config.rigidity * second**2))
    row = np.fft.ifft(spectrum).real
    half = _KERNEL_PERIOD // 2 - 1
    wide = np.concatenate([row[-half:], row[: half + 1]])
    reach = int(np.abs(np.flatnonzero(np.abs(wide) > _KERNEL_TAIL) - half).max())
    kernel = wide[half - reach : half + reach + 1]
    return np.asarray(kernel / kernel.sum(), np.float64)


@njit(cache=True, nogil=True)
def resample(points: Points, spacing: float) -> Points:
    """Return the closed contour (n, 2) with points at equal distances of about ``spacing`` px along it."""
    n = len(points)
    length = 0.0
    for k in range(n):
        a, b = points[k], points[(k + 1) % n]
        length += math.hypot(b[0] - a[0], b[1] - a[1])
    count = min(max(int(length / spacing + 0.5), _LEAST_POINTS), _MOST_POINTS)
    out = np.empty((count, 2))
    piece = length / count
    k, passed = 0, 0.0
    for m in range(count):
        wanted = m * piece
        while True:
            a, b = points[k], points[(k + 1) % n]
            side = math.hypot(b[0] - a[0], b[1] - a[1])
            if passed + side >= wanted or k == n - 1:
                share = min((wanted - passed) / side, 1.0) if side > 0.0 else 0.0
                out[m, 0] = a[0] + share * (b[0] - a[0])
                out[m, 1] = a[1] + share * (b[1] - a[1])
                break
            passed += side
            k += 1
    return out


@njit(cache=True, nogil=True)
def _force_at(force: Float32Array, x: float, y: float, axis: int) -> float:
    """Return one axis of the force between pixels, bilinearly; x and y are inside the image."""
    h, w = force.shape[:2]
    j, i = min(int(x), w - 2), min(int(y), h - 2)
    fx, fy = x - j, y - i
    top = (1.0 - fx) * force[i, j, axis] + fx * force[i, j + 1, axis]
    bottom = (1.0 - fx) * force[i + 1, j, axis] + fx * force[i + 1, j + 1, axis]
    return (1.0 - fy) * top + fy * bottom


@njit(cache=True, nogil=True)
def _swept(old: Points, new: Points) -> tuple[float, float]:
    """Return the area in px² that the contour has swept over, and the area it encloses now."""
    n = len(old)
    swept, area = 0.0, 0.0
    for k in range(n):
        before, after = old[(k - 1) % n], old[(k + 1) % n]
        tx, ty = 0.5 * (after[0] - before[0]), 0.5 * (after[1] - before[1])
        swept += abs(tx * (new[k, 1] - old[k, 1]) - ty * (new[k, 0] - old[k, 0]))
        following = new[(k + 1) % n]
        area += 0.5 * (new[k, 0] * following[1] - following[0] * new[k, 1])
    return swept, abs(area)


@njit(cache=True, nogil=True)
def evolve(
    points: Points,
    force: Float32Array,
    kernel: Points,
    step_and_spacing: tuple[float, float],
    iterations: int,
    stop_fraction: float,
    stop_after: int,
) -> tuple[Points, int]:
    """Move a closed contour (n, 2) until it rests; returns it and the iterations done.

    It rests when the area swept in an iteration, in px the pixels that change side, is at most
    ``stop_fraction`` of the area enclosed, ``stop_after`` times running. Points are held inside the image.
    """
    step, spacing = step_and_spacing
    h, w = force.shape[:2]
    half = len(kernel) // 2
    x = resample(points, spacing)
    quiet = 0
    for iteration in range(iterations):
        if iteration % _RESAMPLE_EVERY == 0:
            x = resample(x, spacing)
        n = len(x)
        pushed = np.empty((n, 2))
        for k in range(n):
            for c in range(2):
                pushed[k, c] = x[k, c] + step * _force_at(force, x[k, 0], x[k, 1], c)
        new = np.zeros((n, 2))
        for k in range(n):
            for m in range(-half, half + 1):
                weight = kernel[m + half]
                source = (k + m) % n
                new[k, 0] += weight * pushed[source, 0]
                new[k, 1] += weight * pushed[source, 1]
            new[k, 0] = min(max(new[k, 0], 0.0), w - 1.0)
            new[k, 1] = min(max(new[k, 1], 0.0), h - 1.0)
        swept, area = _swept(x, new)
        x = new
        quiet = quiet + 1 if swept <= stop_fraction * area else 0
        if quiet >= stop_after or area < 1.0:
            return x, iteration + 1
    return x, iterations
