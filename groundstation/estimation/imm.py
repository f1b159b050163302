"""Interacting multiple model (IMM) filter: one filter per motion mode, weighted by its likelihood.

A glide and a flare need different process noise (docs/derivation.md, section 5). Each mode has its own mean and
covariance; before a prediction the modes are mixed with their transition probabilities (Blom & Bar-Shalom 1988), and
each pixel updates the weights with the likelihoods of its innovation. Measurements are linearised once, at the weighted
mean. With one mode the result is that of the plain filter.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import (
    BoolArray,
    LinearMeasurement,
    carry_into,
    correct_into,
    log_likelihood,
)

# a mode that is given up could not come back
LEAST_WEIGHT = 1e-6
# a direction of a covariance with a smaller share of its largest variance is rounding
_LEAST_SHARE = 1e-14


class ImmState(NamedTuple):
    """State of an IMM filter with r modes and n states; its arrays are read-only.

    ``states`` (r, n), ``covariances`` (r, n, n) and ``weights`` (r,) of the modes; ``mean`` (n,) and ``covariance``
    (n, n) of their mixture.
    """

    states: FloatArray
    covariances: FloatArray
    weights: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @classmethod
    def mixed(cls, states: FloatArray, covariances: FloatArray, weights: FloatArray) -> "ImmState":
        """Return the state of given modes."""
        mean, covariance = np.empty(states.shape[1]), np.empty(covariances.shape[1:])
        _moments(states, covariances, weights, mean, covariance)
        return cls(states, covariances, weights, mean, covariance)

    @classmethod
    def empty(cls, modes: int, size: int) -> "ImmState":
        """Return new arrays for the output of a compiled step, since snapshots refer to the previous ones."""
        return cls(
            np.empty((modes, size)),
            np.empty((modes, size, size)),
            np.empty(modes),
            np.empty(size),
            np.empty((size, size)),
        )


# an `ImmState` as argument of a compiled function: numba takes ten times longer to recognise a named tuple
ImmArrays = tuple[FloatArray, ...]


class ImmFilter:
    """IMM filter with ``size`` states.

    Parameters
    ----------
    stay_s : mean sojourn time of each mode; its length is the number of modes.
    """

    def __init__(self, size: int, stay_s: Sequence[float]) -> None:
        self._size = size
        self.stay_s = np.asarray(stay_s, dtype=np.float64)
        modes = len(self.stay_s)
        self._stationary_weights = self.stay_s / self.stay_s.sum()
        # replaced with each step, never written to: snapshots refer to it
        self.state = self.mixed(np.zeros((modes, size)), np.zeros((modes, size, size)), self._stationary_weights.copy())

    @property
    def x(self) -> FloatArray:
        """The weighted mean (n,)."""
        return self.state.mean

    @property
    def P(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The covariance (n, n) of the mixture about its mean."""
        return self.state.covariance

    @property
    def weights(self) -> FloatArray:
        """The probabilities (r,) of the modes."""
        return self.state.weights

    def mixed(self, states: FloatArray, covariances: FloatArray, weights: FloatArray) -> ImmState:
        """Return the state of given modes: states (r, n), covariances (r, n, n), weights (r,)."""
        return ImmState.mixed(states, covariances, weights)

    def reset_modes(self) -> None:
        """Reset the weights to the stationary mode probabilities, for a new target."""
        self.state = self.mixed(self.state.states, self.state.covariances, self._stationary_weights.copy())

    def set_states(self, part: slice, values: FloatArray, covariance: FloatArray) -> None:
        """Set some states (k,) and their covariance (k, k), uncorrelated with the rest."""
        states, covariances = self.state.states.copy(), self.state.covariances.copy()
        states[:, part] = values
        covariances[:, part, :] = 0.0
        covariances[:, :, part] = 0.0
        covariances[:, part, part] = covariance
        self.state = self.mixed(states, covariances, self.weights)

    def correlate(self, part: slice, source: slice, sensitivity: FloatArray) -> None:
        """Correlate uncorrelated states (k,) with others (m,) by ``sensitivity`` (k, m)."""
        covariances = self.state.covariances.copy()
        for P in covariances:
            common = sensitivity @ P[source, source]
            P[part, part] += common @ sensitivity.T
            P[part, source] = common
            P[source, part] = common.T
        self.state = self.mixed(self.state.states, covariances, self.weights)

    def inflate(self, part: slice, variances: FloatArray) -> None:
        """Add to the variances (k,) of some states."""
        covariances = self.state.covariances.copy()
        diagonal = np.arange(part.start, part.stop)
        covariances[:, diagonal, diagonal] += variances
        self.state = self.mixed(self.state.states, covariances, self.weights)

    def predict(self, F: FloatArray, noises: FloatArray | Sequence[FloatArray], dt_s: float) -> None:
        """Predict every mode with ``F`` (n, n) and its own process noise (r, n, n) over ``dt_s`` seconds."""
        predicted = ImmState.empty(len(self.stay_s), self._size)
        _predict(tuple(self.state), self.stay_s, F, np.asarray(noises), dt_s, tuple(predicted))
        self.state = predicted

    def correct(
        self, measurement: LinearMeasurement, estimated: BoolArray, *, updates_weights: bool, share: float = 1.0
    ) -> None:
        """Update with a measurement linearised at the weighted mean; weights only change with ``updates_weights``.

        ``share`` scales the gain; states that are not ``estimated`` (n,) are considered only.
        """
        corrected = ImmState.empty(len(self.stay_s), self._size)
        _correct(tuple(self.state), tuple(measurement), estimated, share, updates_weights, tuple(corrected))
        self.state = corrected

    def replace_moments(self, H: FloatArray, shift: FloatArray, covariance: FloatArray, estimated: BoolArray) -> None:
        """Replace the predicted moments of the measured quantity, and update the state accordingly.

        With H (m, n): the mean moves by ``shift`` (m,), the covariance becomes ``covariance`` (m, m);
        x += K·shift, P += K (covariance − S) Kᵀ with K = P Hᵀ S⁻¹, S = H P Hᵀ. States that are not ``estimated`` (n,)
        keep value and variance. Where the covariance gets smaller their correlations follow, as in a Schmidt-Kalman
        filter: unchanged ones would be too large for what is left.
        """
        states, covariances = self.state.states.copy(), self.state.covariances.copy()
        for k, P in enumerate(self.state.covariances):
            PHt = P @ H.T
            S = H @ PHt
            K = np.linalg.solve(S, PHt.T).T
            K_estimated = np.where(estimated[:, None], K, 0.0)
            grown, shrunk = _changes(S, covariance)
            moved = P + K_estimated @ grown @ K_estimated.T - K @ shrunk @ K.T
            moved[np.ix_(~estimated, ~estimated)] = P[np.ix_(~estimated, ~estimated)]
            states[k] += K_estimated @ shift
            covariances[k] = 0.5 * (moved + moved.T)
        self.state = self.mixed(states, covariances, self.weights)

    def weights_after(self, dt_s: float) -> FloatArray:
        """Return the mode weights (r,) after a prediction over ``dt_s`` ≥ 0."""
        return _joint(self.weights, self.stay_s, dt_s).sum(axis=0)


def _changes(S: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what a covariance (m, m) has more than S and what it has less, each positive, the latter at most S."""
    variances, directions = np.linalg.eigh(0.5 * (S + S.T))
    sigmas = np.sqrt(np.maximum(variances, _LEAST_SHARE * np.abs(variances).max()))
    whitening = directions / sigmas
    values, vectors = np.linalg.eigh(whitening.T @ (covariance - S) @ whitening)
    axes = (directions * sigmas) @ vectors
    return (axes * np.maximum(values, 0.0)) @ axes.T, (axes * np.clip(-values, 0.0, 1.0)) @ axes.T


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
        change = 1.0 - np.exp(-dt_s / stay_s[a]) if count > 1 else 0.0
        for b in range(count):
            joint[a, b] = weights[a] * ((1.0 - change) if a == b else change / (count - 1))
    return joint


@njit(cache=True)
def _predict(
    before: ImmArrays, stay_s: FloatArray, F: FloatArray, noises: FloatArray, dt_s: float, after_dt: ImmArrays
) -> None:
    """Write the predicted modes after ``dt_s``, each from its mixed initial condition."""
    state, predicted = ImmState(*before), ImmState(*after_dt)
    count, n = state.states.shape
    joint = _joint(state.weights, stay_s, dt_s)
    after = predicted.weights
    after[:] = joint.sum(axis=0)
    start_x, start_P, half = np.empty(n), np.empty((n, n)), np.empty((n, n))
    for k in range(count):
        _moments(state.states, state.covariances, joint[:, k] / after[k], start_x, start_P)
        carry_into(start_x, start_P, F, noises[k], half, predicted.states[k], predicted.covariances[k])
    _moments(predicted.states, predicted.covariances, after, predicted.mean, predicted.covariance)


@njit(cache=True)
def _correct(
    before: ImmArrays,
    measurement: tuple[FloatArray, ...],
    estimated: BoolArray,
    share: float,
    updates_weights: bool,
    after: ImmArrays,
) -> None:
    """Call `correct_modes`."""
    state, linear, corrected = ImmState(*before), LinearMeasurement(*measurement), ImmState(*after)
    correct_modes(state, linear, estimated, share, updates_weights, corrected)


@njit(cache=True)
def correct_modes(
    state: ImmState,
    measurement: LinearMeasurement,
    estimated: BoolArray,
    share: float,
    updates_weights: bool,
    corrected: ImmState,
) -> None:
    """Write the modes updated with a measurement, whose residual (m,) is that of the weighted mean."""
    residual, H, R = measurement
    count, n = state.states.shape
    m, logs = residual.size, np.zeros(count)
    own, Kt, S = np.empty(m), np.empty((m, n)), np.empty((m, m))
    for k in range(count):
        for a in range(m):
            own[a] = residual[a]
            for j in range(n):
                own[a] -= H[a, j] * (state.states[k, j] - state.mean[j])
        of_mode = LinearMeasurement(own, H, R)
        new_x, new_P = corrected.states[k], corrected.covariances[k]
        correct_into(state.states[k], state.covariances[k], of_mode, estimated, share, new_x, new_P, Kt, S)
        if updates_weights:
            logs[k] = log_likelihood(own, S)
    after = corrected.weights
    after[:] = state.weights
    if updates_weights:
        after[:] = np.maximum(state.weights * np.exp(logs - logs.max()), LEAST_WEIGHT)
        after /= after.sum()
    _moments(corrected.states, corrected.covariances, after, corrected.mean, corrected.covariance)
