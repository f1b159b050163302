"""One camera's detector: a region of interest in, the pixel of the nose or a named miss out."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray, MaskArray
from groundstation.box import Box, box_of_size, shift
from groundstation.detection.appearance import initial_appearance
from groundstation.detection.background import BackgroundModel, Difference
from groundstation.detection.config import DetectionConfig, TargetPoint
from groundstation.detection.level_set_input import LevelSetInput, prepare
from groundstation.detection.nose_point import find_nose
from groundstation.detection.regions import Group, Regions, find_regions, soft_silhouette
from groundstation.detection.segmentation import make_segmenter
from groundstation.detection.start_contour import PreviousSilhouette, start_contour
from groundstation.detection.target_selection import TargetMemory, features_of, select_target
from groundstation.detection.working_image import DetectionHint, WorkingImage, crop_working_image, expectation
from groundstation.geometry.mahalanobis import mahalanobis_squared
from groundstation.messages import Detection, Miss, MissReason
from groundstation.picture import Picture, as_picture
from groundstation.registration import translation

__all__ = ["DetectionHint", "Detector", "warm_up"]

_MEMORY_SPAN_SIGMA = 0.2
_MEMORY_SIGMA_PER_MISS = 0.05
_MEMORY_RATE = 0.3
_MISSES_TO_FORGET = 5
_TRUSTED_CONTRAST = 5.0
_FAINTER = 0.6
_MOST_DOUBT_PER_SPAN, _MOST_DOUBT_PX = 0.4, 3.0
_MISSES_TO_FORGET_LOOKS = 30


class Detector:
    """Finds the target of one camera, frame after frame."""

    def __init__(self, config: DetectionConfig, image_size_px: tuple[int, int]) -> None:
        self._config = config
        self._image_size_px = image_size_px
        self._memory: TargetMemory | None = None
        self._last: PreviousSilhouette | None = None
        self._background = BackgroundModel()
        self.segment = make_segmenter(config)

    def reset(self) -> None:
        """Discard contour, size and appearance of the target."""
        self._memory = None
        self._last = None
        self._background.reset()

    @contextmanager
    def state_preserved(self) -> Iterator[None]:
        """Detect without learning inside the block: the state is restored at its end."""
        memory, last, background = self._memory, self._last, self._background
        self._background = background.copy()
        yield
        self._memory, self._last, self._background = memory, last, background

    def detect(self, image: ImageArray | Picture, roi: Box[int], hint: DetectionHint) -> Detection | Miss:
        """Detect the target inside ``roi`` of a picture or full image (h, w, 3) BGR, which must not change later."""
        picture = as_picture(image)
        limits = (self._config.min_span_px, self._config.max_working_span_px)
        working = crop_working_image(picture, roi, hint, self._expected_size(hint), limits)
        expected = expectation(working)
        box = expected.box
        if box.w < 2 or box.h < 2:
            return Miss(reason=MissReason.OUT_OF_VIEW, detail="the prediction lies outside the region of interest")
        difference = self._learnt_difference(picture, working, box)
        prepared = prepare(working.image, expected, difference, self._config)
        if prepared.level < self._config.min_contrast_to_noise:
            detail = f"nothing above {prepared.level:.1f} sigma near the prediction"
            return self._missed(Miss(reason=MissReason.LOW_CONTRAST, detail=detail))
        start = start_contour(working, self._last)
        regions, choice = self._divide(prepared, start, working)
        if isinstance(choice, Miss) and choice.reason is MissReason.WRONG_SIZE:
            # a pale wing may have less than half of the contrast of the strongest part
            prepared = prepared.fainter(_FAINTER)
            regions, choice = self._divide(prepared, start, working)
        if isinstance(choice, Miss):
            return self._missed(choice)
        detection = self._describe(choice, regions, prepared, working)
        if isinstance(detection, Miss):
            return self._missed(detection)
        if not detection.cut:
            self._learn(picture, roi, detection, choice.mass * working.scale**2, features_of(choice, regions, working))
        return detection

    def _divide(self, prepared: LevelSetInput, start: MaskArray, working: WorkingImage) -> tuple[Regions, Group | Miss]:
        """Run the level set; return its regions and the target among them, or a miss."""
        regions = find_regions(self.segment(prepared.u, start), prepared.contrast)
        return regions, select_target(regions, working, self._memory, self._config)

    def _missed(self, miss: Miss) -> Miss:
        """Count a miss; after several, the background model may contain the target and is reset."""
        self._last = None
        if self._memory is not None:
            self._memory = replace(self._memory, misses=self._memory.misses + 1)
            if self._memory.misses % _MISSES_TO_FORGET == 0:
                self._background.reset()
            if self._memory.misses >= _MISSES_TO_FORGET_LOOKS:
                self._memory = None
        return miss

    def _learn(self, picture: Picture, roi: Box[int], detection: Detection, mass: float, seen: FloatArray) -> None:
        """Update size, mass, appearance and background from a detection."""
        width, appearance = max(detection.box.w, 1.0), initial_appearance(seen)
        if self._memory is not None:
            old = self._memory.span_px
            width = old * math.exp(_MEMORY_RATE * math.log(width / old))
            before = self._memory.mass_at(width)
            mass = before * math.exp(_MEMORY_RATE * math.log(mass / before))
            appearance = self._memory.appearance.learn(seen, self._config.appearance_rate)
        self._memory = TargetMemory(span_px=width, mass=mass, appearance=appearance)
        sure = detection.contrast_to_noise >= _TRUSTED_CONTRAST
        if sure and self._config.learn_background:
            self._background.remember(picture, roi, _hidden_by(detection), detection.box.w)

    def _learnt_difference(self, picture: Picture, working: WorkingImage, box: Box[int]) -> Difference | None:
        """Return the difference from the learnt background; None for large targets in a reduced image."""
        if working.scale > 1 or not self._config.learn_background:
            return None
        roi = working.roi
        return self._background.subtract(picture, roi, shift(box, roi.x0, roi.y0))

    def _expected_size(self, hint: DetectionHint) -> tuple[float | None, float]:
        """Return the span to expect in px and the sigma of its logarithm: the better of hint and memory."""
        span, sigma = hint.expected_span_px, hint.span_sigma_ratio
        if self._memory is not None:
            # the uncertainty grows with misses, since the size may have been wrong
            remembered = _MEMORY_SPAN_SIGMA + _MEMORY_SIGMA_PER_MISS * self._memory.misses
            if span is None or sigma > remembered:
                return self._memory.span_px, remembered
        return span, sigma

    def _describe(
        self,
        group: Group,
        regions: Regions,
        prepared: LevelSetInput,
        working: WorkingImage,
    ) -> Detection | Miss:
        """Measure the chosen group: target point, covariance, outline."""
        h, w = prepared.u.shape
        margin = max(4, math.ceil(0.08 * group.width))
        x0, y0 = max(group.box.x0 - margin, 0), max(group.box.y0 - margin, 0)
        x1, y1 = min(group.box.x1 + margin, w), min(group.box.y1 + margin, h)
        member, soft = soft_silhouette(regions.labels, group.members, Box(x0, y0, x1, y1), prepared.u)
        corner = np.array([x0, y0], np.float64)
        width = float(group.width)
        forward = None if working.forward is None else working.forward * width
        up = None if working.up is None else working.up * width
        expected = None if working.span is None else (working.span, working.span_sigma)
        nose = find_nose(soft, width, group.contrast, forward, up, expected, working.height_per_span, working.scale)
        # one array of five points, since mapping one costs as much as mapping all
        upper_left = (group.box.x0 - 0.5, group.box.y0 - 0.5)
        places = np.array((nose.point + corner, corner, group.centre, working.predicted, upper_left))
        point, origin, centroid, predicted, (left, top) = working.full(places)
        covariance = nose.covariance * working.scale**2
        if self._config.target_point is TargetPoint.CENTROID:
            point = centroid
        cut = working.cuts(group.box)
        if cut:
            if working.border_distance(point) < 0.1 * width * working.scale or working.half_wing_gone(group.box):
                return Miss(reason=MissReason.CUT, detail="the image border cuts the nose off")
            covariance = covariance + working.cut_covariance(group.box)
        doubt = math.sqrt(float(covariance[0, 0] + covariance[1, 1]))
        if doubt > _MOST_DOUBT_PER_SPAN * width * working.scale + _MOST_DOUBT_PX:
            return Miss(reason=MissReason.NO_REGION, detail=f"the target point is uncertain by {doubt:.0f} px")
        # a bird in front of the aircraft merges with its silhouette and displaces the nose
        spread = covariance + working.covariance * working.scale**2
        if mahalanobis_squared(point - predicted, spread + np.eye(2)) > self._config.gate_sigmas**2:
            return Miss(reason=MissReason.NO_REGION, detail="the target point is too far from the prediction")
        size = working.scale
        point_in_mask = (point - origin) / size
        self._last = PreviousSilhouette(mask=member, point=point_in_mask, width=width, scale=float(size))
        return Detection(
            u_px=float(point[0]),
            v_px=float(point[1]),
            covariance_px2=covariance,
            noise_px2=nose.noise * working.scale**2,
            centroid_px=centroid,
            box=box_of_size(float(left), float(top), float(group.width * size), float(group.height * size)),
            area_px=group.area * size**2,
            contour_px=_outline(member, working.scale, origin),
            contrast_to_noise=group.contrast,
            channel=prepared.channel.value,
            cut=cut,
        )


def _hidden_by(detection: Detection) -> Box[int]:
    """Return the box in which the target certainly hides the background, in full-image px."""
    w, h = detection.box.size
    cx, cy = detection.box.x0 + 0.5 * w, detection.box.y0 + 0.5 * h
    half_w, half_h = 0.6 * w + 3, max(0.25 * w, 0.6 * h) + 3
    return Box(int(cx - half_w), int(cy - half_h), int(cx + half_w) + 1, int(cy + half_h) + 1)


def _outline(member: NDArray[np.uint8], scale: int, corner_px: FloatArray) -> NDArray[np.float32]:
    """Return the outline in full-image pixels, pieces separated by a row of NaN.

    ``member`` (h, w) of 0 and 1 has its first pixel at ``corner_px`` (2,), and each of its pixels stands for ``scale``.
    """
    if scale > 1:
        # round the pixels that those of a reduced image stand for: through their middles it would lose half of each
        size = (member.shape[1] * scale, member.shape[0] * scale)
        member = np.asarray(cv2.resize(member, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    contours, _ = cv2.findContours(member, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2), np.float32)
    # one array of all pieces, with a row between them
    points = np.empty((sum(map(len, contours)) + len(contours) - 1, 2), np.float32)
    n, origin = 0, corner_px - 0.5 * (scale - 1)
    for contour in contours:
        points[n : n + len(contour)] = contour[:, 0] + origin
        points[n + len(contour) : n + len(contour) + 1] = np.nan
        n += len(contour) + 1
    return points


def warm_up() -> None:
    """Compile every kernel by a few detections in a small synthetic scene that moves behind its target."""
    translation.warm_up()
    y, x = np.mgrid[0:96, 0:160]
    scene = (150 + 40 * ((x // 9 + y // 7) % 2)).astype(np.uint8)
    detector = Detector(DetectionConfig(), (160, 96))
    for k in range(4):
        image = np.ascontiguousarray(np.roll(np.repeat(scene[:, :, None], 3, axis=2), k, axis=1))
        image[40:46, 60:90] = (20, 40, 220)
        hint = DetectionHint(
            predicted_px=np.array([75.0, 43.0]), predicted_covariance_px2=np.eye(2), expected_span_px=30.0
        )
        detector.detect(image, Box(0, 0, 160, 96), hint)
