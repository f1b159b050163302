"""True pointing of a station over time: ideal, fixed, disturbed, or by a servo loop with lag.

Cameras expose at the head's true angles, continuous in time; the encoder sits on the motor's side of the
gears. Both are (pan, tilt) in rad, rates in rad/s.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry
from groundstation.simulation.command_errors import NO_COMMAND_ERRORS, CommandErrors
from groundstation.simulation.parameter_checks import require, require_not_negative, require_positive
from groundstation.simulation.pointing_kernels import aim_many, apply_backlash, simulate_axis
from groundstation.simulation.trajectory import Trajectory

STEP_S = 0.001
# the loop runs so long before it is looked at, so that its start is forgotten
_SETTLE_S = 3.0
_DIFFERENCE_S = 1e-4
_MAX_STEPS = 4_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeadAngles:
    """A station's state at n times: (pan, tilt) of head and of encoder shaft, rad; the head's rates, rad/s; (n, 2)."""

    head_rad: FloatArray
    head_rate_rad_s: FloatArray
    encoder_rad: FloatArray


class PointingHistory(Protocol):
    """A station's pointing over the flight."""

    def at(self, t_s: FloatArray) -> HeadAngles:
        """Return the pointing at true session times (n,), s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdealPointing:
    """The optical axis passes through the target point at every instant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedPointing:
    """Constant angles, rad; a station without a head has zero angles."""

    pan_rad: float = 0.0
    tilt_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopLimits:
    """Limits of each axis and its play: rad/s, rad/s², s and rad.

    ``command_delay_s`` is the age of the commanded bearing. The head follows the motor within
    ± half of ``backlash_rad``.
    """

    max_rate_rad_s: float = 1.0
    max_acceleration_rad_s2: float = 10.0
    command_delay_s: float = 0.0
    backlash_rad: float = 0.0

    def __post_init__(self) -> None:
        require_positive("LoopLimits: max_rate_rad_s", self.max_rate_rad_s)
        require_positive("LoopLimits: max_acceleration_rad_s2", self.max_acceleration_rad_s2)
        require_not_negative("LoopLimits: command_delay_s", self.command_delay_s)
        require_not_negative("LoopLimits: backlash_rad", self.backlash_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstOrderLoop:
    """rate = (command − angle)/τ within the limits: lags a steady turn by τ · rate."""

    time_constant_s: float = 0.1
    limits: LoopLimits = field(default_factory=LoopLimits)

    def __post_init__(self) -> None:
        wanted = f"at least {10 * STEP_S:g} s, ten steps of the loop"
        enough = self.time_constant_s >= 10 * STEP_S
        require(enough, "FirstOrderLoop: time_constant_s", got=self.time_constant_s, wanted=wanted)

    @property
    def gains(self) -> FloatArray:
        """(1/τ,) for `simulate_axis`."""
        return np.array([1.0 / self.time_constant_s])


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondOrderLoop:
    """Acceleration = ω² (command − angle) − 2ζω · rate within the limits: lags a steady turn by 2ζ/ω · rate.

    ``errors`` are how the command differs from the target's bearing.
    """

    natural_rad_s: float = 15.0
    damping: float = 0.8
    limits: LoopLimits = field(default_factory=LoopLimits)
    errors: CommandErrors = NO_COMMAND_ERRORS

    def __post_init__(self) -> None:
        require_positive("SecondOrderLoop: damping", self.damping)
        stable = 0 < self.natural_rad_s <= 0.1 / STEP_S
        wanted = f"above 0, at most {0.1 / STEP_S:g} rad/s"
        require(stable, "SecondOrderLoop: natural_rad_s", got=self.natural_rad_s, wanted=wanted)

    @property
    def gains(self) -> FloatArray:
        """(ω², 2ζω) for `simulate_axis`."""
        return np.array([self.natural_rad_s**2, 2.0 * self.damping * self.natural_rad_s])


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbedPointing:
    """Aims at the target, but for a deviation drawn from the filter's own model of a head: white acceleration.

    Nothing holds it to the target: after t s it is √(PSD · t³ / 3) off, at one sigma. ``deviation`` has pan and tilt
    in the first two places, rad.
    """

    deviation: Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class UncontrolledPointing:
    """Aims at the target when the flight begins, without control afterwards: the filter's own model of the head.

    Constant rates and white acceleration, so that the head does not follow the target: for studies with a truth to be
    drawn from the model to the last, with a picture that is wide enough. ``deviation`` is that of `DisturbedPointing`.
    """

    deviation: Trajectory


PointingModel = (
    IdealPointing | DisturbedPointing | UncontrolledPointing | FixedPointing | FirstOrderLoop | SecondOrderLoop
)


def pointing_history(
    model: PointingModel, geometry: StationGeometry, trajectory: Trajectory, span_s: tuple[float, float]
) -> PointingHistory:
    """Return how a station of true ``geometry`` points over a span (s) while a trajectory is flown."""
    if isinstance(model, IdealPointing):
        return _IdealHistory(geometry=geometry, trajectory=trajectory)
    if isinstance(model, DisturbedPointing):
        return _DisturbedHistory(
            aimed=_IdealHistory(geometry=geometry, trajectory=trajectory), deviation=model.deviation
        )
    if isinstance(model, UncontrolledPointing):
        first = np.array(trajectory.span_s[:1])
        aim = _IdealHistory(geometry=geometry, trajectory=trajectory).at(first).head_rad[0]
        still = _FixedHistory(pan_rad=float(aim[0]), tilt_rad=float(aim[1]))
        return _DisturbedHistory(aimed=still, deviation=model.deviation)
    if isinstance(model, FixedPointing):
        return _FixedHistory(pan_rad=model.pan_rad, tilt_rad=model.tilt_rad)
    count = int(np.ceil((span_s[1] - span_s[0] + _SETTLE_S) / STEP_S)) + 2
    wanted = f"at most {_MAX_STEPS} steps of {STEP_S:g} s"
    require(count <= _MAX_STEPS, "pointing_history: span_s", got=f"{count} steps", wanted=wanted)
    t = span_s[0] - _SETTLE_S + STEP_S * np.arange(count, dtype=np.float64)
    delayed = trajectory.position(np.asarray(t - model.limits.command_delay_s))
    # a target that passes behind the station does not turn the head once around
    command = np.unwrap(aim_many(geometry.packed, delayed), axis=0)
    if isinstance(model, SecondOrderLoop):
        command = model.errors.commanded(t, command)
    motor, rate, head = np.empty_like(command), np.zeros_like(command), np.empty_like(command)
    motor[0] = head[0] = command[0]
    limits = model.limits
    fastest, hardest = limits.max_rate_rad_s, limits.max_acceleration_rad_s2
    for axis in range(2):
        simulate_axis(command[:, axis], STEP_S, model.gains, fastest, hardest, motor[:, axis], rate[:, axis])
        apply_backlash(motor[:, axis], limits.backlash_rad, head[:, axis])
    return _ServoHistory(start_s=float(t[0]), motor=motor, rate=rate, head=head, backlash_rad=limits.backlash_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class _IdealHistory:
    geometry: StationGeometry
    trajectory: Trajectory

    def at(self, t_s: FloatArray) -> HeadAngles:
        angles, before, after = (
            aim_many(self.geometry.packed, self.trajectory.position(t_s + step))
            for step in (0.0, -_DIFFERENCE_S, _DIFFERENCE_S)
        )
        turned = (after - before + np.pi) % (2.0 * np.pi) - np.pi
        return HeadAngles(head_rad=angles, head_rate_rad_s=turned / (2.0 * _DIFFERENCE_S), encoder_rad=angles)


@dataclass(frozen=True, slots=True, kw_only=True)
class _DisturbedHistory:
    aimed: PointingHistory
    deviation: Trajectory

    def at(self, t_s: FloatArray) -> HeadAngles:
        aimed = self.aimed.at(t_s)
        head = aimed.head_rad + self.deviation.position(t_s)[:, :2]
        rate = aimed.head_rate_rad_s + self.deviation.velocity(t_s)[:, :2]
        return HeadAngles(head_rad=head, head_rate_rad_s=rate, encoder_rad=head)


@dataclass(frozen=True, slots=True, kw_only=True)
class _FixedHistory:
    pan_rad: float
    tilt_rad: float

    def at(self, t_s: FloatArray) -> HeadAngles:
        angles = np.tile([self.pan_rad, self.tilt_rad], (t_s.size, 1))
        return HeadAngles(head_rad=angles, head_rate_rad_s=np.zeros_like(angles), encoder_rad=angles)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ServoHistory:
    """A loop's states (n, 2) at steps of `STEP_S` from ``start_s``; acceleration is constant within a step."""

    start_s: float
    motor: FloatArray
    rate: FloatArray
    head: FloatArray
    backlash_rad: float

    def at(self, t_s: FloatArray) -> HeadAngles:
        place = (t_s - self.start_s) / STEP_S
        k = np.clip(np.floor(place).astype(np.int64), 0, len(self.motor) - 2)
        s = (STEP_S * (place - k))[:, None]
        bend = (self.rate[k + 1] - self.rate[k]) / STEP_S
        motor = self.motor[k] + s * (self.rate[k] + 0.5 * s * bend)
        half = 0.5 * self.backlash_rad
        head = np.clip(self.head[k], motor - half, motor + half)
        # the head moves with the motor where the gears touch in that direction
        rate = self.rate[k] + s * bend
        dragged = np.where(rate > 0, head <= motor - half, head >= motor + half)
        return HeadAngles(head_rad=head, head_rate_rad_s=np.where(dragged, rate, 0.0), encoder_rad=motor)
