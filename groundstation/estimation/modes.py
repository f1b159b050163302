"""Interacting multiple models: one filter for each way of flying, weighed by how well it predicts.

A glide and a flare need different process noise (docs/derivation.md, modes). Each mode is a filter of its own; before a
prediction they are mixed by how likely the aircraft is to have changed its way (Blom & Bar-Shalom 1988), and each
pixel shifts the weights by the likelihoods of its innovation. Measurements are linearised once, at the weighted mean.
With one mode this is the plain filter, to the last bit.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import BoolArray, CompiledKalmanFilter, log_likelihood

_LEAST_WEIGHT = 1e-6


class ModeBank:
    """Filters of ``size`` states that share one target.

    Parameters
    ----------
    stay_s : how long the aircraft keeps each way of flying, on average; as many as there are modes.
    """

    def __init__(self, size: int, stay_s: Sequence[float]) -> None:
        self._filters = [CompiledKalmanFilter(dim_x=size, dim_z=2) for _ in stay_s]
        for each in self._filters:
            each.x, each.P = np.zeros(size), np.zeros((size, size))
        self._stay_s = np.asarray(stay_s, dtype=np.float64)
        # the shares of time that the aircraft spends in each
        self._usual = self._stay_s / self._stay_s.sum()
        self.weights: FloatArray = self._usual.copy()
        self._mean: tuple[FloatArray, FloatArray] | None = None

    @property
    def x(self) -> FloatArray:
        """The weighted mean (n,)."""
        return self._mixture()[0]

    @property
    def P(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The covariance (n, n) of the mixture about its mean."""
        return self._mixture()[1]

    def snapshot(self) -> list[FloatArray]:
        """Return all there is to know, to be given to `restore`; nothing is copied, since nothing is written over."""
        return [self.weights, *(a for f in self._filters for a in (f.x, f.P))]

    def restore(self, saved: list[FloatArray]) -> None:
        """Go back to a `snapshot`."""
        self.weights, self._mean = saved[0], None
        for k, each in enumerate(self._filters):
            each.x, each.P = saved[1 + 2 * k], saved[2 + 2 * k]

    def forget_modes(self) -> None:
        """Set the weights to what is usual: a new target, of whose flying nothing is known."""
        self.weights, self._mean = self._usual.copy(), None

    def place(self, part: slice, values: FloatArray, covariance: FloatArray) -> None:
        """Set some states (k,) and their covariance (k, k), uncorrelated with the rest."""
        self._mean = None
        for each in self._filters:
            # copies: whoever holds a snapshot holds the old ones
            each.x, each.P = each.x.copy(), each.P.copy()
            each.P[part, :] = 0.0
            each.P[:, part] = 0.0
            each.x[part] = values
            each.P[part, part] = covariance

    def share(self, part: slice, source: slice, sensitivity: FloatArray) -> None:
        """Let some states (k,) err with others (m,) by ``sensitivity`` (k, m); they knew nothing of them before."""
        self._mean = None
        for each in self._filters:
            each.P = each.P.copy()
            common = sensitivity @ each.P[source, source]
            each.P[part, part] += common @ sensitivity.T
            each.P[part, source] = common
            each.P[source, part] = common.T

    def doubt(self, part: slice, variances: FloatArray) -> None:
        """Add to the variances (k,) of some states."""
        self._mean = None
        diagonal = np.arange(part.start, part.stop)
        for each in self._filters:
            each.P = each.P.copy()
            each.P[diagonal, diagonal] += variances

    def predict(self, F: FloatArray, noises: Sequence[FloatArray], dt_s: float) -> None:
        """Carry every mode forward by ``F`` and its own process noise over ``dt_s`` seconds."""
        self._mean = None
        if len(self._filters) > 1:
            self._mix(dt_s)
        for each, Q in zip(self._filters, noises, strict=True):
            each.F, each.Q = F, Q
            each.predict()

    def correct(
        self,
        residual: FloatArray,
        H: FloatArray,
        R: FloatArray,
        estimated: BoolArray,
        *,
        telling: bool,
        share: float = 1.0,
    ) -> None:
        """Fuse a residual (m,), taken at the weighted mean; if ``telling``, it shifts the weights, too.

        ``share`` scales the gain.
        """
        if len(self._filters) == 1:
            self._filters[0].correct(residual, H, R, estimated, share)
            return
        x = self.x
        logs = np.zeros(len(self._filters))
        for k, each in enumerate(self._filters):
            own = residual - H @ (each.x - x)
            each.correct(own, H, R, estimated, share)
            if telling:
                logs[k] = log_likelihood(own, each.S)
        if telling:
            weights = np.maximum(self.weights * np.exp(logs - logs.max()), _LEAST_WEIGHT)
            self.weights = weights / weights.sum()
        self._mean = None

    def reshape(self, H: FloatArray, shift: FloatArray, covariance: FloatArray, estimated: BoolArray) -> None:
        """Give the measured quantity another distribution than predicted, and let the state follow.

        With H (m, n): its mean moves by ``shift`` (m,), its covariance becomes ``covariance`` (m, m);
        x += K·shift, P += K (covariance − S) Kᵀ with K = P Hᵀ S⁻¹, S = H P Hᵀ. States that are not ``estimated`` (n,)
        keep value and variance; what they have in common with the others stays, too.
        """
        self._mean = None
        for each in self._filters:
            PHt = each.P @ H.T
            S = H @ PHt
            K = np.linalg.solve(S, PHt.T).T
            K[~estimated] = 0.0
            each.x = each.x + K @ shift
            P = each.P + K @ (covariance - S) @ K.T
            each.P = 0.5 * (P + P.T)

    def _mixture(self) -> tuple[FloatArray, FloatArray]:
        if len(self._filters) == 1:
            return self._filters[0].x, self._filters[0].P
        if self._mean is None:
            states, covariances = self._all()
            self._mean = _moments(states, covariances, self.weights)
        return self._mean

    def weights_after(self, dt_s: float) -> FloatArray:
        """Return the weights (r,) that a prediction over ``dt_s`` ≥ 0 would leave."""
        return self.weights if len(self._filters) == 1 else self._joint(dt_s).sum(axis=0)

    def _joint(self, dt_s: float) -> FloatArray:
        """Return how likely each change of mode is, (r, r): from the row's into the column's."""
        count = len(self._filters)
        change = 1.0 - np.exp(-dt_s / self._stay_s)
        switch = np.outer(change, np.ones(count)) / (count - 1)
        np.fill_diagonal(switch, 1.0 - change)
        return switch * self.weights[:, None]

    def _mix(self, dt_s: float) -> None:
        """Let each mode start from where the aircraft may have come from into it."""
        joint = self._joint(dt_s)
        self.weights = joint.sum(axis=0)
        states, covariances = self._all()
        for k, each in enumerate(self._filters):
            each.x, each.P = _moments(states, covariances, joint[:, k] / self.weights[k])

    def _all(self) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        return tuple(f.x for f in self._filters), tuple(f.P for f in self._filters)


@njit(cache=True)
def _moments(
    states: tuple[FloatArray, ...], covariances: tuple[FloatArray, ...], weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean (n,) and covariance (n, n) of a mixture of states (n,) and covariances (n, n)."""
    n = states[0].size
    x, P = np.zeros(n), np.zeros((n, n))
    for k in range(len(states)):
        x += weights[k] * states[k]
    for k in range(len(states)):
        away, own = states[k] - x, covariances[k]
        for i in range(n):
            for j in range(n):
                P[i, j] += weights[k] * (own[i, j] + away[i] * away[j])
    return x, P
