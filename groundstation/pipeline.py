"""The order of things, written once: event in → synchronise → predict → look → update → report out.

`Pipeline.step` takes one event and returns what it brought forth. It reads no clock and touches no file: two
runs over the same events give the same reports. The only time it knows besides the events' own is a
stopwatch handed in by the caller, which goes into ``elapsed_s`` and ``latency_s`` and nowhere else.
"""

from collections.abc import Callable, Iterable

from groundstation.camera_tracker import CameraTracker, SpanModel
from groundstation.config import Config
from groundstation.epoch import EpochBook
from groundstation.estimation.ekf import StationEkf
from groundstation.estimation.encoders import EncoderFeed
from groundstation.estimation.parameters import rig_prior
from groundstation.frame_update import FrameUpdate, span_prior_sigma
from groundstation.messages import (
    CameraReport,
    Epoch,
    Event,
    Frame,
    InitialState,
    PixelMeasurement,
    PtuSample,
    StepReport,
    TrackEstimate,
)
from groundstation.rig import Rig
from groundstation.station_health import StationHealth
from groundstation.synchronise import Ready, ReadyFrame, Synchroniser
from groundstation.target_keeper import TargetKeeper


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
    ) -> None:
        rig.require_known()
        self._config = config
        self._stopwatch = stopwatch
        self._cameras = {s.name: CameraTracker(s, config) for s in rig.stations}
        geometries = {name: c.geometry for name, c in self._cameras.items()}
        turning = tuple(s.name for s in rig.stations if not s.fixed)
        self._ekf = StationEkf(
            geometries, turning, config.estimation, rig_prior(rig).with_span(span_prior_sigma(span_m))
        )
        self._encoders = EncoderFeed(self._ekf, {s.name: s for s in rig.stations}, config.estimation)
        self._keeper = TargetKeeper(self._ekf, self._cameras, config, span_m=span_m, initial=initial)
        self._synchroniser = Synchroniser(turning, config.synchronise, cameras=rig.names)
        self._book = EpochBook(config.estimation.fix_window_s)
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
            stopwatch=stopwatch,
            keep_images=keep_images,
        )
        self._out_cameras: list[CameraReport] = []
        self._out_estimates: list[TrackEstimate] = []

    @property
    def counts(self) -> dict[str, int]:
        """What was refused on the way: late readings and frames, PTU spikes, stations lost, doubted, left out."""
        late, health = self._synchroniser.late, self._health
        return {
            "late_ptu": late.ptu,
            "late_frames": late.frames,
            "ptu_spikes": self._encoders.spikes,
            "stations_lost": health.lost,
            "stations_doubted": health.watch.doubts,
            "stations_excluded": health.watch.exclusions,
            "excluded_pixels": health.excluded_pixels,
        }

    def step(self, event: Event) -> StepReport:
        """Take one event; return the reports of everything whose time has come."""
        if isinstance(event, (Frame, PixelMeasurement)):
            self._book.arrived(event.epoch, self._stopwatch())
            self._health.delivered(event.station, event.t_s)
        return self._run(self._synchroniser.push(event))

    def finish(self) -> StepReport:
        """Nothing more will come: return the reports of everything still waiting."""
        return self._run(self._synchroniser.finish())

    def _run(self, ready: Iterable[Ready]) -> StepReport:
        for item in ready:
            if isinstance(item, PtuSample):
                self._predict_to(item.t_s)
                self._read_encoder(item)
            elif isinstance(item, Epoch):
                self._answer(item)
            else:
                self._out_cameras.append(self._frame(item))
        report = StepReport(
            cameras=tuple(self._out_cameras),
            estimates=tuple(self._out_estimates),
            events=tuple(self._keeper.take_events()),
        )
        self._out_cameras.clear()
        self._out_estimates.clear()
        return report

    # ------------------------------------------------------------------------------- time and angles
    def _predict_to(self, t_s: float) -> None:
        """Carry the filter to ``t_s``; start the target that was given once its time has come."""
        self._ekf.predict_to(t_s)
        self._keeper.start_if_due(t_s)

    def _read_encoder(self, sample: PtuSample) -> None:
        oddity = self._encoders.read(sample)
        if oddity is not None:
            self._keeper.say(sample.t_s, "warning", oddity)

    def _frame(self, ready: ReadyFrame) -> CameraReport:
        """Bring the filter to a frame's time and let the frame update it."""
        if not ready.late:
            self._predict_to(ready.record.t_s)
            if ready.following is not None:
                self._read_encoder(ready.following)
        return self._frames.take(ready)

    # ---------------------------------------------------------------------------------------- epochs
    def _answer(self, epoch: Epoch) -> None:
        """Say where the target is at the pair's stamp, and how that is known."""
        page = self._book.close(epoch)
        triangulation_status, triangulation = page.triangulate(self._config.estimation.residual_gate_sigma)
        for event in self._health.epoch(epoch.t_s, page):
            self._keeper.say(event.t_s, event.level, event.text)
        fixed = len(page.accepted) >= 2
        kinematics = self._keeper.answer(epoch, fixed=fixed, proof=fixed and bool(page.views))
        self._out_estimates.append(
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
