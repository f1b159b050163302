"""Effective sample size of a correlated series, and the bounds of its mean χ²."""

from collections.abc import Sequence

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.metrics import CONFIDENCE, ChiSquareMean
from groundstation.geometry.chi_square import chi_square_quantile

_LARGEST = 0.999


def lag_one(runs: Sequence[FloatArray]) -> float:
    """Return the correlation of neighbours in unbroken runs of errors (n, d), each about zero.

    The mean is not taken off: an error that stays is an error that repeats. 0 where there are no neighbours.
    """
    first = np.concatenate([np.zeros(0), *(run[:-1].ravel() for run in runs)])
    second = np.concatenate([np.zeros(0), *(run[1:].ravel() for run in runs)])
    power = float(np.sqrt((first**2).sum() * (second**2).sum()))
    return float((first * second).sum()) / power if power > 0 else 0.0


def effective_count(count: int, correlation: float) -> float:
    """Return how many independent squares ``count`` squares of a first-order Gaussian series are worth.

    Squares of errors that correlate by ρ correlate by ρ², so n_eff = n (1 − ρ²) / (1 + ρ²); at least 1 if any.
    """
    square = min(abs(correlation), _LARGEST) ** 2
    return max(count * (1 - square) / (1 + square), min(float(count), 1.0))


def correlated_chi_square(runs: Sequence[FloatArray]) -> ChiSquareMean | None:
    """Return the mean square of whitened errors, runs of (n, d), with its two-sided 95 % bounds.

    Errors are divided by the root of their stated covariance, so the mean per degree of freedom is 1 where that
    is right. The bounds hold for the effective number of independent errors. None without errors.
    """
    count = sum(len(run) for run in runs)
    if count == 0:
        return None
    dof = effective_count(count, lag_one(runs)) * runs[0].shape[1]
    low, high = chi_square_quantile([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], dof) / dof
    mean = float(np.mean(np.concatenate([run.ravel() for run in runs]) ** 2))
    return ChiSquareMean(mean=mean, low=float(low), high=float(high), count=count)
