"""The edge tracker: one picture and one pose in, the runway's edges with their covariance out.

Order in a frame. Nothing known: Algorithm 1, its best pairs become hypotheses. Some hypotheses: each is tracked, and
one that is better than the others over some frames is the runway. The runway known: it is tracked, and compared again
where its score is low or it is missed, and periodically: then Algorithm 1 may find a better pair, and the
comparison restarts.

Pairs found by Algorithm 1 next to tracked ones are measured over some frames, in the picture where they were found:
a frame has a number of units of work (tracking a pair, Algorithm 1, measuring one of its pairs), in which tracking has
priority. Work is counted, not timed: the same pictures give the same edges.
"""

import math
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.frame_geometry import TrackerCamera
from groundstation.onboard.edges.hypotheses import (
    EXPECTED_NIS,
    Hypothesis,
    PairSearch,
    begin_search,
    continue_search,
    find_pairs,
    merge_hypotheses,
    same_lines,
    score,
    track_hypotheses,
)
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_state import C, D
from groundstation.onboard.edges.line_tracking import TrackingStep, side_lines_of, track_lines
from groundstation.onboard.edges.lines import angle_between
from groundstation.onboard.edges.markings import Change
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift, with_drift
from groundstation.onboard.edges.report import EdgeMiss, EdgeReport, EdgeStatus

# pieces of work that following the runway counts for, with its descent: more than it takes, so that there is room
_THOROUGHLY = 3
# share of a frame's innovation by which the poses' variance is learned, the most that counts of one, most of them all
_LEARNED, _MOST_NIS, _MOST_NOISIER = 0.1, 40.0, 100.0
# of an edge, against division by nothing: one grey level
_LEAST_CONTRAST = 1.0 / 255.0
_LEAST_WIDTH_M = 0.1
# sigma of a runway's announced direction
_ANNOUNCED_RAD = math.radians(0.1)


class EdgeTracker:
    """Follows the runway's edges through the pictures of one camera without distortion.

    Parameters
    ----------
    kappa : intrinsic matrix (3, 3).
    image_size_px : (w, h).
    """

    def __init__(self, kappa: FloatArray, image_size_px: tuple[int, int], config: TrackerConfig) -> None:
        if config.profile is not None:
            config = replace(config, profile=side_lines_of(config.profile, config.guess))
        self._lookout = TrackerCamera(kappa=kappa, image_size_px=image_size_px, config=config)
        self._config = config
        self._runway: Hypothesis | None = None
        self._open: list[Hypothesis] = []
        self._search: PairSearch | None = None
        self._arrived: list[Hypothesis] = []
        self._compared = 0
        self._unchecked = 0
        self._noisier = 1.0
        # with the attitude's noise that was learnt
        self._tuned, self._drift = config, NO_DRIFT

    def start(self, state: LineState) -> None:
        """Continue from known lines."""
        self._runway = Hypothesis(
            state=state, edges=None, frames=1, missed=0, agreement=1.0, nis=EXPECTED_NIS, lost=0.0
        )
        self._forget()
        self._unchecked = 0

    def step(self, image: ImageArray, pose: NoseCameraPose, drift: PoseDrift = NO_DRIFT) -> EdgeReport:
        """Take one picture (h, w, 3) uint8 BGR and its pose, with what that is wrong by besides the tuning."""
        self._drift = drift
        self._lookout = replace(self._lookout, config=with_drift(self._tuned, drift))
        if self._runway is not None:
            return self._track(self._runway, image, pose)
        if self._open:
            work, new = len(self._open) + len(self._arrived), self._arrived
            self._open, self._arrived = track_hypotheses(self._lookout, image, pose, self._open, new), []
            if self._open:
                return self._compare(image, pose, work)
        return self._seek(image, pose)

    def _forget(self) -> None:
        """Drop all that is being compared."""
        self._open, self._arrived, self._search = [], [], None

    def _track(self, runway: Hypothesis, image: ImageArray, pose: NoseCameraPose) -> EdgeReport:
        """Follow the runway; doubt it where there is reason to, and in any case now and then."""
        # a search takes the time in which other layouts are compared
        searching = self._search is not None or self._due(runway, self._unchecked + 1)
        layouts = 0 if searching or self._config.profile is None else self._config.profile.layouts
        step = track_lines(
            self._lookout, image, pose, runway.state, thorough=True, markings=runway.markings, layouts=layouts
        )
        usual, runway = runway.contrast, runway.after(step)
        self._unchecked += 1
        self._learn(step)
        if runway.missed > self._config.coast_frames:
            self._runway = None
            self._forget()
            return EdgeReport(status=EdgeStatus.SEARCHING, miss=step.miss, edges=None)
        self._runway = runway
        if self._config.confirm_frames > 1 and self._doubted(runway, image, pose):
            return EdgeReport(status=EdgeStatus.ACQUIRING, miss=step.miss, edges=step.edges)
        return EdgeReport(status=self._status_of(runway, step, usual, pose), miss=step.miss, edges=step.edges)

    def _status_of(
        self, runway: Hypothesis, step: TrackingStep, usual: FloatArray | None, pose: NoseCameraPose
    ) -> EdgeStatus:
        """Return the status of the runway that is followed: not tracking in a picture in which it is not like one.

        Nor where one of its edges has lost more of its ``usual`` contrast (2,) than the other.
        """
        if step.miss is not EdgeMiss.NONE or step.found is None:
            return EdgeStatus.COASTING
        config = self._config
        like = score(runway, config) >= config.least_score and _like_announced(runway, config, pose)
        if usual is not None:
            like = like and _evenly_kept(step.found.contrast, usual) >= config.tracked_contrast
        return EdgeStatus.TRACKING if like or config.confirm_frames == 1 else EdgeStatus.ACQUIRING

    def _learn(self, step: TrackingStep) -> None:
        """Take the poses for as noisy as innovations show them to be, never for less than configured."""
        config = self._config
        if not config.estimate_noise or step.edges is None or not math.isfinite(step.edges.nis):
            return
        if self._drift != NO_DRIFT:
            return  # innovations of a pose that has drifted tell nothing of the others
        # innovations are of all that is assumed, so that the noise alone grows by more
        excess = min(step.edges.nis, _MOST_NIS) / EXPECTED_NIS - 1.0
        self._noisier = min(max(self._noisier + _LEARNED * self._noisier * excess, 1.0), _MOST_NOISIER)
        sigma = config.attitude_sigma_rad * math.sqrt(self._noisier)
        self._tuned = replace(config, attitude_sigma_rad=sigma)
        self._lookout = replace(self._lookout, config=self._tuned)

    def _doubted(self, runway: Hypothesis, image: ImageArray, pose: NoseCameraPose) -> bool:
        """Return whether Algorithm 1 has found a better pair; if so, all are compared again."""
        config, search = self._config, self._search
        if search is None:
            if not self._due(runway, self._unchecked):
                return False
            self._unchecked = 0
        search = self._search_on(image, pose, [runway], _THOROUGHLY)
        if search is None or search.waiting:
            return False
        self._search = None
        own = score(runway, config) + config.margin
        rivals = [h for h in search.found if not same_lines(h, search.known[0]) and score(h, config) > own]
        if not rivals:
            return False
        self._open, self._arrived, self._runway, self._compared = [runway], rivals, None, 0
        return True

    def _due(self, runway: Hypothesis, unchecked: int) -> bool:
        """Return whether so many frames without a search are enough; fewer are where the runway's score is low."""
        config = self._config
        strange = runway.missed >= config.doubt_missed or runway.agreement < config.doubt_agreement
        strange = strange or score(runway, config) < config.doubt_score
        return unchecked >= (config.doubt_frames if strange else config.check_frames)

    def _search_on(
        self, image: ImageArray, pose: NoseCameraPose, known: list[Hypothesis], work: int
    ) -> PairSearch | None:
        """Begin a search, or continue the current one; ``work`` was done in this frame already."""
        # one piece at least, but where new pairs were followed besides: in the next frame there are fewer of them
        least = int(self._runway is not None or work <= self._config.hypotheses)
        left = max(self._config.work - work, least)
        if self._search is None and left > 0:
            self._search, left = begin_search(self._lookout, image, pose, known), left - 1
        if self._search is not None:
            continue_search(self._lookout, self._search, left)
        return self._search

    def _seek(self, image: ImageArray, pose: NoseCameraPose) -> EdgeReport:
        """Begin with the result of Algorithm 1, all of it in one frame, since there is no other work."""
        self._forget()
        found = find_pairs(self._lookout, image, pose)
        if isinstance(found, EdgeMiss):
            return EdgeReport(status=EdgeStatus.SEARCHING, miss=found, edges=None)
        self._open, self._compared = merge_hypotheses(self._lookout, [], found), 1
        return self._chosen(pose)

    def _compare(self, image: ImageArray, pose: NoseCameraPose, work: int) -> EdgeReport:
        """Choose where one hypothesis is clearly the best; if not, add what Algorithm 1 finds."""
        self._compared += 1
        report = self._chosen(pose)
        if self._runway is None:
            search = self._search_on(image, pose, self._open, work)
            if search is not None and not search.waiting:
                # no more of them, the best, than can be followed in the next frame
                room = max(self._config.work - len(self._open), 1)
                self._arrived = sorted(search.found, key=lambda h: -score(h, self._config))[:room]
                self._search = None
        return report

    def _chosen(self, pose: NoseCameraPose) -> EdgeReport:
        """Return the best hypothesis, and take it for the runway where it has proved to be."""
        config, best = self._config, self._open[0]
        proved = best.frames >= config.confirm_frames and best.missed == 0 and self._compared >= config.confirm_frames
        if config.confirm_frames > 1:
            others = [h for h in self._open[1:] if 2 * h.frames >= config.confirm_frames]
            ahead = score(best, config) - max((score(h, config) for h in others), default=-math.inf)
            proved = proved and ahead >= config.margin and best.agreement >= config.doubt_agreement
            # the best of none that is like the announced runway is not the runway
            proved = proved and score(best, config) >= config.least_score
            proved = proved and self._search is None
        if proved:
            self._forget()
            self._runway, self._unchecked = best, 0
        miss = EdgeMiss.NONE if best.missed == 0 else EdgeMiss.FAINT
        tracking = proved and (config.confirm_frames == 1 or _like_announced(best, config, pose))
        return EdgeReport(status=EdgeStatus.TRACKING if tracking else EdgeStatus.ACQUIRING, miss=miss, edges=best.edges)


def _like_announced(pair: Hypothesis, config: TrackerConfig, pose: NoseCameraPose) -> bool:
    """Return whether a pair is like the announced runway in the last picture: else its covariance does not hold.

    Its lines have not just gone elsewhere; its edges are of the same colours; it is as wide as the runway may be, lies
    where the poses' lasting errors leave it, and moves as the poses say, within their noise. One edge of a runway and
    the border of a field are a pair as well.
    """
    found, mean = pair.found, pair.state.mean
    if found is not None and (found.change is Change.LINES or found.agreement < config.tracked_agreement):
        return False
    factor = max(abs(float(mean[C] - mean[D])), _LEAST_WIDTH_M) / config.guess.width_m
    if max(factor, 1.0 / factor) > config.tracked_width or pair.nis > config.tracked_nis:
        return False
    turned = math.hypot(config.lasting_yaw_rad or config.lasting_attitude_rad, _ANNOUNCED_RAD)
    place = math.hypot(config.lasting_across_m or config.lasting_height_m, turned * float(pose.camera_threshold_m[1]))
    apart = max(abs(angle_between(mean)) / turned, 0.5 * abs(float(mean[C] + mean[D])) / place)
    return apart <= config.tracked_sigmas


def _evenly_kept(contrast: FloatArray, usual: FloatArray) -> float:
    """Return what one edge keeps of its usual contrast (2,) over what the other one does, 0 to 1."""
    kept = contrast / np.maximum(usual, _LEAST_CONTRAST)
    return float(kept.min() / max(kept.max(), _LEAST_CONTRAST))
