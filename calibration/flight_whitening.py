"""Residuals of all stations together, whitened: what frames and stations have in common of the reference's noise.

The path through the DGPS fixes is off for a while, and for all stations alike. The covariance of the pixels is

    V = blockdiag(own) + Σ_axes b_i b_jᵀ c(t_i − t_j)

with b what one sigma of a fix does to a pixel and c the path's noise (`calibration.reference_track.PathNoise`). In the
order of time V is banded, V = L Lᵀ by Cholesky, and L⁻¹ takes residuals and Jacobian to unit covariance.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded

from calibration.flight_problem import FlightProblem, Predicted
from groundstation.arrays import FloatArray, MaskArray
from groundstation.evaluation.series import IndexArray


@dataclass(slots=True, eq=False)
class JointResiduals:
    """Whitened residuals and Jacobian of the kept looks; then those of the priors.

    ``change`` is where covariances are taken; ``factors`` the noise found over assumed, ``kept`` the looks, by station.
    """

    problem: FlightProblem
    factors: Mapping[str, float]
    kept: Mapping[str, MaskArray]
    change: FloatArray
    t_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    _order: IndexArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    _lower: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    _at: bytes = b""
    _residual: FloatArray = field(default_factory=lambda: np.zeros(0))
    _seen: dict[str, Predicted] = field(default_factory=dict)

    def __post_init__(self) -> None:
        seen = self._predictions(self.change)
        own, shared, stamps = [], [], []
        for name, predicted in seen.items():
            kept = self.kept[name]
            own.append(predicted.own_px2[kept] * self.factors[name] ** 2)
            shared.append(predicted.by_reference_px[kept])
            stamps.append(predicted.reference_s[kept])
        times = np.concatenate(stamps)
        order = np.argsort(times, kind="stable")
        self._order, self.t_s = order, times[order]
        self._lower = _banded_root(self.problem, np.concatenate(own)[order], np.concatenate(shared)[order], self.t_s)

    def residual(self, change: FloatArray) -> FloatArray:
        """Return all residuals in sigmas: two for each look in the order of time, then the priors'."""
        if change.tobytes() != self._at:
            off = []
            self._seen, self._at = self._predictions(change), change.tobytes()
            for name, predicted in self._seen.items():
                kept = self.kept[name]
                # a look that lost its reference meanwhile pulls nowhere
                there = predicted.usable[kept][:, None]
                off.append((predicted.pixel_px - self.problem.looks[name].pixel_px)[kept] * there)
            white = self._whitened(np.concatenate(off)[self._order].ravel())
            known = np.isfinite(self.problem.prior_sigma)
            self._residual = np.concatenate([white, (change / self.problem.prior_sigma)[known]])
        return self._residual

    def jacobian(self, change: FloatArray) -> FloatArray:
        """Return their derivatives (n, p)."""
        self.residual(change)
        by_change = np.concatenate([seen.jacobian[self.kept[name]] for name, seen in self._seen.items()])
        white = self._whitened(by_change[self._order].reshape(-1, len(change)))
        known = np.isfinite(self.problem.prior_sigma)
        return np.vstack([white, np.diag(1.0 / self.problem.prior_sigma)[known]])

    def _predictions(self, change: FloatArray) -> dict[str, Predicted]:
        return {name: self.problem.predict(name, change) for name in self.problem.looks}

    def _whitened(self, values: FloatArray) -> FloatArray:
        return np.asarray(solve_banded((len(self._lower) - 1, 0), self._lower, values))


def _banded_root(problem: FlightProblem, own: FloatArray, shared: FloatArray, t_s: FloatArray) -> FloatArray:
    """Return L of V = L Lᵀ as lower bands, from n looks in the order of time: own (n, 2, 2), shared (n, 2, 3)."""
    noise, n = problem.track.noise, len(t_s)
    last = np.searchsorted(t_s, t_s + noise.reach_s, side="right") - 1
    furthest = int((last - np.arange(n)).max())
    bands = np.zeros((2 * furthest + 2, 2 * n))
    for away in range(furthest + 1):
        first = np.arange(n - away)
        weight = noise.at(t_s[first + away] - t_s[first])
        block = np.einsum("nia,na,nja->nij", shared[first + away], weight, shared[first])
        if away == 0:
            block = block + own
        for i in range(2):
            for j in range(2):
                if 2 * away + i - j >= 0:
                    bands[2 * away + i - j, 2 * first + j] = block[:, i, j]
    return np.asarray(cholesky_banded(bands, lower=True))
