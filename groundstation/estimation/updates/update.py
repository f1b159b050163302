"""What a measurement update returns, and the predicted state that it starts from."""

from dataclasses import dataclass
from typing import NamedTuple

from groundstation.arrays import FloatArray
from groundstation.estimation.imm import ImmState
from groundstation.estimation.kalman_kernels import BoolArray, LinearMeasurement
from groundstation.messages import Innovation


class PredictedState(NamedTuple):
    """The filter at the time of a measurement.

    ``estimated`` (n,) are the states that an update may change, the others are considered; ``age_s`` is the time since
    the first prediction, for clock drifts. ``alone`` is the station that has seen the target
    alone for some time, empty if none has, None if two do.
    """

    imm: ImmState
    estimated: BoolArray
    age_s: float
    alone: str | None = None

    @property
    def x(self) -> FloatArray:
        """The mean (n,)."""
        return self.imm.mean

    @property
    def P(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The covariance (n, n)."""
        return self.imm.covariance


@dataclass(slots=True, kw_only=True, eq=False)
class LinearCorrection:
    """A Kalman update in Joseph form; ``gain_share`` scales the gain.

    ``estimated`` (n,) limits the states that change; by default all that the filter estimates. ``ray`` (3,) is a unit
    vector along which position and velocity of the target do not change either.
    """

    measurement: LinearMeasurement
    gain_share: float = 1.0
    updates_weights: bool = True
    estimated: BoolArray | None = None
    ray: FloatArray | None = None


@dataclass(slots=True, kw_only=True, eq=False)
class CorrectedModes:
    """The state after an update that was computed in one compiled step."""

    imm: ImmState


@dataclass(slots=True, kw_only=True, eq=False)
class VarianceInflation:
    """Additional variances (k,) of the states ``part``."""

    part: slice
    variances: FloatArray


@dataclass(slots=True, kw_only=True, eq=False)
class TargetReset:
    """New target states (6,) with covariance (6, 6).

    The states ``correlated`` (k,) depend on the carried errors by ``sensitivity`` (k, m), in addition.
    """

    target: FloatArray
    covariance: FloatArray
    correlated: slice
    sensitivity: FloatArray


@dataclass(slots=True, kw_only=True, eq=False)
class MomentMatching:
    """New moments of a predicted measurement with Jacobian (m, n): shifted mean (m,) and covariance (m, m)."""

    jacobian: FloatArray
    shift: FloatArray
    covariance: FloatArray


Correction = LinearCorrection | CorrectedModes | VarianceInflation | TargetReset | MomentMatching


class Update(NamedTuple):
    """Innovation of a measurement, and the correction to apply; None if it is rejected."""

    innovation: Innovation
    correction: Correction | None = None


class LinearPrediction(NamedTuple):
    """A predicted measurement (m,) with its Jacobian H (m, n) over the state."""

    value: FloatArray
    jacobian: FloatArray
