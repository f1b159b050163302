"""Solution separation of one station over a window of epochs, and the onset of jumps in its innovations.

The statistics of `station_exclusion`, which documents the model: A and g of each epoch, their sums, T and b̂.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import BoolArray
from groundstation.integrity.leave_one_out import TERM_COUNT, whiten, window_statistic, write_epoch_terms

# limit of T of a single epoch, so that a single gross outlier is no fault
_MOST_OF_ONE = 36.0
# an innovation beyond this limit is a jump (χ² with 2 degrees of freedom, 0.001); two of three exclude chance
_JUMP = 13.8
_FIRST_ROOM = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelResidual:
    """Residual of one station's pixel to the filter's prediction at its exposure.

    ``residual_px`` (2,) detected − predicted; ``jacobian_px_per_m`` (2, 3) by the target position; ``noise_px2`` (2, 2)
    of pixel and angles, without the uncertainty of the position; ``constant_px2`` the variance of the constant error
    caused by the uncertainty of the rig.
    """

    station: str
    residual_px: FloatArray
    jacobian_px_per_m: FloatArray
    noise_px2: FloatArray
    constant_px2: float = 0.0


class ResidualStack(NamedTuple):
    """The k residuals of one epoch as arrays for `leave_one_out`; ``used`` marks those that enter the fix.

    ``noises`` (k, 2, 2) px², ``jacobians`` (k, 2, 3) px per m, ``residuals`` (k, 2) px, ``used`` (k,).
    """

    noises: FloatArray
    jacobians: FloatArray
    residuals: FloatArray
    used: BoolArray

    @classmethod
    def of(cls, residuals: Sequence[PixelResidual], used: Sequence[bool]) -> "ResidualStack":
        """Return the stacked residuals, in their order."""
        return cls(
            np.array([s.noise_px2 for s in residuals]),
            np.array([s.jacobian_px_per_m for s in residuals]),
            np.array([s.residual_px for s in residuals]),
            np.array(used),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeparationTest:
    """Result of a window: T with its degrees of freedom, the constant error b̂ (2,), and the number of epochs."""

    statistic: float
    dof: int
    bias_px: FloatArray
    epochs: int


class StationWindow:
    """The epochs of one station in the last ``length_s``, and its innovations of twice that time.

    ``constant_px`` is one sigma of the constant error of a station without a fault.
    """

    def __init__(self, length_s: float, constant_px: float) -> None:
        self._length_s = length_s
        self._constant_px2 = constant_px**2
        # terms of each epoch for `window_statistic`, and their times
        self._parts = np.empty((_FIRST_ROOM, TERM_COUNT))
        self._epochs: deque[float] = deque()
        self._innovations: deque[tuple[float, FloatArray]] = deque()

    @property
    def first_s(self) -> float:
        """Time of the oldest epoch; infinite without epochs."""
        return self._epochs[0] if self._epochs else math.inf

    def forget_epochs(self) -> None:
        """Clear the epochs and keep the innovations."""
        self._epochs.clear()

    def forget(self) -> None:
        """Clear epochs and innovations, for another target."""
        self._epochs.clear()
        self._innovations.clear()

    def add(self, t_s: float, own_constant_px2: float, own: int, among: ResidualStack) -> None:
        """Add the station's pixel of one epoch, index ``own`` of ``among``, compared with the used stations.

        ``own_constant_px2`` is its `PixelResidual.constant_px2`. Without another used station nothing is added.
        """
        if np.count_nonzero(among.used) + (not among.used[own]) >= 2:
            constant = self._constant_px2 + own_constant_px2
            write_epoch_terms(own, *among, constant, _MOST_OF_ONE, self._room())
            self._epochs.append(t_s)
        epochs, old = self._epochs, 0
        while epochs and epochs[0] < t_s - self._length_s:
            epochs.popleft()
            old += 1
        if old:
            left = len(epochs)
            self._parts[:left] = self._parts[old : old + left]

    def _room(self) -> FloatArray:
        """Return the row (7,) for the next epoch."""
        count = len(self._epochs)
        if count == len(self._parts):
            self._parts = np.concatenate([self._parts, np.empty_like(self._parts)])
        return self._parts[count]

    def separation(self) -> SeparationTest:
        """Return the leave-one-out test of the window."""
        n = len(self._epochs)
        if n == 0:
            return SeparationTest(statistic=0.0, dof=1, bias_px=np.zeros(2), epochs=0)
        bias = np.empty(2)
        statistic, dof = window_statistic(self._parts, n, bias)
        return SeparationTest(statistic=statistic, dof=max(dof, 1), bias_px=bias, epochs=n)

    def add_innovation(self, t_s: float, residual_px: FloatArray, covariance_px2: FloatArray) -> None:
        """Add an innovation of the filter, accepted or not."""
        white, own = np.empty(2), self._innovations
        whiten(residual_px, covariance_px2, _MOST_OF_ONE**0.5, white)
        own.append((t_s, white))
        while own[0][0] < t_s - 2.0 * self._length_s:
            own.popleft()

    def first_jump_s(self) -> float | None:
        """Return the time of the first jump of the innovations; None without a jump."""
        times = [(t_s, float(w @ w) > _JUMP) for t_s, w in self._innovations]
        for k, (t_s, jump) in enumerate(times):
            if jump and any(again for _, again in times[k + 1 : k + 3]):
                return t_s
        return None
