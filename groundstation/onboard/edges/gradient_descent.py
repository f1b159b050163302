"""Descent of the energy from initial crossings, which move independently: a trapezoid stays one (Eq. 5)."""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.energy import non_variant, spatially_variant, spatially_variant_as_printed

_LEAST_GAP_PX = 2.0
_GROWTH = 1.4


class Energy(Enum):
    """Which energy, with which gradient."""

    SPATIALLY_VARIANT = 0
    AS_PRINTED = 1
    NON_VARIANT = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class DescentConfig:
    """Numerics of the descent.

    Attributes
    ----------
    energy : the minimised energy.
    places, samples : points along a line, and on either side of each.
    step_px : the first step; the paper's 0.5 (each step is the gradient scaled to that length).
    least_step_px : smallest step; a step without improvement is halved, one with improvement increased.
    most_steps : evaluations at most.
    gamma : weight γ of the distance from the initial crossings, per px² (Eq. 3).
    adaptive_gamma : multiply γ by 1 + (variance within the bands) / (squared difference of their means), initially.
    """

    energy: Energy = Energy.SPATIALLY_VARIANT
    places: int = 40
    samples: int = 8
    step_px: float = 0.5
    least_step_px: float = 0.02
    most_steps: int = 60
    gamma: float = 1e-2
    adaptive_gamma: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DescentResult:
    """Crossings (4,) px at the end, energy there and at the start (γ's part included), steps, and the γ used."""

    crossings_px: FloatArray
    energy: float
    start_energy: float
    steps: int
    gamma: float


class EnergyTerms(NamedTuple):
    """One of the three energies, ``kind``, and its data, as in `energy`; ``far`` of the non-variant one alone."""

    kind: int
    image: ImageArray
    rows: FloatArray
    widths: FloatArray
    across: FloatArray
    far: FloatArray
    counts: tuple[int, int]


class StepLimits(NamedTuple):
    """The first step and the smallest one, px, and the most evaluations."""

    first_px: float
    least_px: float
    most: int


@njit(cache=True, nogil=True)
def evaluate(energy: EnergyTerms, x: FloatArray, grad: FloatArray) -> float:
    """Return one of the three energies, without γ's part, and fill its gradient (4,)."""
    if energy.kind == 0:
        return spatially_variant(energy.image, x, energy.rows, energy.widths, energy.across, energy.counts, grad)
    if energy.kind == 1:
        return spatially_variant_as_printed(energy.image, x, energy.rows, energy.widths, energy.counts, grad)
    return non_variant(energy.image, x, energy.rows, energy.far, grad)


@njit(cache=True, nogil=True)
def _descend(terms: EnergyTerms, x: FloatArray, gamma: float, steps: StepLimits, energies: FloatArray) -> int:
    """Move ``x`` (4,) downhill in place; fills energies (2,) at start and end, returns the evaluations done."""
    step = steps.first_px
    prior, trial = x.copy(), x.copy()
    grad, new_grad = np.empty(4), np.empty(4)
    energy = evaluate(terms, x, grad)
    energies[0] = energy
    done = 1
    while done < steps.most and step >= steps.least_px:
        norm = np.sqrt((grad * grad).sum())
        if norm < 1e-12:
            break
        for k in range(4):
            trial[k] = x[k] - step / norm * grad[k]
        done += 1
        if trial[2] - trial[0] < _LEAST_GAP_PX or trial[3] - trial[1] < _LEAST_GAP_PX:
            step *= 0.5
            continue
        found = evaluate(terms, trial, new_grad)
        for k in range(4):
            found += gamma * (trial[k] - prior[k]) ** 2
            new_grad[k] += 2.0 * gamma * (trial[k] - prior[k])
        if found < energy:
            energy = found
            x[:] = trial
            grad[:] = new_grad
            step *= _GROWTH
        else:
            step *= 0.5
    energies[1] = energy
    return done


@njit(cache=True, nogil=True)
def clutter(image: ImageArray, x: FloatArray, rows: FloatArray, widths: FloatArray, counts: tuple[int, int]) -> float:
    """Return the variance within the bands over the squared difference of their means; 0 where nothing is seen."""
    n_t, n_s = counts
    height = rows[1] - rows[0]
    within, between = 0.0, 0.0
    for line in range(2):
        w = x[2 * line + 1] - x[2 * line]
        length = np.sqrt(w * w + height * height)
        nx, ny = height / length, -w / length
        for k in range(n_t):
            t = (k + 0.5) / n_t
            cx, cy = x[2 * line] + w * t, rows[0] + height * t
            ell = widths[line, 0] + (widths[line, 1] - widths[line, 0]) * t
            ax, ay, bx, by = cx - ell * nx, cy - ell * ny, cx + ell * nx, cy + ell * ny
            if min(ax, bx, ay, by) < 0 or max(ax, bx) >= image.shape[1] or max(ay, by) >= image.shape[0]:
                continue
            for c in range(3):
                mean_a, mean_b, square = 0.0, 0.0, 0.0
                for m in range(n_s):
                    s = (m + 0.5) * ell / n_s
                    a = image[int(cy - s * ny), int(cx - s * nx), c] / 255.0
                    b = image[int(cy + s * ny), int(cx + s * nx), c] / 255.0
                    mean_a += a / n_s
                    mean_b += b / n_s
                    square += (a * a + b * b) / n_s
                within += 0.5 * (square - mean_a**2 - mean_b**2)
                between += (mean_a - mean_b) ** 2
    return within / between if between > 0.0 else 0.0


def descend(
    image: ImageArray,
    guess_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    config: DescentConfig,
    across: FloatArray | None = None,
) -> DescentResult:
    """Descend from initial crossings.

    Parameters
    ----------
    image : (h, w, 3) uint8.
    guess_px : initial crossings (4,), also d′ of the penalty.
    rows_px : upper and lower row (2,).
    widths_px : band widths ℓ (2, 2): line 1 and 2, at the upper and lower row; along ``across``.
    across : direction of the bands (2,), a unit vector to the right; None for the normals (SPATIALLY_VARIANT only).
    """
    along = np.zeros(2) if across is None else np.asarray(across, dtype=np.float64)
    x, energies = np.array(guess_px, dtype=np.float64), np.zeros(2)
    counts = (config.places, config.samples)
    gamma = config.gamma
    if config.adaptive_gamma:
        gamma *= 1.0 + min(float(clutter(image, x, rows_px, widths_px, counts)), 100.0)
    steps = StepLimits(config.step_px, config.least_step_px, config.most_steps)
    far = far_sides(x, rows_px, widths_px)
    terms = EnergyTerms(config.energy.value, image, rows_px, widths_px, along, far, counts)
    done = _descend(terms, x, gamma, steps, energies)
    return DescentResult(
        crossings_px=x, energy=float(energies[1]), start_energy=float(energies[0]), steps=int(done), gamma=gamma
    )


def far_sides(crossings_px: FloatArray, rows_px: FloatArray, widths_px: FloatArray) -> FloatArray:
    """Return the crossings (2, 2, 2) of the bands' far sides: line, inner or outer, upper or lower row."""
    pair = crossings_px.reshape(2, 2)
    height = rows_px[1] - rows_px[0]
    # along a row a band is wider than along its normal
    across = widths_px * np.hypot(1.0, (pair[:, 1:] - pair[:, :1]) / height)
    outwards = np.array([-1.0, 1.0])[:, None] * across
    return np.asarray(np.stack([pair - outwards, pair + outwards], axis=1))
