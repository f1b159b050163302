"""Recognition of the target by the learned channel: what it takes the pixels of a track for.

Each accepted pixel of the learned detector has log odds of aircraft. Their mean over about a second, of each camera and
then of all, is a statement on the target that does not depend on where it is or how it moves: a bird is followed as
smoothly as an aircraft. It ranks targets among each other and excludes none, as an aircraft unlike those of the
training has low odds, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from groundstation.detection_messages import RECOGNISED_LOG_ODDS
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.messages import RecognisedPixel

# of the mean
_MEMORY_S = 1.0
# log odds by which the target is far more likely to be an aircraft than another one: in validate worlds 3 and 8 birds
# had 0.5 to 1.5, and the aircraft 2.1 to 3; a choice, with no figure for other birds
_FAR_MORE_ODDS = 1.0


class Recognition:
    """Mean log odds of aircraft of a target's pixels; a target that no learned channel has seen has none."""

    def __init__(self) -> None:
        self._start: _Mean | None = None
        self._means: dict[str, _Mean] = {}

    @property
    def odds(self) -> float | None:
        """Mean log odds of aircraft, of the cameras that have seen the target lately; None without any."""
        if not self._means:
            return None if self._start is None else self._start.odds
        newest_s = max(m.newest_s for m in self._means.values())
        recent = [m.odds for m in self._means.values() if newest_s - m.newest_s <= _MEMORY_S]
        return sum(recent) / len(recent)

    @property
    def is_available(self) -> bool:
        """Whether the learned channel has seen the target."""
        return self.odds is not None

    @property
    def is_recognised(self) -> bool:
        """Whether the learned channel takes the target for an aircraft."""
        odds = self.odds
        return odds is not None and odds >= RECOGNISED_LOG_ODDS

    def is_likelier_than(self, odds: float | None) -> bool:
        """Return whether the target is far more likely to be an aircraft than another one of these mean log odds."""
        own = self.odds
        return own is not None and odds is not None and own > odds + _FAR_MORE_ODDS

    def start(self, t_s: float, odds: float | None) -> None:
        """Start at ``t_s`` with the mean log odds of the candidates by which a target was found; None without them."""
        self._start = None if odds is None else _Mean(odds=odds, newest_s=t_s)
        self._means.clear()

    def add(self, station: str, t_s: float, odds: float) -> None:
        """Add the log odds of an accepted pixel of a camera."""
        mean = self._means.setdefault(station, replace(self._start or _Mean(odds=odds, newest_s=t_s)))
        share = 1.0 - math.exp(-max(t_s - mean.newest_s, 0.0) / _MEMORY_S)
        mean.odds += share * (odds - mean.odds)
        mean.newest_s = max(mean.newest_s, t_s)


@dataclass(slots=True)
class _Mean:
    odds: float
    newest_s: float


def likeliest_aircraft(candidates: Sequence[CameraCandidate]) -> RecognisedPixel | None:
    """Return the likeliest aircraft of a frame's candidates; None where the learned channel recognises none."""
    recognised = [(c.odds, c) for c in candidates if c.odds is not None and c.odds >= RECOGNISED_LOG_ODDS]
    if not recognised:
        return None
    odds, best = max(recognised, key=lambda pair: pair[0])
    return RecognisedPixel(u_px=float(best.pixel[0]), v_px=float(best.pixel[1]), log_odds=odds)
