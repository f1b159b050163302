"""Review of what a tracker of one camera holds: is it an aircraft, and if not, is there one elsewhere?

A tracker that adapts to what it follows can hold anything that stays in place: after a cut, a sign at the border. Every
few tenths of a second the learned channel looks at the target. One that it does not recognise in several reviews is
compared with the rest of the frame; what is recognised elsewhere, in several frames running and on a smooth path,
replaces it. A target that was given, and that the channel has never recognised, is what the user wants: it is kept.

The channel has seen many aircraft and few signs, and takes some for aircraft. So what is cut by the border and moves
with the background, or rests where no background is seen, is doubted whatever the channel says.
"""

import math

from groundstation.arrays import ImageArray
from groundstation.box import Box, overlap
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.learned_finder import LearnedFinder
from groundstation.registration.picture_shift import small_copy
from groundstation.single_camera.rest_check import rests_between

_REVIEW_S, _RIVAL_S = 0.4, 0.1
# reviews running without recognition; earlier ones with it, for a target that was given; sights of a rival
_DOUBTS, _KNOWN, _SIGHTS = 3, 3, 4
# log odds of a rival; these and the next were chosen on ten composed clips, and no rival replaced an aircraft of the
# 28 labelled stretches of real clips
_RIVAL_ODDS = 2.0
# log odds of a target that is clearly recognised, and the lead of a rival over one that is not
_RECOGNISED_ODDS, _LEAD = 2.5, 2.5
# how far a rival may be from where it was seen last: in widths, and per second in widths
_GATE, _SPEED = 0.7, 6.0
# what is cut by the border lies so near to it
_BORDER_PX = 3.0


class TargetReview:
    """Reviews the target of one camera with pictures of ``image_size_px`` (w, h)."""

    def __init__(self, image_size_px: tuple[int, int]) -> None:
        self._size_px = image_size_px
        self._finder: LearnedFinder | None = None
        self.reset(given=False)

    def reset(self, *, given: bool) -> None:
        """Begin with another target, ``given`` by the user or found."""
        self._given = given
        self._next_s = -math.inf
        self._doubts = self._recognised = 0
        self._rival: tuple[float, Candidate] | None = None
        self._sights = 0
        self._before: tuple[ImageArray, Box[float]] | None = None

    def rival(self, image: ImageArray, t_s: float, box: Box[float]) -> Candidate | None:
        """Look at the target in ``box`` of a frame (h, w, 3) at ``t_s`` s; return what is to replace it, or None."""
        if t_s < self._next_s:
            return None
        if self._finder is None:
            detection = DetectionConfig(detector=DetectorKind.LEARNED)
            self._finder = LearnedFinder(AcquisitionConfig(), detection, self._size_px)
        self._next_s = t_s + _REVIEW_S
        odds = self._finder.aircraft_odds(image, box)
        if self._is_scenery(image, box):
            odds = min(odds, 0.0)
        if odds >= _RECOGNISED_ODDS:
            self._recognised += 1
            self._doubts, self._rival, self._sights = 0, None, 0
            return None
        self._doubts += 1
        if self._doubts < _DOUBTS or (self._given and self._recognised < _KNOWN):
            return None
        self._next_s = t_s + _RIVAL_S
        return self._seen_again(self._likeliest(self._finder, image, t_s, box, odds), t_s)

    def _is_scenery(self, image: ImageArray, box: Box[float]) -> bool:
        """Return whether the target is cut by the border and has moved with the background since the last review."""
        small = small_copy(image)
        before, self._before = self._before, (small, box)
        w, h = self._size_px
        cut = min(box.x0, box.y0, w - box.x1, h - box.y1) <= _BORDER_PX
        if before is None or not cut or before[0].shape != small.shape:
            return False
        return rests_between(before[0], before[1], small, box)

    def _likeliest(
        self, finder: LearnedFinder, image: ImageArray, t_s: float, box: Box[float], odds: float
    ) -> Candidate | None:
        """Return the likeliest aircraft of a frame outside of ``box``, where log odds are ``odds``."""
        least = max(_RIVAL_ODDS, odds + _LEAD)
        found = [c for c in finder.find(image, t_s) if c.odds is not None and c.odds >= least]
        found = [c for c in found if not overlap(c.box, box)]
        return max(found, key=lambda c: c.odds or 0.0, default=None)

    def _seen_again(self, found: Candidate | None, t_s: float) -> Candidate | None:
        """Count a sight of the rival; return it once it has been seen often enough."""
        if found is None:
            self._rival, self._sights = None, 0
            return None
        if self._rival is not None:
            before_s, before = self._rival
            away = math.hypot(found.u_px - before.u_px, found.v_px - before.v_px)
            if away > (_GATE + _SPEED * min(t_s - before_s, _REVIEW_S)) * max(found.box.w, before.box.w):
                self._sights = 0
        self._rival = (t_s, found)
        self._sights += 1
        return found if self._sights >= _SIGHTS else None
