"""The order of things, written once: event in → synchronise → predict → look → update → report out.

`Pipeline.step` takes one event and returns what it brought forth. It reads no clock and touches no file: two
runs over the same events give the same reports. The only time it knows besides the events' own is a
stopwatch handed in by the caller, which goes into ``elapsed_s`` and ``latency_s`` and nowhere else.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

from groundstation.estimation.encoders import EncoderFeed
from groundstation.estimation.late_measurements import LateMeasurementBuffer
from groundstation.estimation.parameters import ParameterPrior, rig_prior
from groundstation.estimation.recorded_ekf import ROUNDING_S, RecordedEkf
from groundstation.estimation.smoother import Smoother
from groundstation.messages import (
    CameraReport,
    CarriedError,
    DetectionStatus,
    Epoch,
    Event,
    FilterReset,
    Frame,
    Heartbeat,
    InitialState,
    Kinematics,
    PixelMeasurement,
    PtuSample,
    ReferenceFix,
    StepReport,
    TrackEstimate,
)
from groundstation.rig.rig import Rig
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel
from groundstation.tracking.config import Config
from groundstation.tracking.epoch import EpochBuffer
from groundstation.tracking.frame_update import FrameUpdate, span_prior_sigma
from groundstation.tracking.log_throttle import LogThrottle
from groundstation.tracking.pending_report import PendingReport
from groundstation.tracking.reference_update import ReferenceUpdate
from groundstation.tracking.station_health import StationHealth
from groundstation.tracking.synchronise import LateReading, LateReference, Ready, ReadyFrame, Synchroniser
from groundstation.tracking.track_manager import TrackManager


class Pipeline:
    """One target, N stations, events in and reports out.

    Parameters
    ----------
    rig : calibrated stations.
    config : tuning.
    span_m : the target's wing span in m, or None if unknown.
    initial : where to start; None searches.
    stopwatch : a clock for measuring effort, in s; the default measures nothing.
    keep_images : whether reports carry the images (for a viewer that has no video to refer to).
    reference_errors : what is not known of the reference positions that will come: their clock, their antenna.
    """

    def __init__(
        self,
        rig: Rig,
        config: Config,
        *,
        span_m: float | None = None,
        initial: InitialState | None = None,
        stopwatch: Callable[[], float] = lambda: 0.0,
        keep_images: bool = False,
        reference_errors: ParameterPrior | None = None,
    ) -> None:
        rig.require_known()
        self._rig, self._config, self._span_m = rig, config, span_m
        self._stopwatch = stopwatch
        self._keep_images = keep_images
        self._reference_errors = reference_errors
        self._before: Counter[str] = Counter()
        self._found: Callable[[float, Kinematics], None] | None = None
        self.taught_until_s: float | None = None
        self._begin(initial)

    def _begin(self, initial: InitialState | None) -> None:
        """Know nothing but what stands in the rig, and where to start."""
        rig, config, span_m = self._rig, self._config, self._span_m
        self._cameras = {s.name: CameraTracker(s, config) for s in rig.stations}
        geometries = {name: c.geometry for name, c in self._cameras.items()}
        turning = tuple(s.name for s in rig.stations if not s.fixed)
        prior = rig_prior(rig, self._reference_errors).with_span(span_prior_sigma(span_m))
        self._ekf = RecordedEkf(geometries, turning, config.estimation, prior)
        self._encoders = EncoderFeed(self._ekf, {s.name: s for s in rig.stations}, config.estimation)
        self._keeper = TrackManager(self._ekf, self._cameras, config, span_m=span_m, initial=initial)
        self._readings_said = LogThrottle(lambda t_s, text: self._keeper.say(t_s, "warning", text))
        self._synchroniser = Synchroniser(turning, config.synchronise, cameras=rig.names)
        self._window = LateMeasurementBuffer(
            self._ekf,
            self._encoders,
            stations=rig.names,
            horizon_s=config.estimation.late_horizon_s,
            max_entries=config.estimation.late_max_entries,
            max_gap_s=config.synchronise.max_gap_s,
            say=self._readings_said.take,
        )
        self._fused_late = {"fused_late_ptu": 0, "fused_late_frames": 0}
        self._book = EpochBuffer(config.estimation.fix_window_s)
        self._health = StationHealth(geometries, self._ekf, config.integrity)
        self._frames = FrameUpdate(
            self._cameras,
            self._ekf,
            self._encoders,
            self._keeper,
            self._book,
            self._health,
            config,
            span=SpanModel(span_m),
            stopwatch=self._stopwatch,
            keep_images=self._keep_images,
        )
        self._references = ReferenceUpdate(self._ekf, self._keeper, self._window, self._readings_said.take)
        self._out = PendingReport()
        self._archive()

    @property
    def counts(self) -> dict[str, int]:
        """What was refused: what came too late even to go back for, PTU spikes, references, stations, starts."""
        return {name: self._before[name] + n for name, n in self._counted().items()}

    def _counted(self) -> dict[str, int]:
        """Return what was counted since the beginning, or since it began anew."""
        late, fused, health = self._synchroniser.late, self._fused_late, self._health
        return {
            "late_ptu": late.ptu - fused["fused_late_ptu"],
            "late_frames": late.frames - fused["fused_late_frames"],
            "ptu_spikes": self._encoders.spikes,
            "references_refused": self._references.refused + late.references - self._references.fused_late,
            "stations_lost": health.lost,
            "stations_doubted": health.watch.doubts,
            "stations_excluded": health.watch.exclusions,
            "excluded_pixels": health.excluded_pixels,
            "starts_taken_back": self._ekf.starts_taken_back,
            "begun_anew": 0,
        }

    @property
    def carried_errors(self) -> tuple[CarriedError, ...]:
        """What the filter knows now of the errors of calibration and clocks."""
        return self._ekf.carried_errors()

    @property
    def fused_late(self) -> dict[str, int]:
        """How many PTU readings came late and were fused in their place, and for how many frames one went back."""
        return {name: self._before[name] + n for name, n in self._fused_late.items()}

    @property
    def time_s(self) -> float | None:
        """The session time that the filter stands at; None before the first event."""
        return self._ekf.time_s

    def estimate_at(self, t_s: float) -> Kinematics | None:
        """Return the target at a session time, given all that is fused so far; None without a target.

        Ahead of the filter, to make up for delays, with the modes' process noise; behind it, as far as the window for
        late data reaches, sharpened by the newer measurements; further back None.
        """
        if not self._ekf.has_target or self._ekf.time_s is None:
            return None
        ahead = t_s >= self._ekf.time_s - ROUNDING_S
        return self._ekf.kinematics_at(t_s) if ahead else self._ekf.passed(t_s)

    def smooth(self, found: Callable[[float, Kinematics], None]) -> Callable[[float], None]:
        """Have the flight smoothed, once its end is known: returns what to call with each time that is wanted.

        ``found`` is told the answers, session time in s and the target then, the newest first: when a target ends, at
        `finish_smoothing`, or, of a long flight, in between. To be called before the first step.
        """
        self._found = found
        self._archive()
        return self._want

    def _want(self, t_s: float) -> None:
        self._smoother.want(t_s)

    def _archive(self) -> None:
        """Have what the filter does from now on kept for smoothing, if that is wanted."""
        found = self._found
        if found is not None:
            self._smoother = Smoother(
                self._ekf.motion_over, lambda t_s, x, P: found(t_s, self._ekf.kinematics_of(x, P))
            )
            self._ekf.tape.archive = self._smoother.take

    def step(self, event: Event) -> StepReport:
        """Take one event; return the reports of everything whose time has come."""
        if isinstance(event, (Frame, PixelMeasurement)):
            self._book.arrived(event.epoch, self._stopwatch())
            self._health.delivered(event.station, event.t_s)
        if isinstance(event, FilterReset):
            return self._begin_anew(event)
        if isinstance(event, Heartbeat):
            return self._pass_time(event.t_s)
        return self._run(self._synchroniser.push(event))

    def _begin_anew(self, event: FilterReset) -> StepReport:
        """Forget everything: numbers had come about that no filter can work with."""
        self._before.update({**self._counted(), **self._fused_late, "begun_anew": 1})
        if self._found is not None:
            self._ekf.finish_tape()
        self._begin(None)
        self._keeper.say(event.t_s, "error", f"the filter has failed ({event.why}); begun anew")
        return self._run(())

    def _pass_time(self, t_s: float) -> StepReport:
        """Say how the target does at ``t_s``, and decide it if no pair has for long; the filter stays where it is."""
        self._take(self._synchroniser.pass_time(t_s))
        if self._keeper.is_quiet(t_s):
            for line in self._health.silence(t_s):
                self._keeper.say(line.t_s, line.level, line.text)
            self._readings_said.pass_time(t_s)
            if self._keeper.gives_up(t_s):
                self._drop(t_s)
        self._out.states.append(self._keeper.state_at(t_s))
        return self._out.take(self._keeper.take_events())

    def _drop(self, t_s: float) -> None:
        """Give the target up at ``t_s``, which the filter has not come to."""
        with self._window.decision():
            self._keeper.drop(t_s)

    def finish(self) -> StepReport:
        """Nothing more will come: return the reports of everything still waiting."""
        return self._run(self._synchroniser.finish(), last=True)

    def finish_smoothing(self) -> None:
        """Look back from the end, after `finish` and after the last wanted time has been said."""
        self._ekf.finish_tape()

    def _run(self, ready: Iterable[Ready], *, last: bool = False) -> StepReport:
        self._take(ready)
        if last:
            self._readings_said.finish()
        return self._out.take(self._keeper.take_events())

    def _take(self, ready: Iterable[Ready]) -> None:
        """Take in order what is ready."""
        for item in ready:
            if isinstance(item, PtuSample):
                self._reading(item)
            elif isinstance(item, LateReading):
                self._late_reading(item.sample)
            elif isinstance(item, ReferenceFix):
                self._learn(item, late=False)
            elif isinstance(item, LateReference):
                self._learn(item.fix, late=True)
            elif isinstance(item, Epoch):
                with self._window.decision():
                    self._answer(item)
            else:
                self._out.cameras.append(self._frame(item))

    # ------------------------------------------------------------------------------- time and angles
    def _predict_to(self, t_s: float) -> None:
        """Carry the filter to ``t_s``; start the target that was given once its time has come."""
        self._ekf.predict_to(t_s)
        self._keeper.start_if_due(t_s)

    def _frame(self, ready: ReadyFrame) -> CameraReport:
        """Bring the filter to a frame's time and let the frame update it."""
        if ready.late:
            return self._late_frame(ready)
        if self._ekf.has_target and self._keeper.life.is_unseen(ready.record.t_s):
            # where no heartbeat has done so: a source without a clock, that had no picture for long
            self._drop(ready.record.t_s)
        with self._window.frame(ready.record.t_s, ready.record.station):
            self._predict_to(ready.record.t_s)
            if ready.following is not None:
                self._window.read(ready.following)
            return self._frames.take(ready)

    def _reading(self, sample: PtuSample) -> None:
        """Bring the filter to a reading's time and let the reading update it."""
        if self._window.completes(sample):
            # a frame was held no longer than it may be, and its angles come only now
            self._window.late_reading(sample, self._synchroniser.release)
            return
        with self._window.reading(sample.t_s, sample.station):
            self._predict_to(sample.t_s)
            self._window.read(sample)

    def _late_reading(self, sample: PtuSample) -> None:
        """Put a late reading in its place, if that is not too long ago."""
        if self._window.reaches(sample.t_s):
            self._window.late_reading(sample, self._synchroniser.release)
            self._fused_late["fused_late_ptu"] += 1

    def _late_frame(self, ready: ReadyFrame) -> CameraReport:
        """Go back to a late frame's time, look where the target was expected then, and come forward again."""
        t_s, station = ready.record.t_s, ready.record.station
        if not self._window.reaches(t_s):
            return self._frames.take(ready)
        following = self._window.claim_following(station, t_s)
        if following is None and not self._window.has_reading_after(station, t_s):
            following = self._synchroniser.claim_following(ready.record)
        with self._window.late_frame(t_s, station), self._cameras[station].aside():
            self._ekf.predict_to(t_s)
            if following is not None:
                self._window.read(following)
            known = self._ekf.has_target
            # nothing is searched for in the past
            report = self._frames.take(replace(ready, late=False, revisited=True) if known else ready)
        self._fused_late["fused_late_frames"] += known
        return replace(report, status=DetectionStatus.LATE) if report.status is DetectionStatus.OK else report

    def _learn(self, fix: ReferenceFix, *, late: bool) -> None:
        """Let a reference position correct the target and the errors that are carried."""
        if self._references.take_late(fix) if late else self._references.take(fix):
            self.taught_until_s = fix.t_s

    # ---------------------------------------------------------------------------------------- epochs
    def _answer(self, epoch: Epoch) -> None:
        """Say where the target is at the pair's stamp, and how that is known."""
        page = self._book.close(epoch)
        triangulation_status, triangulation = page.triangulate(self._config.estimation.residual_gate_sigma)
        for event in self._health.epoch(epoch.t_s, page):
            self._keeper.say(event.t_s, event.level, event.text)
        self._readings_said.pass_time(epoch.t_s)
        fixed = len(page.accepted) >= 2
        newest_s = self._synchroniser.newest_s
        kinematics = self._keeper.answer(epoch, fixed=fixed, proof=fixed and bool(page.views), newest_s=newest_s)
        self._out.estimates.append(
            TrackEstimate(
                t_s=epoch.t_s,
                epoch=epoch.epoch,
                status=self._keeper.life.status,
                kinematics=kinematics,
                triangulation_status=triangulation_status,
                triangulation=triangulation,
                latency_s=0.0 if page.arrived_s is None else self._stopwatch() - page.arrived_s,
            )
        )
