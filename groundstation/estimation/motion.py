"""The motion model: constant velocity and constant turn rate, driven by white acceleration.

The paper drives its model with one impulse of acceleration per step (G = [Δt·I; I]); here the noise is a
continuous white acceleration of given power spectral density, so that the same tuning holds at any frame
rate: over Δt it adds PSD·[[Δt³/3, Δt²/2], [Δt²/2, Δt]] to each (position, velocity) pair. Errors of calibration and
clocks stay as they are, or walk.

What a detector gets wrong it goes on getting wrong: a wing in the shade, a fuselage against a dark hill. A part of its
error is therefore a first-order Gauss-Markov process of unit variance, e' = e·exp(−|Δt|/τ) + noise, that each detection
scales with its own sigmas; only the rest is new in every frame.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.estimation.state_model import StateLayout

IndexArray = NDArray[np.int64]


class MotionModel:
    """Transition and process noise for one layout.

    Parameters
    ----------
    layout : the state's layout.
    acceleration_psd_m2_s3 : (3,) white-acceleration PSD of the target along x, y, z.
    ptu_acceleration_psd_rad2_s3 : the same of each PTU axis.
    walk_psd : (m,) how fast the variance of each carried error grows, unit²/s; none walks by default.
    lasting_s : τ of the target point's lasting errors.
    """

    # pairs: indices (k,) of values and (k,) of their rates in the state; psd (k,): of each pair
    __slots__ = ("_first_constant", "_first_offset", "_lasting_s", "_size", "_walk", "pairs", "psd")

    def __init__(
        self,
        layout: StateLayout,
        acceleration_psd_m2_s3: Sequence[float],
        ptu_acceleration_psd_rad2_s3: float,
        walk_psd: FloatArray | None = None,
        lasting_s: float = 1.0,
    ) -> None:
        values = [*range(layout.position.start, layout.position.stop)]
        slopes = [*range(layout.velocity.start, layout.velocity.stop)]
        psd = list(acceleration_psd_m2_s3)
        for name, angles in layout.angles.items():
            values += range(angles.start, angles.stop)
            slopes += range(layout.rates[name].start, layout.rates[name].stop)
            psd += [ptu_acceleration_psd_rad2_s3] * 2
        self.pairs = (np.array(values), np.array(slopes))
        self.psd = np.array(psd)
        self._size = layout.size
        self._walk = np.zeros(len(layout.parameters)) if walk_psd is None else walk_psd
        self._first_constant = layout.constant.start
        self._first_offset = self._first_constant - 2 * len(layout.offsets)
        self._lasting_s = lasting_s

    def transition(self, dt_s: float) -> FloatArray:
        """Return F, (n, n), over ``dt_s`` seconds (which may be negative)."""
        F = np.empty((self._size, self._size))
        _write_transition(*self.pairs, self._first_offset, self._first_constant, self._lasting_s, dt_s, F)
        return F

    def process_noise(self, dt_s: float) -> FloatArray:
        """Return Q, (n, n), gathered over ``|dt_s|`` seconds."""
        Q = np.empty((self._size, self._size))
        _write_noise(
            *self.pairs,
            self.psd,
            self._first_offset,
            self._first_constant,
            self._walk,
            self._lasting_s,
            dt_s,
            Q,
        )
        return Q

    def with_noises(self, psds: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Return F (n, n) and Q (r, n, n) for each row of ``psds`` (r, k), as `psd` is of this one, over ``dt_s``."""
        F, noises = np.empty((self._size, self._size)), np.empty((len(psds), self._size, self._size))
        _write_motion(
            *self.pairs,
            psds,
            self._first_offset,
            self._first_constant,
            self._walk,
            self._lasting_s,
            dt_s,
            F,
            noises,
        )
        return F, noises


class MotionModes:
    """The motion models of all modes, steady flight first, with the mean duration of each in s."""

    def __init__(self, models: Sequence[MotionModel], stay_s: Sequence[float]) -> None:
        self.steady, self.manoeuvre = models[0], models[-1]
        self.stay_s = tuple(stay_s)
        self._models = models
        self._psds = np.array([model.psd for model in models])

    def __len__(self) -> int:
        return len(self._models)

    def over(self, dt_s: float, least_psd_m2_s3: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return F (n, n), common to all modes, and Q (r, n, n) of each over ``dt_s``.

        ``least_psd_m2_s3`` (3,) is the least density of the target's acceleration along x, y, z in every mode.
        """
        psds = self._psds
        if least_psd_m2_s3 is not None:
            psds = psds.copy()
            psds[:, :3] = np.maximum(psds[:, :3], least_psd_m2_s3)
        return self.steady.with_noises(psds, dt_s)

    def mixed_over(
        self, dt_s: float, weights: FloatArray, least_psd_m2_s3: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return F and Q, (n, n) each, over ``dt_s``; the process noises of the modes are weighted by ``weights`` (r,).

        Mixing the modes does not change mean and covariance of the mixture, so that F and Q describe the prediction
        of both.
        """
        if least_psd_m2_s3 is not None:
            F, noises = self.over(dt_s, least_psd_m2_s3)
            return F, np.asarray(np.tensordot(weights, noises, axes=1))
        Q = sum(w * model.process_noise(dt_s) for w, model in zip(weights, self._models, strict=True))
        return self.steady.transition(dt_s), np.asarray(Q)


# outputs are arguments: returning a matrix takes a compiled function longer than filling it
@njit(cache=True)
def _write_transition(
    values: IndexArray,
    slopes: IndexArray,
    first_offset: int,
    first_constant: int,
    lasting_s: float,
    dt_s: float,
    F: FloatArray,
) -> None:
    F[:] = 0.0
    for k in range(F.shape[0]):
        F[k, k] = 1.0
    for k in range(values.size):
        F[values[k], slopes[k]] = dt_s
    for k in range(first_offset, first_constant):
        F[k, k] = np.exp(-abs(dt_s) / lasting_s)


@njit(cache=True)
def _write_noise(
    values: IndexArray,
    slopes: IndexArray,
    psd: FloatArray,
    first_offset: int,
    first_constant: int,
    walk_psd: FloatArray,
    lasting_s: float,
    dt_s: float,
    Q: FloatArray,
) -> None:
    dt = abs(dt_s)
    Q[:] = 0.0
    for k in range(values.size):
        a, b = values[k], slopes[k]
        Q[a, a] = psd[k] * dt * dt * dt / 3.0
        Q[b, b] = psd[k] * dt
        Q[a, b] = Q[b, a] = psd[k] * dt_s * dt / 2.0
    for k in range(first_offset, first_constant):
        Q[k, k] = 1.0 - np.exp(-2.0 * dt / lasting_s)
    for k in range(walk_psd.size):
        Q[first_constant + k, first_constant + k] = walk_psd[k] * dt


@njit(cache=True)
def _write_motion(
    values: IndexArray,
    slopes: IndexArray,
    psds: FloatArray,
    first_offset: int,
    first_constant: int,
    walk_psd: FloatArray,
    lasting_s: float,
    dt_s: float,
    F: FloatArray,
    noises: FloatArray,
) -> None:
    _write_transition(values, slopes, first_offset, first_constant, lasting_s, dt_s, F)
    for mode in range(psds.shape[0]):
        _write_noise(values, slopes, psds[mode], first_offset, first_constant, walk_psd, lasting_s, dt_s, noises[mode])
