"""A pan-tilt unit in simulated time: with delay, limited acceleration, and a log of its positions."""

import math
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from ptu_drivers.errors import LimitError
from ptu_drivers.health import Health, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.lease import NO_LEASE, Lease
from ptu_drivers.messages import (
    AngleSample,
    AngleSource,
    Axis,
    AxisDescription,
    Capability,
    NoReading,
    Reading,
    UnitDescription,
)

STEP_S = 0.005
QUANTUM_RAD = math.radians(0.01)
ABOUT = AxisDescription(
    quantum_rad=QUANTUM_RAD,
    low_rad=math.radians(-170),
    high_rad=math.radians(170),
    max_rate_rad_s=math.radians(60),
    max_acceleration_rad_s2=math.radians(60),
)


class TurningUnit(PanTiltUnit):
    """Both axes go by themselves: positions in trapezoids, rates as the acceleration lets them."""

    def __init__(
        self,
        pan_deg: float,
        tilt_deg: float,
        *,
        acceleration_deg_s2: float = 60.0,
        latency_s: float = 0.03,
        lease: Lease = NO_LEASE,
    ) -> None:
        self.now_s = 0.0
        self.angles = np.radians([pan_deg, tilt_deg])
        self.rates = np.zeros(2)
        self.log: list[tuple[float, float, float]] = []
        self.silent = False
        self._steepest = math.radians(acceleration_deg_s2)
        self._latency_s = latency_s
        self._waiting: list[tuple[float, str, FloatArray, float]] = []
        self._way: tuple[str, FloatArray, float] = ("rates", np.zeros(2), 0.0)
        axis = replace(ABOUT, max_acceleration_rad_s2=self._steepest)
        tilt = replace(axis, low_rad=math.radians(-30), high_rad=math.radians(90))
        self._about = UnitDescription(
            protocol="simulated",
            url="here",
            model="",
            firmware="",
            serial="",
            pan=axis,
            tilt=tilt,
            capabilities=frozenset(Capability),
            reply_timeout_s=0.1,
            lease=lease,
        )

    def clock(self) -> float:
        return self.now_s

    def run(self, seconds: float) -> None:
        """Let time pass."""
        # plain numbers: arrays of two are ten times slower
        angles, rates = self.angles.tolist(), self.rates.tolist()
        step = self._steepest * STEP_S
        for _ in range(round(seconds / STEP_S)):
            while self._waiting and self._waiting[0][0] <= self.now_s:
                _, *rest = self._waiting.pop(0)
                self._way = (rest[0], rest[1], rest[2])
            kind, goal, fastest = self._way
            for axis in (0, 1):
                wanted = float(goal[axis])
                if kind != "rates":
                    off = wanted - angles[axis]
                    # as fast as it can still be braked, less what one step may be too late
                    safe = math.sqrt(2.0 * self._steepest * abs(off))
                    wanted = math.copysign(min(safe, fastest, abs(off) / STEP_S), off)
                rates[axis] += min(max(wanted - rates[axis], -step), step)
                angles[axis] += rates[axis] * STEP_S
            self.now_s += STEP_S
            self.log.append((self.now_s, angles[0], angles[1]))
        self.angles, self.rates = np.array(angles), np.array(rates)

    def describe(self) -> UnitDescription:
        return self._about

    def read(self) -> Reading | NoReading:
        if self.silent:
            from ptu_drivers.health import FailureReason

            return NoReading(reason=FailureReason.TIMEOUT, state=UnitState.RESYNCHRONISING, t_s=self.now_s)
        pan, tilt = (
            AngleSample(
                axis=axis,
                t_s=self.now_s,
                sigma_t_s=0.001,
                angle_rad=round(float(angle) / QUANTUM_RAD) * QUANTUM_RAD,
                sigma_rad=QUANTUM_RAD,
                source=AngleSource.ROUND_TRIP,
            )
            for axis, angle in zip(Axis, self.angles, strict=True)
        )
        return Reading(pan=pan, tilt=tilt, sent_s=self.now_s, answered_s=self.now_s)

    def _take(self, kind: str, goal: FloatArray, fastest: float) -> None:
        self._waiting.append((self.now_s + self._latency_s, kind, goal, fastest))

    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        goal = self.angles.copy()
        for k, (value, about) in enumerate(zip((pan_rad, tilt_rad), (self._about.pan, self._about.tilt), strict=True)):
            if value is not None:
                if not about.low_rad <= value <= about.high_rad:
                    raise LimitError("axis", "limit", got=value, bound=about.high_rad, origin="unit")
                goal[k] = value
        self._take("position", goal, rate_rad_s or self._about.pan.max_rate_rad_s)

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        self._take("rates", np.array([pan_rad_s, tilt_rad_s]), 0.0)

    def halt(self) -> None:
        self._take("rates", np.zeros(2), 0.0)

    def home(self) -> None:
        self._take("position", np.zeros(2), self._about.pan.max_rate_rad_s)

    def health(self) -> Health:
        raise NotImplementedError

    def close(self) -> None:
        self.halt()
