"""Outcomes of several detectors on the same scenes, compared with the truth.

Times are processor time of the detecting thread, which does not depend on other load of the machine.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.box import Box
from groundstation.detection.config import DetectionConfig
from groundstation.detection.detector import Detector
from groundstation.detection.roi import place_roi
from groundstation.detection.segmentation import Float32Array
from groundstation.experiments.truth_scenes import TruthScene
from groundstation.messages import Detection, Frame, Miss
from groundstation.sources.true_silhouettes import TrueSilhouette
from groundstation.tracking.camera_tracker import silhouette_mask

FOUND = "found"
_WRONG_PX, _WRONG_WIDTHS = 10.0, 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectorOutcome:
    """Result of one detector on one scene.

    Attributes
    ----------
    reason : "found", or the reason of the miss.
    point_px, error_px : (2,) the target point and its distance from the true nose; NaN for a miss.
    whitened : (2,) the error divided by the root of its stated covariance; NaN for a miss.
    covariance_px2, noise_px2 : (2, 2) the stated covariance, and its part that is new in each frame; NaN for a miss.
    overlap : intersection over union with the true silhouette; 0 for a miss.
    centre_error_px : distance of the detected silhouette's centre from the true one's; NaN for a miss.
    elapsed_s, segment_s : processor time of the whole detector, and of the segmentation in it.
    holds_nose, holds_silhouette : whether the true nose and all of the true silhouette are in the ROI.
    """

    station: str
    t_s: float
    background: str
    width_px: int
    roi: Box[int]
    elapsed_s: float
    segment_s: float
    reason: str
    point_px: FloatArray
    error_px: FloatArray
    whitened: FloatArray
    covariance_px2: FloatArray
    noise_px2: FloatArray
    overlap: float
    centre_error_px: float
    holds_nose: bool
    holds_silhouette: bool

    @property
    def found(self) -> bool:
        """Return whether there is a target point."""
        return self.reason == FOUND

    @property
    def wrong(self) -> bool:
        """Return whether a point was given that is not the nose: beyond 10 px and a quarter of the width."""
        limit = max(_WRONG_PX, _WRONG_WIDTHS * self.width_px)
        return self.found and float(np.hypot(*self.error_px)) > limit


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameTruth:
    """Truth of a frame: the nose (2,) px, the silhouette, and the background behind it."""

    nose_px: FloatArray
    silhouette: TrueSilhouette
    background: str


class DetectorRunner:
    """One detector of each camera with its region of interest placed as the pipeline does."""

    def __init__(self, config: DetectionConfig) -> None:
        self._config = config
        self._detectors: dict[str, Detector] = {}
        self._stopwatches: dict[str, list[float]] = {}
        self._sizes: dict[str, tuple[float, float]] = {}
        self._middles: dict[str, tuple[float, float]] = {}

    def look(self, scene: TruthScene) -> DetectorOutcome:
        """Run the detector on one scene; only the detector is timed."""
        name, image = scene.frame.station, scene.frame.image.whole()
        size = (image.shape[1], image.shape[0])
        if name not in self._detectors:
            self._detectors[name] = Detector(self._config, size)
            self._stopwatches[name] = _time_segmentation(self._detectors[name])
        hint = scene.hint
        spread = hint.predicted_covariance_px2
        middle = self._middles.get(name, (0.0, 0.0))
        roi = place_roi(hint.predicted_px, spread, self._sizes.get(name), self._config, size, middle)
        if roi is None:
            raise ValueError("a scene's prediction lies in the picture, so its region of interest does")
        self._stopwatches[name].clear()
        started = time.thread_time()
        result = self._detectors[name].detect(image, roi, hint)
        elapsed = time.thread_time() - started
        if isinstance(result, Detection):
            w, h = result.box.size
            self._sizes[name] = (w, h)
            self._middles[name] = (result.box.x0 + 0.5 * w - result.u_px, result.box.y0 + 0.5 * h - result.v_px)
        truth = FrameTruth(nose_px=scene.nose_px, silhouette=scene.silhouette, background=scene.background)
        return judged(scene.frame, truth, (roi, result), (elapsed, sum(self._stopwatches[name])))


def judged(
    frame: Frame, truth: FrameTruth, look: tuple[Box[int], Detection | Miss], times_s: tuple[float, float] = (0.0, 0.0)
) -> DetectorOutcome:
    """Return the outcome of a detection; ``times_s`` are those of the detector and of the segmentation in it."""
    roi, result = look
    point = error = whitened = np.full(2, np.nan)
    covariance = noise = np.full((2, 2), np.nan)
    overlap, centre_error, reason = 0.0, float("nan"), FOUND
    if isinstance(result, Detection):
        point = np.array([result.u_px, result.v_px])
        error = point - truth.nose_px
        covariance, noise = result.covariance_px2, result.noise_px2
        whitened = np.linalg.solve(np.linalg.cholesky(covariance), error)
        overlap = _overlap(result, truth.silhouette)
        centre_error = float(np.hypot(*(result.centroid_px - truth.silhouette.centre_px)))
    else:
        reason = result.reason.value
    height, width = truth.silhouette.mask.shape
    return DetectorOutcome(
        station=frame.station,
        t_s=frame.t_s,
        background=truth.background,
        width_px=truth.silhouette.width_px,
        roi=roi,
        elapsed_s=times_s[0],
        segment_s=times_s[1],
        reason=reason,
        point_px=point,
        error_px=error,
        whitened=whitened,
        covariance_px2=covariance,
        noise_px2=noise,
        overlap=overlap,
        centre_error_px=centre_error,
        holds_nose=_holds(roi, truth.nose_px[0], truth.nose_px[1], 0, 0),
        holds_silhouette=_holds(roi, truth.silhouette.x, truth.silhouette.y, width - 1, height - 1),
    )


def _time_segmentation(detector: Detector) -> list[float]:
    """Return a list to which the detector from now on adds the seconds of each segmentation."""
    spent: list[float] = []
    segment = detector.segment

    def timed(u: Float32Array, inside: MaskArray) -> Float32Array:
        started = time.thread_time()
        phi = segment(u, inside)
        spent.append(time.thread_time() - started)
        return phi

    detector.segment = timed
    return spent


def segmentation_input(
    scene: TruthScene, config: DetectionConfig, roi: Box[int]
) -> tuple[Float32Array, MaskArray] | None:
    """Return the segmentation's input from a new detector: the scalar image and the initial contour's inside.

    None where it has no contrast: on the ground a new detector has no background model yet.
    """
    image = scene.frame.image.whole()
    detector = Detector(config, (image.shape[1], image.shape[0]))
    segment, taken = detector.segment, []

    def taking(u: Float32Array, inside: MaskArray) -> Float32Array:
        taken.append((u.copy(), inside.copy()))
        return segment(u, inside)

    detector.segment = taking
    detector.detect(image, roi, scene.hint)
    return taken[0] if taken else None


def _holds(roi: Box[int], x: float, y: float, right: float, down: float) -> bool:
    """Return whether the pixels from (x, y) to (x + right, y + down) are in the ROI."""
    across = roi.x0 - 0.5 <= x and x + right <= roi.x1 - 0.5
    return bool(across and roi.y0 - 0.5 <= y and y + down <= roi.y1 - 0.5)


def _overlap(found: Detection, true: TrueSilhouette) -> float:
    """Return intersection over union of two silhouettes, in the window that holds both."""
    h, w = true.mask.shape
    left, top, right, bottom = found.box
    x0, y0 = min(true.x, int(np.floor(left))) - 2, min(true.y, int(np.floor(top))) - 2
    x1, y1 = max(true.x + w, int(np.ceil(right))) + 2, max(true.y + h, int(np.ceil(bottom))) + 2
    seen = silhouette_mask(found, Box(x0, y0, x1, y1))
    truth = np.zeros(seen.shape, np.bool_)
    truth[true.y - y0 : true.y - y0 + h, true.x - x0 : true.x - x0 + w] = true.mask
    return float(np.count_nonzero(seen & truth) / np.count_nonzero(seen | truth))


def watch(
    scenes: Iterable[TruthScene], configs: Mapping[str, DetectionConfig], progress: Callable[[int], None]
) -> dict[str, list[DetectorOutcome]]:
    """Show every scene to every detector and return the outcomes by the detectors' names, in order of time."""
    watchers = {name: DetectorRunner(config) for name, config in configs.items()}
    outcomes: dict[str, list[DetectorOutcome]] = {name: [] for name in configs}
    for number, scene in enumerate(scenes, start=1):
        for name, watcher in watchers.items():
            outcomes[name].append(watcher.look(scene))
        progress(number)
    return outcomes
