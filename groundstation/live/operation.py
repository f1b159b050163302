"""A station in operation: device input, one pipeline, output to heads, recorders and operator; orderly shutdown.

One thread steps the pipeline; each device has its own. The session's clock is the host's monotonic clock from the start
of the operation on: a wall clock that is set, or jumps, moves nothing.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from groundstation.approach.approach_outputs import ApproachOutputs, ApproachSummary
from groundstation.estimation.parameters import ParameterPrior
from groundstation.integrity.approach_advice import ApproachAdvice
from groundstation.landing.glide_path import ApproachDeviations
from groundstation.landing.touchdown import TouchdownForecast
from groundstation.landing_site.runway import LandingRunway
from groundstation.live.camera_status import clock_status, lost_frames
from groundstation.live.camera_worker import CameraWorker
from groundstation.live.core import LiveCore, LiveStep
from groundstation.live.frame_pairing import FramePairer, LoadShedder
from groundstation.live.head_controllers import head_controllers
from groundstation.live.head_log import HeadState
from groundstation.live.head_manager import HeadManager
from groundstation.live.input_queue import DeviceLogLine, InputQueue, Item, TimedPicture
from groundstation.live.reference_worker import ReferenceWorker
from groundstation.live.shutdown import Shutdown
from groundstation.live.station_file import StationFile
from groundstation.live.status_board import DeviceState, LiveStatus, StatusBoard
from groundstation.messages import Event, Frame, Kinematics, PtuSample, StepReport, TrackEvent, TrackStatus
from groundstation.pointing.search_pattern import SearchPattern
from groundstation.rig.rig import Rig
from groundstation.sinks.sink import Sink
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.thread_scheduling import short_gil_switch_interval
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.registered_heads import RegisteredHeads
from groundstation.tracking.warm_up import warm_up
from ptu_drivers.health import UnitState

_WAIT_S = 0.01
_STATUS_EVERY_S = 0.5  # and at once when time alone, or a lost process, has changed it
_PARKED_RAD = 0.01
_NEVER = 1e9


class EventSink(Protocol):
    """Receives every event that the pipeline consumes, each before the reports that result from it."""

    def take(self, event: Event) -> None:
        """Take one event; never waits."""


class StatusSink(Protocol):
    """Receives the operator's status twice a second."""

    def update(self, status: LiveStatus) -> None:
        """Take it; never waits long."""


@runtime_checkable
class ApproachSink(Protocol):
    """A sink that also shows what is known of an approach."""

    def show_approach(
        self,
        t_s: float,
        advice: ApproachAdvice | None,
        deviations: ApproachDeviations | None,
        touchdown: TouchdownForecast | None,
        runway: LandingRunway,
    ) -> None:
        """Take it; never waits long."""


# from the pipeline's ``estimate_at`` and the session's clock
ApproachOpener = Callable[[Callable[[float], Kinematics | None], Callable[[], float]], ApproachOutputs]


@dataclass(frozen=True, slots=True, kw_only=True)
class OperationResult:
    """Statistics of an operation.

    ``epochs`` pairs were answered, ``dropped`` counts what was not step, ``latency_*`` from a pair's first frame at
    the host to its answer, ``tracking_*`` while tracking, 0 where there is none; ``counts`` are the pipeline's;
    ``busy_s`` is what its thread computed in ``elapsed_s``; ``approach`` is what came of the outputs of an approach.
    """

    elapsed_s: float
    epochs: int
    tracked: int
    latency_p50_ms: float
    latency_p99_ms: float
    tracking_p50_ms: float
    tracking_p99_ms: float
    dropped: Mapping[str, int]
    counts: Mapping[str, int]
    busy_s: float
    approach: ApproachSummary | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OperationOutputs:
    """Receivers of an operation's results.

    ``sinks`` get every report, the recorder among them, ``recorders`` every event and ``operators`` the status;
    ``approach`` opens what watches the approach and sends it, given the pipeline's ``estimate_at`` and the session's
    clock; None for nothing. A sink that is an `ApproachSink` gets what is known of it after estimates and changes.
    ``extra_status`` returns the status of recorder and screen, ``keep_images`` leaves the pictures in the reports for
    a screen.
    """

    sinks: Sequence[Sink] = ()
    recorders: Sequence[EventSink] = ()
    operators: Sequence[StatusSink] = ()
    approach: ApproachOpener | None = None
    extra_status: Callable[[], str] = str
    keep_images: bool = False


class Operation:
    """One run of a station.

    Parameters
    ----------
    file, rig, config : the station's devices, geometry and tuning.
    outputs : receivers of the results; none by default.
    clock : monotonic, s; the devices stamp with the same one.
    start_s : the session's time zero on that clock; None for now.
    reference_errors : prior of the errors of a reference receiver that the filter learns from; None without one.
    heads : takes angles from the pictures; by default as the file's panorama has them.
    """

    def __init__(
        self,
        file: StationFile,
        rig: Rig,
        config: Config,
        outputs: OperationOutputs | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
        start_s: float | None = None,
        reference_errors: ParameterPrior | None = None,
        heads: RegisteredHeads | None = None,
    ) -> None:
        self._file, self._rig, self._config = file, rig, config
        outputs = outputs or OperationOutputs()
        self._sinks, self._recorders, self._operators = outputs.sinks, outputs.recorders, outputs.operators
        self._clock, self._extra_status, self._keep_images = clock, outputs.extra_status, outputs.keep_images
        self._reference_errors, self._open_approach = reference_errors, outputs.approach
        self._heads = file.registered_heads(rig) if heads is None else heads
        self._reference: ReferenceWorker | None = None
        self._approach_sinks = [sink for sink in self._sinks if isinstance(sink, ApproachSink)]
        self._approach: ApproachOutputs | None = None
        self.start_s = clock() if start_s is None else start_s
        self.input_queue = InputQueue(together_s=0.5 / file.rate_hz)
        self._board = StatusBoard()
        self._epochs, self._tracked, self._busy_s = 0, 0, 0.0
        self._shown_s, self._shown_track = -_NEVER, TrackStatus.SEARCHING
        self._shown_changes = 0

    @property
    def now_s(self) -> float:
        """Session time, s."""
        return self._clock() - self.start_s

    def log(self, level: str, text: str) -> None:
        """Add a line to the log; thread-safe."""
        self.input_queue.put(DeviceLogLine(t_s=self.now_s, level=level, text=text))

    def run(
        self,
        cameras: Mapping[str, LiveCamera],
        heads: HeadManager,
        until: Callable[[], bool],
        reference: ReferenceWorker | None = None,
        shutdown: Shutdown | None = None,
    ) -> OperationResult:
        """Operate until ``until`` is set, then park the heads, and process everything that waits.

        Heads are parked as long as ``shutdown`` allows, and not at all once their process is lost.
        The devices are already open, and the caller closes them; ``reference`` opens its line itself.
        """
        warm_up(self._config.detection.detector)
        workers = [CameraWorker(n, c, self.input_queue, -self.start_s) for n, c in cameras.items()]
        core = self._core(heads)
        with ExitStack() as stack:
            if self._open_approach is not None:
                self._approach = self._open_approach(core.pipeline.estimate_at, lambda: self.now_s)
                stack.callback(self._approach.close)
            stack.enter_context(short_gil_switch_interval())
            for worker in workers:
                stack.callback(worker.stop)
                worker.start()
            heads.start(self.input_queue)
            self._reference = reference
            if reference is not None:
                stack.callback(reference.stop)
                reference.start()
            began_s = self.now_s
            while not until():
                self._cycle(core, heads, workers, self.input_queue.get(_WAIT_S))
            shutdown = shutdown or Shutdown(until, clock=self._clock)
            shutdown.begin()
            core.park({s.name: s.head.park_rad for s in self._file.stations if s.head is not None})
            self.log("info", "parking")
            while shutdown.may_park() and heads.running and core.not_parked(self.now_s, _PARKED_RAD, heard=True):
                item = self.input_queue.get(_WAIT_S)
                # what is seen while the heads swing away is of no use
                self._cycle(core, heads, workers, None if isinstance(item, TimedPicture) else item)
            for line in core.not_parked(self.now_s, _PARKED_RAD):
                self._dispatch(core.take(DeviceLogLine(t_s=self.now_s, level="warning", text=line), self.now_s), heads)
            self._dispatch(core.finish(), heads)
            if self._approach is not None:
                self._log_events(self._approach.finish())
        return OperationResult(
            elapsed_s=self.now_s - began_s,
            epochs=self._epochs,
            tracked=self._tracked,
            latency_p50_ms=self._board.latency_ms(50),
            latency_p99_ms=self._board.latency_ms(99),
            tracking_p50_ms=self._board.latency_ms(50, tracking=True),
            tracking_p99_ms=self._board.latency_ms(99, tracking=True),
            dropped=self._dropped(core),
            counts=core.pipeline.counts,
            busy_s=self._busy_s,
            approach=None if self._approach is None else self._approach.summary(),
        )

    # ------------------------------------------------------------------------------------- one turn
    def _cycle(self, core: LiveCore, heads: HeadManager, cameras: Sequence[CameraWorker], item: Item | None) -> None:
        began_s = self.now_s
        if isinstance(item, TimedPicture) and self._load_shedder.drops(
            item.station, item.t_s, self.input_queue.frames_waiting
        ):
            item = None
        known_s = self._known_s(item, began_s)
        step = core.pass_time(began_s, known_s) if item is None else core.take(item, began_s, known_s)
        if isinstance(item, TimedPicture):
            for event in step.consumed:
                if isinstance(event, Frame):
                    self._board.arrived(event.epoch, item.arrived_s)
        self._dispatch(step, heads)
        now_s = self.now_s
        if self._approach is not None:
            self._follow_approach(self._approach, self._approach.pass_time(now_s))
        if item is not None:
            self._busy_s += now_s - began_s
        track_changed = core.status is not self._shown_track and any(report.states for report in step.reports)
        changed = heads.log.changes != self._shown_changes
        if track_changed or changed or now_s - self._shown_s >= _STATUS_EVERY_S:
            self._shown_s, self._shown_track, self._shown_changes = now_s, core.status, heads.log.changes
            core.set_delays({n: h.delay_s for n, h in heads.states.items()}, self._file.pointing.latency_s)
            self._publish_status(core, heads, cameras, now_s)

    def _known_s(self, item: Item | None, now_s: float) -> float:
        """Return up to when the devices' records have been step, ``item`` included: now, unless more waits."""
        if not len(self.input_queue):
            return now_s
        return item.t_s if isinstance(item, TimedPicture | PtuSample) else -_NEVER

    def _dispatch(self, step: LiveStep, heads: HeadManager) -> None:
        for command in step.commands:
            heads.send_command(command)
        for event in step.consumed:
            for recorder in self._recorders:
                recorder.take(event)
        for report in step.reports:
            now_s = self.now_s
            for estimate in report.estimates:
                self._epochs += 1
                self._tracked += estimate.status is TrackStatus.TRACKING
                self._board.answered(estimate, now_s)
            for state in report.states:
                self._board.passed(state)
            for sink in self._sinks:
                sink.write(report)
            if self._approach is not None:
                events = self._approach.note(report, now_s)
                self._follow_approach(self._approach, events, seen=bool(report.estimates))

    def _follow_approach(self, approach: ApproachOutputs, events: Sequence[TrackEvent], *, seen: bool = False) -> None:
        """Log lines of the approach; show its state after estimates and after each line."""
        self._log_events(events)
        if seen or events:
            known = approach.state
            for sink in self._approach_sinks:
                sink.show_approach(self.now_s, known.advice, known.deviations, known.touchdown, approach.runway)

    def _log_events(self, events: Sequence[TrackEvent]) -> None:
        """Give lines of the approach to the sinks: log, recording, screen."""
        if events:
            for sink in self._sinks:
                sink.write(StepReport(events=tuple(events)))

    def _publish_status(
        self, core: LiveCore, heads: HeadManager, cameras: Sequence[CameraWorker], now_s: float
    ) -> None:
        states = [self._camera_state(c, now_s) for c in cameras] + [
            self._head_state(n, h, now_s) for n, h in heads.states.items()
        ]
        if self._reference is not None:
            rate_hz = self._board.rate("DGPS", self._reference.fixes, now_s)
            contradicted = core.pipeline.counts["references_refused"]
            states.append(self._reference.state(now_s, rate_hz, contradicted))
        dropped = self._dropped(core)
        approach = () if self._approach is None else self._approach.lines(now_s)
        status = self._board.status(now_s, core.status, tuple(states), dropped, self._extra_status(), approach)
        for operator in self._operators:
            operator.update(status)

    def _dropped(self, core: LiveCore) -> dict[str, int]:
        dropped = {what: n for what, n in self.input_queue.dropped.items() if n} | core.refused
        return dropped | ({"pairs, being behind": self._load_shedder.pairs} if self._load_shedder.pairs else {})

    def _camera_state(self, worker: CameraWorker, now_s: float) -> DeviceState:
        camera, found = worker.camera, worker.camera.read_back
        clock = clock_status(camera.clock_state, has_clock=found is None or found.device_clock)
        lost, name = lost_frames(camera.counts, worker.counts_before), f"{worker.station} camera"
        note = ", ".join(w for w in (lost, clock) if w)
        rate = self._board.rate(name, worker.frames, now_s)
        return DeviceState(name=name, rate_hz=rate, age_s=now_s - worker.newest_s, note=note, trouble=bool(lost))

    def _head_state(self, station: str, head: HeadState, now_s: float) -> DeviceState:
        note, name = head.state + (f", {head.failures} answers rejected" if head.failures else ""), f"{station} PTU"
        rate = self._board.rate(name, head.readings, now_s)
        bad = bool(head.failures) or head.state not in ("", UnitState.READY)
        return DeviceState(name=name, rate_hz=rate, age_s=now_s - head.newest_s, note=note, trouble=bad)

    # --------------------------------------------------------------------------------------- set-up
    def _pipeline(self) -> Pipeline:
        return Pipeline(
            self._rig,
            self._config,
            span_m=self._file.span_m,
            stopwatch=self._clock,
            keep_images=self._keep_images,
            reference_errors=self._reference_errors,
            heads=self._heads,
        )

    def _core(self, heads: HeadManager) -> LiveCore:
        geometries = {s.name: s.geometry() for s in self._rig.stations}
        limits = {name: head.limits for name, head in heads.states.items()}
        controllers = head_controllers(self._file, self._rig, limits, self.start_s)
        period_s = 1.0 / self._file.rate_hz
        pairing = FramePairer(self._rig.names, period_s)
        self._load_shedder = LoadShedder(pairing, period_s, most=len(self._rig.names) + 1)
        return LiveCore(self._pipeline(), pairing, controllers, SearchPattern(geometries, self._file.search), self._rig)
