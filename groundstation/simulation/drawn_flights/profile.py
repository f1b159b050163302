"""A quantity over time that changes by smooth ramps: speed, slope, rate of turn, incidence."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp:
    """A change by a smooth step, s² (3 − 2 s), from ``start_s`` on within ``length_s``.

    Its steepest rate is 1.5 · change / length, halfway.
    """

    start_s: float
    length_s: float
    change: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """A value ``first`` and the ramps that change it, which may overlap."""

    first: float
    ramps: tuple[Ramp, ...] = ()

    def at(self, t_s: FloatArray) -> FloatArray:
        """Return the values (n,) at times (n,), s."""
        values = np.full(t_s.shape, self.first)
        for ramp in self.ramps:
            values += ramp.change * smooth_step((t_s - ramp.start_s) / ramp.length_s)
        return values


def smooth_step(share: FloatArray) -> FloatArray:
    """Return s² (3 − 2 s) of shares (n,), which are held within 0 and 1."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))


def inverse_smooth_step(value: float) -> float:
    """Return where `smooth_step` has a value from 0 to 1."""
    return 0.5 - math.sin(math.asin(1.0 - 2.0 * value) / 3.0)
