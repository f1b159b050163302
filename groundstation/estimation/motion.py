"""The motion model: constant velocity and constant turn rate, driven by white acceleration.

The paper drives its model with one impulse of acceleration per step (G = [Δt·I; I]); here the noise is a
continuous white acceleration of given power spectral density, so that the same tuning holds at any frame
rate: over Δt it adds PSD·[[Δt³/3, Δt²/2], [Δt²/2, Δt]] to each (position, velocity) pair.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.estimation.state import StateLayout

IndexArray = NDArray[np.int64]


class MotionModel:
    """Transition and process noise for one layout.

    Parameters
    ----------
    layout : the state's layout.
    acceleration_psd_m2_s3 : (3,) white-acceleration PSD of the target along x, y, z.
    ptu_acceleration_psd_rad2_s3 : the same of each PTU axis.
    """

    __slots__ = ("_pair_of", "_psd", "_size")

    def __init__(
        self,
        layout: StateLayout,
        acceleration_psd_m2_s3: tuple[float, float, float],
        ptu_acceleration_psd_rad2_s3: float,
    ) -> None:
        values = [*range(layout.position.start, layout.position.stop)]
        slopes = [*range(layout.velocity.start, layout.velocity.stop)]
        psd = list(acceleration_psd_m2_s3)
        for name, angles in layout.angles.items():
            values += range(angles.start, angles.stop)
            slopes += range(layout.rates[name].start, layout.rates[name].stop)
            psd += [ptu_acceleration_psd_rad2_s3] * 2
        self._pair_of = (np.array(values), np.array(slopes))
        self._psd = np.array(psd)
        self._size = layout.size

    def transition(self, dt_s: float) -> FloatArray:
        """Return F, (n, n), over ``dt_s`` seconds (which may be negative)."""
        return _transition(self._size, *self._pair_of, dt_s)

    def process_noise(self, dt_s: float) -> FloatArray:
        """Return Q, (n, n), gathered over ``|dt_s|`` seconds."""
        return _process_noise(self._size, *self._pair_of, self._psd, dt_s)


@njit(cache=True)
def _transition(size: int, values: IndexArray, slopes: IndexArray, dt_s: float) -> FloatArray:
    F = np.eye(size)
    for k in range(values.size):
        F[values[k], slopes[k]] = dt_s
    return F


@njit(cache=True)
def _process_noise(size: int, values: IndexArray, slopes: IndexArray, psd: FloatArray, dt_s: float) -> FloatArray:
    dt = abs(dt_s)
    Q = np.zeros((size, size))
    for k in range(values.size):
        a, b = values[k], slopes[k]
        Q[a, a] = psd[k] * dt * dt * dt / 3.0
        Q[b, b] = psd[k] * dt
        Q[a, b] = Q[b, a] = psd[k] * dt_s * dt / 2.0
    return Q
