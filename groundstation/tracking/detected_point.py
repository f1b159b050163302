"""The point of the aircraft that the filter's state is of, and what is known of it on an aircraft not seen before."""

from collections.abc import Mapping, Sequence

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.target_point import TargetPointError
from groundstation.messages import Kinematics
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel
from groundstation.tracking.config import Config


class DetectedPoint:
    """The detected point, once a detector has found it; before, as of pixels that others found, the target point.

    Parameters
    ----------
    cameras : by station.
    span : of the target, m.
    eyes_m : (3,) each, the positions of the cameras in the runway frame.
    """

    def __init__(
        self, config: Config, cameras: Mapping[str, CameraTracker], span: SpanModel, eyes_m: Sequence[FloatArray]
    ) -> None:
        inferred = any(camera.infers_hidden_nose for camera in cameras.values())
        self._error = TargetPointError.by(config.estimation, eyes_m, inferred=inferred)
        self._cameras, self._span, self._usual_span_m = cameras, span, config.initiation.usual_span_m

    def as_target_point(self, kinematics: Kinematics) -> Kinematics:
        """Return an estimate of the filter as one of the target point."""
        return self._error.corrected(kinematics, self._span_m) if self._is_detected else kinematics

    def lead_m(self, kinematics: Kinematics) -> FloatArray:
        """Return how far (3,) the target point is ahead of the detected one in the mean, m."""
        return self._error.lead_m(kinematics, self._span_m) if self._is_detected else np.zeros(3)

    @property
    def _is_detected(self) -> bool:
        return any(camera.has_detected for camera in self._cameras.values())

    @property
    def _span_m(self) -> float:
        return self._usual_span_m if self._span.span_m is None else self._span.span_m
