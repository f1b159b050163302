"""Search for candidates in a window of an image: `candidate_finder` without a model of the target.

It is slower than the detector but independent of the previous frames: it finds a target that has jumped, and
corrects a silhouette that covers only a part of the aircraft.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, contains, overlap, shift
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder

_LEAST_HALF_PX = 80.0
_LEAST_SCORE = 3.0
_BEYOND, _BEYOND_PX = 0.1, 2.0  # how far out of the box that was given a target may reach
_CENTRED = 0.35  # how far from its middle, as a share of its size
_STEP_PX = 32  # windows grow in such steps
_LEAST_SIZE_PX = 8.0  # smaller sizes count as equal
CLEAR_SCORE = 8.0  # sigmas: what stands out so much is seen as it is
_ALONE = 2.0  # ratio of contrasts by which a target far from its place has to exceed all others


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blob:
    """A region of high contrast: ``centre_px`` (2,), ``box`` in px, and its score in sigmas."""

    centre_px: FloatArray
    box: Box[float]
    score: float

    @property
    def size_px(self) -> float:
        """The longer side of the box."""
        return self.box.length


class WindowSearch:
    """Applies the whole-frame finder to a window of an image."""

    def __init__(self, config: AcquisitionConfig) -> None:
        # the position is known: candidates in front of ground get the same weight as those in the sky
        self._config = replace(config, ground_weight=1.0)

    def inside(self, image: ImageArray, box: Box[float]) -> Blob | None:
        """Return the most conspicuous blob inside a loose box, or None."""
        w, h = box.size
        middle = np.array([box.x0 + 0.5 * w, box.y0 + 0.5 * h])

        def worth(blob: Blob) -> float:
            off = (blob.centre_px - middle) / (_CENTRED * np.array([w, h]))
            # prefers the larger of several, unless it is much fainter: the smaller may be a part of the aircraft
            return blob.score * math.sqrt(blob.size_px) * math.exp(-0.5 * float(off @ off))

        found = [s for s in self.around(image, middle, max(w, h)) if _within(s.box, box)]
        return max(found, key=worth, default=None)

    def around(self, image: ImageArray, place_px: FloatArray, reach_px: float) -> list[Blob]:
        """Return the blobs within about ``reach_px`` of a place (2,), most conspicuous first."""
        h, w = image.shape[:2]
        half = math.ceil((max(_LEAST_HALF_PX, reach_px + 24.0)) / _STEP_PX) * _STEP_PX
        x0, x1 = _span(float(place_px[0]), half, w)
        y0, y1 = _span(float(place_px[1]), half, h)
        if x1 - x0 < _STEP_PX or y1 - y0 < _STEP_PX:
            return []
        window = np.ascontiguousarray(image[y0:y1, x0:x1])
        finder = CandidateFinder(self._config, (x1 - x0, y1 - y0))
        return [_moved(c, x0, y0) for c in finder.find(window, 0.0) if c.score >= _LEAST_SCORE]


def _span(centre: float, half: int, limit: int) -> tuple[int, int]:
    middle = min(max(round(centre), 0), limit)
    return max(middle - half, 0), min(middle + half, limit)


def _within(box: Box[float], given: Box[float]) -> bool:
    """Return whether a box is inside another one, within a tolerance."""
    x, y = _BEYOND * given.w + _BEYOND_PX, _BEYOND * given.h + _BEYOND_PX
    return contains(Box(given.x0 - x, given.y0 - y, given.x1 + x, given.y1 + y), box)


def _moved(c: Candidate, x0: int, y0: int) -> Blob:
    return Blob(centre_px=np.array([c.u_px + x0, c.v_px + y0]), box=shift(c.box, x0, y0), score=c.score)


def best_blob(similar: list[Blob], place: FloatArray, reach_px: float, all_of_them: list[Blob]) -> Blob | None:
    """Return the blob that is most likely the target: one near the place (2,), or one without an equal."""

    def off(blob: Blob) -> float:
        return float(np.hypot(*(blob.centre_px - place))) / reach_px

    near = [s for s in similar if off(s) <= 1.0]
    if near:
        return min(near, key=lambda s: off(s) - 0.02 * s.score)
    best = max(similar, key=lambda s: s.score, default=None)
    if best is None or best.score < CLEAR_SCORE:
        return None
    rivals = [s.score for s in all_of_them if not overlap(s.box, best.box)]
    return best if best.score >= _ALONE * max(rivals, default=0.0) else None


def alike(a_px: float, b_px: float, ratio: float) -> bool:
    """Return whether two sizes differ by no more than a ratio."""
    a, b = max(a_px, _LEAST_SIZE_PX), max(b_px, _LEAST_SIZE_PX)
    return max(a, b) <= ratio * min(a, b)
