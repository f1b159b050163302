"""Identity of one camera's target: its appearance and motion, with a history of some frames.

A bird that crosses the target merges with its silhouette and then flies on; a tracker that adapts to the merged
silhouette follows the bird. So the appearance model adapts slowly; a silhouette that suddenly differs updates neither
the appearance nor the motion, and both are restored from some frames earlier.
"""

import copy
import math
from collections import deque
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.appearance import features
from groundstation.messages import Detection
from groundstation.single_camera.pixel_motion import PixelMotion

# mean grey, blue-red, green-magenta in grey levels; ln(height / width); ln(area / width²); ln(length)
_TOLERANCE = np.array([14.0, 6.0, 6.0, 0.25, 0.3, 0.25])
_SMALL_PX = 6.0  # a silhouette of this length may differ by twice as much: a pixel more or less changes it
_RATE = 0.1
_KNOWN_AFTER = 5  # frames
_BEFORE = 4  # frames: so long before a change is noticed it may have begun
_CALM_FRAMES = 3


def appearance_of(image: ImageArray, seen: Detection) -> FloatArray:
    """Return the features (6,) of a detection in its frame (h, w, 3) BGR."""
    w, h = seen.box.size
    length = math.log(max(w, h, 1.0))
    return np.append(features(_colour(image, seen), w, h, seen.area_px), length)


def _colour(image: ImageArray, seen: Detection) -> FloatArray:
    """Return mean grey, blue-red and green-magenta inside the outline."""
    x0, y0 = max(math.floor(seen.box.x0), 0), max(math.floor(seen.box.y0), 0)
    x1, y1 = min(math.ceil(seen.box.x1) + 1, image.shape[1]), min(math.ceil(seen.box.y1) + 1, image.shape[0])
    mask = np.zeros((max(y1 - y0, 1), max(x1 - x0, 1)), np.uint8)
    breaks = np.flatnonzero(np.isnan(seen.contour_px[:, 0]))
    pieces = [p[~np.isnan(p[:, 0])] for p in np.split(seen.contour_px, breaks)]
    cv2.fillPoly(mask, [np.round(p - (x0, y0)).astype(np.int32) for p in pieces if len(p)], 1)
    b, g, r, _ = cv2.mean(image[y0 : y0 + mask.shape[0], x0 : x0 + mask.shape[1]], mask)
    return np.array([0.114 * b + 0.587 * g + 0.299 * r, 0.5 * (b - r), 0.5 * g - 0.25 * (b + r)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AppearanceSample:
    """Appearance and motion of the target after an unambiguous frame.

    Attributes
    ----------
    mean, variance : of its features (6,), running.
    motion : its path.
    size_px, whole_px : its (w, h), smoothed, and its length as second looks have shown it.
    t_s : when.
    """

    mean: FloatArray
    variance: FloatArray
    motion: PixelMotion
    size_px: tuple[float, float]
    whole_px: float | None
    t_s: float


@dataclass(slots=True, kw_only=True, eq=False)
class TargetAppearance:
    """Appearance model of a target, with a history of some frames.

    Attributes
    ----------
    frames : number of frames in the model.
    doubt_s : time since which the detections differ from the model; None if they agree.
    calm : number of consecutive frames since then that agree again.
    other, other_s : model of the differing detections, and the time since which they agree with it.
    """

    frames: int = 0
    doubt_s: float | None = None
    calm: int = 0
    other: "TargetAppearance | None" = None
    other_s: float = 0.0
    _known: deque[AppearanceSample] = field(default_factory=lambda: deque(maxlen=_BEFORE))

    def unlikeness(self, appearance: FloatArray) -> float:
        """Return the distance of a silhouette from the model in sigmas; 0 until enough frames are in the model."""
        if self.frames < _KNOWN_AFTER:
            return 0.0
        known = self._known[0 if self.doubt_s is not None else -1]
        length = math.exp(0.5 * (appearance[-1] + known.mean[-1]))
        variance = ((1.0 + _SMALL_PX / length) * _TOLERANCE) ** 2 + known.variance
        return math.sqrt(float(np.mean((appearance - known.mean) ** 2 / variance)))

    def learn(
        self,
        appearance: FloatArray,
        motion: PixelMotion,
        size_px: tuple[float, float],
        whole_px: float | None,
        t_s: float,
    ) -> None:
        """Update the model with an unambiguous frame."""
        self.frames += 1
        mean, variance = appearance, np.zeros_like(appearance)
        if self._known:
            last = self._known[-1]
            gain = max(_RATE, 1.0 / self.frames)
            error = appearance - last.mean
            mean, variance = last.mean + gain * error, (1.0 - gain) * (last.variance + gain * error**2)
        self._known.append(
            AppearanceSample(
                mean=mean, variance=variance, motion=copy.copy(motion), size_px=size_px, whole_px=whole_px, t_s=t_s
            )
        )

    def doubt(self, t_s: float) -> AppearanceSample:
        """Mark the start of a disagreement; return the sample from before the change."""
        self.doubt_s, self.calm, self.other = t_s, 0, None
        return self._known[0]

    def other_duration_s(self, appearance: FloatArray, motion: PixelMotion, most: float, t_s: float) -> float:
        """Add a differing frame; return the time in s since which such frames agree with each other.

        A bird changes its shape; a target after a turn or before another background keeps its new appearance.
        """
        if self.other is None or self.other.unlikeness(appearance) > most:
            self.other, self.other_s = TargetAppearance(), t_s
        self.other.learn(appearance, motion, (0.0, 0.0), None, t_s)
        return t_s - self.other_s

    def confirm(self, motion: PixelMotion, t_s: float) -> None:
        """Add a frame that agrees with the model; a few consecutive ones end the disagreement."""
        self.calm += 1
        if self.calm >= _CALM_FRAMES:
            self.doubt_s = None
            first = replace(self._known[0], motion=copy.copy(motion), t_s=t_s)
            self._known.clear()
            self._known.append(first)
