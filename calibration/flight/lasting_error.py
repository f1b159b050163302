"""The error of a reference that lasts: a receiver without corrections is off by metres that change in minutes.

Its fixes then agree with their neighbours far better than with the truth, and the sigma that it states is mostly of an
error which no smoothing averages out. For each axis it is modelled as a constant, as of orbits and ionosphere, and a
first-order Gauss-Markov process, as of reflections, with half of the variance each; the process has the correlation
exp(-|dt| / tau) and is linear between knots. Cameras of surveyed positions distinguish it from the path.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_diag, csr_matrix, diags

from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_quantile

# correlation time of the part that changes within a flight
CORRELATION_S = 60.0
_KNOTS_EACH = 30.0
_CONSTANT_SHARE = 0.5
# of logs whose noise is as stated, so many have no part that lasts
_CHANCE = 0.999
# a log whose neighbours agree a little better than stated is taken at its word: its receiver filters
_LEAST_SHARE = 0.5
# a fix by the carrier's phase is off by less, which labels and lenses hide
_LEAST_SIGMA_M = 0.1
# one sigma of an axis without such an error, and of what the constant differs by from stretch to stretch, m
_NOTHING_M = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LastingError:
    """A reference's lasting error along one stretch of its fixes, with d axes.

    Its coefficients are, axis by axis, the constant and the process at ``knots_s`` (m,). ``sigma_m`` (d,) is one sigma
    of both together, 0 where none lasts; ``white_m`` (d,) of what each fix is off by for itself. ``continues``: an
    earlier stretch has the prior of the constant and of the process's beginning.
    """

    knots_s: FloatArray
    sigma_m: FloatArray
    white_m: FloatArray
    continues: bool = False

    @property
    def each(self) -> int:
        """Number of coefficients of an axis."""
        return 1 + len(self.knots_s)

    @property
    def size(self) -> int:
        """Number of all coefficients."""
        return self.each * len(self.sigma_m)

    @property
    def centres_s(self) -> FloatArray:
        """Where each coefficient acts most (size,), s."""
        middle = 0.5 * (self.knots_s[0] + self.knots_s[-1])
        return np.tile(np.concatenate([[middle], self.knots_s]), len(self.sigma_m))

    @property
    def text(self) -> str:
        """What was found, in words."""
        white, lasting = ("/".join(f"{s:.2f}" for s in values) for values in (self.white_m, self.sigma_m))
        return (
            f"DGPS: neighbouring fixes agree to {white} m; an error of {lasting} m that lasts, the rest of what is"
            " stated, is estimated with the calibration"
        )

    def at(self, t_s: FloatArray) -> csr_matrix:
        """Return what each coefficient of an axis contributes (n, 1 + m) at instants (n,)."""
        n, m = len(t_s), len(self.knots_s)
        right = np.clip(np.searchsorted(self.knots_s, t_s), 1, m - 1)
        share = (t_s - self.knots_s[right - 1]) / (self.knots_s[right] - self.knots_s[right - 1])
        rows = np.arange(n)
        values = np.concatenate([np.ones(n), 1.0 - share, share])
        columns = np.concatenate([np.zeros(n, np.int64), right, right + 1])
        return csr_matrix((values, (np.tile(rows, 3), columns)), shape=(n, 1 + m))

    def prior(self) -> csr_matrix:
        """Return the design of the prior of all coefficients, in sigmas: constant, first knot, steps."""
        return block_diag([self._prior_of(*self.sigmas_m(axis)) for axis in range(len(self.sigma_m))], format="csr")

    def sigmas_m(self, axis: int) -> tuple[float, float]:
        """Return one sigma of an axis' constant and of its process, m."""
        sigma = max(float(self.sigma_m[axis]), _NOTHING_M)
        return sigma * float(np.sqrt(_CONSTANT_SHARE)), sigma * float(np.sqrt(1.0 - _CONSTANT_SHARE))

    def _prior_of(self, constant_m: float, process_m: float) -> csr_matrix:
        m = len(self.knots_s)
        kept = float(np.exp(-(self.knots_s[1] - self.knots_s[0]) / CORRELATION_S))
        scale = np.full(m, 1.0 / (process_m * np.sqrt(1.0 - kept**2)))
        scale[0] = 0.0 if self.continues else 1.0 / process_m
        process = diags(scale) @ diags([np.ones(m), np.full(m - 1, -kept)], [0, -1])
        return block_diag([csr_matrix([[0.0 if self.continues else 1.0 / constant_m]]), process], format="csr")


def joined(before: LastingError, at: int, after: LastingError, then: int, count: int) -> csr_matrix:
    """Return the rows (2d, count), in sigmas, that make an error go on from one stretch to the next.

    ``at`` and ``then`` are the places of their first coefficients among all ``count``.
    """
    d = len(after.sigma_m)
    kept = float(np.exp(-(after.knots_s[0] - before.knots_s[-1]) / CORRELATION_S))
    values, columns = [], []
    for axis in range(d):
        own, next_ = at + axis * before.each, then + axis * after.each
        _, process_m = after.sigmas_m(axis)
        step = 1.0 / (process_m * max(np.sqrt(1.0 - kept**2), 1e-3))
        values += [-1.0 / _NOTHING_M, 1.0 / _NOTHING_M, -kept * step, step]
        columns += [own, next_, own + before.each - 1, next_ + 1]
    return csr_matrix((values, (np.repeat(np.arange(2 * d), 2), columns)), shape=(2 * d, count))


def mean_sigma(sigma_m: FloatArray, span_s: float) -> FloatArray:
    """Return one sigma (d,) of the mean over ``span_s`` of errors of one sigma ``sigma_m`` (d,)."""
    ratio = span_s / CORRELATION_S
    process = 2.0 / ratio * (1.0 - (1.0 - np.exp(-ratio)) / ratio)
    return np.asarray(sigma_m * np.sqrt(_CONSTANT_SHARE + (1.0 - _CONSTANT_SHARE) * process))


def may_last(stated_m: FloatArray) -> bool:
    """Return whether fixes with these usual stated errors (d,) may have one that lasts and matters."""
    return bool(np.any(stated_m >= _LEAST_SIGMA_M))


def lasting_sigma(stated_m: FloatArray, white_m: FloatArray, freedom: int) -> FloatArray:
    """Return one sigma (d,) of the part of ``stated_m`` (d,) that lasts, where neighbours agree to ``white_m`` (d,).

    Zero for an axis whose white noise is not below half of what is stated, beyond chance for its degrees of freedom.
    """
    if freedom <= 0:
        return np.zeros(len(stated_m))
    least = float(np.sqrt(chi_square_quantile(1.0 - _CHANCE, freedom) / freedom))
    lasts = (stated_m >= _LEAST_SIGMA_M) & (white_m < min(least, _LEAST_SHARE) * stated_m)
    return np.where(lasts, np.sqrt(np.maximum(stated_m**2 - white_m**2, 0.0)), 0.0)


def lasting_error(
    t_s: FloatArray, sigma_m: FloatArray, white_m: FloatArray, *, continues: bool = False
) -> LastingError:
    """Return the error along one stretch of fixes (n,), of one sigma ``sigma_m`` (d,)."""
    count = max(int(np.ceil(float(t_s[-1] - t_s[0]) / (CORRELATION_S / _KNOTS_EACH))), 1) + 1
    return LastingError(
        knots_s=np.linspace(t_s[0], t_s[-1], count), sigma_m=sigma_m, white_m=white_m, continues=continues
    )
