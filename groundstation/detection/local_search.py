"""A second look around one place of a picture, without any memory: what stands out there, and how large is it?

It is slower than the detector and knows nothing of the target, so it neither loses a target that has jumped nor
takes a part for the whole because it did so before.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.acquisition import AcquisitionConfig, Candidate, CandidateFinder

Box = tuple[float, float, float, float]

_LEAST_HALF_PX = 80.0
_LEAST_SCORE = 4.0
_LOOSE = 1.3  # how much larger than the box that was given a target may be
_STEP_PX = 32  # windows grow in such steps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """Something that stands out: ``centre_px`` (2,), ``box`` x, y, w, h in px, and its score in sigmas."""

    centre_px: FloatArray
    box: Box
    score: float

    @property
    def size_px(self) -> float:
        """The longer side of the box."""
        return max(self.box[2], self.box[3])


class LocalSearch:
    """Looks at a window of a picture with the whole-frame finder."""

    def __init__(self, config: AcquisitionConfig) -> None:
        self._config = config

    def inside(self, image: ImageArray, box: Box) -> Sight | None:
        """Return what stands out most inside a loose box; None if nothing does."""
        x, y, w, h = box
        found = [
            s
            for s in self.around(image, np.array([x + 0.5 * w, y + 0.5 * h]), max(w, h))
            if x <= s.centre_px[0] <= x + w and y <= s.centre_px[1] <= y + h and _fits(s.box, box)
        ]
        # of several the larger, unless it is much fainter: a part of an aircraft is no aircraft
        return max(found, key=lambda s: s.score * math.sqrt(s.size_px), default=None)

    def around(self, image: ImageArray, place_px: FloatArray, reach_px: float) -> list[Sight]:
        """Return what stands out within about ``reach_px`` of a place (2,), most conspicuous first."""
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


def _fits(box: Box, given: Box) -> bool:
    return box[2] <= _LOOSE * given[2] and box[3] <= _LOOSE * given[3]


def _moved(c: Candidate, x0: int, y0: int) -> Sight:
    x, y, w, h = c.box
    return Sight(centre_px=np.array([c.u_px + x0, c.v_px + y0]), box=(x + x0, y + y0, w, h), score=c.score)
