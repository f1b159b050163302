"""Search of whole pictures of one camera for what the learned channel recognises as an aircraft."""

from dataclasses import replace

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.detection.candidate_finder import Candidate
from groundstation.detection.config import DetectorKind
from groundstation.detection.learned_finder import LearnedFinder
from groundstation.detection.target_confirmation import ConfirmedTarget, TargetConfirmation
from groundstation.detection_messages import RECOGNISED_LOG_ODDS
from groundstation.single_camera.pixel_tracker_config import PixelTrackerConfig


class RecognisedSearch:
    """Confirms one recognised aircraft in successive whole pictures of one camera, of ``image_size_px`` (w, h).

    The rules are those of `TargetConfirmation`, with log odds in place of contrasts.
    """

    def __init__(self, config: PixelTrackerConfig, image_size_px: tuple[int, int]) -> None:
        detection = replace(config.detection, detector=DetectorKind.LEARNED)
        self._finder = LearnedFinder(config.acquisition, detection, image_size_px)
        rules = replace(config.search, least_score=RECOGNISED_LOG_ODDS)
        self._confirmation = TargetConfirmation(rules, config.acquisition, image_size_px)

    def reset(self) -> None:
        """Discard the earlier pictures."""
        self._finder.reset()
        self._confirmation.reset()

    def update(self, image: ImageArray, t_s: float) -> ConfirmedTarget | None:
        """Search a picture (h, w, 3) taken at ``t_s``; return the aircraft once it is confirmed."""
        found = [_by_odds(c) for c in self._finder.find(image, t_s) if c.odds is not None and c.odds > 0.0]
        return self._confirmation.confirm(sorted(found, key=lambda c: -c.score), t_s)

    def drop(self, box: Box[float]) -> None:
        """Discard what is tentative at ``box``, after a false confirmation."""
        self._confirmation.drop(box)


def _by_odds(c: Candidate) -> Candidate:
    """Return a candidate at the middle of its box, with its log odds as the score."""
    middle = 0.5 * (c.box.x0 + c.box.x1), 0.5 * (c.box.y0 + c.box.y1)
    return replace(c, u_px=middle[0], v_px=middle[1], score=c.odds or 0.0)
