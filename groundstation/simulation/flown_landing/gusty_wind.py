"""Wind of a landing: a mean wind that falls off towards the ground, and Dryden turbulence of a stated largest gust.

Turbulence has the shape of MIL-F-8785C below 1000 ft (scale lengths and the ratio of the axes by height), at the height
that the planned path has at each time. So it is a function of time alone, the same whatever the aircraft does. Its
strength is such that its largest horizontal gust during the landing is the stated one.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.jsbsim_model import FOOT_M
from groundstation.simulation.parameter_checks import require_not_negative, require_positive

# the mean wind is stated at this height (20 ft); roughness length of short grass, and the least height of the profile
_STATED_AT_M, _ROUGHNESS_M, _LEAST_M = 20.0 * FOOT_M, 0.03, 0.3
# the model's least height is 10 ft
_LOWEST_FT = 10.0
_RUN_IN_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WindStrength:
    """Largest mean wind at 20 ft, its largest angle off the runway, and the largest horizontal gust about the mean."""

    most_mean_m_s: float = 6.0
    most_angle_rad: float = math.radians(60.0)
    gust_m_s: float = 6.0

    def __post_init__(self) -> None:
        require_not_negative("WindStrength: most_mean_m_s", self.most_mean_m_s)
        require_not_negative("WindStrength: gust_m_s", self.gust_m_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedDescent:
    """Height over the runway at time 0, m, sink, m/s, and airspeed, m/s, on the planned path."""

    height_m: float
    sink_m_s: float
    airspeed_m_s: float


class GustyWind:
    """Wind of one landing, drawn: a head wind of 0 to the largest, from an angle of up to the largest to either side.

    Parameters
    ----------
    step_s : of the turbulence.
    seconds : its length; afterwards the last gust stays.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        strength: WindStrength,
        descent: PlannedDescent,
        *,
        step_s: float,
        seconds: float,
    ) -> None:
        require_positive("GustyWind: step_s", step_s)
        speed = float(generator.uniform(0.0, strength.most_mean_m_s))
        angle = float(generator.uniform(-strength.most_angle_rad, strength.most_angle_rad))
        # along the landing direction and to its right: the air moves against the aircraft
        self.mean_m_s: FloatArray = speed * np.array([-math.cos(angle), math.sin(angle), 0.0])
        self._step_s = step_s
        gusts = _dryden(generator, descent, step_s, seconds)
        largest = float(np.max(np.hypot(gusts[:, 0], gusts[:, 1])))
        self.gusts_m_s: FloatArray = gusts * (strength.gust_m_s / largest)

    def at(self, t_s: float, height_m: float) -> FloatArray:
        """Return where the air moves to (3,): along the landing direction, right of it, down, m/s."""
        height = max(height_m, _LEAST_M)
        share = math.log(height / _ROUGHNESS_M) / math.log(_STATED_AT_M / _ROUGHNESS_M)
        k = min(max(int(t_s / self._step_s), 0), len(self.gusts_m_s) - 1)
        return self.mean_m_s * share + self.gusts_m_s[k]


def _dryden(generator: np.random.Generator, descent: PlannedDescent, step_s: float, seconds: float) -> FloatArray:
    """Return turbulence (n, 3) of σ_w = 1: MIL-F-8785C, 3.7.2 and figures 10 and 11, by its transfer functions."""
    run_in, count = round(_RUN_IN_S / step_s), round(seconds / step_s)
    normals = generator.normal(size=(run_in + count, 3))
    out = np.empty((run_in + count, 3))
    u, v, w = 0.0, (0.0, 0.0), (0.0, 0.0)
    for k in range(run_in + count):
        t_s = max(k - run_in, 0) * step_s
        feet = max((descent.height_m - descent.sink_m_s * t_s) / FOOT_M, _LOWEST_FT)
        factor = 0.177 + 0.000823 * feet
        horizontal_s = feet / factor**1.2 * FOOT_M / descent.airspeed_m_s
        vertical_s = feet * FOOT_M / descent.airspeed_m_s
        sigma = factor**-0.4
        kept = math.exp(-step_s / horizontal_s)
        u = kept * u + sigma * math.sqrt(1.0 - kept * kept) * normals[k, 0]
        v = _second_order(v, horizontal_s, sigma * float(normals[k, 1]), step_s)
        w = _second_order(w, vertical_s, float(normals[k, 2]), step_s)
        out[k] = u, _gust(v), _gust(w)
    return out[run_in:]


def _second_order(state: tuple[float, float], scale_s: float, normal: float, step_s: float) -> tuple[float, float]:
    """Return the two states of (1 + √3 T s) / (1 + T s)² after a step; its output has the normal's sigma."""
    share = step_s / scale_s
    driven = normal / math.sqrt(share)
    return state[0] + share * (driven - state[0]), state[1] + share * (state[0] - state[1])


def _gust(state: tuple[float, float]) -> float:
    return state[1] + math.sqrt(3.0) * (state[0] - state[1])
