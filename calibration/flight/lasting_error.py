"""The error of a reference that lasts: a receiver without corrections is off by metres that change in minutes.

Its fixes then agree with their neighbours far better than with the truth, and the sigma that it states is mostly of an
error which no smoothing averages out. It is modelled as a first-order Gauss–Markov process for each axis, one sigma
σ, correlation exp(−|Δt| / τ), linear between knots; cameras of surveyed positions distinguish it from the path.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, diags

from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_quantile

# correlation time of a stand-alone receiver's error: multipath and tracking filters minutes at most, orbits and
# ionosphere more; a longer one is a constant, which orientations absorb either way
_CORRELATION_S = 60.0
_KNOTS_EACH = 30.0
# of logs whose noise is as stated, so many have no part that lasts
_CHANCE = 0.999
# a log whose neighbours agree a little better than stated is taken at its word: its receiver filters
_LEAST_SHARE = 0.5
# a fix by the carrier's phase is off by less, which labels and lenses hide
_LEAST_SIGMA_M = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LastingError:
    """A reference's error at ``knots_s`` (m,), one sigma ``sigma_m`` (d,) for each of its axes, 0 where none lasts.

    ``white_m`` (d,) is one sigma of what each fix is off by for itself.
    """

    knots_s: FloatArray
    sigma_m: FloatArray
    white_m: FloatArray

    @property
    def text(self) -> str:
        """What was found, in words."""
        white, lasting = ("/".join(f"{s:.2f}" for s in values) for values in (self.white_m, self.sigma_m))
        return (
            f"DGPS: neighbouring fixes agree to {white} m; an error of {lasting} m that lasts for about"
            f" {_CORRELATION_S:g} s, the rest of what is stated, is estimated with the calibration"
        )

    @property
    def size(self) -> int:
        """Number of coefficients, d · m, axis by axis."""
        return len(self.knots_s) * len(self.sigma_m)

    def at(self, t_s: FloatArray) -> csr_matrix:
        """Return what each knot contributes (n, m) at instants (n,)."""
        m = len(self.knots_s)
        right = np.clip(np.searchsorted(self.knots_s, t_s), 1, m - 1)
        share = (t_s - self.knots_s[right - 1]) / (self.knots_s[right] - self.knots_s[right - 1])
        rows = np.arange(len(t_s))
        return csr_matrix(
            (np.concatenate([1.0 - share, share]), (np.tile(rows, 2), np.concatenate([right - 1, right]))),
            shape=(len(t_s), m),
        )

    def prior(self, axis: int) -> csr_matrix:
        """Return the design (m, m) of an axis' prior, in sigmas: the first knot, then the steps."""
        m = len(self.knots_s)
        step_s = float(self.knots_s[1] - self.knots_s[0])
        kept = float(np.exp(-step_s / _CORRELATION_S))
        # an axis without it is held at zero
        sigma = max(float(self.sigma_m[axis]), 1e-9)
        scale = np.full(m, 1.0 / (sigma * np.sqrt(1.0 - kept**2)))
        scale[0] = 1.0 / sigma
        return csr_matrix(diags(scale) @ diags([np.ones(m), np.full(m - 1, -kept)], [0, -1]))


def may_last(stated_m: FloatArray) -> bool:
    """Return whether fixes with these stated errors (d,) may have one that lasts and matters."""
    return bool(np.any(stated_m >= _LEAST_SIGMA_M))


def lasting_error(t_s: FloatArray, stated_m: FloatArray, white_m: FloatArray, freedom: int) -> LastingError | None:
    """Return the part of fixes' stated errors ``stated_m`` (d,) that lasts, where neighbours agree to ``white_m`` (d,).

    None where no axis' white noise is below half of what is stated, beyond chance for its degrees of freedom.
    """
    if freedom <= 0:
        return None
    least = float(np.sqrt(chi_square_quantile(1.0 - _CHANCE, freedom) / freedom))
    lasts = (stated_m >= _LEAST_SIGMA_M) & (white_m < min(least, _LEAST_SHARE) * stated_m)
    if not lasts.any():
        return None
    count = max(int(np.ceil(float(t_s[-1] - t_s[0]) / (_CORRELATION_S / _KNOTS_EACH))), 1) + 1
    sigma = np.where(lasts, np.sqrt(np.maximum(stated_m**2 - white_m**2, 0.0)), 0.0)
    return LastingError(knots_s=np.linspace(t_s[0], t_s[-1], count), sigma_m=sigma, white_m=white_m)
