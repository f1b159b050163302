"""The target of one camera as the learned channel follows it: its motion, its width, and the odds of an aircraft."""

import math
from dataclasses import dataclass

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection_messages import RECOGNISED_LOG_ODDS
from groundstation.messages import Detection, Miss
from groundstation.single_camera.pixel_motion import PixelMotion
from groundstation.single_camera.pixel_tracker_config import PixelTrackerConfig

# the width for which the next window is made follows that of the region by this power: a region may be a part of the
# aircraft, or contain scenery
_WIDTH_GAIN = 0.15
# log odds of a target: a running mean, each look limited from below
_ODDS_RATE, LEAST_ODDS = 0.2, -2.0
_MOTION_PX, _MOTION_SHARE = 1.0, 0.05


@dataclass(slots=True, kw_only=True, eq=False)
class ChannelTarget:
    """What is held of the target.

    Attributes
    ----------
    motion : where it is and where it goes.
    span_px : width for which its window is made.
    odds : its log odds of aircraft, smoothed.
    box : of its last silhouette in px.
    newest_s, seen_s : times of the newest frame and of the last one that showed it.
    misses : frames running that did not show it.
    wider : whether the last window of another width was a wider one.
    small : the newest frame's small copy.
    """

    motion: PixelMotion
    span_px: float
    odds: float
    box: Box[float]
    newest_s: float
    seen_s: float
    misses: int = 0
    wider: bool = False
    small: ImageArray | None = None

    @property
    def recognised(self) -> bool:
        """Whether it is recognised as an aircraft."""
        return self.odds >= RECOGNISED_LOG_ODDS

    def weigh(self, odds: float) -> None:
        """Take the log odds of one look."""
        self.odds += _ODDS_RATE * (max(odds, LEAST_ODDS) - self.odds)

    def saw(self, seen: Detection, t_s: float) -> None:
        """Take a detection of either detector."""
        self.motion.correct(seen.centroid_px, _MOTION_PX + _MOTION_SHARE * seen.box.length)
        if not seen.cut:
            self.span_px *= (max(seen.box.w, 1.0) / self.span_px) ** _WIDTH_GAIN
        self.box, self.seen_s, self.misses = seen.box, t_s, 0

    def miss(self, dt_s: float) -> None:
        """Take note of a frame, ``dt_s`` after the last one, that does not show it."""
        self.misses += 1
        self.motion.coast(dt_s)


def begin_target(
    config: PixelTrackerConfig,
    place_px: FloatArray,
    box: Box[float],
    odds: float,
    t_s: float,
    velocity_px_s: tuple[float, float] | None = None,
) -> ChannelTarget:
    """Return a target at a place (2,) whose silhouette has a box."""
    motion = PixelMotion(
        (float(place_px[0]), float(place_px[1])),
        velocity_px_s,
        sigma_px=2.0 + _MOTION_SHARE * box.length,
        least_shake_px=config.least_shake_px,
        most_shake_px=config.most_shake_px,
    )
    return ChannelTarget(
        motion=motion, span_px=max(box.w, 1.0), odds=max(odds, LEAST_ODDS), box=box, newest_s=t_s, seen_s=t_s
    )


def odds_of(result: Detection | Miss) -> float:
    """Return the log odds of aircraft of a look; minus infinity of one that shows nothing."""
    return -math.inf if isinstance(result, Miss) or result.log_odds is None else result.log_odds
