"""Core of a live station: pairs frames, steps the pipeline, commands the heads. No thread, no clock, no device.

Items come in the order in which they arrived, and with them the time; out come the events that the pipeline consumed
(for the recorder: nothing else is consumed), its reports, and the commands to the heads. So a day in the field can be
run again, and a thousand bad days can be run in a test.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.live.finite_values import refused
from groundstation.live.frame_pairing import FramePairer
from groundstation.live.input_queue import DeviceLogLine, Item, TimedPicture
from groundstation.messages import (
    Epoch,
    Event,
    FilterReset,
    Frame,
    Heartbeat,
    PixelMeasurement,
    PointingCommand,
    PtuSample,
    Purpose,
    StepReport,
    TrackEvent,
    TrackStatus,
)
from groundstation.pointing.pointing_law import HeadController
from groundstation.pointing.search_pattern import SearchPattern
from groundstation.rig.ptu_axes import AxisCorrection
from groundstation.rig.rig import EQUAL_CLOCKS, Rig
from groundstation.tracking.config import Config
from groundstation.tracking.log_throttle import LogThrottle
from groundstation.tracking.pipeline import Pipeline

# period of the pointing commands, s
COMMAND_EVERY_S = 0.03
# with no pair answered and no heartbeat for so long there is one
HEARTBEAT_EVERY_S = 0.1
# without a pair for so many periods the track coasts, if that is longer than in the tuning: one pair may be missing
_COAST_PERIODS = 2.5
# numerical failures of the filter
_FAILED = (ArithmeticError, np.linalg.LinAlgError)
# the angles of a head that has been silent for longer are unknown
_SILENT_S = 1.0
# how far ahead a target is extrapolated for a head
_FURTHEST_AHEAD_S = 1.0


def live_config(config: Config, rate_hz: float, rig: Rig | None = None) -> Config:
    """Return the tuning with what is known of cameras that run at a rate, and of the lags that a rig states.

    No frame comes half a period early, from pair to pair a track does not coast, and records wait for those that lag.
    """
    config = replace(config, synchronise=replace(config.synchronise, hold_s=config.synchronise.hold_s + _apart_s(rig)))
    coast_s = max(config.estimation.coast_after_s, _COAST_PERIODS / rate_hz)
    config = replace(config, estimation=replace(config.estimation, coast_after_s=coast_s))
    if config.synchronise.camera_gap_s > 0.0:
        return config
    return replace(config, synchronise=replace(config.synchronise, camera_gap_s=0.5 / rate_hz))


def _apart_s(rig: Rig | None) -> float:
    """Return by how much a rig's slowest device lags behind its fastest, s."""
    if rig is None:
        return 0.0
    clocks = [station.camera_clock or EQUAL_CLOCKS for station in rig.stations]
    clocks += [station.ptu_clock for station in rig.stations if not station.fixed]
    offsets_s = [clock.offset_s for clock in clocks]
    return max(offsets_s) - min(offsets_s)


@dataclass(slots=True)
class LiveStep:
    """Output of one step: events consumed, reports and pointing commands."""

    consumed: list[Event] = field(default_factory=list)
    reports: list[StepReport] = field(default_factory=list)
    commands: list[PointingCommand] = field(default_factory=list)


class LiveCore:
    """One pipeline in operation.

    Parameters
    ----------
    pipeline : fresh.
    pairing : of its cameras.
    heads : of the stations that turn.
    pattern : where to look while there is no target.
    rig : corrects readings by ``ptu_clock`` and ``ptu_axes``, the heads' in time alone, and frames by ``camera_clock``;
        without, they are angles at session times. Frames are paired by their stamps as they come.

    ``refused`` counts the items that are not used because a value is not finite, by kind.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        pairing: FramePairer,
        heads: Mapping[str, HeadController],
        pattern: SearchPattern,
        rig: Rig | None = None,
    ) -> None:
        self.pipeline = pipeline
        self.status = TrackStatus.SEARCHING
        self.refused: Counter[str] = Counter()
        self._pairing = pairing
        self._heads = heads
        self._pattern = pattern
        stations = () if rig is None else rig.stations
        self._camera_clocks = {s.name: s.camera_clock or EQUAL_CLOCKS for s in stations}
        self._reading_corrections = {s.name: (s.ptu_clock, AxisCorrection(s.ptu_axes)) for s in stations}
        self._commanded_s = -math.inf
        # the newest pair or heartbeat
        self._answered_s = -math.inf
        self._parking: Mapping[str, tuple[float, float]] | None = None
        self._ahead_s = 0.0
        self._lines: list[TrackEvent] = []
        self._throttle = LogThrottle(
            lambda t_s, text: self._lines.append(TrackEvent(t_s=t_s, level="warning", text=text))
        )

    def take(self, item: Item | PixelMeasurement, now_s: float, known_s: float | None = None) -> LiveStep:
        """Take one item at session time ``now_s``; ``known_s`` as in `pass_time`."""
        step = LiveStep()
        refusal = refused(item)
        if refusal is not None:
            self.refused[refusal.kind] += 1
            self._throttle.take(now_s, refusal.line)
        elif isinstance(item, DeviceLogLine):
            line = TrackEvent(t_s=item.t_s, level=item.level, text=item.text)
            step.reports.append(StepReport(events=(line,)))
        elif isinstance(item, (TimedPicture, PixelMeasurement)):
            paired = self._pairing.frame(item.station, item.t_s, now_s)
            self._close(paired.closed_before, step)
            self._step(self._numbered(item, paired.epoch), step)
            self._close(paired.closed_after, step)
        elif isinstance(item, PtuSample):
            self._take_reading(item, step)
        else:
            self._step(item, step)
        self._pass_time(now_s, now_s if known_s is None else known_s, step)
        return step

    def _numbered(self, item: TimedPicture | PixelMeasurement, epoch: int) -> Frame | PixelMeasurement:
        """Return a frame of a pair, at the session time of its exposure."""
        t_s = self._camera_clocks.get(item.station, EQUAL_CLOCKS).session_from_device(item.t_s)
        if isinstance(item, TimedPicture):
            return Frame(t_s=t_s, station=item.station, epoch=epoch, image=item.picture)
        return replace(item, t_s=t_s, epoch=epoch)

    def _close(self, epochs: Iterable[Epoch], step: LiveStep) -> None:
        """Close pairs, each at the mean of its frames' session times."""
        for epoch in epochs:
            later = [
                self._camera_clocks.get(n, EQUAL_CLOCKS).session_from_device(epoch.t_s) - epoch.t_s
                for n in epoch.stations
            ]
            self._step(replace(epoch, t_s=epoch.t_s + sum(later) / max(len(later), 1)), step)

    def _take_reading(self, reading: PtuSample, step: LiveStep) -> None:
        """Give the head its reading and the pipeline the angles, both at the session time of the motion."""
        if reading.station in self._reading_corrections:
            clock, axes = self._reading_corrections[reading.station]
            reading = replace(reading, t_s=clock.session_from_device(reading.t_s))
            pan_rad, tilt_rad = axes.angles(reading.pan_rad, reading.tilt_rad)
            angles = replace(reading, pan_rad=pan_rad, tilt_rad=tilt_rad)
        else:
            angles = reading
        if reading.station in self._heads:
            self._heads[reading.station].read(reading)
        self._step(angles, step)

    def pass_time(self, now_s: float, known_s: float | None = None) -> LiveStep:
        """Close a pair that will not be completed, send a heartbeat, and tell the heads where to turn, if it is time.

        ``known_s`` is the time up to which all that was delivered has been step, ``now_s`` unless more waits: what
        waits may yet hold the target.
        """
        step = LiveStep()
        self._pass_time(now_s, now_s if known_s is None else known_s, step)
        return step

    def _pass_time(self, now_s: float, known_s: float, step: LiveStep) -> None:
        beat_s = min(now_s, known_s)
        if self._pairing.overdue(beat_s):
            self._close(self._pairing.flush(), step)
        self._throttle.pass_time(now_s)
        if beat_s >= self._answered_s + HEARTBEAT_EVERY_S:
            self._answered_s = beat_s
            self._step(Heartbeat(t_s=beat_s), step)
        if now_s >= self._commanded_s + COMMAND_EVERY_S:
            self._commanded_s = now_s
            try:
                step.commands += self._commands(now_s)
            except _FAILED as fault:
                self._reset_filter(fault, now_s, step, in_vain=False)
                step.commands += self._commands(now_s)
        self._report_lines(step)

    def _report_lines(self, step: LiveStep) -> None:
        """Report the lines of the log that wait."""
        if self._lines:
            step.reports.append(StepReport(events=tuple(self._lines)))
            self._lines.clear()

    def set_delays(self, seconds: Mapping[str, float], latency_s: float) -> None:
        """Say how long each head's line has lately step from command to acknowledgement, and the head after that."""
        for name, delay_s in seconds.items():
            self._heads[name].latency_s = max(delay_s, 0.0) + latency_s

    def park(self, angles_rad: Mapping[str, tuple[float, float]]) -> None:
        """Drive each head to its parking angles (pan, tilt), rad, from now on; no search, no tracking."""
        self._parking = angles_rad

    def not_parked(self, now_s: float, within_rad: float, *, heard: bool = False) -> list[str]:
        """Return a line for each head that is not at its parking angles; unless ``heard``, for silent ones, too."""
        lines = []
        for name, (pan_rad, tilt_rad) in (self._parking or {}).items():
            head = self._heads.get(name)
            if head is None:
                continue
            age_s, off_rad = head.age_s(now_s), head.off_rad(pan_rad, tilt_rad, now_s)
            words = ""
            if not math.isfinite(age_s):
                words = "" if heard else "has reported no angles, and may not be parked"
            elif age_s > _SILENT_S and not heard:
                # a command sent does not prove a motion
                words = f"has not answered for {age_s:.1f} s, and may not be parked"
            elif off_rad > within_rad:
                words = f"has not parked, it is {math.degrees(off_rad):.1f}° off"
            if words:
                lines.append(f"station {name}: the head {words}")
        return lines

    def finish(self) -> LiveStep:
        """Flush the pairs that are still open and finish the pipeline."""
        step = LiveStep()
        self._close(self._pairing.flush(), step)
        t_s = self.pipeline.time_s or 0.0
        try:
            report = self.pipeline.finish()
        except _FAILED as fault:
            # angles before the reset: a replay has to know them when it comes to these frames
            step.consumed += self.pipeline.heads.take_found()
            self._reset_filter(fault, self.pipeline.time_s or t_s, step, in_vain=False)
        else:
            step.consumed += self.pipeline.heads.take_found()
            step.reports.append(report)
        # time is unknown after a reset
        t_s, notes = self.pipeline.time_s or t_s, self.pipeline.heads.notes()
        self._throttle.finish()
        self._lines += [TrackEvent(t_s=t_s, level="info", text=text) for text in notes]
        self._report_lines(step)
        return step

    def _step(self, event: Event, step: LiveStep) -> None:
        try:
            report = self.pipeline.step(event)
        except _FAILED as fault:
            # numerical failure: reset the filter
            self._note_consumed(event, step)
            self._reset_filter(fault, event.t_s, step, in_vain=True)
        else:
            self._note_consumed(event, step)
            self._note_report(report, step)

    def _note_consumed(self, event: Event, step: LiveStep) -> None:
        """Note an event, and before it the angles that it made the pipeline take from pictures: a replay has none."""
        step.consumed += [*self.pipeline.heads.take_found(), event]

    def _reset_filter(self, fault: Exception, t_s: float, step: LiveStep, *, in_vain: bool) -> None:
        """Reset the pipeline by a `FilterReset` event, which is recorded so that a replay resets it too."""
        self.status = TrackStatus.SEARCHING
        reset = FilterReset(t_s=t_s, why=f"{type(fault).__name__}: {fault}", in_vain=in_vain)
        step.consumed.append(reset)
        self._note_report(self.pipeline.step(reset), step)

    def _note_report(self, report: StepReport, step: LiveStep) -> None:
        for estimate in report.estimates:
            self.status = estimate.status
            self._answered_s = max(self._answered_s, estimate.t_s)
            if estimate.kinematics is not None and estimate.status is TrackStatus.TRACKING:
                self._pattern.seen(estimate.t_s, estimate.kinematics)
        for state in report.states:
            self.status = state.status
        if not report.empty:
            step.reports.append(report)

    def _commands(self, now_s: float) -> list[PointingCommand]:
        if any(head.keep_out is not None for head in self._heads.values()):
            self._ahead_s = self._pattern.ahead_s(now_s, lambda point_m: self._may_look(now_s, point_m), self._ahead_s)
        commands = [self._command(name, head, now_s) for name, head in self._heads.items()]
        for name, head in self._heads.items():
            if head.keep_out is not None and head.keep_out.held:
                self._throttle.take(now_s, f"{name}: {head.keep_out.held}")
        return commands

    def _command(self, name: str, head: HeadController, now_s: float) -> PointingCommand:
        if self._parking is not None:
            if name not in self._parking:
                return head.hold(now_s)
            return head.go_to(now_s, *self._parking[name], Purpose.PARK)
        if self.status in (TrackStatus.TRACKING, TrackStatus.COASTING, TrackStatus.ACQUIRING):
            held = self._target(now_s)
            if held is not None:
                return head.follow(now_s, self._target)
        return head.follow(now_s, lambda t_s: self._pattern.point(t_s + self._ahead_s), Purpose.SEARCH)

    def _may_look(self, now_s: float, point_m: FloatArray) -> bool:
        """Return whether no head is kept from looking at a point (3,)."""
        return all(head.may_look_at(now_s, point_m) for head in self._heads.values())

    def _target(self, t_s: float) -> FloatArray | None:
        """Return where the target is at a session time; None without one, or too far ahead of what is known."""
        newest_s = self.pipeline.time_s
        if newest_s is None or t_s > newest_s + _FURTHEST_AHEAD_S:
            return None
        kinematics = self.pipeline.estimate_at(t_s)
        return None if kinematics is None else kinematics.position_runway_m
