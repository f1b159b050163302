"""The learned channel's looks at the target of one camera: where it is expected, and at what has been seen there."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, overlap
from groundstation.detection.config import DetectionConfig, DetectorKind, TargetPoint
from groundstation.detection.learned_detector import LearnedDetector
from groundstation.detection.roi import place_roi
from groundstation.detection.working_image import DetectionHint
from groundstation.messages import Detection, Miss, MissReason
from groundstation.single_camera.channel_target import LEAST_ODDS, ChannelTarget, odds_of

Look = tuple[Box[int] | None, Detection | Miss]

# one sigma of the logarithm of a width that the detector is to take as known
_WIDTH_SIGMA = 0.2
# where the log odds fall by so much, the target is looked at once more, in a wider or a narrower window in turns
_FALL, _RESCALED = 1.0, 1.6
# a box drawn by hand is larger than what is in it, and a silhouette may be a part of the aircraft: widths looked at, as
# shares of its width; and one sigma of the place, as a share of its size
GIVEN, SILHOUETTE = ((1.0, 0.6, 0.36, 0.22), 0.25), ((1.0, 1.6, 2.5), 0.1)


class ChannelView:
    """Lets the learned detector of one camera, with pictures of ``image_size_px`` (w, h), look at its target."""

    def __init__(self, config: DetectionConfig, image_size_px: tuple[int, int]) -> None:
        # without the direction of flight it is not known which end of a silhouette is the nose
        self._config = replace(config, detector=DetectorKind.LEARNED, target_point=TargetPoint.CENTROID)
        self._image_size = image_size_px
        self._detector = LearnedDetector(self._config, image_size_px)

    def look(self, target: ChannelTarget, image: ImageArray) -> Look:
        """Look where the target is expected, and where its odds have fallen in a window of another width as well."""
        place, covariance = target.motion.place(), target.motion.covariance()
        look = self._at(image, place, covariance, target.span_px)
        if target.odds <= 0.0 or odds_of(look[1]) >= target.odds - _FALL:
            return look
        target.wider = not target.wider
        span = target.span_px * (_RESCALED if target.wider else 1.0 / _RESCALED)
        other = self._at(image, place, covariance, span)
        if odds_of(other[1]) <= odds_of(look[1]):
            return look
        target.span_px = span
        return other

    def likeliest_in(
        self, image: ImageArray, box: Box[float], widths: tuple[Sequence[float], float]
    ) -> Detection | None:
        """Return what is likeliest an aircraft in a box, with its middle there; None if nothing is.

        ``widths`` : `GIVEN` or `SILHOUETTE`.
        """
        shares, sigma = widths
        middle = _middle(box)
        covariance = (sigma * box.length) ** 2 * np.eye(2)
        looks = [self._at(image, middle, covariance, share * box.w)[1] for share in shares]
        seen = [each for each in looks if isinstance(each, Detection) and _holds(box, each.centroid_px)]
        return max(seen, key=odds_of, default=None)

    def odds_at(self, image: ImageArray, seen: Detection) -> float:
        """Return the log odds of aircraft of what another detector has seen."""
        result = self._at(image, seen.centroid_px, np.eye(2), seen.box.w)[1]
        if isinstance(result, Miss) or not overlap(result.box, seen.box):
            return LEAST_ODDS
        return max(odds_of(result), LEAST_ODDS)

    def _at(self, image: ImageArray, place: FloatArray, covariance: FloatArray, span_px: float) -> Look:
        """Look for something ``span_px`` wide at a place (2,) with a covariance (2, 2)."""
        span = max(span_px, 1.0)
        roi = place_roi(place, covariance, (span, 0.5 * span), self._config, self._image_size)
        if roi is None:
            return None, Miss(reason=MissReason.OUT_OF_VIEW)
        hint = DetectionHint(
            predicted_px=place,
            predicted_covariance_px2=covariance,
            expected_span_px=span,
            span_sigma_ratio=_WIDTH_SIGMA,
        )
        return roi, self._detector.detect(image, roi, hint)


def _middle(box: Box[float]) -> FloatArray:
    return np.array([0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)])


def _holds(box: Box[float], point: FloatArray) -> bool:
    return bool(box.x0 <= point[0] <= box.x1 and box.y0 <= point[1] <= box.y1)
