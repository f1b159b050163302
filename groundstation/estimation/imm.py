"""Interacting multiple model (IMM) filter: one filter per motion mode, weighted by its likelihood.

A glide and a flare need different process noise (docs/derivation.md, section 5). Each mode has its own filter; before a
prediction the modes are mixed with their transition probabilities (Blom & Bar-Shalom 1988), and each pixel updates the
weights with the likelihoods of its innovation. Measurements are linearised once, at the weighted mean. With one mode
the result is bit-identical to the plain filter.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import (
    BoolArray,
    CompiledKalmanFilter,
    carry_into,
    correct_into,
    log_likelihood,
)

_LEAST_WEIGHT = 1e-6
# of the modes: states (r, n), covariances (r, n, n), weights (r,); of their mixture: mean (n,), covariance (n, n)
Moved = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
Stacked = tuple[FloatArray, FloatArray]


class ImmFilter:
    """IMM filter with ``size`` states.

    Parameters
    ----------
    stay_s : mean sojourn time of each mode; its length is the number of modes.
    """

    def __init__(self, size: int, stay_s: Sequence[float]) -> None:
        self._size = size
        self._filters = [CompiledKalmanFilter(dim_x=size, dim_z=2) for _ in stay_s]
        for each in self._filters:
            each.x, each.P = np.zeros(size), np.zeros((size, size))
        self._stay_s = np.asarray(stay_s, dtype=np.float64)
        # stationary mode probabilities
        self._usual = self._stay_s / self._stay_s.sum()
        self.weights: FloatArray = self._usual.copy()
        self._mean: tuple[FloatArray, FloatArray] | None = None
        # stacked states and covariances of the modes, if a compiled step has written them
        self._stacked: Stacked | None = None
        self._behind = False

    @property
    def x(self) -> FloatArray:
        """The weighted mean (n,)."""
        mean = self._mean
        return mean[0] if mean is not None else self._mixture()[0]

    @property
    def P(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The covariance (n, n) of the mixture about its mean."""
        mean = self._mean
        return mean[1] if mean is not None else self._mixture()[1]

    def snapshot(self) -> list[FloatArray]:
        """Return the complete state for `restore`; without copies, since arrays are never modified in place."""
        return [self.weights, *self.modes()]

    def restore(self, saved: list[FloatArray]) -> None:
        """Restore a `snapshot`."""
        self.weights, states, covariances = saved
        self._mean, self._stacked, self._behind = None, (states, covariances), True
        if len(self._filters) == 1:
            self._changed()

    def copy(self) -> "ImmFilter":
        """Return an independent copy."""
        other = ImmFilter(self._size, self._stay_s.tolist())
        other.restore(self.snapshot())
        return other

    def reset_modes(self) -> None:
        """Reset the weights to the stationary mode probabilities, for a new target."""
        self.weights = self._usual.copy()
        self._changed()

    def set_states(self, part: slice, values: FloatArray, covariance: FloatArray) -> None:
        """Set some states (k,) and their covariance (k, k), uncorrelated with the rest."""
        self._changed()
        for each in self._filters:
            # copies, since snapshots refer to the old arrays
            each.x, each.P = each.x.copy(), each.P.copy()
            each.P[part, :] = 0.0
            each.P[:, part] = 0.0
            each.x[part] = values
            each.P[part, part] = covariance

    def correlate(self, part: slice, source: slice, sensitivity: FloatArray) -> None:
        """Correlate uncorrelated states (k,) with others (m,) by ``sensitivity`` (k, m)."""
        self._changed()
        for each in self._filters:
            each.P = each.P.copy()
            common = sensitivity @ each.P[source, source]
            each.P[part, part] += common @ sensitivity.T
            each.P[part, source] = common
            each.P[source, part] = common.T

    def inflate(self, part: slice, variances: FloatArray) -> None:
        """Add to the variances (k,) of some states."""
        states, covariances = self.modes()
        covariances = covariances.copy()
        diagonal = np.arange(part.start, part.stop)
        covariances[:, diagonal, diagonal] += variances
        self.restore([self.weights, states, covariances])

    def predict(self, F: FloatArray, noises: Sequence[FloatArray] | FloatArray, dt_s: float) -> None:
        """Predict every mode with ``F`` and its own process noise over ``dt_s`` seconds."""
        if len(self._filters) > 1:
            moved = self.room()
            _predict(*self.modes(), self.weights, self._stay_s, F, np.asarray(noises), dt_s, *moved)
            self.take(moved)
            return
        self._changed()
        only = self._filters[0]
        only.F, only.Q = F, noises[0]
        only.predict()

    def correct(
        self,
        residual: FloatArray,
        H: FloatArray,
        R: FloatArray,
        estimated: BoolArray,
        *,
        updates_weights: bool,
        share: float = 1.0,
    ) -> None:
        """Update with a residual (m,) at the weighted mean; mode weights only change with ``updates_weights``.

        ``share`` scales the gain.
        """
        if len(self._filters) == 1:
            self._changed()
            self._filters[0].correct(residual, H, R, estimated, share)
            return
        moved = self.room()
        correct_modes(*self.modes(), self.x, self.weights, residual, H, R, estimated, share, updates_weights, *moved)
        self.take(moved)

    def replace_moments(self, H: FloatArray, shift: FloatArray, covariance: FloatArray, estimated: BoolArray) -> None:
        """Replace the predicted moments of the measured quantity, and update the state accordingly.

        With H (m, n): the mean moves by ``shift`` (m,), the covariance becomes ``covariance`` (m, m);
        x += K·shift, P += K (covariance − S) Kᵀ with K = P Hᵀ S⁻¹, S = H P Hᵀ. States that are not ``estimated`` (n,)
        keep value, variance and correlations.
        """
        self._changed()
        for each in self._filters:
            PHt = each.P @ H.T
            S = H @ PHt
            K = np.linalg.solve(S, PHt.T).T
            K[~estimated] = 0.0
            each.x = each.x + K @ shift
            P = each.P + K @ (covariance - S) @ K.T
            each.P = 0.5 * (P + P.T)

    def _mixture(self) -> tuple[FloatArray, FloatArray]:
        if self._mean is None:
            if len(self._filters) == 1:
                self._mean = self._filters[0].x, self._filters[0].P
            else:
                x, P = np.empty(self._size), np.empty((self._size, self._size))
                _moments(*self.modes(), self.weights, x, P)
                self._mean = x, P
        return self._mean

    def weights_after(self, dt_s: float) -> FloatArray:
        """Return the mode weights (r,) after a prediction over ``dt_s`` ≥ 0."""
        return self.weights if len(self._filters) == 1 else _joint(self.weights, self._stay_s, dt_s).sum(axis=0)

    def _changed(self) -> None:
        """Synchronise the filters with the last compiled step and clear the cached results, before a modification."""
        self._catch_up()
        self._mean = self._stacked = None

    def _catch_up(self) -> None:
        """Copy the stacked result of the last compiled step to the filters."""
        if self._behind and self._stacked is not None:
            for each, own_x, own_P in zip(self._filters, *self._stacked, strict=True):
                each.x, each.P = own_x, own_P
        self._behind = False

    def room(self) -> Moved:
        """Return new output arrays for a compiled step, since snapshots refer to the previous ones.

        They are passed as arguments, since returning an array from a compiled function takes longer than a product.
        """
        r, n = len(self._filters), self._size
        return np.empty((r, n)), np.empty((r, n, n)), np.empty(r), np.empty(n), np.empty((n, n))

    def take(self, moved: Moved) -> None:
        """Take over the result of a compiled step."""
        states, covariances, self.weights, x, P = moved
        self._mean, self._stacked, self._behind = (x, P), (states, covariances), True

    def modes(self) -> Stacked:
        """Return the states (r, n) and covariances (r, n, n) of the modes; read-only."""
        if self._stacked is None:
            self._stacked = np.array([f.x for f in self._filters]), np.array([f.P for f in self._filters])
        return self._stacked


@njit(cache=True)
def _moments(states: FloatArray, covariances: FloatArray, weights: FloatArray, x: FloatArray, P: FloatArray) -> None:
    """Write mean (n,) and covariance (n, n) of a mixture of states (r, n) and covariances (r, n, n)."""
    n = x.size
    x[:] = 0.0
    P[:] = 0.0
    for k in range(len(states)):
        for i in range(n):
            x[i] += weights[k] * states[k, i]
    away = np.empty(n)
    for k in range(len(states)):
        for i in range(n):
            away[i] = states[k, i] - x[i]
        for i in range(n):
            for j in range(n):
                P[i, j] += weights[k] * (covariances[k, i, j] + away[i] * away[j])


@njit(cache=True)
def _joint(weights: FloatArray, stay_s: FloatArray, dt_s: float) -> FloatArray:
    """Return the joint mode probabilities (r, r): previous mode by row, next mode by column."""
    count = weights.size
    joint = np.empty((count, count))
    for a in range(count):
        change = 1.0 - np.exp(-dt_s / stay_s[a])
        for b in range(count):
            joint[a, b] = weights[a] * ((1.0 - change) if a == b else change / (count - 1))
    return joint


@njit(cache=True)
def _predict(
    states: FloatArray,
    covariances: FloatArray,
    weights: FloatArray,
    stay_s: FloatArray,
    F: FloatArray,
    noises: FloatArray,
    dt_s: float,
    X: FloatArray,
    P: FloatArray,
    after: FloatArray,
    mean: FloatArray,
    spread: FloatArray,
) -> None:
    """Write the predicted modes after ``dt_s``, each from its mixed initial condition."""
    count, n = states.shape
    joint = _joint(weights, stay_s, dt_s)
    after[:] = joint.sum(axis=0)
    start_x, start_P, half = np.empty(n), np.empty((n, n)), np.empty((n, n))
    for k in range(count):
        _moments(states, covariances, joint[:, k] / after[k], start_x, start_P)
        carry_into(start_x, start_P, F, noises[k], half, X[k], P[k])
    _moments(X, P, after, mean, spread)


@njit(cache=True)
def correct_modes(
    states: FloatArray,
    covariances: FloatArray,
    x: FloatArray,
    weights: FloatArray,
    residual: FloatArray,
    H: FloatArray,
    R: FloatArray,
    estimated: BoolArray,
    share: float,
    updates_weights: bool,
    X: FloatArray,
    P: FloatArray,
    after: FloatArray,
    mean: FloatArray,
    spread: FloatArray,
) -> None:
    """Write the modes updated with a residual (m,) at ``x`` (n,)."""
    count, n = states.shape
    m, logs = residual.size, np.zeros(count)
    own, Kt, S = np.empty(m), np.empty((m, n)), np.empty((m, m))
    for k in range(count):
        for a in range(m):
            own[a] = residual[a]
            for j in range(n):
                own[a] -= H[a, j] * (states[k, j] - x[j])
        correct_into(states[k], covariances[k], H, R, own, estimated, share, X[k], P[k], Kt, S)
        if updates_weights:
            logs[k] = log_likelihood(own, S)
    after[:] = weights
    if updates_weights:
        after[:] = np.maximum(weights * np.exp(logs - logs.max()), _LEAST_WEIGHT)
        after /= after.sum()
    _moments(X, P, after, mean, spread)
