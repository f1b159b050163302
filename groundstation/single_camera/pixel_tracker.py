"""One camera, pixels only: find the target, follow it from frame to frame, find it again after a loss.

Nothing is known of the lens, of where the camera points or of what is flown. What is predicted is the target's
place in the picture; what moves it besides its own flight is the camera, seen in the picture's background.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.box import Box, box_of_size, overlap
from groundstation.detection.candidate_finder import Candidate
from groundstation.detection.image_conditioning import ImageConditioner
from groundstation.detection.pixel_track import PixelTrack, in_full
from groundstation.detection.target_confirmation import ConfirmedTarget, TargetConfirmation
from groundstation.messages import Detection, Miss, MissReason, TrackStatus
from groundstation.registration.picture_shift import is_cut, small_copy
from groundstation.single_camera.pixel_identity import TargetAppearance, appearance_of
from groundstation.single_camera.pixel_motion import PixelMotion
from groundstation.single_camera.pixel_target import PixelTarget
from groundstation.single_camera.pixel_tracker_config import PixelTrackerConfig
from groundstation.single_camera.target_review import TargetReview
from groundstation.single_camera.target_view import TargetView, in_place, is_off_path, is_second_object, on_path

Look = tuple[Box[int] | None, Detection | Miss]

_SIZE_RATE = 0.2
_LEAST_MISSES = 10
_NEAR, _SPEED_PER_S = 0.1, 0.3  # how far off a missed target may appear again, as shares of the picture's width


class PixelTracker:
    """Follows one target through the frames of one camera.

    Parameters
    ----------
    image_size_px : (w, h) of every frame.
    config : the tuning.

    Attributes
    ----------
    start_confirmed : whether what a start was given has shown itself; True without a start.
    replaced : how many targets the review has replaced by others.
    """

    def __init__(self, image_size_px: tuple[int, int], config: PixelTrackerConfig | None = None) -> None:
        self._config = config if config is not None else PixelTrackerConfig()
        self._picture = ImageConditioner(image_size_px)
        self._image_size = image_size_px = self._picture.size_px
        self._view = TargetView(self._config, image_size_px)
        self._confirmation = TargetConfirmation(self._config.search, self._config.acquisition, image_size_px)
        self._review = TargetReview(image_size_px)
        self._target: PixelTarget | None = None
        self._given: Box[float] | None = None  # where a start that is on trial was last seen
        self.start_confirmed = True
        self.replaced = 0

    def reset(self) -> None:
        """Forget the target and everything that might become one."""
        self._target = self._given = None
        self._review.reset(given=False)
        self._view.detector.reset()
        self._confirmation.reset()

    def start(self, image: ImageArray, t_s: float, box: Box[float]) -> PixelTrack:
        """Begin with the target inside ``box`` (px) of a frame (h, w, 3) BGR; return what is there.

        The box may be loose: what stands out in it is the target, at once where it does so clearly. Otherwise it is on
        trial, acquiring without a point, until as many frames have shown it as searching would ask for; where they do
        not, the box holds nothing and the whole picture is searched.
        """
        return in_full(self.start_prepared(self._picture.prepare(image), t_s, box), self._picture.scale)

    def start_prepared(self, working: ImageArray, t_s: float, box: Box[float]) -> PixelTrack:
        """Do as `start` with a working picture of `picture`; return the track in its pixels."""
        self.reset()
        scale = self._picture.scale
        x, y, w, h = box.x0 * scale, box.y0 * scale, box.w * scale, box.h * scale
        given = box_of_size(x, y, w, h)
        sight = self._view.inside(working, given)
        if sight is None:
            # a box drawn by hand is larger than what is in it
            place, size = (x + 0.5 * w, y + 0.5 * h), (0.7 * w, 0.7 * h)
        else:
            place, size = (float(sight.centre_px[0]), float(sight.centre_px[1])), sight.box.size
        target = self._begin(t_s, place, size, None, 2.0 + 0.1 * max(w, h))
        target.whole_px = None if sight is None else sight.size_px
        self._given, self.start_confirmed = given, False
        self._review.reset(given=True)
        return self._on_trial(target, given, working, t_s)

    def step(self, image: ImageArray, t_s: float) -> PixelTrack:
        """Look at the next frame, (h, w, 3) BGR, taken at ``t_s``, later than the last one."""
        return in_full(self.step_prepared(self._picture.prepare(image), t_s), self._picture.scale)

    def step_prepared(self, working: ImageArray, t_s: float) -> PixelTrack:
        """Do as `step` with a working picture of `picture`; return the track in its pixels."""
        target = self._target
        if target is None:
            return self._find(working, t_s)
        target.motion.predict(t_s - target.newest_s)
        if self._given is None:
            return self.reviewed(self._follow(target, working, t_s), working, t_s)
        return self._on_trial(target, self._given, working, t_s)

    @property
    def picture(self) -> ImageConditioner:
        """What prepares the working pictures."""
        return self._picture

    @property
    def has_target(self) -> bool:
        """Whether there is a target, seen or predicted."""
        return self._target is not None

    def release(self) -> None:
        """Forget the target, but not what the review knows of it: something else follows it."""
        self._target = self._given = None
        self._view.detector.reset()
        self._confirmation.reset()

    def take(
        self, working: ImageArray, t_s: float, box: Box[float], velocity_px_s: tuple[float, float]
    ) -> PixelTrack | None:
        """Begin with what something else has followed into ``box`` of a working picture; None if it is not seen."""
        return self._take(working, t_s, _in_middle(box, velocity_px_s))

    # ------------------------------------------------------------------------------------ without a target
    def _find(self, image: ImageArray, t_s: float) -> PixelTrack:
        """Search the whole frame; a target that is sure is looked at at once."""
        track = self._take(image, t_s, self._confirmation.update(image, t_s))
        if track is not None:
            self._review.reset(given=False)
            return track
        status = TrackStatus.ACQUIRING if self._confirmation.promising else TrackStatus.SEARCHING
        miss = Miss(reason=MissReason.NOT_ACQUIRED)
        return PixelTrack(t_s=t_s, status=status, result=miss, roi=None, predicted_px=None)

    def _take(
        self, image: ImageArray, t_s: float, found: ConfirmedTarget | None, *, another: bool = False
    ) -> PixelTrack | None:
        """Begin with a confirmed target; None if there is none or the detector does not see it there.

        ``another`` target is known not to be the one that is held.
        """
        if found is None:
            return None
        c = found.candidate
        held = self._target
        target = self._begin(t_s, (c.u_px, c.v_px), c.box.size, found.velocity_px_s, 2.0 + 0.05 * c.box.length)
        target.whole_px = c.box.length
        roi, result = self._view.look(target, image)
        if (
            isinstance(result, Detection)
            and overlap(result.box, c.box)
            and (another or self._may_be(held, image, result, t_s))
        ):
            self._confirmation.reset()
            self._saw(target, result, t_s)
            target.small = small_copy(image)
            place = target.motion.place()
            return PixelTrack(t_s=t_s, status=TrackStatus.TRACKING, result=result, roi=roi, predicted_px=place)
        self._target = held
        self._view.detector.reset()
        self._confirmation.drop(c.box)
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
        self._view.detector.reset()
        self._target = PixelTarget(
            motion=PixelMotion(
                place, velocity, sigma_px=sigma_px, least_shake_px=c.least_shake_px, most_shake_px=c.most_shake_px
            ),
            size_px=size,
            begun_s=t_s,
            newest_s=t_s,
            seen_s=t_s,
            checked_s=t_s,
            box=box_of_size(place[0] - 0.5 * size[0], place[1] - 0.5 * size[1], size[0], size[1]),
            proven=False,
            span_px=size[0],
        )
        return self._target

    # --------------------------------------------------------------------------------------- with a target
    def reviewed(self, track: PixelTrack, image: ImageArray, t_s: float) -> PixelTrack:
        """Return the track of a frame, of another target where the review replaces the one that is held."""
        if not isinstance(track.result, Detection):
            return track
        rival = self._review.rival(image, t_s, track.result.box)
        if rival is None:
            return track
        taken = self._take(image, t_s, _in_middle(rival.box, (0.0, 0.0)), another=True)
        if taken is None:
            return track
        self._review.reset(given=False)
        self.replaced += 1
        return taken

    def _on_trial(self, target: PixelTarget, given: Box[float], image: ImageArray, t_s: float) -> PixelTrack:
        """Follow what a start was given until it is sure, or until it is sure that there is nothing."""
        c = self._config.search
        track = self._follow(target, image, t_s)
        seen, miss = track.result, Miss(reason=MissReason.NOT_ACQUIRED)
        if isinstance(seen, Detection) and overlap(seen.box, given):
            clear = target.frames == 1 and seen.contrast_to_noise >= c.least_score
            if clear or (target.seen >= c.frames and t_s - target.begun_s >= c.span_s):
                self._given, self.start_confirmed = None, True
                target.proven = clear
                return track
            self._given = seen.box
        elif isinstance(seen, Detection) or self._target is not target or target.misses >= self._config.search_after:
            self.reset()
            return PixelTrack(t_s=t_s, status=TrackStatus.SEARCHING, result=miss, roi=None, predicted_px=None)
        return replace(track, status=TrackStatus.ACQUIRING, result=miss)

    def _follow(self, target: PixelTarget, image: ImageArray, t_s: float) -> PixelTrack:
        """Look where the target is expected and, where that is not enough, wider."""
        small, target.small = target.small, small_copy(image)
        dt_s, target.newest_s = t_s - target.newest_s, t_s
        target.frames += 1
        predicted = target.motion.place()
        roi, result = self._view.look(target, image)
        if isinstance(result, Miss) or self._view.doubtful(target, result, t_s):
            if small is not None and is_cut(small, target.small):
                self.reset()
                return self._find(image, t_s)
            roi, result = self._view.again(target, image, small, (roi, result))
        roi, result = self._judge(target, image, (roi, result), t_s)
        if isinstance(result, Detection):
            status = TrackStatus.TRACKING
            return PixelTrack(t_s=t_s, status=status, result=result, roi=roi, predicted_px=predicted)
        target.misses += 1
        target.motion.coast(dt_s)
        if target.misses >= self._config.search_after:
            found = self._confirmation.update(image, t_s, max(target.size_px))
            track = self._take(image, t_s, found if found is None or self._likely(target, found, t_s) else None)
            if track is not None:
                return track
        status = TrackStatus.COASTING
        if self._is_lost(target, t_s) or self._is_false(target, t_s):
            status = TrackStatus.LOST
            self._target = None
            self._view.detector.reset()
        return PixelTrack(t_s=t_s, status=status, result=result, roi=roi, predicted_px=predicted)

    def _judge(self, target: PixelTarget, image: ImageArray, look: Look, t_s: float) -> Look:
        """Take what is the target; where something else is seen in its place, look for it on its own path.

        What looks like something else but is in the target's place, as a bird before it is, is returned without
        being learnt from; what is elsewhere is a miss.
        """
        identity, seen = target.identity, look[1]
        if isinstance(seen, Detection):
            appearance = appearance_of(image, seen)
            as_before = seen.cut or self._view.appears_as_before(target, seen, appearance)
            if identity.doubt_s is None:
                if as_before:
                    aside = is_off_path(target, seen)
                    if aside:
                        # of two that look alike, the one that is where the path leads
                        other = self._view.on_its_path(target, image)
                        look, seen = (other, other[1]) if isinstance(other[1], Detection) else (look, seen)
                        appearance = appearance_of(image, seen)
                    self._saw(target, seen, t_s)
                    if aside:
                        target.span_px = seen.box.w
                    if not seen.cut:
                        identity.learn(appearance, target.motion, target.size_px, target.whole_px, t_s)
                    return look
                target.go_back(t_s)
                as_before = identity.unlikeness(appearance) <= self._config.unlikeness
            if as_before and on_path(target, seen):
                self._saw(target, seen, t_s)
                identity.confirm(target.motion, t_s)
                return look
        if identity.doubt_s is None:
            return look
        other = self._view.on_its_path(target, image)
        if isinstance(other[1], Detection) and not is_second_object(target, seen, other[1]):
            self._saw(target, other[1], t_s)
            identity.confirm(target.motion, t_s)
            return other
        # whatever the detector has just learnt is not the target
        self._view.detector.reset()
        target.span_px = target.size_px[0]
        if not isinstance(seen, Detection):
            return look
        if not in_place(target, seen):
            return look[0], Miss(reason=MissReason.AMBIGUOUS, detail="something else, away from the target's path")
        appearance = appearance_of(image, seen)
        if identity.other_duration_s(appearance, target.motion, self._config.unlikeness, t_s) > self._config.accept_s:
            target.identity = TargetAppearance()
            self._saw(target, seen, t_s)
        return look

    def _saw(self, target: PixelTarget, seen: Detection, t_s: float) -> None:
        """Take a detection."""
        size = seen.box.size
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
            self._confirmation.reset()
        target.misses = 0
        target.seen += 1

    def _likely(self, target: PixelTarget, found: ConfirmedTarget, t_s: float) -> bool:
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
        return held.identity.unlikeness(appearance_of(image, seen)) <= self._config.unlikeness

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


def _in_middle(box: Box[float], velocity_px_s: tuple[float, float]) -> ConfirmedTarget:
    """Return a target whose point is the middle of its box."""
    u, v = 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)
    candidate = Candidate(u_px=u, v_px=v, box=box, score=0.0, moving=False, motion_px_s=None)
    return ConfirmedTarget(candidate=candidate, velocity_px_s=velocity_px_s)
