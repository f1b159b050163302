"""Non-linearity of the pixel model: iterated updates, second-order noise terms, and the sensitivity of a triangulated
initial state to the errors of the rig.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import (
    BoolArray,
    innovation_covariance,
    trial_state,
    write_innovation_covariance,
)
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import CLOCKS, clock_places
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.pixel_model import PixelModel, PixelPrediction
from groundstation.estimation.variance_check import sigma_of
from groundstation.geometry.mahalanobis import mahalanobis_squared

# the update is iterated until it changes by less than this many sigmas of the pixel noise, or this many times
_LINEAR_SIGMA = 0.1
_MAX_LINEARISATIONS = 5
_BEHIND = 1e6  # residual of a trial state that is behind the camera, sigmas
_MOMENT_S = 0.05
_UNDETERMINED = 1e12  # condition of the normal equations


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearised:
    """A linearised pixel: Jacobian H (2, n) and residual (2,) at the prior state."""

    jacobian: FloatArray
    residual: FloatArray


class _Clock(NamedTuple):
    """Indices of the errors of one clock in the state, (m,), and which are offsets; the others are drifts."""

    places: NDArray[np.int64]
    is_offset: BoolArray


class _Motion(NamedTuple):
    """Indices of the first target and PTU states of one station; −1 for a fixed station."""

    position: int
    velocity: int
    angles: int
    rates: int


class PixelLinearisation:
    """Linearisation of the pixel models of all stations."""

    def __init__(self, layout: StateLayout, pixels: Mapping[str, PixelModel]) -> None:
        self._layout = layout
        self.pixels = pixels
        is_offset = {place: name.endswith(".offset") for name, place in layout.parameters.items()}
        self._clocks = {
            name: {
                clock: _Clock(np.array(places, np.int64), np.array([is_offset[k] for k in places], np.bool_))
                for clock, places in clock_places(layout.parameters, name).items()
            }
            for name in pixels
        }
        self._motion_states = {
            name: _Motion(
                position=layout.position.start,
                velocity=layout.velocity.start,
                angles=layout.angles[name].start if name in layout.angles else -1,
                rates=layout.rates[name].start if name in layout.rates else -1,
            )
            for name in pixels
        }

    def iterated(
        self,
        station: str,
        pixel: FloatArray,
        first: Linearised,
        state: tuple[FloatArray, FloatArray, BoolArray],
        R: FloatArray,
        times: tuple[float, float],
    ) -> Linearised:
        """Return a pixel (2,) linearised at its updated state (iterated EKF).

        With a position uncertain by 10 m at 600 m, the plain update is wrong by several pixels, which it attributes to
        the velocity. Once the track has converged, the first linearisation is sufficient.

        Parameters
        ----------
        pixel : without the time-correlated error of the station, which is linear.
        first : the linearisation at the prior state; its columns of offsets are kept.
        state : x (n,), P (n, n) and which states are estimated (n,).
        times : exposure of the row after the stamp, and the time over which clocks have drifted, s.
        """
        x, P, estimated = state
        own = self._layout.offsets.get(station, slice(0, 0))
        H, residual = first.jacobian, first.residual
        for _ in range(_MAX_LINEARISATIONS):
            there = trial_state(x, P, H, R, residual, estimated)
            seen = self.pixels[station].predict(there, *times)
            if seen is None:
                break
            again, there_H = self._from(seen, pixel, there - x, H, own)
            # change of the residual at the prior mean, and of the Jacobian over the prior covariance
            change = again - residual
            turned = innovation_covariance(P, there_H - H, np.zeros((2, 2)))
            off = float(mahalanobis_squared(change, R))
            if off + turned[0, 0] / R[0, 0] + turned[1, 1] / R[1, 1] < _LINEAR_SIGMA**2:
                return Linearised(jacobian=H, residual=residual)
            H, residual = there_H, again
        there = self._likeliest(station, pixel, first.jacobian, (x, P), R, times)
        seen = self.pixels[station].predict(there, *times)
        if seen is not None:
            residual, H = self._from(seen, pixel, there - x, first.jacobian, own)
        return Linearised(jacobian=H, residual=residual)

    @staticmethod
    def _from(
        seen: PixelPrediction, pixel: FloatArray, away: FloatArray, first: FloatArray, own: slice
    ) -> tuple[FloatArray, FloatArray]:
        """Return residual and Jacobian at the prior state, linearised ``away`` (n,) from it."""
        H = seen.jacobian
        residual = pixel - seen.pixel + H @ away
        H[:, own] = first[:, own]
        return residual, H

    def _likeliest(
        self,
        station: str,
        pixel: FloatArray,
        H: FloatArray,
        prior: tuple[FloatArray, FloatArray],
        R: FloatArray,
        times: tuple[float, float],
    ) -> FloatArray:
        """Return the state (n,) with the maximum a posteriori target, where the iteration does not converge.

        The contribution of all other states to the pixel is treated as noise, by the Jacobian ``H``.
        """
        x, P = prior
        target = self._layout.target
        others = H.copy()
        others[:, target] = 0.0
        L, W = np.linalg.cholesky(P[target, target]), np.linalg.cholesky(innovation_covariance(P, others, R))

        def at(y: FloatArray) -> FloatArray:
            state = x.copy()
            state[target] += L @ y
            return state

        def residuals(y: FloatArray) -> FloatArray:
            seen = self.pixels[station].predict(at(y), *times)
            off = np.full(2, _BEHIND) if seen is None else np.linalg.solve(W, pixel - seen.pixel)
            return np.concatenate([y, off])

        def jacobian(y: FloatArray) -> FloatArray:
            seen = self.pixels[station].predict(at(y), *times)
            own = np.zeros((2, len(y))) if seen is None else -np.linalg.solve(W, seen.jacobian[:, target] @ L)
            return np.vstack([np.eye(len(y)), own])

        return at(least_squares(residuals, np.zeros(target.stop - target.start), jac=jacobian).x)

    def carries_clock(self, station: str) -> bool:
        """Return whether an error of one of the station's clocks is a state of the filter."""
        return bool(self._clocks[station])

    def speed_noise(self, station: str, H: FloatArray, P: FloatArray, age_s: float) -> FloatArray:
        """Return the noise (2, 2) of a pixel with Jacobian ``H`` due to a clock error times an uncertain speed.

        A clock error δ moves the pixel by δ·ṁ; the product of the variances of δ and ṁ is the second-order term that
        a linear filter neglects, and which would bias the clock estimates.
        """
        noise = np.zeros((2, 2))
        for name, clock in self._clocks[station].items():
            moves_target = name == "camera_clock"
            _add_speed_noise(P, H, tuple(self._motion_states[station]), *clock, moves_target, age_s, noise)
        return noise

    def passage_noise(
        self, station: str, H: FloatArray, state: tuple[FloatArray, FloatArray], age_s: float, motion: MotionModel
    ) -> FloatArray:
        """Return the noise (2, 2) of a pixel with Jacobian ``H`` due to the clock offset from the filter time.

        Target and PTU are propagated over this offset, with the process noise of ``motion``.
        """
        x, P = state
        away = {clock: np.zeros(2) for clock in CLOCKS}
        for clock, (places, is_offset) in self._clocks[station].items():
            lateness = np.where(is_offset, 1.0, age_s)
            away[clock] += lateness @ x[places], lateness @ P[np.ix_(places, places)] @ lateness
        camera, ptu = (away[clock] for clock in CLOCKS)
        noise = np.zeros((2, 2))
        head = camera + np.array([-1.0, 1.0]) * ptu
        for part, (mean, variance) in ((self._layout.position, camera), (self._layout.angles.get(station), head)):
            if part is not None:
                Q = motion.process_noise(sigma_of(mean**2 + variance, f"clocks of {station}"))[part, part]
                noise += H[:, part] @ Q @ H[:, part].T
        return noise

    def sensitivity(self, state: FloatArray, age_s: float) -> FloatArray | None:
        """Return the sensitivity (6, m) of a triangulated point and its velocity to the carried errors.

        By the normal equations, ∂X/∂θ = −(Σ JᵀJ)⁻¹ Σ Jᵀ ∂pixel/∂θ, now and a moment later. None if the views of the
        stations do not determine a point.
        """
        at = []
        for ahead_s in (0.0, _MOMENT_S):
            information, moved = np.zeros((3, 3)), np.zeros((3, len(self._layout.parameters)))
            for model in self.pixels.values():
                prediction = model.predict(state, ahead_s, age_s)
                if prediction is not None:
                    J = prediction.jacobian[:, self._layout.position]
                    information += J.T @ J
                    moved -= J.T @ prediction.jacobian[:, self._layout.constant]
            if np.linalg.cond(information) > _UNDETERMINED:
                return None
            at.append(np.linalg.solve(information, moved))
        return np.vstack([at[0], (at[1] - at[0]) / _MOMENT_S])


@njit(cache=True)
def _add_speed_noise(
    P: FloatArray,
    H: FloatArray,
    motion: tuple[int, ...],
    places: NDArray[np.int64],
    is_offset: BoolArray,
    moves_target: bool,
    age_s: float,
    noise: FloatArray,
) -> None:
    """Add the variance of one clock's error times that of the pixel's speed to ``noise`` (2, 2)."""
    states = _Motion(*motion)
    share = 0.0
    for a in range(places.size):
        for b in range(places.size):
            late_a, late_b = 1.0 if is_offset[a] else age_s, 1.0 if is_offset[b] else age_s
            share += late_a * P[places[a], places[b]] * late_b
    by_state = np.zeros_like(H)
    for row in range(2):
        for k in range(2 if states.rates >= 0 else 0):
            by_state[row, states.rates + k] = H[row, states.angles + k]
        for k in range(3 if moves_target else 0):
            by_state[row, states.velocity + k] = H[row, states.position + k]
    spread = np.empty((2, 2))
    write_innovation_covariance(P, by_state, np.zeros((2, 2)), spread)
    noise += share * spread
