"""Smooth paths: cubic splines with a prior on the differences of their coefficients (docs/derivation.md, section 16).

A path is Σ c_k B_k(t), cubic B-splines on even knots. Its differences of order m, c_{k+3} − 3c_{k+2} + 3c_{k+1} − c_k
for m = 3, c_{k+2} − 2c_{k+1} + c_k for m = 2, are modelled as white noise of s: a jerk or an acceleration that changes
at random. The size of s is estimated from the samples: it maximises

    −2 log p = Q/σ² + log|BᵀB + DᵀD σ²/s²| + (K − m) log(s²/σ²),     Q the residual, in both parts,

the probability of the samples with all paths integrated out (Eilers and Marx 1996 for the splines). Cross-validation,
which needs no σ, follows an encoder's steps where the head turns slowly.

So is m: the path of an aircraft in gusts is rougher than any random jerk, and errors of a spline that is too smooth
for it last longer than a fix. For that the second differences get a mean g β, β unknown, so that either order
leaves the same paths free, parabolas (restricted likelihood, Harville 1974); log|DDᵀ|, else constant, counts then.

A flare, or a head that is commanded elsewhere: at an instant a path is less smooth than elsewhere. Where
the estimated difference is more than 4.5 of its own sigmas, √(s² − (D N⁻¹ Dᵀ)_kk) with N the normal matrix, it and its
neighbours are freed, and s is estimated again (de Jong and Penzer 1998).
"""

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_matrix, diags

from calibration.flight.banded_inverse import banded_inverse
from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_quantile

CUBIC = 3
# of the differences that may be white, the smoother first
ORDERS = (3, 2)
# s over σ is sought between these
_STIFF, _LOOSE = 1e-4, 1e2
# between knots of a path's rate
_RATE_KNOT_S = 2.0
# a difference so many sigmas off breaks the path: with so many neighbours on each side, it is then as good as free
_BREAK_SIGMA = 4.5
_NEIGHBOURS = 2
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
    def centres_s(self) -> FloatArray:
        """Where each spline is largest (K,), s."""
        return self.knots[2 : 2 + self.count]

    def differences(self, order: int) -> csr_matrix:
        """Return D (K − m, K): the coefficients' differences of order m."""
        k = self.count
        weights = [float((-1) ** (order - j) * comb(order, j)) for j in range(order + 1)]
        return diags(weights, list(range(order + 1)), shape=(k - order, k)).tocsr()

    def at(self, t_s: FloatArray) -> csr_matrix:
        """Return B (n, K) at instants (n,); those outside are taken to the nearest end."""
        inside = np.clip(t_s, self.from_s, np.nextafter(self.to_s, self.from_s))
        return BSpline.design_matrix(inside, self.knots, CUBIC).tocsr()

    def rate(self, path: BSpline) -> BSpline:
        """Return the derivative of a path without what changes within seconds.

        A shift in time of a path that is as rough as its prior allows leaves the prior as it was; to first order it
        seems to cost much, and fixes that are off by metres would seem to know the time to milliseconds.
        """
        t = np.linspace(self.from_s, self.to_s, 3 * self.count)
        inner = np.linspace(self.from_s, self.to_s, max(int((self.to_s - self.from_s) / _RATE_KNOT_S), 1) + 1)
        knots = np.concatenate([np.full(CUBIC, inner[0]), inner, np.full(CUBIC, inner[-1])])
        return make_lsq_spline(t, path(t, nu=1), knots, CUBIC)

    def spline(self, coefficients: FloatArray) -> BSpline:
        """Return the path of coefficients (K,)."""
        return BSpline(self.knots, coefficients, CUBIC)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smoothness:
    """One sigma of each of a path's differences of an order m, (K − m,); the noise of its samples over that stated."""

    order: int
    difference: FloatArray
    noise_factor: float

    def loosened(self, found: FloatArray, taken: FloatArray) -> "Smoothness":
        """Return it set free where differences found (K − m,), with (D N⁻¹ Dᵀ)_kk ``taken``, break the path."""
        s = self.difference
        odd = np.abs(found) / np.sqrt(np.maximum(s**2 - taken, 1e-6 * s**2))
        odd[s > _USUAL * np.median(s)] = 0.0
        free = s.copy()
        for k in np.flatnonzero(odd > _BREAK_SIGMA):
            neighbours = slice(max(k - _NEIGHBOURS, 0), k + _NEIGHBOURS + 1)
            if odd[k] == odd[neighbours].max():
                free[neighbours] = np.median(s) / np.sqrt(_FREE)
        return replace(self, difference=free)


def path_basis(from_s: float, to_s: float, step_s: float) -> PathBasis:
    """Return splines over a stretch of time with knots no further apart than a step."""
    intervals = max(int(np.ceil((to_s - from_s) / step_s - 1e-6)), max(ORDERS) + 1)
    step = (to_s - from_s) / intervals
    knots = np.asarray(from_s + step * np.arange(-CUBIC, intervals + CUBIC + 1), dtype=np.float64)
    return PathBasis(knots=knots, from_s=from_s, to_s=to_s)


def find_smoothness(
    basis: PathBasis, t_s: FloatArray, values: FloatArray, sigma: FloatArray, orders: tuple[int, ...] = ORDERS
) -> Smoothness:
    """Return the smoothness of a path that was sampled as ``values`` (n,) with noise ``sigma`` (n,).

    The noise is as stated, or larger where the samples show it beyond chance.
    """
    usual = float(np.sqrt(np.mean(sigma**2)))
    fits = [_fit(Evidence(basis, t_s, values - values.mean(), sigma / usual, order), usual) for order in orders]
    return min(fits, key=lambda fit: fit.minus_two_log).smoothness


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """How smooth a path is if differences of one order are white, and −2 log of how probable that makes the samples."""

    smoothness: Smoothness
    minus_two_log: float


def _fit(evidence: "Evidence", usual: float) -> _Fit:
    weight = np.ones(evidence.differences.shape[0])
    ratio, noise = evidence.best(weight, usual)
    for _ in range(_MOST_BREAKS):
        odd = np.where(weight < 1.0, 0.0, evidence.standardised_differences(weight, ratio, noise))
        worst = int(np.argmax(odd))
        if odd[worst] < _BREAK_SIGMA:
            break
        weight[max(worst - _NEIGHBOURS, 0) : worst + _NEIGHBOURS + 1] = _FREE
        ratio, noise = evidence.best(weight, usual)
    smoothness = Smoothness(
        order=evidence.order, difference=ratio * noise / np.sqrt(weight), noise_factor=noise / usual
    )
    return _Fit(smoothness=smoothness, minus_two_log=evidence.comparable(weight, ratio, noise))


class Evidence:
    """The probability of samples for a ratio s/σ and weights (K − m,) of the differences, by banded Cholesky."""

    def __init__(self, basis: PathBasis, t_s: FloatArray, values: FloatArray, relative: FloatArray, order: int) -> None:
        design = diags(1.0 / relative) @ basis.at(t_s)
        data = values / relative
        self.order = order
        self.differences = basis.differences(order)
        self._samples = len(t_s)
        self._count = basis.count
        self._normal = _bands(design.T @ design)
        self._right = np.asarray(design.T @ data)
        self._square = float(data @ data)

    def best(self, weight: FloatArray, stated: float) -> tuple[float, float]:
        """Return the ratio and the sigma of the samples, not below that stated, that are most probable."""
        penalty = _bands(self.differences.T @ diags(weight) @ self.differences)
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
        noise = float(np.sqrt(self._residual(penalty, ratio)[0] / max(self._samples - self.order, 1)))
        # the stated noise is prior information: an excess within chance has no effect
        freedom = self._samples - self.order
        raised = freedom > 0 and noise >= stated * float(np.sqrt(chi_square_quantile(_CHANCE, freedom) / freedom))
        return (ratio, noise) if raised else (most_probable(stated), stated)

    def standardised_differences(self, weight: FloatArray, ratio: float, noise: float) -> FloatArray:
        """Return the third differences (K − 3,) of the path found over their sigmas, without their signs."""
        D = self.differences
        penalty = _bands(D.T @ diags(weight) @ D)
        root = cholesky_banded(self._normal + penalty / ratio**2, lower=True)
        found = np.abs(D @ cho_solve_banded((root, True), self._right)) / noise
        # a difference involves neighbours only, so that the inverse within the band is sufficient
        Z = _symmetric(banded_inverse(root))
        taken = np.asarray((D @ Z).multiply(D).sum(axis=1)).ravel()
        variance = ratio**2 / weight - taken
        return np.asarray(found / np.sqrt(np.maximum(variance, 1e-6 * ratio**2)))

    def comparable(self, weight: FloatArray, ratio: float, noise: float) -> float:
        """Return −2 log p, parabolas free, but for a constant that orders have in common."""
        D = self.differences
        penalty = _bands(D.T @ diags(weight) @ D)
        root = cholesky_banded(self._normal + penalty / ratio**2, lower=True)
        found = cho_solve_banded((root, True), self._right)
        square = self._square - float(self._right @ found)
        shape = 2.0 * float(np.sum(np.log(root[0]))) + 2.0 * len(weight) * np.log(ratio) - float(np.sum(np.log(weight)))
        shape -= 2.0 * float(np.sum(np.log(cholesky_banded(_bands(D @ D.T), lower=True)[0])))
        if self.order < max(ORDERS):
            away = np.arange(self._count) - 0.5 * (self._count - 1)
            parabola = away**2 - np.mean(away**2)
            mean = D @ (parabola / np.linalg.norm(parabola))
            pull = D.T @ (weight * mean) / ratio**2
            stiff = float(mean @ (weight * mean)) / ratio**2 - float(pull @ cho_solve_banded((root, True), pull))
            square -= float(pull @ found) ** 2 / stiff
            shape += float(np.log(stiff))
        return square / noise**2 + shape + 2.0 * (self._samples - max(ORDERS)) * float(np.log(noise))

    def _residual(self, penalty: FloatArray, ratio: float) -> tuple[float, float]:
        root = cholesky_banded(self._normal + penalty / ratio**2, lower=True)
        found = cho_solve_banded((root, True), self._right)
        return max(self._square - float(self._right @ found), 1e-300), 2.0 * float(np.sum(np.log(root[0])))

    def _minus_two_log(self, penalty: FloatArray, ratio: float, sigma: float | None) -> float:
        """Return −2 log p, but for a constant; without a sigma, at the one that makes it least."""
        square, determinant = self._residual(penalty, ratio)
        shape = determinant + 2.0 * (self._count - self.order) * np.log(ratio)
        if sigma is None:
            return float((self._samples - self.order) * np.log(square) + shape)
        return float(square / sigma**2 + shape)


def _bands(matrix: csr_matrix) -> FloatArray:
    """Return the lower bands (4, K) of a symmetric matrix of bandwidth 3 or less."""
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
