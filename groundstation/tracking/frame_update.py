"""Processing of one camera frame: PTU angles, detection, filter update.

Each camera is independent: a frame is fused at its own time, whether or not the other frames of its epoch have
arrived, so that a lost camera needs no special case.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.box import Box
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import Predictor
from groundstation.estimation.encoders import EncoderFeed
from groundstation.estimation.out_of_view_weight import probability_in_view
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.trajectory_curve import Knot
from groundstation.estimation.updates.pixel_model import PixelPrediction
from groundstation.estimation.variance_check import require_definite
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.head_rates import HeadRates
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.integrity.station_exclusion import StationVerdict
from groundstation.messages import (
    CameraReport,
    Detection,
    DetectionStatus,
    Frame,
    Innovation,
    Miss,
    MissReason,
    PixelMeasurement,
)
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel, level_extent_px
from groundstation.tracking.config import Config
from groundstation.tracking.epoch_buffer import EpochBuffer, EpochView
from groundstation.tracking.labelled_pixel import labelled_candidate, labelled_detection
from groundstation.tracking.recognition import likeliest_aircraft
from groundstation.tracking.station_health import StationHealth
from groundstation.tracking.synchronise import AngleFault, InterpolatedAngles, ReadyFrame
from groundstation.tracking.track_manager import TrackManager
from groundstation.tracking.view_at_stamp import view_at_stamp
from groundstation.tracking.weighed_pixel import weighed

_MISS_STATUS = {
    MissReason.AMBIGUOUS: DetectionStatus.AMBIGUOUS,
    MissReason.CUT: DetectionStatus.CUT,
    MissReason.OUT_OF_VIEW: DetectionStatus.OUT_OF_VIEW,
}
# while two cameras see the target, its width updates the span this often: successive widths are correlated
_WIDTH_EVERY_S = 0.25
_NO_TARGET_SEEN = (MissReason.LOW_CONTRAST, MissReason.NO_REGION)


def span_prior_sigma(span_m: float | None) -> float:
    """Return the prior sigma of the logarithm of the target's span; None is unknown."""
    return SpanModel(span_m).sigma_ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class _Angles:
    """A station's pan and tilt at an exposure, with one sigma of each, in rad, and their rates."""

    pan_rad: float
    tilt_rad: float
    sigma_rad: float
    rates: HeadRates


class _Outcome(NamedTuple):
    """Result of a frame before the filter update; fields as in `CameraReport`."""

    status: DetectionStatus
    result: Detection | Miss
    predicted_px: FloatArray | None = None
    covariance_px2: FloatArray | None = None
    roi: Box[int] | None = None
    channel_contrast: Mapping[str, float] | None = None
    by_itself: Detection | None = None
    """The detection without what the filter says about it."""
    expected_width_px: float = 0.0
    """The target's width as the filter expects it."""


def _missed(reason: MissReason, detail: str) -> _Outcome:
    """Return the outcome of a frame without a detection attempt."""
    return _Outcome(_MISS_STATUS.get(reason, DetectionStatus.MISS), Miss(reason=reason, detail=detail))


class FrameUpdate:
    """Processes the frames of all cameras, one by one, and updates the filter.

    Parameters
    ----------
    cameras : trackers of the cameras, by station.
    encoders, ekf, track_manager, epochs, health : shared with the pipeline.
    span : model of the target's span.
    stopwatch : returns the elapsed processing time in s.
    keep_images : whether reports contain the images.
    """

    def __init__(
        self,
        cameras: Mapping[str, CameraTracker],
        ekf: StationEkf,
        encoders: EncoderFeed,
        track_manager: TrackManager,
        epochs: EpochBuffer,
        health: StationHealth,
        config: Config,
        *,
        span: SpanModel,
        stopwatch: Callable[[], float],
        keep_images: bool,
    ) -> None:
        self._cameras = cameras
        self._ekf = ekf
        self._encoders = encoders
        self._track_manager = track_manager
        self._epochs = epochs
        self._health = health
        self._width_fused_s: dict[str, float] = {}
        self._contributed: dict[str, float] = {}
        self._config = config
        self._span, self._learns_span = span, span.span_m is None
        # the filter carries the span's error against this one
        self._assumed_span_m = config.initiation.usual_span_m if span.span_m is None else span.span_m
        self._stopwatch, self._keep_images = stopwatch, keep_images

    def process(self, ready: ReadyFrame) -> CameraReport:
        """Detect the target in a frame and update the filter, which is at the time of the frame."""
        record = ready.record
        if ready.late:
            return self._report(record, None, _missed(MissReason.LATE, "older than what was already used"))
        if (wrong := self._cameras[record.station].wrong_picture(record)) is not None:
            return self._report(record, None, _missed(wrong.reason, wrong.detail))
        angles = self._angles(ready)
        if angles is None:
            fault = ready.angles.value if isinstance(ready.angles, AngleFault) else "PTU readings do not change"
            return self._report(record, None, _missed(MissReason.NO_PTU_ANGLE, fault))
        started = self._stopwatch()
        searches = not ready.revisited and self._track_manager.searches(record)
        found = self._search(record, angles) if searches else []
        if not self._ekf.has_target:
            unseen = self._cameras[record.station].search_fault if searches and isinstance(record, Frame) else None
            seen = _missed(unseen or MissReason.NOT_ACQUIRED, f"{len(found)} candidates")
            return self._report(record, angles, seen, self._stopwatch() - started, found=found)
        prediction = self._ekf.predict_pixel(record.station)
        if prediction is None:
            return self._report(record, angles, _missed(MissReason.OUT_OF_VIEW, "behind the camera"), found=found)
        seen = self._detect(record, prediction)
        elapsed_s = self._stopwatch() - started
        if not isinstance(seen.result, Detection):
            return self._report(record, angles, seen, elapsed_s, found=found)
        fused = self._fuse_detection(record, seen.result, seen, angles)
        return self._report(record, angles, seen, elapsed_s, *fused, found=found)

    def _report(
        self,
        record: Frame | PixelMeasurement,
        angles: _Angles | None,
        seen: _Outcome,
        elapsed_s: float = 0.0,
        status: DetectionStatus | None = None,
        innovation: Innovation | None = None,
        found: Sequence[CameraCandidate] = (),
    ) -> CameraReport:
        """Return the report of a frame; ``found`` are the candidates of a search."""
        return CameraReport(
            t_s=record.t_s,
            station=record.station,
            epoch=record.epoch,
            status=seen.status if status is None else status,
            result=seen.result,
            roi=seen.roi,
            predicted_px=seen.predicted_px,
            predicted_covariance_px2=seen.covariance_px2,
            pan_rad=None if angles is None else angles.pan_rad,
            tilt_rad=None if angles is None else angles.tilt_rad,
            innovation=innovation,
            elapsed_s=elapsed_s,
            channel_contrast=seen.channel_contrast,
            image=record.image if self._keep_images and isinstance(record, Frame) else None,
            recognised=likeliest_aircraft(found),
            track_id=self._track_manager.track_id,
            rates=None if angles is None else angles.rates,
        )

    def _angles(self, ready: ReadyFrame) -> _Angles | None:
        """Return the angles at the exposure: interpolated, or the filter's if a reading is missing or rejected."""
        record, angles = ready.record, ready.angles
        rates = self._encoders.rates(record.station)
        if self._cameras[record.station].station.fixed:
            return _Angles(pan_rad=0.0, tilt_rad=0.0, sigma_rad=0.0, rates=rates)
        if self._encoders.is_frozen(record.station):
            return None
        pan, tilt = self._ekf.angles(record.station)
        doubt = self._encoders.sigma_rad(record.station)
        if isinstance(angles, InterpolatedAngles) and not self._encoders.is_doubtful(record.station):
            sigma = self._encoders.noise_rad(record.station) * angles.variance_share**0.5
            off = max(abs(wrap_rad(angles.pan_rad - pan)), abs(wrap_rad(angles.tilt_rad - tilt)))
            if off <= self._config.estimation.encoder_gate_sigma * math.hypot(sigma, doubt):
                return _Angles(pan_rad=angles.pan_rad, tilt_rad=angles.tilt_rad, sigma_rad=sigma, rates=rates)
        age = self._encoders.age_s(record.station, record.t_s)
        ended = angles is AngleFault.ENDED and age <= self._config.synchronise.max_gap_s
        if ended or isinstance(angles, InterpolatedAngles):
            return _Angles(pan_rad=pan, tilt_rad=tilt, sigma_rad=doubt, rates=rates)
        return None

    def _search(self, record: Frame | PixelMeasurement, angles: _Angles) -> list[CameraCandidate]:
        """Search the whole frame, or take the labelled pixel, for the next epoch; return the candidates."""
        sigma_rad = self._pointing_sigma_rad(record, angles)
        if isinstance(record, Frame):
            places = self._track_manager.guided_places(record, angles.pan_rad, angles.tilt_rad)
            found = self._cameras[record.station].search(record, angles.pan_rad, angles.tilt_rad, sigma_rad, places)
            self._track_manager.add_search(record.station, record.t_s, found)
            return found
        label = labelled_candidate(record, angles.pan_rad, angles.tilt_rad, sigma_rad)
        self._track_manager.add_label(label)
        return [label]

    def _pointing_sigma_rad(self, record: Frame | PixelMeasurement, angles: _Angles) -> float:
        """Return one sigma of the pointing of the camera, from angles and rig."""
        return float(np.hypot(angles.sigma_rad, self._ekf.pointing_sigma_rad(record.station)))

    def _detect(self, record: Frame | PixelMeasurement, prediction: PixelPrediction) -> _Outcome:
        """Detect the target near its predicted pixel; the result is a detection or a named miss."""
        camera, ekf = self._cameras[record.station], self._ekf
        spread = ekf.pixel_covariance(prediction)
        require_definite(spread, f"predicted pixel of {record.station}")
        if isinstance(record, PixelMeasurement):
            found = labelled_detection(record, self._config.estimation.labelled_sigma_px)
            return _Outcome(DetectionStatus.MISS, found, prediction.pixel, spread)
        visible = probability_in_view(prediction.pixel, spread, camera.geometry.image_size_px)
        look = None
        if visible >= self._config.estimation.min_view_probability:
            hint = camera.hint(
                prediction.pixel,
                spread,
                prediction.jacobian[:, ekf.layout.position],
                prediction.depth_m,
                record.t_s,
                (ekf.state[ekf.layout.velocity], ekf.covariance[ekf.layout.velocity, ekf.layout.velocity]),
                self._span,
                float(ekf.state[ekf.layout.position][2]),
            )
            look = camera.detect(record, self._roi_centre(record, prediction), spread, hint)
        if look is None:
            miss = Miss(reason=MissReason.OUT_OF_VIEW, detail=f"in view with probability {visible:.2g}")
            return _Outcome(DetectionStatus.OUT_OF_VIEW, miss, prediction.pixel, spread)
        status, result = DetectionStatus.MISS, look.result
        if isinstance(result, Miss):
            self._fuse_miss(record, result)
            status = _MISS_STATUS.get(result.reason, DetectionStatus.MISS)
            return _Outcome(status, result, prediction.pixel, spread, look.roi, look.channel_contrast)
        found = weighed(result, prediction.pixel, spread, camera.geometry.image_size_px)
        span_m = self._assumed_span_m if self._span.span_m is None else self._span.span_m
        width_px = span_m * float(camera.station.lens.focal_px[0]) / prediction.depth_m
        return _Outcome(status, found, prediction.pixel, spread, look.roi, look.channel_contrast, result, width_px)

    def _fuse_detection(
        self, record: Frame | PixelMeasurement, found: Detection, seen: _Outcome, angles: _Angles
    ) -> tuple[DetectionStatus, Innovation | None]:
        """Fuse a detected pixel if it passes the gate, and store it for the triangulation."""
        camera = self._cameras[record.station]
        pixel = np.array([found.u_px, found.v_px])
        row_dt = row_delay_s(found.v_px, camera.geometry.image_size_px[1], camera.station.readout_s)
        if found.cut and not self._likely_in_view(record.station, seen):
            # the nose is outside the image: the detected point is another part of the aircraft
            return DetectionStatus.CUT, None
        innovation, status = None, DetectionStatus.EXCLUDED
        if trusted := self._health.uses(record.station):
            R = found.covariance_px2 + self._health.monitor.extra_px2(record.station)
            # errors of the own detector are time-correlated; labelled pixels have white noise
            lasting = self._config.estimation.detection_lasting_share if isinstance(record, Frame) else 0.0
            innovation = self._ekf.update_pixel(record.station, pixel, R, row_dt, lasting)
            status = DetectionStatus.GATED
        if innovation is not None:
            self._health.monitor.add_innovation(record.station, record.t_s, innovation.residual, innovation.covariance)
        accepted = innovation is not None and innovation.accepted
        if innovation is not None and accepted:
            status = DetectionStatus.CUT if found.cut else DetectionStatus.OK
            track = self._track_manager.state_machine
            track.add_pixel(record.t_s)
            if isinstance(record, Frame):
                # a region larger than the target is no more of a target
                width_px = min(found.box.w, seen.expected_width_px)
                track.existence.hit(record.station, record.t_s, innovation.residual, innovation.covariance, width_px)
                if found.log_odds is not None:
                    track.recognition.add(record.station, record.t_s, found.log_odds)
                if not found.cut and found.box.w > 0.0:
                    self._use_width(camera, found, record.t_s)
            self._contributed[record.station] = max(record.t_s, self._contributed.get(record.station, record.t_s))
        # cameras agree with each other by what each shows, not by what the filter makes of it
        own = found if seen.by_itself is None else seen.by_itself
        view = view_at_stamp(
            self._ekf,
            camera.geometry,
            own,
            (angles.pan_rad, angles.tilt_rad),
            self._pointing_sigma_rad(record, angles),
            camera.station.readout_s,
        )
        self._epochs.add(
            EpochView(
                t_s=record.t_s,
                epoch=record.epoch,
                station=record.station,
                view=view,
                accepted=accepted and not found.cut,
                cut=accepted and found.cut,
                labelled=isinstance(record, PixelMeasurement),
                trusted=trusted,
            )
        )
        return status, innovation

    def _likely_in_view(self, station: str, seen: _Outcome) -> bool:
        """Return whether the predicted target point is more likely inside the image than not."""
        if seen.predicted_px is None or seen.covariance_px2 is None:
            return True
        size = self._cameras[station].geometry.image_size_px
        return probability_in_view(seen.predicted_px, seen.covariance_px2, size) >= 0.5

    def _fuse_miss(self, record: Frame, miss: Miss) -> None:
        """Update existence and filter with a missed detection, unless something else was detected."""
        verdict = self._health.monitor.verdict(record.station)
        if miss.reason not in _NO_TARGET_SEEN or verdict is StationVerdict.EXCLUDED:
            return
        before = self._ekf.probability_in_view(record.station)
        share = self._track_manager.state_machine.existence.miss(record.station, record.t_s, before)
        self._ekf.update_miss(record.station, share)

    def _use_width(self, camera: CameraTracker, found: Detection, t_s: float) -> None:
        """Update the range with the silhouette's width if no other camera sees the target, else the span."""
        camera.update_extent(found)
        name, span_m = camera.station.name, self._assumed_span_m
        began_s = self._track_manager.state_machine.started_s
        others = [max(self._contributed.get(station, began_s), began_s) for station in self._cameras if station != name]
        alone = all(t_s - seen > self._config.estimation.alone_after_s for seen in others)
        if alone or t_s - self._width_fused_s.get(name, -math.inf) >= _WIDTH_EVERY_S:
            self._width_fused_s[name] = t_s
            self._ekf.update_width(name, found.box.w, span_m, alone=alone)
        if self._learns_span and (after := self._ekf.predict_pixel(name)) is not None:
            wings_px = level_extent_px(found.box, after.jacobian[:, self._ekf.layout.position])
            self._span.learn(wings_px, float(camera.station.lens.focal_px[0]) / after.depth_m)

    def _roi_centre(self, record: Frame, prediction: PixelPrediction) -> FloatArray:
        """Project the point of the predictor; by default the filter's own prediction."""
        if self._config.estimation.predictor is Predictor.HERMITE:
            return prediction.pixel
        own = Knot(t_s=record.t_s, position_m=self._ekf.state[self._ekf.layout.position])
        pan, tilt = self._ekf.angles(record.station)
        geometry = self._cameras[record.station].geometry
        projection = geometry.project(self._track_manager.predictor.predict(own), pan, tilt)
        return prediction.pixel if projection is None else projection.pixel
