"""The processing order of the ground station: event → synchronise → predict → detect → update → report.

`Pipeline.step` takes one event and returns the reports that result from it. It reads no clock and no file: two
runs over the same events give the same reports. The caller's stopwatch only enters ``elapsed_s`` and ``latency_s``.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from groundstation.detection.detector_callback import DetectorCallback
from groundstation.estimation.encoders import EncoderFeed
from groundstation.estimation.implementation import filter_arithmetic
from groundstation.estimation.journal import ROUNDING_S, FilterJournal
from groundstation.estimation.late_measurements import LateMeasurementBuffer
from groundstation.estimation.parameters import ParameterPrior, rig_prior
from groundstation.estimation.smoother import Smoother
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import (
    CameraReport,
    CarriedError,
    DetectionStatus,
    Epoch,
    Event,
    FilterReset,
    Frame,
    FrameAngles,
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
from groundstation.tracking.camera_cross_check import CameraCrossCheck
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel
from groundstation.tracking.config import Config
from groundstation.tracking.epoch_buffer import EpochBuffer
from groundstation.tracking.frame_update import FrameUpdate, span_prior_sigma
from groundstation.tracking.log_throttle import LogThrottle
from groundstation.tracking.pending_report import PendingReport
from groundstation.tracking.reference_fusion import ReferenceUpdate
from groundstation.tracking.registered_heads import RegisteredHeads
from groundstation.tracking.station_health import StationHealth
from groundstation.tracking.synchronise import LateReading, LateReference, Ready, ReadyFrame, Synchroniser
from groundstation.tracking.track_manager import TrackManager


class Pipeline:
    """Tracks one target with N stations: events in, reports out.

    Parameters
    ----------
    rig : calibrated stations.
    config : tuning.
    span_m : the target's wing span in m, or None if unknown.
    initial : initial state of the target; with None the target is acquired by searching.
    stopwatch : returns the elapsed processing time in s; the default disables the measurement.
    keep_images : whether reports contain the images (for a viewer without a video).
    reference_errors : prior of the errors of the reference positions: receiver clock and antenna offset.
    callbacks : functions that take the place of the program's detector, by station.
    heads : takes angles from the pictures, where panoramas are known.
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
        callbacks: Mapping[str, DetectorCallback] | None = None,
        heads: RegisteredHeads | None = None,
    ) -> None:
        rig.require_known()
        self._rig, self._config, self._span_m = rig, config, span_m
        self.heads = RegisteredHeads(rig, {}) if heads is None else heads
        self._stopwatch, self._keep_images = stopwatch, keep_images
        self._reference_errors, self._callbacks = reference_errors, callbacks or {}
        self._counts_before_restart: Counter[str] = Counter()
        self._on_smoothed: Callable[[float, Kinematics], None] | None = None
        self.reference_used_until_s: float | None = None
        self._set_up(initial)

    def _set_up(self, initial: InitialState | None) -> None:
        """Create all components from the rig and the configuration."""
        rig, config, span_m = self._rig, self._config, self._span_m
        self._throttle = LogThrottle(lambda t_s, text: self._track_manager.log(t_s, "warning", text))
        callbacks, log = self._callbacks, self._throttle.take
        self._cameras = {s.name: CameraTracker(s, config, callbacks.get(s.name), log) for s in rig.stations}
        geometries = {name: c.geometry for name, c in self._cameras.items()}
        turning = tuple(s.name for s in rig.stations if not s.fixed)
        prior = rig_prior(rig, self._reference_errors).with_span(span_prior_sigma(span_m))
        self._journal = FilterJournal(filter_arithmetic(config.estimation.implementation).smooth_across)
        self._ekf = StationEkf(geometries, turning, config.estimation, prior, self._journal)
        self._encoders = EncoderFeed(self._ekf, {s.name: s for s in rig.stations}, config.estimation)
        span = SpanModel(span_m)
        self._track_manager = TrackManager(self._ekf, self._cameras, config, span=span, initial=initial)
        self._synchroniser = Synchroniser(turning, config.synchronise, cameras=rig.names)
        self._late_buffer = LateMeasurementBuffer(
            self._ekf,
            self._journal,
            self._encoders,
            stations=rig.names,
            horizon_s=config.estimation.late_horizon_s,
            max_entries=config.estimation.late_max_entries,
            max_gap_s=config.synchronise.max_gap_s,
            log=log,
        )
        self._fused_late = {"fused_late_ptu": 0, "fused_late_frames": 0}
        self._epochs = EpochBuffer(config.estimation.fix_window_s)
        self._health = StationHealth(geometries, self._ekf, config.integrity)
        self._frames = FrameUpdate(
            self._cameras,
            self._ekf,
            self._encoders,
            self._track_manager,
            self._epochs,
            self._health,
            config,
            span=span,
            stopwatch=self._stopwatch,
            keep_images=self._keep_images,
        )
        pointing = {name: self._ekf.pointing_sigma_rad(name) for name in rig.names}
        limits = config.estimation
        self._cross_check = CameraCrossCheck(pointing, limits.search_again_s, limits.residual_gate_sigma)
        self._references = ReferenceUpdate(
            self._ekf, self._track_manager, self._late_buffer, self._cross_check, self._throttle.take
        )
        self._out = PendingReport()
        self._start_smoother()

    @property
    def counts(self) -> dict[str, int]:
        """Counts of rejected data: records beyond the late horizon, PTU spikes, references, stations, restarts."""
        return {name: self._counts_before_restart[name] + n for name, n in self._counts_since_restart().items()}

    def _counts_since_restart(self) -> dict[str, int]:
        """Return the counts since the start, or since the last restart."""
        late, fused, health = self._synchroniser.late, self._fused_late, self._health
        return {
            "late_ptu": late.ptu - fused["fused_late_ptu"],
            "late_frames": late.frames - fused["fused_late_frames"],
            **self._encoders.counts(),
            "references_refused": self._references.refused + late.references - self._references.fused_late,
            "stations_lost": health.lost,
            "stations_doubted": health.monitor.doubts,
            "stations_excluded": health.monitor.exclusions,
            "excluded_pixels": health.excluded_pixels,
            "starts_taken_back": self._ekf.starts_taken_back,
            "begun_anew": 0,
        }

    @property
    def carried_errors(self) -> tuple[CarriedError, ...]:
        """Current estimates of the errors of calibration and clocks."""
        return self._ekf.carried_errors()

    @property
    def fused_late(self) -> dict[str, int]:
        """Numbers of out-of-sequence PTU readings and frames that were fused at their own time."""
        return {name: self._counts_before_restart[name] + n for name, n in self._fused_late.items()}

    @property
    def time_s(self) -> float | None:
        """Session time of the filter state; None before the first event."""
        return self._ekf.time_s

    def estimate_at(self, t_s: float) -> Kinematics | None:
        """Return the target at a session time, given all measurements fused so far; None without a target.

        Ahead of the filter time the state is predicted with the process noise of the modes, to compensate delays.
        Behind it it is smoothed with the newer ones, as far back as the buffer for late ones reaches; before, None.
        """
        if not self._ekf.has_target or self._ekf.time_s is None:
            return None
        ahead = t_s >= self._ekf.time_s - ROUNDING_S
        found = self._ekf.kinematics_at(t_s) if ahead else self._ekf.smoothed_at(t_s)
        return None if found is None else self._track_manager.reported(found)

    def smooth(self, on_smoothed: Callable[[float, Kinematics], None]) -> Callable[[float], None]:
        """Enable smoothing of the whole flight; return the function that requests an estimate at a time.

        ``on_smoothed`` receives session time in s and target, newest first: when a track ends, at `finish_smoothing`,
        or, for a long flight, in between. To be called before the first step.
        """
        self._on_smoothed = on_smoothed
        self._start_smoother()
        return self._request_smoothed

    def _request_smoothed(self, t_s: float) -> None:
        self._smoother.request(t_s)

    def _start_smoother(self) -> None:
        """Connect a smoother to the history of the filter, if smoothing is enabled."""
        if (on_smoothed := self._on_smoothed) is not None:
            self._smoother = Smoother(
                self._ekf.motion_over,
                lambda t_s, x, P: on_smoothed(t_s, self._track_manager.reported(self._ekf.kinematics_of(x, P))),
                across=self._journal.smooth_across,
            )
            self._journal.history.archive = self._smoother.take

    def step(self, event: Event) -> StepReport:
        """Process one event; return the reports of all records that are due."""
        if isinstance(event, (Frame, PixelMeasurement)):
            self._epochs.arrived(event.epoch, self._stopwatch())
            self._health.delivered(event.station, event.t_s)
        if isinstance(event, FilterReset):
            return self._restart(event)
        if isinstance(event, FrameAngles):
            self.heads.recall(event)
            return StepReport()
        if isinstance(event, Heartbeat):
            return self._process_heartbeat(event.t_s)
        return self._run(self._synchroniser.push(event))

    def _restart(self, event: FilterReset) -> StepReport:
        """Discard the complete state after a numerical failure of the filter."""
        self._counts_before_restart.update({**self._counts_since_restart(), **self._fused_late, "begun_anew": 1})
        if self._on_smoothed is not None:
            self._ekf.close_history()
        changes = self._track_manager.changes.after_reset()
        self._set_up(None)
        self._track_manager.changes = changes
        self._track_manager.log(event.t_s, "error", f"the filter has failed ({event.why}); reset")
        return self._run(())

    def _process_heartbeat(self, t_s: float) -> StepReport:
        """Report the track status at ``t_s``, and update it if no epoch came for long; the filter is not predicted."""
        self._process(self._synchroniser.pass_time(t_s))
        if self._track_manager.is_quiet(t_s):
            for line in self._health.silence(t_s):
                self._track_manager.log(line.t_s, line.level, line.text)
            self._throttle.pass_time(t_s)
            if self._track_manager.must_drop(t_s):
                self._drop(t_s)
        self._out.states.append(self._track_manager.state_at(t_s))
        return self._out.take(self._track_manager.changes.take())

    def _drop(self, t_s: float) -> None:
        """Drop the target at ``t_s``, ahead of the filter time."""
        with self._late_buffer.decision():
            self._track_manager.drop(t_s)

    def finish(self) -> StepReport:
        """Process all records that are still waiting, at the end of the input; return their reports."""
        return self._run(self._synchroniser.finish(), last=True)

    def finish_smoothing(self) -> None:
        """Smooth from the end of the flight; to be called after `finish` and after the last request."""
        self._ekf.close_history()

    def _run(self, ready: Iterable[Ready], *, last: bool = False) -> StepReport:
        self._process(ready)
        if last:
            self._throttle.finish()
        return self._out.take(self._track_manager.changes.take())

    def _process(self, ready: Iterable[Ready]) -> None:
        """Process the synchronised records in order."""
        for item in ready:
            if isinstance(item, PtuSample):
                self._process_reading(item)
            elif isinstance(item, LateReading):
                self._process_late_reading(item.sample)
            elif isinstance(item, ReferenceFix):
                self._process_reference(item, late=False)
            elif isinstance(item, LateReference):
                self._process_reference(item.fix, late=True)
            elif isinstance(item, Epoch):
                with self._late_buffer.decision():
                    self._process_epoch(item)
            else:
                self._out.cameras.append(self._process_frame(item))

    def _predict_to(self, t_s: float) -> None:
        """Predict the filter to ``t_s``; start the target from the given initial state once its time is reached."""
        self._ekf.predict_to(t_s)
        self._track_manager.start_if_due(t_s)

    def _process_frame(self, ready: ReadyFrame) -> CameraReport:
        """Predict the filter to the time of a frame and update it with the frame."""
        if ready.late:
            return self._process_late_frame(self.heads.carried(ready))
        if self._ekf.has_target and self._track_manager.state_machine.is_unseen(ready.record.t_s):
            # sources without heartbeats: no frame came for longer than a track may coast
            self._drop(ready.record.t_s)
        with self._late_buffer.frame(ready.record.t_s, ready.record.station):
            self._predict_to(ready.record.t_s)
            if ready.following is not None:
                self._late_buffer.read(ready.following)
            return self._frames.process(self.heads.with_angles(ready, self._late_buffer.read, self._encoders.rates))

    def _process_reading(self, sample: PtuSample) -> None:
        """Predict the filter to the time of a PTU reading and update it with the reading."""
        if self._late_buffer.completes(sample):
            # the hold time of a frame ended before the reading that completes its angles
            self._late_buffer.late_reading(sample, self._synchroniser.release)
            return
        with self._late_buffer.reading(sample.t_s, sample.station):
            self._predict_to(sample.t_s)
            self._late_buffer.read(sample)

    def _process_late_reading(self, sample: PtuSample) -> None:
        """Fuse an out-of-sequence PTU reading at its own time, if it is within the horizon."""
        if self._late_buffer.reaches(sample.t_s):
            self._late_buffer.late_reading(sample, self._synchroniser.release)
            self._fused_late["fused_late_ptu"] += 1

    def _process_late_frame(self, ready: ReadyFrame) -> CameraReport:
        """Rewind the filter to an out-of-sequence frame, detect and fuse there, and replay the later measurements."""
        t_s, station = ready.record.t_s, ready.record.station
        if not self._late_buffer.reaches(t_s):
            return self._frames.process(ready)
        following = self._late_buffer.claim_following(station, t_s)
        if following is None and not self._late_buffer.has_reading_after(station, t_s):
            following = self._synchroniser.claim_following(ready.record)
        with self._late_buffer.late_frame(t_s, station), self._cameras[station].state_preserved():
            self._ekf.predict_to(t_s)
            if following is not None:
                self._late_buffer.read(following)
            known = self._ekf.has_target  # no acquisition from out-of-sequence frames
            report = self._frames.process(replace(ready, late=False, revisited=True) if known else ready)
        self._fused_late["fused_late_frames"] += known
        return replace(report, status=DetectionStatus.LATE) if report.status is DetectionStatus.OK else report

    def _process_reference(self, fix: ReferenceFix, *, late: bool) -> None:
        """Update the target and the carried errors with a reference position."""
        if self._references.take_late(fix) if late else self._references.take(fix):
            self.reference_used_until_s = fix.t_s

    def _process_epoch(self, epoch: Epoch) -> None:
        """Estimate the target at the stamp of an epoch and report it with the triangulation."""
        views = self._epochs.close(epoch)
        status, triangulation = views.triangulate(self._config.estimation.residual_gate_sigma)
        self._cross_check.add(epoch.t_s, [(v.station, v.view) for v in views.views if v.trusted])
        for event in self._health.epoch(epoch.t_s, views, confirmed=self._track_manager.is_confirmed):
            self._track_manager.log(event.t_s, event.level, event.text)
        self._throttle.pass_time(epoch.t_s)
        kinematics = self._track_manager.process_epoch(epoch, views, newest_s=self._synchroniser.newest_s)
        self._out.estimates.append(
            TrackEstimate(
                t_s=epoch.t_s,
                epoch=epoch.epoch,
                status=self._track_manager.state_machine.status,
                kinematics=kinematics,
                triangulation_status=status,
                triangulation=triangulation,
                latency_s=0.0 if views.arrived_s is None else self._stopwatch() - views.arrived_s,
                seen_by=views.accepted,
            )
        )
