"""Closed-loop simulation of a station in virtual time: turning heads, pixel measurements and scheduled faults.

The complete `LiveCore` runs; its pointing commands determine the view of the simulated cameras. There are no pictures:
a thousand simulated landings take minutes. The result depends on the seed only.
"""

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.parameters import DGPS_CLOCK, ParameterPrior
from groundstation.geometry.aim import aim_at
from groundstation.live.core import LiveCore, LiveStep, live_config
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.input_queue import Item
from groundstation.messages import PixelMeasurement, PtuSample, ReferenceFix, TrackEstimate, TrackState, TrackStatus
from groundstation.pointing.head_limits import AxisLimits, HeadLimits
from groundstation.pointing.pointing_law import HeadController, PointingConfig
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.rig.rig import Rig, Station
from groundstation.simulation.closed_loop_head import ClosedLoopHead
from groundstation.simulation.station_listener import StationListener
from groundstation.simulation.trajectory import Trajectory
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

_TICK_S = 0.005


class ClosedLoopFaultKind(StrEnum):
    """Faults of a device or process in operation."""

    CAMERA_LOST = "camera lost"
    CAMERA_FROZEN = "camera frozen"
    CAMERA_LATE = "camera late"
    CAMERA_CLOCK_STEPPED = "camera clock stepped"
    PTU_SILENT = "PTU silent"
    PTU_POWER_CYCLED = "PTU power-cycled"
    PTU_SPIKES = "PTU spikes"
    DGPS_GONE = "DGPS gone"
    DGPS_FROZEN = "DGPS frozen"
    DGPS_CLOCK_STEPPED = "DGPS clock stepped"
    PROCESS_KILLED = "process killed"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoopFault:
    """A fault of one station (or, without a name, of the process or the receiver) from ``from_s`` to ``to_s``."""

    kind: ClosedLoopFaultKind
    station: str
    from_s: float
    to_s: float

    def now(self, t_s: float) -> bool:
        """Return whether the fault is active at a time."""
        return self.from_s <= t_s < self.to_s


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosedLoopConfig:
    """The simulated hardware: rates in Hz, delays in s, noise in px, limits of the heads in deg.

    ``ptu_sigma_deg`` and the step are those of the rig. ``late_s`` and ``step_s`` are what a late camera and a stepped
    clock are off. ``dgps_rate_hz`` 0 has no reference receiver; else the filter learns from one, whose clock is
    ``dgps_clock_s`` ahead, and by ``dgps_step_s`` more while it is stepped.
    """

    frame_rate_hz: float = 30.0
    frame_delay_s: float = 0.012
    frame_jitter_s: float = 0.002
    ptu_rate_hz: float = 80.0
    ptu_delay_s: float = 0.004
    head_latency_s: float = 0.02
    head_rate_deg_s: float = 50.0
    head_acceleration_deg_s2: float = 60.0
    pixel_sigma_px: float = 0.5
    miss_share: float = 0.01
    late_s: float = 0.3
    step_s: float = 0.2
    spike_deg: float = 3.0
    homing_s: float = 8.0
    dgps_rate_hz: float = 0.0
    dgps_delay_s: float = 0.12
    dgps_sigma_m: float = 0.02
    dgps_clock_s: float = 0.05
    dgps_step_s: float = 0.1


@dataclass(slots=True)
class ClosedLoopResult:
    """Estimates with the truth at their stamps, and whether the target was near the image centre.

    ``estimates`` with ``truth_m`` (n, 3) at their stamps; ``states`` answer heartbeats; ``inside`` per camera and frame
    whether the target was in the central half of the picture (by width and height), ``at_s`` when.
    """

    estimates: list[TrackEstimate] = field(default_factory=list)
    truth_m: list[FloatArray] = field(default_factory=list)
    states: list[TrackState] = field(default_factory=list)
    inside: list[bool] = field(default_factory=list)
    at_s: list[float] = field(default_factory=list)
    restarts: int = 0

    def squared_errors(self, from_s: float = -math.inf, to_s: float = math.inf) -> FloatArray:
        """Return the normalised squared position errors (n,) of the estimates in [from_s, to_s)."""
        out = []
        for estimate, truth in zip(self.estimates, self.truth_m, strict=True):
            if estimate.kinematics is not None and from_s <= estimate.t_s < to_s:
                error = estimate.kinematics.position_runway_m - truth
                out.append(float(error @ np.linalg.solve(estimate.kinematics.covariance[:3, :3], error)))
        return np.array(out)

    def share(self, status: TrackStatus, from_s: float, to_s: float) -> float:
        """Return the fraction of the estimates in [from_s, to_s) with a track status."""
        of = [e.status is status for e in self.estimates if from_s <= e.t_s < to_s]
        return sum(of) / len(of) if of else 0.0


class ClosedLoopSimulation:
    """One closed-loop simulation of a landing.

    Parameters
    ----------
    rig : of the pipeline.
    true_rig : of the simulated hardware, with the same stations; None for the pipeline's.
    flight : the target point.
    faults : kinds of faults and their times.
    span_m : wing span of the target as in a station file; None if unknown.
    listener : hears the reports; None without.
    """

    def __init__(
        self,
        rig: Rig,
        config: Config,
        flight: Trajectory,
        *,
        faults: Sequence[ClosedLoopFault] = (),
        hardware: ClosedLoopConfig | None = None,
        seed: int = 0,
        span_m: float | None = None,
        listener: StationListener | None = None,
        true_rig: Rig | None = None,
    ) -> None:
        self._rig, self._config, self._flight, self._faults = rig, config, flight, tuple(faults)
        self._span_m, self._listener = span_m, listener
        self._hardware = ClosedLoopConfig() if hardware is None else hardware
        self._random = np.random.default_rng(seed)
        # its own random stream, so that a receiver does not change the other draws
        self._receiver_random = np.random.default_rng([seed, 1])
        self._last_fix_m: FloatArray | None = None
        self._geometries = {s.name: s.geometry() for s in (rig if true_rig is None else true_rig).stations}
        self._frozen: dict[str, tuple[float, float]] = {}
        self._repeated: set[str] = set()
        self._heads: dict[str, ClosedLoopHead] = {}
        self._line: list[tuple[float, int, Callable[[float], None]]] = []
        self._number = 0
        self._result = ClosedLoopResult()
        self._core = self._fresh_core()

    def run(self) -> ClosedLoopResult:
        """Simulate the whole span of the trajectory."""
        start_s, end_s = self._flight.span_s
        begin = self._position(start_s)
        for name, geometry in self._geometries.items():
            aim = aim_at(geometry, begin)
            if aim is None:
                raise ValueError(f"{name}: the flight begins outside the station's range")
            # initial pointing error of about half a degree
            angles = np.array([aim.pan_rad, aim.tilt_rad]) + self._random.normal(0.0, 0.01, 2)
            self._heads[name] = ClosedLoopHead(
                angles,
                latency_s=self._hardware.head_latency_s,
                acceleration_deg_s2=self._hardware.head_acceleration_deg_s2,
            )
        self._schedule(start_s, end_s)
        while self._line:
            now_s, _, action = heapq.heappop(self._line)
            action(now_s)
        self._done(self._core.finish())
        return self._result

    def stop(self) -> None:
        """End the simulation at the present time; for a listener."""
        self._line.clear()

    def _schedule(self, start_s: float, end_s: float) -> None:
        """Schedule all exposures, PTU queries, time steps and restarts."""
        h = self._hardware
        for station in self._rig.stations:
            name, phase_s = station.name, float(self._random.uniform(0.0, 0.002))
            for t in np.arange(start_s + phase_s, end_s, 1.0 / h.frame_rate_hz):
                self._at(float(t), partial(self._expose, name))
            phase_s = float(self._random.uniform(0.0, 1.0 / h.ptu_rate_hz))
            for t in np.arange(start_s + phase_s, end_s, 1.0 / h.ptu_rate_hz):
                self._at(float(t), partial(self._ask, station))
        if h.dgps_rate_hz > 0.0:
            for t in np.arange(start_s + 0.013, end_s, 1.0 / h.dgps_rate_hz):
                self._at(float(t), self._measure)
        for t in np.arange(start_s, end_s, _TICK_S):
            self._at(float(t), self._tick)
        for fault in self._faults:
            if fault.kind is ClosedLoopFaultKind.PROCESS_KILLED:
                self._at(fault.to_s, self._restart)
            if fault.kind is ClosedLoopFaultKind.PTU_POWER_CYCLED:
                self._at(fault.from_s, partial(self._lose_power, fault.station))

    def _at(self, t_s: float, action: Callable[[float], None]) -> None:
        self._number += 1
        heapq.heappush(self._line, (t_s, self._number, action))

    def _is(self, kind: ClosedLoopFaultKind, station: str, t_s: float) -> bool:
        return any(f.kind is kind and f.station == station and f.now(t_s) for f in self._faults)

    @property
    def _dead(self) -> tuple[ClosedLoopFault, ...]:
        return tuple(f for f in self._faults if f.kind is ClosedLoopFaultKind.PROCESS_KILLED)

    # ------------------------------------------------------------------------------------ the hardware
    def _expose(self, name: str, t_s: float) -> None:
        """Project the target into one exposure of a camera."""
        head, geometry = self._heads[name], self._geometries[name]
        head.run_to(t_s)
        projected = geometry.project(self._position(t_s), *(float(a) for a in head.angles))
        size = np.array(geometry.image_size_px)
        pixel = np.full(2, -1.0) if projected is None else projected.pixel
        self._result.inside.append(bool(np.all(np.abs(pixel - 0.5 * size) <= 0.25 * size)))
        self._result.at_s.append(t_s)
        self._look(name, t_s, pixel, size)

    def _look(self, name: str, t_s: float, pixel: FloatArray, size: FloatArray) -> None:
        """Schedule the delivery of a noisy measurement of ``pixel`` (2,), if it is inside the image of ``size``."""
        h = self._hardware
        noise = self._random.normal(0.0, h.pixel_sigma_px, 2)
        missed = self._random.random() < h.miss_share
        delay_s = h.frame_delay_s + abs(float(self._random.normal(0.0, h.frame_jitter_s)))
        found = (float(pixel[0] + noise[0]), float(pixel[1] + noise[1]))
        if self._is(ClosedLoopFaultKind.CAMERA_FROZEN, name, t_s):
            # a camera reader accepts one repeated picture and discards the following ones as frozen
            missed = missed or name in self._repeated
            self._repeated.add(name)
            found = self._frozen.setdefault(name, found)
        else:
            self._frozen[name] = found
        if (
            missed
            or self._is(ClosedLoopFaultKind.CAMERA_LOST, name, t_s)
            or not np.all((pixel >= 0) & (pixel <= size - 1))
        ):
            return
        delay_s += h.late_s * self._is(ClosedLoopFaultKind.CAMERA_LATE, name, t_s)
        stamp_s = t_s + h.step_s * self._is(ClosedLoopFaultKind.CAMERA_CLOCK_STEPPED, name, t_s)
        shot = PixelMeasurement(t_s=stamp_s, station=name, epoch=0, u_px=found[0], v_px=found[1])
        self._at(t_s + delay_s, partial(self._deliver, shot))

    def _ask(self, station: Station, t_s: float) -> None:
        """Read the angles of a head from its encoders."""
        head, name, h = self._heads[station.name], station.name, self._hardware
        head.run_to(t_s)
        noise = self._random.normal(0.0, max(station.ptu_sigma_rad, 1e-9), 2)
        spike = self._random.random() < 0.05 and self._is(ClosedLoopFaultKind.PTU_SPIKES, name, t_s)
        if self._is(ClosedLoopFaultKind.PTU_SILENT, name, t_s) or self._homing(name, t_s):
            return
        shown = head.angles + noise + (math.radians(h.spike_deg) if spike else 0.0)
        if station.ptu_resolution_rad > 0:
            shown = np.round(shown / station.ptu_resolution_rad) * station.ptu_resolution_rad
        sample = PtuSample(t_s=t_s, station=name, pan_rad=float(shown[0]), tilt_rad=float(shown[1]))
        self._at(t_s + h.ptu_delay_s, partial(self._deliver, sample))

    def _measure(self, t_s: float) -> None:
        """Take a fix of the reference receiver; its reader discards repeated positions."""
        h = self._hardware
        place = self._position(t_s) + self._receiver_random.normal(0.0, h.dgps_sigma_m, 3)
        if self._is(ClosedLoopFaultKind.DGPS_FROZEN, "", t_s) and self._last_fix_m is not None:
            place = self._last_fix_m
        repeated, self._last_fix_m = place is self._last_fix_m, place
        if repeated or self._is(ClosedLoopFaultKind.DGPS_GONE, "", t_s):
            return
        stamp_s = t_s + h.dgps_clock_s + h.dgps_step_s * self._is(ClosedLoopFaultKind.DGPS_CLOCK_STEPPED, "", t_s)
        fix = ReferenceFix(t_s=stamp_s, position_runway_m=place, sigma_m=np.full(3, h.dgps_sigma_m))
        self._at(t_s + h.dgps_delay_s, partial(self._deliver, fix))

    def _homing(self, name: str, t_s: float) -> bool:
        """Return whether a power-cycled head is still homing; it neither answers queries nor executes commands."""
        return any(
            f.kind is ClosedLoopFaultKind.PTU_POWER_CYCLED
            and f.station == name
            and 0 <= t_s - f.from_s < self._hardware.homing_s
            for f in self._faults
        )

    def _lose_power(self, name: str, t_s: float) -> None:
        """Start the homing of a head to zero after a power cycle."""
        head = self._heads[name]
        head.run_to(t_s)
        head.home(t_s + self._hardware.homing_s)

    # ------------------------------------------------------------------------------------- the station
    def _deliver(self, item: Item | PixelMeasurement, now_s: float) -> None:
        if not any(f.now(now_s) for f in self._dead):
            self._done(self._core.take(item, now_s))

    def _tick(self, now_s: float) -> None:
        if not any(f.now(now_s) for f in self._dead):
            self._done(self._core.pass_time(now_s))
            if self._listener is not None:
                self._listener.pass_time(now_s, self._core.pipeline.estimate_at)

    def _restart(self, _: float) -> None:
        self._core = self._fresh_core()
        self._result.restarts += 1

    def _done(self, taken: LiveStep) -> None:
        """Execute the pointing commands and record the estimates with the truth."""
        for command in taken.commands:
            # a silent head does not receive commands either
            silent = self._is(ClosedLoopFaultKind.PTU_SILENT, command.station, command.t_s)
            if not silent and not self._homing(command.station, command.t_s):
                rates = np.array([command.pan_rate_rad_s, command.tilt_rate_rad_s])
                self._heads[command.station].tell(command.t_s, rates)
        for report in taken.reports:
            if self._listener is not None:
                self._listener.note(report)
            self._result.states += report.states
            for estimate in report.estimates:
                self._result.estimates.append(estimate)
                self._result.truth_m.append(self._position(estimate.t_s))

    def _position(self, t_s: float) -> FloatArray:
        return np.asarray(self._flight.position(np.array([t_s]))[0], np.float64)

    def _fresh_core(self) -> LiveCore:
        h = self._hardware
        axis = AxisLimits(
            low_rad=-math.pi / 2,
            high_rad=math.pi / 2,
            fastest_rad_s=math.radians(h.head_rate_deg_s),
            acceleration_rad_s2=math.radians(h.head_acceleration_deg_s2),
        )
        limits = HeadLimits(pan=axis, tilt=axis)
        stated = {s.name: s.geometry() for s in self._rig.stations}
        config = live_config(self._config, h.frame_rate_hz)
        clock = ParameterPrior.independent([f"{DGPS_CLOCK}.offset"], [config.estimation.reference_clock_sigma_s])
        return LiveCore(
            Pipeline(self._rig, config, span_m=self._span_m, reference_errors=clock if h.dgps_rate_hz > 0.0 else None),
            FramePairer(self._rig.names, 1.0 / h.frame_rate_hz),
            {n: HeadController(g, limits, PointingConfig(latency_s=h.head_latency_s)) for n, g in stated.items()},
            SearchPattern(stated, SearchConfig()),
        )
