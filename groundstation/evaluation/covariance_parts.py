"""Consistency of a stated covariance in its two parts: an error constant over a flight, and white noise per frame.

A constant error is drawn once for a flight and each axis of the picture; only the noise is drawn for every frame. So
the whole covariance is tested over flights, the noise by second differences of neighbouring frames, which remove
constant and linear errors. Bounds are quantiles of many seeded draws from the stated model itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.metrics import CONFIDENCE, ChiSquareMean

_DRAWS = 1000
_SEED = 20_141
_JUMP_SIGMAS = 4.0
_DIFFERENCE = np.array([1.0, -2.0, 1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorsWithCovariance:
    """One camera's errors (n, 2) in consecutive frames and their stated covariances, px and px².

    ``covariances`` (n, 2, 2) of the whole, ``noises`` (n, 2, 2) the white-noise part of it.
    """

    errors: FloatArray
    covariances: FloatArray
    noises: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseChiSquare:
    """Result of `noise_chi_square`: the mean, and the share of differences that are jumps, of ``mean.count``."""

    mean: ChiSquareMean
    jump_share: float


def flights_chi_square(flights: Sequence[Sequence[ErrorsWithCovariance]]) -> ChiSquareMean | None:
    """Return errorᵀ covariance⁻¹ error per degree of freedom, with 95 % bounds that count flights, not frames.

    The cameras of a flight share what lasts: the same two numbers, times the symmetric root of that part of each
    frame's covariance. ``count`` is that of the flights. None without errors.
    """
    flown = [[run for run in flight if len(run.errors)] for flight in flights]
    flown = [flight for flight in flown if flight]
    if not flown:
        return None
    rng = np.random.default_rng(_SEED)
    square, drawn, count = 0.0, np.zeros(_DRAWS), 0
    for flight in flown:
        lasting = rng.normal(size=(_DRAWS, 2))
        for run in flight:
            white = np.linalg.inv(np.linalg.cholesky(run.covariances))
            square += float((np.einsum("nij,nj->ni", white, run.errors) ** 2).sum())
            stays, new = white @ _root(run.covariances - run.noises), white @ _root(run.noises)
            values = _turned(lasting[None], stays) + _turned(rng.normal(size=(len(new), _DRAWS, 2)), new)
            drawn += (values**2).sum(axis=(0, 2))
            count += run.errors.size
    low, high = _bounds(drawn / count)
    return ChiSquareMean(mean=square / count, low=low, high=high, count=len(flown))


def noise_chi_square(runs: Sequence[ErrorsWithCovariance]) -> NoiseChiSquare | None:
    """Return the mean square of second differences over what the stated noise makes them, per degree of freedom.

    Differences of more than four sigmas in one axis are jumps: another part of the outline was taken for the nose's.
    They are counted and left out, of the bounds' draws, too. None where no three frames follow each other.
    """
    long = [run for run in runs if len(run.errors) > 2]
    if not long:
        return None
    rng = np.random.default_rng(_SEED)
    seen, kept, total = 0.0, 0, 0
    drawn, left = np.zeros(_DRAWS), np.zeros(_DRAWS)
    for run in long:
        spread = sum(c * c * part for c, part in zip(_DIFFERENCE, _neighbours(run.noises), strict=True))
        white = np.linalg.inv(np.linalg.cholesky(spread))
        draws = _turned(rng.normal(size=(len(run.errors), _DRAWS, 2)), _root(run.noises))
        squares, calm = _without_jumps(_differences(run.errors[:, None], white))
        drawn_squares, drawn_calm = _without_jumps(_differences(draws, white))
        seen, kept, total = seen + float(squares[0]), kept + int(calm[0]), total + len(white)
        drawn, left = drawn + drawn_squares, left + drawn_calm
    low, high = _bounds(drawn / np.maximum(2 * left, 1.0))
    mean = ChiSquareMean(mean=seen / max(2 * kept, 1), low=low, high=high, count=total)
    return NoiseChiSquare(mean=mean, jump_share=1.0 - kept / total)


def _neighbours(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what lies before, at and after each of the inner values of (n, …)."""
    return values[:-2], values[1:-1], values[2:]


def _differences(errors: FloatArray, white: FloatArray) -> FloatArray:
    """Return the whitened second differences (n − 2, d, 2) of d series of errors (n, d, 2)."""
    parts = zip(_DIFFERENCE, _neighbours(errors), strict=True)
    return _turned(np.asarray(sum(c * part for c, part in parts)), white)


def _turned(vectors: FloatArray, matrices: FloatArray) -> FloatArray:
    """Return each frame's matrix (n, 2, 2) times its vectors (n, d, 2); BLAS is slow at so small ones."""
    first, second = vectors[..., 0], vectors[..., 1]
    return np.stack([m[:, 0, None] * first + m[:, 1, None] * second for m in np.moveaxis(matrices, 1, 0)], axis=2)


def _without_jumps(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the sum of squares (d,) of what is no jump in (n, d, 2), and how many those are (d,)."""
    calm = (np.abs(values) <= _JUMP_SIGMAS).all(axis=2)
    return ((values**2).sum(axis=2) * calm).sum(axis=0), calm.sum(axis=0)


def _root(matrices: FloatArray) -> FloatArray:
    """Return the symmetric roots of covariances (n, 2, 2)."""
    values, axes = np.linalg.eigh(matrices)
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0))[:, None, :] @ np.swapaxes(axes, 1, 2))


def _bounds(drawn: FloatArray) -> tuple[float, float]:
    low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)
