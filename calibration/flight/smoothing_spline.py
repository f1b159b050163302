"""A smooth curve through noisy samples, with smoothness by generalised cross-validation, in banded form.

`scipy.interpolate.make_smoothing_spline` gives the same curve, but takes far longer to determine its smoothness. In the
form of C. H. Reinsch, Numer. Math. 10 (1967): of the f that minimises Σ (y − f)² + λ ∫ f''², the second derivatives γ
are (R + λ QᵀQ) γ = Qᵀy, the residual is λ Q γ, and the trace in the criterion of P. Craven and G. Wahba, Numer.
Math. 31 (1979), is λ tr((R + λ QᵀQ)⁻¹ QᵀQ), for which the bands of the inverse are sufficient (M. F. Hutchinson
and F. R. de Hoog, Numer. Math. 47, 1985).
"""

import numpy as np
from scipy.interpolate import BSpline, make_smoothing_spline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from calibration.flight.banded_inverse import banded_inverse
from groundstation.arrays import FloatArray

# λ in cubes of the usual step: from hardly smoothed to a straight line over n steps, n⁴
_LEAST = 1e-3
_DECADES_EACH = 1.0


class _Criterion:
    """The cross-validation of samples (n,) at times (n,) for one λ, by banded Cholesky."""

    def __init__(self, t_s: FloatArray, values: FloatArray) -> None:
        step = np.diff(t_s)
        first, last = 1.0 / step[:-1], 1.0 / step[1:]
        middle = -(first + last)
        self._columns = np.stack([first, middle, last])
        self._roughness = np.zeros((3, len(first)))
        self._roughness[0] = (step[:-1] + step[1:]) / 3.0
        self._roughness[1, :-1] = step[1:-1] / 6.0
        # QᵀQ, lower bands
        self._square = np.zeros((3, len(first)))
        self._square[0] = first**2 + middle**2 + last**2
        self._square[1, :-1] = middle[:-1] * first[1:] + last[:-1] * middle[1:]
        self._square[2, :-2] = last[:-2] * first[2:]
        self._right = first * values[:-2] + middle * values[1:-1] + last * values[2:]

    def __call__(self, penalty: float) -> float:
        """Return n Σ (y − f)² / tr(I − A)², but for a factor that does not depend on λ."""
        root = cholesky_banded(self._roughness + penalty * self._square, lower=True)
        gamma = cho_solve_banded((root, True), self._right)
        left = np.zeros(len(gamma) + 2)
        for k in range(3):
            left[k : k + len(gamma)] += self._columns[k] * gamma
        inverse = banded_inverse(root)
        trace = float(np.sum(inverse[0] * self._square[0]) + 2.0 * np.sum(inverse[1:] * self._square[1:]))
        return float(left @ left) / trace**2


def smoothing_penalty(t_s: FloatArray, values: FloatArray) -> float:
    """Return the λ of least cross-validation for samples (n,) at rising times (n,), n at least 5."""
    criterion = _Criterion(t_s, values)
    usual, n = float(np.median(np.diff(t_s))), len(t_s)
    decades = np.arange(np.log10(_LEAST), 4.0 * np.log10(n) + _DECADES_EACH, _DECADES_EACH)

    def at(decade: float) -> float:
        return criterion(usual**3 * 10.0 ** float(decade))

    best = float(decades[int(np.argmin([at(d) for d in decades]))])
    around = (best - _DECADES_EACH, best + _DECADES_EACH)
    found = minimize_scalar(at, bounds=around, method="bounded", options={"xatol": 1e-2})
    return float(usual**3 * 10.0**found.x)


def smoothing_spline(t_s: FloatArray, values: FloatArray) -> BSpline:
    """Return the cubic curve through samples (n,) at rising times (n,), n at least 5."""
    return make_smoothing_spline(t_s, values, lam=smoothing_penalty(t_s, values))
