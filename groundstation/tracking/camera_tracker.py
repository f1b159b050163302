"""Detection of the target in the frames of one camera: region of interest, detector and whole-frame finder.

The tracker keeps the last silhouette size in its own image. It has no access to the filter, which is updated by the
caller.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.box import Box
from groundstation.detection.channel_contrast import measure_channels
from groundstation.detection.config import TargetPoint
from groundstation.detection.detector import DetectionHint
from groundstation.detection.detector_callback import DetectorCallback
from groundstation.detection.learned_detector import LearnedDetector
from groundstation.detection.make_detector import make_detector, make_finder
from groundstation.detection.roi import place_roi
from groundstation.errors import printable
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.guided_search import GuidedPlace
from groundstation.geometry.rotation import cross
from groundstation.messages import Detection, Frame, Miss, MissReason, PixelMeasurement
from groundstation.picture import Picture, PictureError, as_picture
from groundstation.rig.rig import Station
from groundstation.tracking.config import Config
from groundstation.tracking.flight_direction import FlightDirection

# sigma of the logarithm of the span: given by the session (bank and crab angles shorten it), and unknown
_GIVEN_SPAN_SIGMA = 0.15
_UNKNOWN_SPAN_SIGMA = 0.7
_LEARNT_AFTER = 10
_LEARNING_RATE = 0.1
# contrast on all channels is measured in one of this many detections, for the report only
_CONTRAST_EVERY = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchResult:
    """Result of a detection attempt: region of interest, detection or miss, contrast of the channels."""

    roi: Box[int] | None
    result: Detection | Miss
    channel_contrast: Mapping[str, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Extent:
    """A silhouette's width and height, offset of the box centre from the target point, and scale, px/m."""

    size_px: tuple[float, float]
    middle_px: tuple[float, float]
    px_per_m: float | None

    def at(self, px_per_m: float | None) -> "_Extent":
        """Return the extent at another scale."""
        if self.px_per_m is None or px_per_m is None:
            return self
        growth = px_per_m / self.px_per_m
        (w, h), (x, y) = self.size_px, self.middle_px
        return _Extent(size_px=(growth * w, growth * h), middle_px=(growth * x, growth * y), px_per_m=px_per_m)


_NO_EXTENT = _Extent(size_px=(0.0, 0.0), middle_px=(0.0, 0.0), px_per_m=None)


class SpanModel:
    """The target's span in metres: given, or learnt from silhouettes at known range."""

    def __init__(self, span_m: float | None) -> None:
        self.span_m = span_m
        self._given = span_m is not None
        self._seen = 0

    @property
    def sigma_ratio(self) -> float:
        """One sigma of the logarithm of the span."""
        if self._given:
            return _GIVEN_SPAN_SIGMA
        return 2.0 * _GIVEN_SPAN_SIGMA if self._seen >= _LEARNT_AFTER else _UNKNOWN_SPAN_SIGMA

    def learn(self, width_px: float, px_per_m: float) -> None:
        """Update the span with the width of an accepted, uncut silhouette."""
        if self._given or width_px <= 0 or px_per_m <= 0:
            return
        seen = width_px / px_per_m
        self.span_m = (
            seen if self.span_m is None else self.span_m * math.exp(_LEARNING_RATE * math.log(seen / self.span_m))
        )
        self._seen += 1


class CameraTracker:
    """Detects the target in the frames of one camera; ``callback`` takes the place of the program's own detector.

    ``log`` receives a session time in s and a line where pictures change their size, and for each frame in which OpenCV
    fails: such a frame is a miss, but for a callback's, whose errors are the caller's. ``search_fault`` is why the last
    `search` could not look, if so.
    """

    def __init__(
        self,
        station: Station,
        config: Config,
        callback: DetectorCallback | None = None,
        log: Callable[[float, str], None] = lambda t_s, line: None,
    ) -> None:
        self.station = station
        self.search_fault: MissReason | None = None
        self._log = log
        # of the newest picture
        self._size_px = station.lens.image_size_px
        self._failures = cv2.error if callback is None else ()
        self.geometry = station.geometry()
        self._config = config
        self._detector = make_detector(config.detection, station.lens.image_size_px, callback, station.name)
        self._finder = make_finder(config.acquisition, config.detection, station.lens, callback, station.name)
        self._extent = _NO_EXTENT
        self._px_per_m: float | None = None
        self._direction = FlightDirection()
        self._detections = 0

    def reset(self) -> None:
        """Discard the state of the target, after its loss."""
        self._detector.reset()
        self._finder.reset()
        self._extent = _NO_EXTENT
        self._direction.reset()

    @property
    def has_detected(self) -> bool:
        """Whether the detector has found a target in any picture so far."""
        return self._detections > 0

    @property
    def infers_hidden_nose(self) -> bool:
        """Whether the learned channel says where a nose is that the aircraft hides."""
        return isinstance(self._detector, LearnedDetector) and self._config.detection.target_point is TargetPoint.NOSE

    @contextmanager
    def state_preserved(self) -> Iterator[None]:
        """Process an older frame inside the block: size, appearance and background are restored at its end."""
        extent, scale, detections = self._extent, self._px_per_m, self._detections
        with self._detector.state_preserved():
            yield
        self._extent, self._px_per_m, self._detections = extent, scale, detections

    def wrong_picture(self, record: Frame | PixelMeasurement) -> Miss | None:
        """Return the miss of a frame whose picture is not of the rig's size, which no detector may see; else None."""
        if not isinstance(record, Frame):
            return None
        size_px, wanted_px = as_picture(record.image).size_px, self.station.lens.image_size_px
        if size_px == wanted_px == self._size_px:
            return None
        (w, h), (wanted_w, wanted_h) = size_px, wanted_px
        detail = f"got pictures of {w} × {h} px, wanted {wanted_w} × {wanted_h} as in the rig"
        if size_px != self._size_px:
            again = f"pictures are of {w} × {h} px again, as in the rig"
            self._log(record.t_s, f"{record.station}: {again if size_px == wanted_px else detail}")
            self._size_px = size_px
        return None if size_px == wanted_px else Miss(reason=MissReason.OTHER_PICTURE_SIZE, detail=detail)

    def search(
        self,
        frame: Frame,
        pan_rad: float,
        tilt_rad: float,
        angle_sigma_rad: float,
        places: Sequence[GuidedPlace] = (),
    ) -> list[CameraCandidate]:
        """Return the candidates of the whole frame; none if a recording kept only a part of it.

        ``places`` are those that other cameras' candidates suggest.
        """
        self.search_fault = None
        if not as_picture(frame.image).has_all:
            self.search_fault = MissReason.NOT_RECORDED
            return []
        pose = self.geometry.camera_pose(pan_rad, tilt_rad)
        guided = tuple((place.pixel, place.width_px) for place in places)
        try:
            found = self._finder.find(frame.image, frame.t_s, pose.runway_from_camera.T, guided)
        except self._failures as fault:
            self.search_fault = self._failed(frame, fault).reason
            self._finder.reset()
            return []
        return [
            CameraCandidate(
                t_s=frame.t_s,
                station=frame.station,
                pixel=np.array([c.u_px, c.v_px]),
                width_px=c.box.w if c.box.w > 0.0 else None,
                score=c.score,
                pan_rad=pan_rad,
                tilt_rad=tilt_rad,
                angle_sigma_rad=angle_sigma_rad,
                moving=c.moving,
                sigma_px=c.sigma_px,
                odds=c.odds,
            )
            for c in found
        ]

    def detect(
        self,
        frame: Frame,
        centre_px: FloatArray,
        covariance_px2: FloatArray,
        hint: DetectionHint,
    ) -> SearchResult | None:
        """Detect the target in the region of interest; None if the region is outside the image."""
        self._px_per_m = hint.px_per_m
        extent, size_px = self._extent.at(hint.px_per_m), self.station.lens.image_size_px
        roi = place_roi(centre_px, covariance_px2, extent.size_px, self._config.detection, size_px, extent.middle_px)
        if roi is None:
            return None
        picture = as_picture(frame.image)
        recorded = _recorded(picture, roi, centre_px)
        if recorded is None:
            return _not_recorded(roi)
        roi, contrast = recorded, None
        try:
            result = self._detector.detect(frame.image, roi, hint)
            if isinstance(result, Detection):
                if self._detections % _CONTRAST_EVERY == 0 and len(result.contour_px) > 0:
                    contrast = measure_channels(frame.image, roi, silhouette_mask(result, roi))
                self._detections += 1
        except self._failures as fault:
            result = self._failed(frame, fault)
            self._detector.reset()
        except PictureError:
            if picture.has_all:
                raise
            # another window than that of the run that was recorded
            return _not_recorded(roi)
        return SearchResult(roi=roi, result=result, channel_contrast=contrast)

    def _failed(self, frame: Frame, fault: Exception) -> Miss:
        """Log that OpenCV failed in a frame; return the miss that the frame is."""
        # after the place in OpenCV's own source
        words = printable(str(fault).strip().rpartition("error: ")[2].partition("\n")[0])
        self._log(frame.t_s, f"{frame.station}: the detection failed: {words}; the frame is a miss")
        return Miss(reason=MissReason.DETECTION_FAILED, detail=words)

    def update_extent(self, detection: Detection) -> None:
        """Store the extent of the last silhouette, after the filter has accepted it."""
        w, h = detection.box.size
        middle = (detection.box.x0 + 0.5 * w - detection.u_px, detection.box.y0 + 0.5 * h - detection.v_px)
        self._extent = _Extent(size_px=(w, h), middle_px=middle, px_per_m=self._px_per_m)

    def hint(
        self,
        predicted_px: FloatArray,
        covariance_px2: FloatArray,
        jacobian_px_per_m: FloatArray,
        depth_m: float,
        t_s: float,
        velocity: tuple[FloatArray, FloatArray],
        span: SpanModel,
        height_m: float | None = None,
    ) -> DetectionHint:
        """Return the prediction of the filter as a hint for the detector.

        ``jacobian_px_per_m`` (2, 3) is ∂(u, v)/∂(x, y, z), ``velocity`` is (3,) in m/s, runway frame, and its
        covariance (3, 3).
        """
        px_per_m = float(self.station.lens.focal_px[0]) / depth_m
        heading = self._direction.at(t_s, *velocity, height_m=math.inf if height_m is None else height_m)
        forward = None if heading is None else jacobian_px_per_m @ heading
        return DetectionHint(
            predicted_px=predicted_px,
            predicted_covariance_px2=covariance_px2,
            expected_span_px=None if span.span_m is None else span.span_m * px_per_m,
            span_sigma_ratio=span.sigma_ratio,
            forward_px_per_m=forward,
            forward_sigma_rad=math.inf if hides_nose(heading, jacobian_px_per_m) else self._direction.sigma_rad,
            up_px_per_m=jacobian_px_per_m[:, 2],
            px_per_m=px_per_m,
            height_m=height_m,
        )


def level_extent_px(box: Box[float], jacobian_px_per_m: FloatArray) -> float:
    """Return how far a silhouette with this box reaches along the horizon, where level wings lie, px.

    ``jacobian_px_per_m`` (2, 3) is ∂(u, v)/∂(x, y, z): which side of the box the wings lie along follows from the
    picture of the vertical.
    """
    u, v = np.abs(jacobian_px_per_m[:, 2])
    return box.w if v >= u else box.h


def hides_nose(heading: FloatArray | None, jacobian_px_per_m: FloatArray) -> bool:
    """Return whether a target flies away from a camera, so that its nose is behind the rest of it.

    ``jacobian_px_per_m`` (2, 3) is ∂(u, v)/∂(x, y, z): its rows span the picture, u to the right and v downwards.
    """
    return heading is not None and float(heading @ cross(jacobian_px_per_m[0], jacobian_px_per_m[1])) > 0.0


def _not_recorded(roi: Box[int]) -> SearchResult:
    """Return that pixels of a region were wanted that the recording did not keep."""
    detail = "the window is not within the part of this picture that the recording kept"
    return SearchResult(roi=roi, result=Miss(reason=MissReason.NOT_RECORDED, detail=detail), channel_contrast=None)


def _recorded(picture: Picture, roi: Box[int], centre_px: FloatArray) -> Box[int] | None:
    """Return the available part of the region of interest; None if the target is expected outside it.

    Only recordings of partial images that are replayed with another configuration lack a part.
    """
    window = picture.available(roi)
    if window is None or window == roi:
        return window
    u, v = (float(c) for c in centre_px)
    return window if window.x0 <= u < window.x1 and window.y0 <= v < window.y1 else None


def silhouette_mask(found: Detection, roi: Box[int]) -> MaskArray:
    """Return the silhouette as a mask (roi.h, roi.w), filled from its contour."""
    mask = np.zeros((roi.h, roi.w), dtype=np.uint8)
    breaks = np.flatnonzero(np.isnan(found.contour_px[:, 0]))
    for piece in np.split(found.contour_px, breaks):
        points = piece[~np.isnan(piece[:, 0])]
        if len(points) >= 3:
            corners = np.round(points - [roi.x0, roi.y0]).astype(np.int32)
            cv2.fillPoly(mask, [corners], 1)
    return mask > 0
