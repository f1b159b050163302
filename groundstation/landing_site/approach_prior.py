"""How an aircraft is supposed to fly a planned approach: the prior of the foretold touchdown (docs/landing.md).

All of it is stated beforehand and none of it is fitted to a flight. On the glide path, height over the plan and
distance off the centre line are two second-order Gauss-Markov processes (critically damped: a path hold in gusts),
and ground speed a first-order one about the planned speed. At the flare height the wheels' sink changes over to the
flare's law ḣ = −h/τ − w, where w is the sink at touchdown and τ follows from the planned sink at the flare height;
height, sink at touchdown and loss of speed differ from landing to landing.
"""

import math
from dataclasses import dataclass, fields

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError

_LARGEST = 1e4
_ABOVE_ZERO = (
    *("vertical_sigma_m", "lateral_sigma_m", "hold_rad_s", "speed_sigma_m_s", "speed_correlation_s"),
    *("flare_height_m", "touchdown_sink_m_s", "flare_sink_sigma_m_s", "flare_sink_correlation_s"),
)


def _require_usual(where: str, record: object, signed: tuple[str, ...] = ()) -> None:
    """Raise `InputError` unless every number of a dataclass is finite, ≥ 0 and of a usual size."""
    for item in fields(record):  # type: ignore[arg-type]
        value = getattr(record, item.name)
        for number in value if isinstance(value, tuple) else (value,):
            low = -_LARGEST if item.name in signed else 0.0
            if not low <= number <= _LARGEST:
                wanted = f"a number from {low:g} to {_LARGEST:g}"
                raise InputError(f"{where}: {item.name}", got=f"{number:g}", wanted=wanted)


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelPosition:
    """Where the wheels are from the nose in the attitude of the touchdown.

    Attributes
    ----------
    below_nose_m : how far the lowest wheel is below the nose.
    below_nose_sigma_m : one sigma of it, from landing to landing, as pitch differs.
    behind_nose_m : how far the wheels are behind the nose.
    """

    below_nose_m: float = 0.3
    below_nose_sigma_m: float = 0.03
    behind_nose_m: float = 0.0

    def __post_init__(self) -> None:
        _require_usual("WheelPosition", self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachPrior:
    """Spread of approaches about their plan; all sigmas are one sigma.

    Attributes
    ----------
    vertical_sigma_m, lateral_sigma_m : of the deviation from glide path and centre line.
    hold_rad_s : natural frequency of both path holds; the rate of a deviation has its sigma times this.
    speed_sigma_m_s, speed_correlation_s : of ground speed about the plan's, and how long it lasts.
    flare_height_m, flare_height_sigma_log : median height of the wheels at which the flare begins, and one sigma of its
        logarithm.
    touchdown_sink_m_s, touchdown_sink_sigma_log : the same of the sink at touchdown, which is at most
        `MOST_SINK_SHARE` of that on the glide path.
    flare_sink_sigma_m_s, flare_sink_correlation_s : of the sink about the flare's law, and how long it lasts.
    flare_deceleration_m_s2, flare_deceleration_sigma_m_s2 : loss of ground speed in the flare; a draw below 0 is 0.
    free_psd_m2_s3 : along, right and up: without a plan velocity is constant but for white acceleration of this power
        spectral density. The default is that of the flights of the filter's posterior bounds.
    free_flare_share : share of the flights without a plan that flare; the others go on as they are.
    """

    vertical_sigma_m: float = 0.7
    lateral_sigma_m: float = 1.0
    hold_rad_s: float = 0.5
    speed_sigma_m_s: float = 1.0
    speed_correlation_s: float = 10.0
    flare_height_m: float = 2.0
    flare_height_sigma_log: float = 0.3
    touchdown_sink_m_s: float = 0.4
    touchdown_sink_sigma_log: float = 0.35
    flare_sink_sigma_m_s: float = 0.15
    flare_sink_correlation_s: float = 1.0
    flare_deceleration_m_s2: float = 0.5
    flare_deceleration_sigma_m_s2: float = 0.25
    free_psd_m2_s3: tuple[float, float, float] = (0.05, 0.1, 0.05)
    free_flare_share: float = 0.0

    def __post_init__(self) -> None:
        _require_usual("ApproachPrior", self)
        if self.free_flare_share > 1.0:
            wanted = "a share from 0 to 1"
            raise InputError("ApproachPrior: free_flare_share", got=f"{self.free_flare_share:g}", wanted=wanted)
        for name in _ABOVE_ZERO:
            if not getattr(self, name) > 0.0:
                raise InputError(f"ApproachPrior: {name}", got="0", wanted="a number above 0")

    def flares(self, normals: FloatArray, glide_sink_m_s: float) -> "FlareParameters":
        """Return n flares for standard normal numbers (n, 3), off a glide path of this sink, m/s."""
        height = self.flare_height_m * np.exp(self.flare_height_sigma_log * normals[:, 0])
        sink = self.touchdown_sink_m_s * np.exp(self.touchdown_sink_sigma_log * normals[:, 1])
        sink = np.minimum(sink, MOST_SINK_SHARE * glide_sink_m_s)
        slowing = self.flare_deceleration_m_s2 + self.flare_deceleration_sigma_m_s2 * normals[:, 2]
        return FlareParameters(
            height_m=height,
            touchdown_sink_m_s=sink,
            time_constant_s=height / (glide_sink_m_s - sink),
            deceleration_m_s2=np.maximum(slowing, 0.0),
        )

    def speed_step(self, step_s: float) -> tuple[float, float]:
        """Return the share of a speed's deviation that lasts over a step, and the sigma of what is new, m/s."""
        return _first_order(self.speed_sigma_m_s, self.speed_correlation_s, step_s)

    def flare_step(self, step_s: float) -> tuple[float, float]:
        """Return the same of the sink about the flare's law."""
        return _first_order(self.flare_sink_sigma_m_s, self.flare_sink_correlation_s, step_s)


# a flare takes away at least this of the sink
MOST_SINK_SHARE = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlareParameters:
    """n flares (n,): height of the wheels at its start, sink at touchdown, τ of its law, and loss of speed."""

    height_m: FloatArray
    touchdown_sink_m_s: FloatArray
    time_constant_s: FloatArray
    deceleration_m_s2: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathHold:
    """A deviation from the planned path with its rate: second-order Gauss-Markov process, critically damped.

    ``sigma_m`` of the deviation in the stationary state; ``hold_rad_s`` ω of d̈ = −ω² d − 2ω ḋ + white noise.
    """

    sigma_m: float
    hold_rad_s: float

    @property
    def stationary(self) -> FloatArray:
        """Covariance (2, 2) of the deviation, m, and its rate, m/s."""
        return np.diag([self.sigma_m**2, (self.sigma_m * self.hold_rad_s) ** 2])

    def step(self, step_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the transition F (2, 2) over a step and a root (2, 2) of the noise gathered in it, exact."""
        w = self.hold_rad_s
        grown = np.array([[1.0 + w * step_s, step_s], [-w * w * step_s, 1.0 - w * step_s]])
        F = math.exp(-w * step_s) * grown
        Q = self.stationary - F @ self.stationary @ F.T
        return F, covariance_root(Q)


def covariance_root(covariance: FloatArray) -> FloatArray:
    """Return roots (…, n, n) of covariances (…, n, n), which may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def _first_order(sigma: float, correlation_s: float, step_s: float) -> tuple[float, float]:
    kept = math.exp(-step_s / correlation_s)
    return kept, sigma * math.sqrt(1.0 - kept * kept)
