"""What a window of one station's pixels says: how far off it is against the others, and when it began to jump.

The statistics of `groundstation.integrity`, whose page has the model: A and g of each epoch, their sums, T and b̂.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.leave_one_out import PART_SIZE, explained, leave_out, summed_up, whitened

# an epoch's own T counts at most so much: a single gross outlier is not a fault
_MOST_OF_ONE = 36.0
# an innovation beyond this (χ² of 2 degrees, one in a thousand) jumps; two of three in a row are no chance
_JUMP = 13.8
_FIRST_ROOM = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
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

    def add(self, t_s: float, sight: Sight, among: Sequence[Sight]) -> None:
        """Take the station's pixel of one epoch, to be held against the others ``among`` whom it is."""
        own = self._epochs
        if len(among) >= 2:
            others = [s for s in among if s is not sight]
            A, g = leave_out(
                np.array([s.noise_px2 for s in (sight, *others)]),
                np.array([s.jacobian_px_per_m for s in (sight, *others)]),
                np.array([s.residual_px for s in (sight, *others)]),
            )
            noise = 0.5 * float(sight.noise_px2[0, 0] + sight.noise_px2[1, 1])
            constant = self._constant_px2 + sight.constant_px2
            square = explained(A, g)
            share = min(1.0, (_MOST_OF_ONE * (1.0 + constant / noise) / max(square, 1e-12)) ** 0.5)
            self._keep(t_s, (A[0, 0], A[0, 1], A[1, 1], g[0] * share, g[1] * share, noise, constant))
        old = 0
        while own and own[0] < t_s - self._length_s:
            own.popleft()
            old += 1
        if old:
            self._parts[: len(own)] = self._parts[old : old + len(own)]

    def _keep(self, t_s: float, part: tuple[float, ...]) -> None:
        """Put an epoch behind the others."""
        count = len(self._epochs)
        if count == len(self._parts):
            self._parts = np.concatenate([self._parts, np.empty_like(self._parts)])
        self._parts[count] = part
        self._epochs.append(t_s)

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
        white = whitened(residual_px, covariance_px2)
        length = math.hypot(float(white[0]), float(white[1]))
        own = self._innovations
        own.append((t_s, white * min(1.0, _MOST_OF_ONE**0.5 / max(length, 1e-12))))
        while own[0][0] < t_s - 2.0 * self._length_s:
            own.popleft()

    def jumped_s(self) -> float | None:
        """Return when the innovations began to jump; None if they did not."""
        times = [(t_s, float(w @ w) > _JUMP) for t_s, w in self._innovations]
        for k, (t_s, jump) in enumerate(times):
            if jump and any(again for _, again in times[k + 1 : k + 3]):
                return t_s
        return None
