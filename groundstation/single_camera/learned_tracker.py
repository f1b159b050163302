"""One camera, pixels only, with both detectors: the classic one on what stands out, the learned channel on aircraft.

Each frame is the classic tracker's (`pixel_tracker`). The learned channel looks at the same target, in every frame at
first and ten times a second once both have agreed for a second. Where the classic tracker has not seen it for half a
second, or holds something at rest in its place, and the channel recognises an aircraft that was given or does not rest,
the channel follows it alone, until the classic detector sees it again. What the channel does not recognise, a speck of
three pixels or an aircraft unlike those of its training, stays the classic tracker's.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.box import Box, box_of_size, overlap
from groundstation.detection.pixel_track import PixelTrack, in_full
from groundstation.detection.target_confirmation import ConfirmedTarget
from groundstation.detection_messages import RECOGNISED_LOG_ODDS
from groundstation.messages import Detection, Miss, MissReason, TrackStatus
from groundstation.registration.picture_shift import is_cut, picture_shift, small_copy
from groundstation.single_camera.channel_target import ChannelTarget, begin_target, odds_of
from groundstation.single_camera.channel_view import GIVEN, SILHOUETTE, ChannelView, Look
from groundstation.single_camera.pixel_tracker import PixelTracker
from groundstation.single_camera.pixel_tracker_config import PixelTrackerConfig
from groundstation.single_camera.recognised_search import RecognisedSearch
from groundstation.single_camera.rest_check import RestCheck

# of two objects, the channel's is the target where its log odds are larger by so much
_LEAD = 1.0
# so long both agree before the channel looks less often, and how often it then does
_AGREED_S, _LOOK_S = 1.0, 0.1
# so long the classic detector may see nothing, or several things without a choice: of 240 drawn flights of real birds
# across a target one and two captured it where the channel did not wait, none where it does (docs/notes/detection.md)
_PASSING_S = 0.5
# how often the classic detector is shown what the channel follows alone
_RETAKE_S = 0.2


class LearnedPixelTracker:
    """Follows one target through the frames of one camera; parameters as of `PixelTracker`."""

    def __init__(self, image_size_px: tuple[int, int], config: PixelTrackerConfig | None = None) -> None:
        self._config = config if config is not None else PixelTrackerConfig()
        self._classic = PixelTracker(image_size_px, self._config)
        self._picture = self._classic.picture
        self._view = ChannelView(self._config.detection, self._picture.size_px)
        self._search = RecognisedSearch(self._config, self._picture.size_px)
        self._given_seen = self._given = False
        self._rest, self._held_rest = RestCheck(), RestCheck()  # of the target, of what the classic detector sees
        self._without_s: float | None = None  # since when there has been no target
        self._target: ChannelTarget | None = None
        self._alone = False  # the channel follows what the classic detector does not see
        self._look_s = self._disagreed_s = self._retake_s = 0.0

    @property
    def start_confirmed(self) -> bool:
        """Whether what a start was given has shown itself; True without a start."""
        return self._given_seen or self._classic.start_confirmed

    def reset(self) -> None:
        """Forget the target and everything that might become one."""
        self._classic.reset()
        self._clear()
        self._given_seen = False

    def start(self, image: ImageArray, t_s: float, box: Box[float]) -> PixelTrack:
        """Begin with the target inside ``box`` (px) of a frame (h, w, 3) BGR; return what is there.

        What the classic detector does not see in it, and the channel recognises there, is the target as well.
        """
        self._clear()
        working, scale = self._picture.prepare(image), self._picture.scale
        track = self._classic.start_prepared(working, t_s, box)
        given = box_of_size(box.x0 * scale, box.y0 * scale, box.w * scale, box.h * scale)
        seen, classic = self._view.likeliest_in(working, given, GIVEN), track.result
        self._given_seen = False
        if (
            seen is not None
            and odds_of(seen) >= RECOGNISED_LOG_ODDS
            and not (isinstance(classic, Detection) and overlap(classic.box, seen.box))
        ):
            self._given_seen = self._given = True
            self._target = begin_target(self._config, seen.centroid_px, seen.box, odds_of(seen), t_s)
            track = self._go_on_alone(self._target, working, (None, seen), t_s)
        elif isinstance(classic, Detection):
            self._join(classic, working, t_s)
            self._given = True
        return in_full(track, scale)

    def step(self, image: ImageArray, t_s: float) -> PixelTrack:
        """Look at the next frame, (h, w, 3) BGR, taken at ``t_s``, later than the last one."""
        working, target = self._picture.prepare(image), self._target
        if target is None:
            return in_full(self._find(working, t_s), self._picture.scale)
        before, before_s = target.small, target.newest_s
        if target.misses == 0 and before is not None:
            self._rest.update(before, target.box, before_s)
        dt_s, target.newest_s = t_s - before_s, t_s
        target.motion.predict(dt_s)
        target.small = small_copy(working)
        step = self._follow_alone if self._alone else self._follow
        return in_full(step(target, working, before, dt_s), self._picture.scale)

    def _clear(self) -> None:
        self._target, self._alone, self._given = None, False, False
        self._without_s, self._rest, self._held_rest = None, RestCheck(), RestCheck()
        self._search.reset()

    # ------------------------------------------------------------------------------------ without a target
    def _find(self, image: ImageArray, t_s: float) -> PixelTrack:
        """Let the classic tracker search, and where it has found nothing for a second the channel as well."""
        on_trial = not self._classic.start_confirmed
        track = self._classic.step_prepared(image, t_s)
        if isinstance(track.result, Detection):
            self._join(track.result, image, t_s)
            self._given = on_trial and self._classic.start_confirmed
        if self._classic.has_target:
            self._without_s = None
            return track
        self._without_s = t_s if self._without_s is None else self._without_s
        if t_s - self._without_s < self._config.another_after_s:
            return track
        found = self._search.update(image, t_s)
        return track if found is None else self._take(found, image, t_s) or track

    def _take(self, found: ConfirmedTarget, image: ImageArray, t_s: float) -> PixelTrack | None:
        """Begin with what the search has found; None where the channel does not see it there."""
        box = found.candidate.box
        place = 0.5 * np.array([box.x0 + box.x1, box.y0 + box.y1])
        target = begin_target(self._config, place, box, 0.0, t_s, found.velocity_px_s)
        look = self._view.look(target, image)
        seen = look[1]
        if not isinstance(seen, Detection) or not overlap(seen.box, box) or odds_of(seen) < RECOGNISED_LOG_ODDS:
            self._search.drop(box)
            return None
        self._clear()
        self._target, target.odds = target, odds_of(seen)
        return self._go_on_alone(target, image, look, t_s)

    def _join(self, seen: Detection, image: ImageArray, t_s: float) -> None:
        """Let the channel look at what the classic detector has seen from now on."""
        known = self._view.likeliest_in(image, seen.box, SILHOUETTE)
        box = (seen if known is None else known).box
        odds = odds_of(Miss(reason=MissReason.LOW_CONTRAST) if known is None else known)
        self._clear()
        self._target = begin_target(self._config, seen.centroid_px, box, odds, t_s)
        self._target.small = small_copy(image)
        self._disagreed_s = self._look_s = t_s

    # ----------------------------------------------------------------------------------- with both detectors
    def _follow(self, target: ChannelTarget, image: ImageArray, before: ImageArray | None, dt_s: float) -> PixelTrack:
        """Return the classic tracker's frame, unless it loses what the channel recognises."""
        t_s, replaced = target.newest_s, self._classic.replaced
        track = self._classic.step_prepared(image, t_s)
        classic = track.result
        if isinstance(classic, Detection) and self._classic.replaced > replaced:
            # the review has weighed both
            self._join(classic, image, t_s)
            return track
        if isinstance(classic, Detection) and target.small is not None:
            self._held_rest.update(target.small, classic.box, t_s)
        if isinstance(classic, Detection) and t_s < self._look_s and overlap(classic.box, target.box):
            target.saw(classic, t_s)
            return track
        look = self._view.look(target, image)
        if self._lost_by_classic(target, track, look[1], image):
            if target.small is None or before is None or not is_cut(before, target.small):
                return self._go_on_alone(target, image, look, t_s)
        elif isinstance(classic, Detection):
            self._look_s = t_s + (_LOOK_S if t_s - self._disagreed_s >= _AGREED_S else 0.0)
            self._keep(target, classic, t_s)
            return track
        target.miss(dt_s)
        if not self._classic.has_target:
            self._clear()
        return track

    def _lost_by_classic(
        self, target: ChannelTarget, track: PixelTrack, seen: Detection | Miss, image: ImageArray
    ) -> bool:
        """Return whether the channel sees an aircraft where the classic tracker has nothing, or something else."""
        odds, classic = odds_of(seen), track.result
        elsewhere = isinstance(classic, Detection) and not (
            isinstance(seen, Detection) and overlap(classic.box, seen.box)
        )
        there = self._view.odds_at(image, classic) if elsewhere and isinstance(classic, Detection) else odds
        target.weigh(odds)
        # a bird in front is often the likelier aircraft of the two: it passes, and it does not rest
        passed = target.newest_s - target.seen_s > _PASSING_S or track.status is not TrackStatus.COASTING
        unseen = isinstance(classic, Miss) and passed
        lost = unseen or (elsewhere and there < odds - _LEAD and self._held_rest.rests is True)
        lost = lost and target.recognised and odds > 0.0 and self._is_proven
        if lost or isinstance(classic, Miss):
            self._disagreed_s = target.newest_s
        elif elsewhere:
            target.weigh(there)
        return lost

    def _keep(self, target: ChannelTarget, classic: Detection, t_s: float) -> None:
        """Take what the classic tracker has seen, wherever it is."""
        away = float(np.hypot(*(classic.centroid_px - target.motion.place())))
        if away > 0.5 * classic.box.length + 3.0 * target.motion.sigma_px:
            again = begin_target(self._config, classic.centroid_px, classic.box, target.odds, t_s)
            target.motion, target.span_px = again.motion, again.span_px
            self._rest, self._given = RestCheck(), False
        target.saw(classic, t_s)

    # --------------------------------------------------------------------------------- with the channel alone
    def _go_on_alone(self, target: ChannelTarget, image: ImageArray, look: Look, t_s: float) -> PixelTrack:
        """Take what the channel sees as the target, without the classic detector."""
        self._classic.release()
        self._search.reset()
        self._alone, self._retake_s = True, t_s + _RETAKE_S
        target.small = small_copy(image)
        predicted = target.motion.place()
        if isinstance(look[1], Detection):
            target.saw(look[1], t_s)
        status = TrackStatus.TRACKING
        track = PixelTrack(t_s=t_s, status=status, result=look[1], roi=look[0], predicted_px=predicted)
        return self._proven(track)

    @property
    def _is_proven(self) -> bool:
        """Whether the target was given, or is known not to rest."""
        return self._given or self._rest.rests is False

    def _proven(self, track: PixelTrack) -> PixelTrack:
        """Return the track, without a point until what was found by searching is known not to rest."""
        if self._is_proven:
            return track
        return replace(track, status=TrackStatus.ACQUIRING, result=Miss(reason=MissReason.NOT_ACQUIRED))

    def _follow_alone(
        self, target: ChannelTarget, image: ImageArray, before: ImageArray | None, dt_s: float
    ) -> PixelTrack:
        """Follow what only the channel sees, until the classic detector sees it, too."""
        t_s, predicted = target.newest_s, target.motion.place()
        look = self._view.look(target, image)
        if isinstance(look[1], Miss) and before is not None and target.small is not None:
            if is_cut(before, target.small):
                self.reset()
                return self._find(image, t_s)
            shift = picture_shift(before, target.small, target.box)
            if shift is not None:
                target.motion.shift_by(shift)
                look = self._view.look(target, image)
        target.weigh(odds_of(look[1]))
        if isinstance(look[1], Miss):
            return self._coast_alone(target, image, look, dt_s)
        if self._rest.rests and not self._given:
            self.reset()
            return self._find(image, t_s)
        target.saw(look[1], t_s)
        status = TrackStatus.TRACKING
        track = PixelTrack(t_s=t_s, status=status, result=look[1], roi=look[0], predicted_px=predicted)
        return self._shown_to_classic(target, image, track)

    def _coast_alone(self, target: ChannelTarget, image: ImageArray, look: Look, dt_s: float) -> PixelTrack:
        """Predict a target that is not seen; after some frames of that, search for it."""
        t_s, predicted = target.newest_s, target.motion.place()
        target.miss(dt_s)
        status = TrackStatus.COASTING if self._is_proven else TrackStatus.ACQUIRING
        if target.misses >= self._config.search_after:
            found = self._search.update(image, t_s)
            taken = None if found is None else self._take(found, image, t_s)
            if taken is not None:
                return taken
            if t_s - target.seen_s > self._config.another_after_s:
                status = TrackStatus.LOST
                self.reset()
        return PixelTrack(t_s=t_s, status=status, result=look[1], roi=look[0], predicted_px=predicted)

    def _shown_to_classic(self, target: ChannelTarget, image: ImageArray, track: PixelTrack) -> PixelTrack:
        """Let the classic detector see what the channel follows, and let the review replace what is no aircraft."""
        t_s, seen, motion = target.newest_s, track.result, target.motion
        replaced = self._classic.replaced
        reviewed = self._classic.reviewed(track, image, t_s)
        if self._classic.replaced > replaced and isinstance(reviewed.result, Detection):
            self._join(reviewed.result, image, t_s)
            return reviewed
        if t_s >= self._retake_s and self._is_proven and target.recognised and isinstance(seen, Detection):
            self._retake_s = t_s + _RETAKE_S
            taken = self._classic.take(image, t_s, seen.box, (motion.du_px_s, motion.dv_px_s))
            if taken is not None and isinstance(taken.result, Detection) and overlap(taken.result.box, seen.box):
                self._alone, self._disagreed_s, self._look_s = False, t_s, t_s
            else:
                self._classic.release()
        return self._proven(track)
