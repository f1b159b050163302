"""One camera's looks at its target: where it is expected, again where that is not enough, and on its own path."""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, overlap
from groundstation.detection.detector import DetectionHint, Detector
from groundstation.detection.roi import place_roi
from groundstation.detection.window_search import CLEAR_SCORE, Blob, WindowSearch, alike, best_blob
from groundstation.messages import Detection, Miss, MissReason
from groundstation.registration.picture_shift import picture_shift
from groundstation.single_camera.pixel_identity import appearance_of
from groundstation.single_camera.pixel_target import PixelTarget
from groundstation.single_camera.pixel_tracker_config import PixelTrackerConfig

Look = tuple[Box[int] | None, Detection | Miss]

_GIVEN_SPAN_SIGMA = 0.5
_SIGHT_SIGMA_PX = 3.0
_SIZE_RATE = 0.2
_SURPRISE_SIGMAS = 3.5
_LEAST_SURPRISE_PX = 6.0
_SIMILAR_SIZE, _UNSURE_SIZE, _ALIKE = 2.0, 3.0, 1.5
_WIDER = 0.15  # how much wider a second look goes after each miss, as a share of the picture's width
_UNSURE_CHECK = 0.15
_PATH_SIGMAS, _ON_PATH, _IN_PLACE = 3.5, 0.35, 0.5
_CLOSE_PX = (36, 36)  # so little is looked at around something, where something else is not far
_ASIDE_SIGMAS = 2.0
_FAR_OFF = 0.6  # how much less unlike something far from the path may look
_MOST_SIGHTS = 3  # that are looked at on the target's own path
_NEAR, _SPEED_PER_S = 0.1, 0.3  # how far off a missed target may appear again, as shares of the picture's width


class TargetView:
    """Lets the detector of one camera look at its target.

    Parameters
    ----------
    config : the tuning.
    image_size_px : (w, h) of every picture.

    Attributes
    ----------
    detector : the detector, and what it has learnt.
    """

    def __init__(self, config: PixelTrackerConfig, image_size_px: tuple[int, int]) -> None:
        self._config = config
        self._image_size = image_size_px
        self._window_search = WindowSearch(config.acquisition)
        self.detector = Detector(config.detection, image_size_px)

    def inside(self, image: ImageArray, box: Box[float]) -> Blob | None:
        """Return what stands out most inside a loose box."""
        return self._window_search.inside(image, box)

    def look(self, target: PixelTarget, image: ImageArray) -> Look:
        """Run the detector at the predicted position."""
        place, covariance = target.motion.place(), target.motion.covariance()
        roi = place_roi(place, covariance, target.size_px, self._config.detection, self._image_size)
        if roi is None:
            return None, Miss(reason=MissReason.OUT_OF_VIEW)
        hint = DetectionHint(
            predicted_px=place,
            predicted_covariance_px2=covariance,
            expected_span_px=target.span_px,
            span_sigma_ratio=_GIVEN_SPAN_SIGMA,
        )
        return roi, self.detector.detect(image, roi, hint)

    def at(self, image: ImageArray, sight: Blob, basic_px: tuple[int, int] | None = None) -> Look:
        """Let the detector look at something that stands out, with ``basic_px`` around it."""
        place, covariance = sight.centre_px, (_SIGHT_SIGMA_PX + 0.05 * sight.size_px) ** 2 * np.eye(2)
        config = self._config.detection
        if basic_px is not None:
            config = replace(config, roi_basic_px=basic_px)
        roi = place_roi(place, covariance, sight.box.size, config, self._image_size)
        if roi is None:
            return None, Miss(reason=MissReason.OUT_OF_VIEW)
        hint = DetectionHint(
            predicted_px=place,
            predicted_covariance_px2=covariance,
            expected_span_px=sight.box.w,
            span_sigma_ratio=_GIVEN_SPAN_SIGMA,
        )
        return roi, self.detector.detect(image, roi, hint)

    def doubtful(self, target: PixelTarget, seen: Detection, t_s: float) -> bool:
        """Return whether a detection has to be looked at twice: another size, a jump, or simply its time."""
        c = self._config
        known = target.length_px
        size, since_s = seen.box.length, t_s - target.checked_s
        # a size that keeps differing is not asked about in every frame
        soon = since_s > _UNSURE_CHECK * c.check_s
        other = not alike(size, known, c.size_change)
        if since_s > c.check_s or (soon and (other or target.whole_px is None)):
            return True
        if other and not alike(size, max(target.size_px), c.size_change):
            return True
        off = float(np.hypot(*(seen.centroid_px - target.motion.place())))
        return off > max(_SURPRISE_SIGMAS * target.motion.sigma_px, _LEAST_SURPRISE_PX)

    def again(self, target: PixelTarget, image: ImageArray, small: ImageArray | None, first: Look) -> Look:
        """Follow the picture's own motion, and compare with what stands out around the place."""
        look = first
        target.checked_s = target.newest_s
        if isinstance(look[1], Miss) and small is not None and target.small is not None:
            shift = picture_shift(small, target.small, target.box)
            if shift is not None:
                target.motion.shift_by(shift)
                look = self.look(target, image)
        missed = isinstance(look[1], Miss)
        place = target.motion.place()
        known = target.length_px
        reach = known + 3.0 * target.motion.sigma_px + _LEAST_SURPRISE_PX
        # a target that is not where it was expected may be anywhere a moment later
        wider = _WIDER * target.misses * self._image_size[0]
        blobs = self._window_search.around(image, place, reach + wider)
        if isinstance(look[1], Detection):
            sight = next((s for s in blobs if overlap(s.box, look[1].box)), None)
            if sight is not None and alike(sight.size_px, known, _SIMILAR_SIZE):
                return self._whole(target, image, sight, (look[0], look[1]))
        ratio = _SIMILAR_SIZE if target.whole_px is not None else _UNSURE_SIZE
        similar = [s for s in blobs if alike(s.size_px, known, ratio)]
        best = best_blob(similar, place, reach, blobs)
        if best is not None:
            again = self.at(image, best)
            if not missed and target.whole_px is None and best.score >= CLEAR_SCORE and not _shows(again, best):
                # what the detector has learnt so far may have been more than the target
                self.detector.reset()
                again = self.at(image, best)
            if _shows(again, best) or (missed and isinstance(again[1], Detection)):
                return again
        return look

    def _whole(
        self, target: PixelTarget, image: ImageArray, sight: Blob, look: tuple[Box[int] | None, Detection]
    ) -> Look:
        """Return the look at the whole thing where the detector has seen a part of it, or more than that.

        What is whole was learnt by earlier second looks: next to a pole or in front of a cloud they see more.
        """
        seen = look[1].box.length
        if target.whole_px is None:
            if sight.score < CLEAR_SCORE and not alike(sight.size_px, seen, _ALIKE):
                return look
            target.whole_px = sight.size_px
        if not alike(sight.size_px, target.whole_px, _ALIKE):
            return look
        target.whole_px += _SIZE_RATE * (sight.size_px - target.whole_px)
        if alike(sight.size_px, seen, self._config.size_change):
            return look
        self.detector.reset()
        again = self.at(image, sight)
        return again if isinstance(again[1], Detection) else look

    def on_its_path(self, target: PixelTarget, image: ImageArray) -> Look:
        """Return the look at something that looks like the target and is where its own path leads.

        Once it has been missed, a moving camera may have brought it farther than that.
        """
        place = target.motion.place()
        wider = min(_WIDER * target.misses, _NEAR + _WIDER) * self._image_size[0]
        reach = target.length_px + 3.0 * target.motion.sigma_px + _LEAST_SURPRISE_PX + wider
        blobs = [
            s
            for s in self._window_search.around(image, place, reach)
            if alike(s.size_px, target.length_px, _SIMILAR_SIZE)
        ]
        tried: list[Box[float]] = []
        for sight in sorted(blobs, key=lambda s: float(np.hypot(*(s.centre_px - place)))):
            # several readings of one thing need not all be looked at
            if len(tried) >= _MOST_SIGHTS or any(overlap(sight.box, t) for t in tried):
                continue
            tried.append(sight.box)
            self.detector.reset()
            look = self.at(image, sight, _CLOSE_PX)
            seen = look[1]
            if not isinstance(seen, Detection) or not on_path(target, seen, wider):
                continue
            if self.appears_as_before(target, seen, appearance_of(image, seen)):
                return look
        return None, Miss(reason=MissReason.NO_REGION)

    def appears_as_before(self, target: PixelTarget, seen: Detection, appearance: FloatArray) -> bool:
        """Return whether something looks like the target; far from the path it has to look more like it."""
        most = self._config.unlikeness * (1.0 if on_path(target, seen) else _FAR_OFF)
        return target.identity.unlikeness(appearance) <= most


def on_path(target: PixelTarget, seen: Detection, wider_px: float = 0.0) -> bool:
    """Return whether something is where the target's path leads, to some sigmas and a share of its size."""
    off = float(np.hypot(*(seen.centroid_px - target.motion.place())))
    return off <= _PATH_SIGMAS * target.motion.sigma_px + _ON_PATH * target.length_px + wider_px


def in_place(target: PixelTarget, seen: Detection) -> bool:
    """Return whether the point of something would be one of the target, too, where its path leads."""
    off = float(np.hypot(*(np.array([seen.u_px, seen.v_px]) - target.motion.place())))
    return off <= max(_IN_PLACE * target.length_px, _LEAST_SURPRISE_PX)


def is_off_path(target: PixelTarget, seen: Detection) -> bool:
    """Return whether something lies off the place where the target is expected."""
    off = float(np.hypot(*(seen.centroid_px - target.motion.place())))
    return off > max(_ASIDE_SIGMAS * target.motion.sigma_px, 0.5 * target.length_px, _LEAST_SURPRISE_PX)


def is_second_object(target: PixelTarget, seen: Detection | Miss, other: Detection) -> bool:
    """Return whether ``other`` is a second thing, away from the target's place, which what was ``seen`` first is in.

    Light and blur of a bird close by change what the target looks like; the bird is no more the target for that.
    """
    if isinstance(seen, Miss):
        return False
    return in_place(target, seen) and not in_place(target, other) and not overlap(seen.box, other.box)


def _shows(look: Look, sight: Blob) -> bool:
    """Return whether a look has seen what stands out there."""
    return isinstance(look[1], Detection) and overlap(look[1].box, sight.box)
