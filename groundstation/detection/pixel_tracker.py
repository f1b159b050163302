"""One camera, pixels only: find the target, follow it from frame to frame, find it again after a loss.

Nothing is known of the lens, of where the camera points or of what is flown. What is predicted is the target's
place in the picture; what moves it besides its own flight is the camera, seen in the picture's background.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.detection.detector import DetectionHint, Detector
from groundstation.detection.local_search import CLEAR_SCORE, LocalSearch, Sight, alike, best_sight
from groundstation.detection.picture_shift import is_cut, picture_shift, small_copy
from groundstation.detection.pixel_identity import Identity, looks_of
from groundstation.detection.pixel_motion import PixelMotion
from groundstation.detection.pixel_target import PixelTarget
from groundstation.detection.pixel_track import PixelTrack, in_full
from groundstation.detection.pixel_tracker_config import PixelTrackerConfig
from groundstation.detection.roi import place_roi
from groundstation.detection.target_search import Found, TargetSearch, overlaps
from groundstation.detection.working_picture import WorkingPicture
from groundstation.messages import Detection, Miss, MissReason, Roi, TrackStatus

Box = tuple[float, float, float, float]
Look = tuple[Roi | None, Detection | Miss]

_GIVEN_SPAN_SIGMA = 0.5
_SIGHT_SIGMA_PX = 3.0
_SIZE_RATE = 0.2
_SURPRISE_SIGMAS = 3.5
_LEAST_SURPRISE_PX = 6.0
_SIMILAR_SIZE, _UNSURE_SIZE, _ALIKE = 2.0, 3.0, 1.5
_LEAST_MISSES = 10
_WIDER = 0.15  # how much wider a second look goes after each miss, as a share of the picture's width
_UNSURE_CHECK = 0.15
_PATH_SIGMAS, _ON_PATH, _IN_PLACE = 3.5, 0.35, 0.5
_CLOSE_PX = (36, 36)  # so little is looked at around something, where something else is not far
_ASIDE_SIGMAS = 2.0
_FAR_OFF = 0.6  # how much less unlike something far from the path may look
_MOST_SIGHTS = 3  # that are looked at on the target's own path
_NEAR, _SPEED_PER_S = 0.1, 0.3  # how far off a missed target may appear again, as shares of the picture's width


class PixelTracker:
    """Follows one target through the frames of one camera.

    Parameters
    ----------
    image_size_px : (w, h) of every frame.
    config : the tuning.
    """

    def __init__(self, image_size_px: tuple[int, int], config: PixelTrackerConfig | None = None) -> None:
        self._config = config if config is not None else PixelTrackerConfig()
        self._picture = WorkingPicture(image_size_px)
        self._image_size = image_size_px = self._picture.size_px
        self._detector = Detector(self._config.detection, image_size_px)
        self._search = TargetSearch(self._config.search, self._config.acquisition, image_size_px)
        self._local = LocalSearch(self._config.acquisition)
        self._target: PixelTarget | None = None

    def reset(self) -> None:
        """Forget the target and everything that might become one."""
        self._target = None
        self._detector.reset()
        self._search.reset()

    def start(self, image: ImageArray, t_s: float, box: Box) -> PixelTrack:
        """Begin with the target inside ``box`` (x, y, w, h in px) of a frame (h, w, 3) BGR; return what is there.

        The box may be loose: what stands out in it is the target.
        """
        self.reset()
        working = self._picture.prepare(image)
        x, y, w, h = (v * self._picture.scale for v in box)
        sight = self._local.inside(working, (x, y, w, h))
        if sight is None:
            # a box drawn by hand is larger than what is in it
            place, size = (x + 0.5 * w, y + 0.5 * h), (0.7 * w, 0.7 * h)
        else:
            place, size = (float(sight.centre_px[0]), float(sight.centre_px[1])), sight.box[2:]
        target = self._begin(t_s, place, size, None, 2.0 + 0.1 * max(w, h))
        target.proven = True
        target.whole_px = None if sight is None else sight.size_px
        return in_full(self._follow(target, working, t_s), self._picture.scale)

    def step(self, image: ImageArray, t_s: float) -> PixelTrack:
        """Look at the next frame, (h, w, 3) BGR, taken at ``t_s``, later than the last one."""
        target = self._target
        working = self._picture.prepare(image)
        if target is None:
            track = self._find(working, t_s)
        else:
            target.motion.predict(t_s - target.newest_s)
            track = self._follow(target, working, t_s)
        return in_full(track, self._picture.scale)

    # ------------------------------------------------------------------------------------ without a target
    def _find(self, image: ImageArray, t_s: float) -> PixelTrack:
        """Search the whole frame; a target that is sure is looked at at once."""
        track = self._take(image, t_s, self._search.look(image, t_s))
        if track is not None:
            return track
        status = TrackStatus.ACQUIRING if self._search.promising else TrackStatus.SEARCHING
        miss = Miss(reason=MissReason.NOT_ACQUIRED)
        return PixelTrack(t_s=t_s, status=status, result=miss, roi=None, predicted_px=None)

    def _take(self, image: ImageArray, t_s: float, found: Found | None) -> PixelTrack | None:
        """Begin with a confirmed target; None if there is none or the detector does not see it there."""
        if found is None:
            return None
        c = found.candidate
        held = self._target
        target = self._begin(t_s, (c.u_px, c.v_px), c.box[2:], found.velocity_px_s, 2.0 + 0.05 * max(c.box[2:]))
        target.whole_px = max(c.box[2:])
        roi, result = self._look(target, image)
        if isinstance(result, Detection) and overlaps(result.box, c.box) and self._may_be(held, image, result, t_s):
            self._search.reset()
            self._saw(target, result, t_s)
            target.small = small_copy(image)
            place = target.motion.place()
            return PixelTrack(t_s=t_s, status=TrackStatus.TRACKING, result=result, roi=roi, predicted_px=place)
        self._target = held
        self._detector.reset()
        self._search.drop(c.box)
        return None

    def _begin(
        self,
        t_s: float,
        place: tuple[float, float],
        size: tuple[float, float],
        velocity: tuple[float, float] | None,
        sigma_px: float,
    ) -> PixelTarget:
        c = self._config
        self._detector.reset()
        self._target = PixelTarget(
            motion=PixelMotion(
                place, velocity, sigma_px=sigma_px, least_shake_px=c.least_shake_px, most_shake_px=c.most_shake_px
            ),
            size_px=size,
            begun_s=t_s,
            newest_s=t_s,
            seen_s=t_s,
            checked_s=t_s,
            box=(place[0] - 0.5 * size[0], place[1] - 0.5 * size[1], size[0], size[1]),
            proven=False,
            span_px=size[0],
        )
        return self._target

    # --------------------------------------------------------------------------------------- with a target
    def _follow(self, target: PixelTarget, image: ImageArray, t_s: float) -> PixelTrack:
        """Look where the target is expected and, where that is not enough, wider."""
        small, target.small = target.small, small_copy(image)
        dt_s, target.newest_s = t_s - target.newest_s, t_s
        target.frames += 1
        predicted = target.motion.place()
        roi, result = self._look(target, image)
        if isinstance(result, Miss) or self._doubtful(target, result, t_s):
            if small is not None and is_cut(small, target.small):
                self.reset()
                return self._find(image, t_s)
            roi, result = self._look_again(target, image, small, (roi, result))
        roi, result = self._judge(target, image, (roi, result), t_s)
        if isinstance(result, Detection):
            status = TrackStatus.TRACKING
            return PixelTrack(t_s=t_s, status=status, result=result, roi=roi, predicted_px=predicted)
        target.misses += 1
        target.motion.coast(dt_s)
        if target.misses >= self._config.search_after:
            found = self._search.look(image, t_s, max(target.size_px))
            track = self._take(image, t_s, found if found is None or self._likely(target, found, t_s) else None)
            if track is not None:
                return track
        status = TrackStatus.COASTING
        if self._is_lost(target, t_s) or self._is_false(target, t_s):
            status = TrackStatus.LOST
            self._target = None
            self._detector.reset()
        return PixelTrack(t_s=t_s, status=status, result=result, roi=roi, predicted_px=predicted)

    def _look(self, target: PixelTarget, image: ImageArray) -> Look:
        """Let the detector look where the motion says."""
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
        return roi, self._detector.detect(image, roi, hint)

    def _look_at(self, image: ImageArray, sight: Sight, basic_px: tuple[int, int] | None = None) -> Look:
        """Let the detector look at something that stands out, with ``basic_px`` around it."""
        place, covariance = sight.centre_px, (_SIGHT_SIGMA_PX + 0.05 * sight.size_px) ** 2 * np.eye(2)
        config = self._config.detection
        if basic_px is not None:
            config = replace(config, roi_basic_px=basic_px)
        roi = place_roi(place, covariance, sight.box[2:], config, self._image_size)
        if roi is None:
            return None, Miss(reason=MissReason.OUT_OF_VIEW)
        hint = DetectionHint(
            predicted_px=place,
            predicted_covariance_px2=covariance,
            expected_span_px=sight.box[2],
            span_sigma_ratio=_GIVEN_SPAN_SIGMA,
        )
        return roi, self._detector.detect(image, roi, hint)

    def _doubtful(self, target: PixelTarget, seen: Detection, t_s: float) -> bool:
        """Return whether a detection has to be looked at twice: another size, a jump, or simply its time."""
        c = self._config
        known = target.length_px
        size, since_s = max(seen.box[2], seen.box[3]), t_s - target.checked_s
        # a size that keeps differing is not asked about in every frame
        soon = since_s > _UNSURE_CHECK * c.check_s
        other = not alike(size, known, c.size_change)
        if since_s > c.check_s or (soon and (other or target.whole_px is None)):
            return True
        if other and not alike(size, max(target.size_px), c.size_change):
            return True
        off = float(np.hypot(*(seen.centroid_px - target.motion.place())))
        return off > max(_SURPRISE_SIGMAS * target.motion.sigma_px, _LEAST_SURPRISE_PX)

    def _look_again(self, target: PixelTarget, image: ImageArray, small: ImageArray | None, first: Look) -> Look:
        """Follow the picture's own motion, and compare with what stands out around the place."""
        look = first
        target.checked_s = target.newest_s
        if isinstance(look[1], Miss) and small is not None and target.small is not None:
            shift = picture_shift(small, target.small, target.box)
            if shift is not None:
                target.motion.go_with(shift)
                look = self._look(target, image)
        missed = isinstance(look[1], Miss)
        place = target.motion.place()
        known = target.length_px
        reach = known + 3.0 * target.motion.sigma_px + _LEAST_SURPRISE_PX
        # a target that is not where it was expected may be anywhere a moment later
        wider = _WIDER * target.misses * self._image_size[0]
        sights = self._local.around(image, place, reach + wider)
        if isinstance(look[1], Detection):
            sight = next((s for s in sights if overlaps(s.box, look[1].box)), None)
            if sight is not None and alike(sight.size_px, known, _SIMILAR_SIZE):
                return self._whole(target, image, sight, (look[0], look[1]))
        ratio = _SIMILAR_SIZE if target.whole_px is not None else _UNSURE_SIZE
        similar = [s for s in sights if alike(s.size_px, known, ratio)]
        best = best_sight(similar, place, reach, sights)
        if best is not None:
            again = self._look_at(image, best)
            if not missed and target.whole_px is None and best.score >= CLEAR_SCORE and not _shows(again, best):
                # what the detector has learnt so far may have been more than the target
                self._detector.reset()
                again = self._look_at(image, best)
            if _shows(again, best) or (missed and isinstance(again[1], Detection)):
                return again
        return look

    def _judge(self, target: PixelTarget, image: ImageArray, look: Look, t_s: float) -> Look:
        """Take what is the target; where something else is seen in its place, look for it on its own path.

        What looks like something else but is in the target's place, as a bird before it is, is returned without
        being learnt from; what is elsewhere is a miss.
        """
        identity, seen = target.identity, look[1]
        if isinstance(seen, Detection):
            looks = looks_of(image, seen)
            as_before = seen.cut or identity.unlikeness(looks) <= self._config.unlikeness
            if identity.doubt_s is None:
                if as_before:
                    aside = _aside(target, seen)
                    if aside:
                        # of two that look alike, the one that is where the path leads
                        other = self._on_its_path(target, image)
                        look, seen = (other, other[1]) if isinstance(other[1], Detection) else (look, seen)
                        looks = looks_of(image, seen)
                    self._saw(target, seen, t_s)
                    if aside:
                        target.span_px = seen.box[2]
                    if not seen.cut:
                        identity.learn(looks, target.motion, target.size_px, target.whole_px, t_s)
                    return look
                target.go_back(t_s)
                as_before = identity.unlikeness(looks) <= self._config.unlikeness
            if as_before and _on_path(target, seen, _ON_PATH):
                self._saw(target, seen, t_s)
                identity.confirm(target.motion, t_s)
                return look
        if identity.doubt_s is None:
            return look
        other = self._on_its_path(target, image)
        if isinstance(other[1], Detection):
            self._saw(target, other[1], t_s)
            identity.confirm(target.motion, t_s)
            return other
        # whatever the detector has just learnt is not the target
        self._detector.reset()
        target.span_px = target.size_px[0]
        if not isinstance(seen, Detection):
            return look
        if not _on_path(target, seen, _IN_PLACE):
            return look[0], Miss(reason=MissReason.AMBIGUOUS, detail="something else, away from the target's path")
        looks = looks_of(image, seen)
        if identity.stays_other(looks, target.motion, self._config.unlikeness, t_s) > self._config.accept_s:
            target.identity = Identity()
            self._saw(target, seen, t_s)
        return look

    def _on_its_path(self, target: PixelTarget, image: ImageArray) -> Look:
        """Return the look at something that looks like the target and is where its own path leads.

        Once it has been missed, a moving camera may have brought it farther than that.
        """
        place = target.motion.place()
        wider = min(_WIDER * target.misses, _NEAR + _WIDER) * self._image_size[0]
        reach = target.length_px + 3.0 * target.motion.sigma_px + _LEAST_SURPRISE_PX + wider
        sights = [
            s for s in self._local.around(image, place, reach) if alike(s.size_px, target.length_px, _SIMILAR_SIZE)
        ]
        tried: list[Box] = []
        for sight in sorted(sights, key=lambda s: float(np.hypot(*(s.centre_px - place)))):
            # several readings of one thing need not all be looked at
            if len(tried) >= _MOST_SIGHTS or any(overlaps(sight.box, t) for t in tried):
                continue
            tried.append(sight.box)
            self._detector.reset()
            look = self._look_at(image, sight, _CLOSE_PX)
            seen = look[1]
            if not isinstance(seen, Detection) or not _on_path(target, seen, _ON_PATH, wider):
                continue
            most = self._config.unlikeness * (1.0 if _on_path(target, seen, _ON_PATH) else _FAR_OFF)
            if target.identity.unlikeness(looks_of(image, seen)) <= most:
                return look
        return None, Miss(reason=MissReason.NO_REGION)

    def _whole(self, target: PixelTarget, image: ImageArray, sight: Sight, look: tuple[Roi | None, Detection]) -> Look:
        """Return the look at the whole thing where the detector has seen a part of it, or more than that.

        What is whole was learnt by earlier second looks: beside a pole or before a cloud they see more.
        """
        seen = max(look[1].box[2], look[1].box[3])
        if target.whole_px is None:
            if sight.score < CLEAR_SCORE and not alike(sight.size_px, seen, _ALIKE):
                return look
            target.whole_px = sight.size_px
        if not alike(sight.size_px, target.whole_px, _ALIKE):
            return look
        target.whole_px += _SIZE_RATE * (sight.size_px - target.whole_px)
        if alike(sight.size_px, seen, self._config.size_change):
            return look
        self._detector.reset()
        again = self._look_at(image, sight)
        return again if isinstance(again[1], Detection) else look

    def _saw(self, target: PixelTarget, seen: Detection, t_s: float) -> None:
        """Take a detection."""
        size = (seen.box[2], seen.box[3])
        target.motion.correct(seen.centroid_px, 1.0 + 0.05 * max(size))
        rate = 1.0 if target.seen == 0 else _SIZE_RATE
        if not seen.cut:
            target.size_px = (
                target.size_px[0] + rate * (size[0] - target.size_px[0]),
                target.size_px[1] + rate * (size[1] - target.size_px[1]),
            )
        target.box = seen.box
        target.span_px = None  # the detector's own memory is better now
        target.seen_s = t_s
        if target.misses:
            self._search.reset()
        target.misses = 0
        target.seen += 1

    def _likely(self, target: PixelTarget, found: Found, t_s: float) -> bool:
        """Return whether what was found may be the target that is missed, or has been missed for long enough."""
        gone_s = t_s - target.seen_s
        c = found.candidate
        away = float(np.hypot(*(np.array([c.u_px, c.v_px]) - target.motion.place())))
        share = away / self._image_size[0]
        return gone_s > self._config.another_after_s or share < _NEAR + _SPEED_PER_S * gone_s

    def _may_be(self, held: PixelTarget | None, image: ImageArray, seen: Detection, t_s: float) -> bool:
        """Return whether something that was found may be the target that is missed, by its looks."""
        if held is None or t_s - held.seen_s > self._config.another_after_s:
            return True
        return held.identity.unlikeness(looks_of(image, seen)) <= self._config.unlikeness

    def _is_lost(self, target: PixelTarget, t_s: float) -> bool:
        return t_s - target.seen_s > self._config.lost_after_s and target.misses >= _LEAST_MISSES

    def _is_false(self, target: PixelTarget, t_s: float) -> bool:
        """Return whether a target that was found by searching fails to show itself."""
        if target.proven or t_s - target.begun_s < self._config.proof_s:
            return False
        if target.seen < self._config.proof_share * target.frames:
            return True
        target.proven = True
        return False


def _on_path(target: PixelTarget, seen: Detection, sizes: float, wider_px: float = 0.0) -> bool:
    """Return whether something is where the target's path leads, to some sigmas and a share of its size."""
    off = float(np.hypot(*(seen.centroid_px - target.motion.place())))
    return off <= _PATH_SIGMAS * target.motion.sigma_px + sizes * target.length_px + wider_px


def _aside(target: PixelTarget, seen: Detection) -> bool:
    """Return whether something is beside the place where the target is expected."""
    off = float(np.hypot(*(seen.centroid_px - target.motion.place())))
    return off > max(_ASIDE_SIGMAS * target.motion.sigma_px, 0.5 * target.length_px, _LEAST_SURPRISE_PX)


def _shows(look: Look, sight: Sight) -> bool:
    """Return whether a look has seen what stands out there."""
    return isinstance(look[1], Detection) and overlaps(look[1].box, sight.box)
