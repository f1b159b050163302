"""What a window of one station's pixels says: how far off it is against the others, and when it began to jump.

The statistics of `station_exclusion`, whose page has the model: A and g of each epoch, their sums, T and b̂.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import BoolArray
from groundstation.integrity.leave_one_out import PART_SIZE, summed_up, whiten, write_part

# an epoch's own T counts at most so much: a single gross outlier is not a fault
_MOST_OF_ONE = 36.0
# an innovation beyond this (χ² of 2 degrees, one in a thousand) jumps; two of three in a row are no chance
_JUMP = 13.8
_FIRST_ROOM = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelResidual:
    """One station's pixel of an epoch against the filter's prediction at its own exposure.

    ``residual_px`` (2,) found − predicted; ``jacobian_px_per_m`` (2, 3) by the target's position; ``noise_px2`` (2, 2)
    of the pixel with its angles, the position's own uncertainty not in it; ``constant_px2`` the variance of what the
    rig's known uncertainty may add to every pixel alike.
    """

    station: str
    residual_px: FloatArray
    jacobian_px_per_m: FloatArray
    noise_px2: FloatArray
    constant_px2: float = 0.0


class SightStack(NamedTuple):
    """The k sights of one epoch in arrays, as `leave_one_out` takes them; whose pixels count is ``used``.

    ``noises`` (k, 2, 2) px², ``jacobians`` (k, 2, 3) px per m, ``residuals`` (k, 2) px, ``used`` (k,).
    """

    noises: FloatArray
    jacobians: FloatArray
    residuals: FloatArray
    used: BoolArray

    @classmethod
    def of(cls, sights: Sequence[PixelResidual], used: Sequence[bool]) -> "SightStack":
        """Return the sights in this order."""
        return cls(
            np.array([s.noise_px2 for s in sights]),
            np.array([s.jacobian_px_per_m for s in sights]),
            np.array([s.residual_px for s in sights]),
            np.array(used),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Separation:
    """What a window says of one station: T with its degrees of freedom, the constant error b̂ (2,), epochs counted."""

    statistic: float
    dof: int
    bias_px: FloatArray
    epochs: int


class StationWindow:
    """One station's epochs of the last ``length_s``, and its innovations of twice that.

    ``constant_px`` is one sigma of a constant error that is no fault.
    """

    def __init__(self, length_s: float, constant_px: float) -> None:
        self._length_s = length_s
        self._constant_px2 = constant_px**2
        # of each epoch what `summed_up` wants; when they were
        self._parts = np.empty((_FIRST_ROOM, PART_SIZE))
        self._epochs: deque[float] = deque()
        self._innovations: deque[tuple[float, FloatArray]] = deque()

    @property
    def first_s(self) -> float:
        """When the oldest epoch was; infinite if there is none."""
        return self._epochs[0] if self._epochs else math.inf

    def forget_epochs(self) -> None:
        """Start anew; the innovations stay."""
        self._epochs.clear()

    def forget(self) -> None:
        """Start anew altogether: another target."""
        self._epochs.clear()
        self._innovations.clear()

    def add(self, t_s: float, own_constant_px2: float, own: int, among: SightStack) -> None:
        """Take the station's pixel of one epoch, number ``own`` of those ``among``, to be held against the used ones.

        ``own_constant_px2`` is its `PixelResidual.constant_px2`. With no other station used, there is nothing to take.
        """
        if np.count_nonzero(among.used) + (not among.used[own]) >= 2:
            constant = self._constant_px2 + own_constant_px2
            write_part(own, *among, constant, _MOST_OF_ONE, self._room())
            self._epochs.append(t_s)
        epochs, old = self._epochs, 0
        while epochs and epochs[0] < t_s - self._length_s:
            epochs.popleft()
            old += 1
        if old:
            left = len(epochs)
            self._parts[:left] = self._parts[old : old + left]

    def _room(self) -> FloatArray:
        """Return where an epoch behind the others goes, (7,)."""
        count = len(self._epochs)
        if count == len(self._parts):
            self._parts = np.concatenate([self._parts, np.empty_like(self._parts)])
        return self._parts[count]

    def separation(self) -> Separation:
        """Return the window's leave-one-out test."""
        n = len(self._epochs)
        if n == 0:
            return Separation(statistic=0.0, dof=1, bias_px=np.zeros(2), epochs=0)
        bias = np.empty(2)
        statistic, dof = summed_up(self._parts, n, bias)
        return Separation(statistic=statistic, dof=max(dof, 1), bias_px=bias, epochs=n)

    def judged(self, t_s: float, residual_px: FloatArray, covariance_px2: FloatArray) -> None:
        """Take an innovation of the filter, accepted or not."""
        white, own = np.empty(2), self._innovations
        whiten(residual_px, covariance_px2, _MOST_OF_ONE**0.5, white)
        own.append((t_s, white))
        while own[0][0] < t_s - 2.0 * self._length_s:
            own.popleft()

    def jumped_s(self) -> float | None:
        """Return when the innovations began to jump; None if they did not."""
        times = [(t_s, float(w @ w) > _JUMP) for t_s, w in self._innovations]
        for k, (t_s, jump) in enumerate(times):
            if jump and any(again for _, again in times[k + 1 : k + 3]):
                return t_s
        return None
