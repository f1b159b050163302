"""Interacting multiple model filter by filterpy: the slow reference of the compiled one, with the same interface.

Each step builds filterpy's objects from the state, so that snapshots, late data and the journal are those of
`ImmFilter`. `IMMEstimator` mixes the initial conditions of the modes, updates their probabilities and gives the moments
of the mixture. Four things it cannot express:

- Its matrix of transition probabilities is constant; here it depends on the time between two measurements, so that
  there is one estimator for each step. A measurement is an update without a transition.
- After a prediction it weights the modes with their probabilities of before; here (Blom & Bar-Shalom 1988) with the
  predicted ones, `cbar`.
- It has no mode with a single filter, which is then filterpy's filter alone, and no update that leaves the
  probabilities as they are, which each mode then makes by itself.
- A mode may die out; here its probability has a floor, the same as in the compiled filter.
"""

from collections.abc import Sequence

import numpy as np
from filterpy.kalman import IMMEstimator

from groundstation.arrays import FloatArray
from groundstation.estimation.filterpy_ekf import FilterpyEkf
from groundstation.estimation.imm import LEAST_WEIGHT, ImmFilter, ImmState
from groundstation.estimation.kalman_kernels import BoolArray, LinearMeasurement


class FilterpyImm(ImmFilter):
    """IMM filter with ``size`` states and mean sojourn times ``stay_s`` of its modes, on filterpy's classes."""

    def mixed(self, states: FloatArray, covariances: FloatArray, weights: FloatArray) -> ImmState:
        """Return the state of given modes: states (r, n), covariances (r, n, n), weights (r,)."""
        if len(weights) == 1:
            return ImmState(states, covariances, weights, states[0].copy(), covariances[0].copy())
        modes = [FilterpyEkf(x, P) for x, P in zip(states, covariances, strict=True)]
        mixture = IMMEstimator(modes, weights, np.eye(len(weights)))
        return ImmState(states, covariances, weights, mixture.x, mixture.P)

    def predict(self, F: FloatArray, noises: FloatArray | Sequence[FloatArray], dt_s: float) -> None:
        """Predict every mode with ``F`` (n, n) and its own process noise (r, n, n) over ``dt_s`` seconds."""
        modes, weights = self._modes(), self.weights
        for mode, Q in zip(modes, noises, strict=True):
            mode.set_motion(F, Q)
        if len(modes) > 1:
            estimator = IMMEstimator(modes, weights, self._transition(dt_s))
            estimator.predict()
            weights = estimator.cbar
        else:
            modes[0].predict()
        self.state = self._state_of(modes, weights)

    def correct(
        self, measurement: LinearMeasurement, estimated: BoolArray, *, updates_weights: bool, share: float = 1.0
    ) -> None:
        """Update with a measurement linearised at the weighted mean; weights only change with ``updates_weights``.

        ``share`` scales the gain; states that are not ``estimated`` (n,) are considered only.
        """
        modes, weights = self._modes(), self.weights
        for mode in modes:
            mode.set_measurement(measurement, self.x, estimated, share)
        if updates_weights and len(modes) > 1:
            estimator = IMMEstimator(modes, weights, np.eye(len(modes)))
            estimator.update(measurement.residual)
            likeliest = int(np.argmax(estimator.likelihood))
            weights = np.maximum(estimator.mu * (weights[likeliest] / estimator.mu[likeliest]), LEAST_WEIGHT)
            weights = weights / weights.sum()
        else:
            for mode in modes:
                mode.update(measurement.residual)
        self.state = self._state_of(modes, weights)

    def weights_after(self, dt_s: float) -> FloatArray:
        """Return the mode weights (r,) after a prediction over ``dt_s`` ≥ 0."""
        return np.asarray(self.weights @ self._transition(dt_s))

    def _modes(self) -> list[FilterpyEkf]:
        """Return one filter for each mode at the present state."""
        return [FilterpyEkf(x, P) for x, P in zip(self.state.states, self.state.covariances, strict=True)]

    def _state_of(self, modes: Sequence[FilterpyEkf], weights: FloatArray) -> ImmState:
        return self.mixed(np.array([mode.x for mode in modes]), np.array([mode.P for mode in modes]), weights)

    def _transition(self, dt_s: float) -> FloatArray:
        """Return the transition probabilities (r, r) over ``dt_s``: previous mode by row, next mode by column."""
        count = len(self.stay_s)
        if count == 1:
            return np.ones((1, 1))
        change = 1.0 - np.exp(-dt_s / self.stay_s)
        M = np.repeat(change[:, None] / (count - 1), count, axis=1)
        np.fill_diagonal(M, 1.0 - change)
        return M
