"""What a window of one station's pixels says: how far off it is against the others, and when it began to jump.

The statistics of `groundstation.integrity`, whose page has the model: A and g of each epoch, their sums, T and b̂.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.leave_one_out import LEAST_SHARE, explained, leave_out, whitened

# an epoch's own T counts at most so much: a single gross outlier is not a fault
_MOST_OF_ONE = 36.0
# an innovation beyond this (χ² of 2 degrees, one in a thousand) jumps; two of three in a row are no chance
_JUMP = 13.8


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
class _Part:
    """What one epoch says of one station: A (2, 2), g (2,), variance of its noise and of its constant error, px²."""

    t_s: float
    A: FloatArray
    g: FloatArray
    noise_px2: float
    constant_px2: float


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
        self._epochs: deque[_Part] = deque()
        self._innovations: deque[tuple[float, FloatArray]] = deque()

    @property
    def first_s(self) -> float:
        """When the oldest epoch was; infinite if there is none."""
        return self._epochs[0].t_s if self._epochs else math.inf

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
            noise = 0.5 * float(np.trace(sight.noise_px2))
            constant = self._constant_px2 + sight.constant_px2
            square = explained(A, g)
            share = min(1.0, (_MOST_OF_ONE * (1.0 + constant / noise) / max(square, 1e-12)) ** 0.5)
            own.append(_Part(t_s=t_s, A=A, g=g * share, noise_px2=noise, constant_px2=constant))
        while own and own[0].t_s < t_s - self._length_s:
            own.popleft()

    def separation(self) -> Separation:
        """Return the window's leave-one-out test."""
        epochs = self._epochs
        n = len(epochs)
        if n == 0:
            return Separation(statistic=0.0, dof=1, bias_px=np.zeros(2), epochs=0)
        A = np.sum([e.A for e in epochs], axis=0)
        g = np.sum([e.g for e in epochs], axis=0)
        noise = float(np.mean([e.noise_px2 for e in epochs]))
        values, vectors = np.linalg.eigh(A)
        # a direction that the others say nothing of: across the line of sight of two stations
        sound = values > LEAST_SHARE * n / noise
        root = np.where(sound, 1.0 / np.where(sound, values, 1.0), 0.0)
        bias = (vectors * root) @ (vectors.T @ g)
        rho = float(np.mean([e.constant_px2 for e in epochs])) / noise
        statistic = float(g @ bias) / (1.0 + n * rho)
        return Separation(statistic=statistic, dof=max(int(sound.sum()), 1), bias_px=bias, epochs=n)

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
