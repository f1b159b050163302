"""A path of which nothing is known but that it is smooth: splines of small third differences (docs/derivation.md, 16).

A path is Σ c_k B_k(t), cubic B-splines on even knots. Its third differences c_{k+3} − 3c_{k+2} + 3c_{k+1} − c_k are
taken to be white noise of s, which is a jerk that changes at random. How large s is, the samples tell: it maximises

    −2 log p = Q/σ² + log|BᵀB + DᵀD σ²/s²| + (K − 3) log(s²/σ²),     Q what is left over, in both parts,

the probability of the samples with all paths integrated out (Eilers and Marx 1996 for the splines). Cross-validation,
which needs no σ, follows an encoder's steps where the head turns slowly.

A craft that rounds out, a head that is sent elsewhere: for an instant a path is less smooth than it is elsewhere. Where
the difference found is more than 4.5 of its own sigmas, √(s² − (D N⁻¹ Dᵀ)_kk) with N the normal matrix, it and its
neighbours are set free, and s is sought anew (de Jong and Penzer 1998).
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_matrix, diags
from scipy.stats import chi2

from calibration.banded_inverse import banded_inverse
from groundstation.arrays import FloatArray

CUBIC = 3
ORDER = 3
# s over σ is sought between these
_STIFF, _LOOSE = 1e-4, 1e2
# a difference so many sigmas off breaks the path: with so many beside it, it is then as good as free
_BREAK_SIGMA = 4.5
_BESIDE = 2
_FREE = 1e-4
_USUAL = 10.0
_MOST_BREAKS = 20
# of paths whose samples are as noisy as stated, so many keep that
_CHANCE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathBasis:
    """B-splines on even knots from ``from_s`` to ``to_s``, some ``step_s`` apart; K of them."""

    knots: FloatArray
    from_s: float
    to_s: float

    @property
    def count(self) -> int:
        """K."""
        return len(self.knots) - CUBIC - 1

    @property
    def differences(self) -> csr_matrix:
        """D (K − 3, K): third differences of the coefficients."""
        k = self.count
        return diags([-1.0, 3.0, -3.0, 1.0], [0, 1, 2, 3], shape=(k - ORDER, k)).tocsr()

    def at(self, t_s: FloatArray) -> csr_matrix:
        """Return B (n, K) at instants (n,); those outside are taken to the nearest end."""
        inside = np.clip(t_s, self.from_s, np.nextafter(self.to_s, self.from_s))
        return BSpline.design_matrix(inside, self.knots, CUBIC).tocsr()

    def spline(self, coefficients: FloatArray) -> BSpline:
        """Return the path of coefficients (K,)."""
        return BSpline(self.knots, coefficients, CUBIC)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smoothness:
    """One sigma of each of a path's third differences, (K − 3,); the noise of its samples over that stated."""

    third_difference: FloatArray
    noise_factor: float

    def loosened(self, found: FloatArray, taken: FloatArray) -> "Smoothness":
        """Return it set free where differences found (K − 3,), with (D N⁻¹ Dᵀ)_kk ``taken``, break the path."""
        s = self.third_difference
        odd = np.abs(found) / np.sqrt(np.maximum(s**2 - taken, 1e-6 * s**2))
        odd[s > _USUAL * np.median(s)] = 0.0
        free = s.copy()
        for k in np.flatnonzero(odd > _BREAK_SIGMA):
            beside = slice(max(k - _BESIDE, 0), k + _BESIDE + 1)
            if odd[k] == odd[beside].max():
                free[beside] = np.median(s) / np.sqrt(_FREE)
        return Smoothness(third_difference=free, noise_factor=self.noise_factor)


def path_basis(from_s: float, to_s: float, step_s: float) -> PathBasis:
    """Return splines over a stretch of time with knots no further apart than a step."""
    intervals = max(int(np.ceil((to_s - from_s) / step_s - 1e-6)), ORDER + 1)
    step = (to_s - from_s) / intervals
    knots = np.asarray(from_s + step * np.arange(-CUBIC, intervals + CUBIC + 1), dtype=np.float64)
    return PathBasis(knots=knots, from_s=from_s, to_s=to_s)


def find_smoothness(basis: PathBasis, t_s: FloatArray, values: FloatArray, sigma: FloatArray) -> Smoothness:
    """Return how smooth a path is that was sampled as ``values`` (n,) with noise ``sigma`` (n,).

    The noise is taken as stated, or larger where the samples say so more clearly than chance would.
    """
    usual = float(np.sqrt(np.mean(sigma**2)))
    evidence = _Evidence(basis, t_s, values - values.mean(), sigma / usual)
    weight = np.ones(basis.count - ORDER)
    ratio, noise = evidence.best(weight, usual)
    for _ in range(_MOST_BREAKS):
        odd = np.where(weight < 1.0, 0.0, evidence.oddness(weight, ratio, noise))
        worst = int(np.argmax(odd))
        if odd[worst] < _BREAK_SIGMA:
            break
        weight[max(worst - _BESIDE, 0) : worst + _BESIDE + 1] = _FREE
        ratio, noise = evidence.best(weight, usual)
    return Smoothness(third_difference=ratio * noise / np.sqrt(weight), noise_factor=noise / usual)


class _Evidence:
    """The probability of samples for a ratio s/σ and weights (K − 3,) of the differences, by banded Cholesky."""

    def __init__(self, basis: PathBasis, t_s: FloatArray, values: FloatArray, relative: FloatArray) -> None:
        design = diags(1.0 / relative) @ basis.at(t_s)
        data = values / relative
        self._differences = basis.differences
        self._samples = len(t_s)
        self._count = basis.count
        self._normal = _bands(design.T @ design)
        self._right = np.asarray(design.T @ data)
        self._square = float(data @ data)

    def best(self, weight: FloatArray, stated: float) -> tuple[float, float]:
        """Return the ratio and the sigma of the samples, not below that stated, that are most probable."""
        penalty = _bands(self._differences.T @ diags(weight) @ self._differences)
        bounds = (np.log(_STIFF), np.log(_LOOSE))

        def most_probable(sigma: float | None) -> float:
            found = minimize_scalar(
                lambda x: self._minus_two_log(penalty, float(np.exp(x)), sigma),
                bounds=bounds,
                method="bounded",
                options={"xatol": 1e-2},
            )
            return float(np.exp(found.x))

        ratio = most_probable(None)
        noise = float(np.sqrt(self._left_over(penalty, ratio)[0] / max(self._samples - ORDER, 1)))
        # what is stated is knowledge: what chance finds above it, too, raises nothing
        freedom = self._samples - ORDER
        raised = noise >= stated * float(np.sqrt(chi2.ppf(_CHANCE, freedom) / freedom)) if freedom > 0 else False
        return (ratio, noise) if raised else (most_probable(stated), stated)

    def oddness(self, weight: FloatArray, ratio: float, noise: float) -> FloatArray:
        """Return the third differences (K − 3,) of the path found over their sigmas, without their signs."""
        D = self._differences
        penalty = _bands(D.T @ diags(weight) @ D)
        root = cholesky_banded(self._normal + penalty / ratio**2, lower=True)
        found = np.abs(D @ cho_solve_banded((root, True), self._right)) / noise
        # a difference touches neighbours only, so that the inverse within the band is all that it asks for
        Z = _symmetric(banded_inverse(root))
        taken = np.asarray((D @ Z).multiply(D).sum(axis=1)).ravel()
        variance = ratio**2 / weight - taken
        return np.asarray(found / np.sqrt(np.maximum(variance, 1e-6 * ratio**2)))

    def _left_over(self, penalty: FloatArray, ratio: float) -> tuple[float, float]:
        root = cholesky_banded(self._normal + penalty / ratio**2, lower=True)
        found = cho_solve_banded((root, True), self._right)
        return max(self._square - float(self._right @ found), 1e-300), 2.0 * float(np.sum(np.log(root[0])))

    def _minus_two_log(self, penalty: FloatArray, ratio: float, sigma: float | None) -> float:
        """Return −2 log p, but for a constant; without a sigma, at the one that makes it least."""
        square, determinant = self._left_over(penalty, ratio)
        shape = determinant + 2.0 * (self._count - ORDER) * np.log(ratio)
        if sigma is None:
            return float((self._samples - ORDER) * np.log(square) + shape)
        return float(square / sigma**2 + shape)


def _bands(matrix: csr_matrix) -> FloatArray:
    """Return the lower bands (4, K) of a symmetric matrix of bandwidth 3."""
    bands = np.zeros((CUBIC + 1, matrix.shape[0]))
    for away in range(CUBIC + 1):
        diagonal = matrix.diagonal(-away)
        bands[away, : len(diagonal)] = diagonal
    return bands


def _symmetric(bands: FloatArray) -> csr_matrix:
    """Return the symmetric matrix of lower bands (b + 1, K)."""
    n = bands.shape[1]
    below = [bands[away, : n - away] for away in range(len(bands))]
    places = [-away for away in range(len(bands))]
    return diags([*below, *below[1:]], [*places, *(-p for p in places[1:])]).tocsr()
