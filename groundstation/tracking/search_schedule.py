"""Which frames are searched as a whole, and which searches of two cameras belong together.

Without a target each frame is searched. A search takes as long as many detections: next to a target that is followed,
all cameras search at about the same time, and then not for a while, so that pairs do not get lost for it.

Where a pair loses one of its frames the other one's candidates wait for the next search of another camera; what only
one camera has searched is no evidence against a tentative track.
"""

from groundstation.estimation.initialise import CameraCandidate

# between the beginnings of searches next to a target, and how long each camera may take its part in one
_EVERY_S, _TOGETHER_S = 0.15, 0.05
# candidates of frames so far apart, at most, are combined: of the same pair, and of two pairs that lost a frame each
_PAIR_S, _APART_S = 0.5, 0.1


class SearchSchedule:
    """Decides on searches, and keeps each camera's newest one until two cameras have searched."""

    def __init__(self) -> None:
        self._began_s = float("-inf")
        self._taken: set[str] = set()
        # by station: time, candidates, whether its pair is over
        self._searches: dict[str, tuple[float, list[CameraCandidate], bool]] = {}
        self._is_used = False

    def is_due(self, station: str, t_s: float, *, has_target: bool) -> bool:
        """Return whether a station's frame at ``t_s`` is searched."""
        if not has_target:
            return True
        if not 0.0 <= t_s - self._began_s < _EVERY_S:
            if -_TOGETHER_S <= t_s - self._began_s < 0.0:
                # another camera's frame was a little later
                return self._take(station)
            self._began_s = t_s
            self._taken.clear()
        return t_s - self._began_s <= _TOGETHER_S and self._take(station)

    def _take(self, station: str) -> bool:
        new = station not in self._taken
        self._taken.add(station)
        return new

    def add(self, station: str, t_s: float, candidates: list[CameraCandidate]) -> None:
        """Add what the search of a station's frame has found."""
        self._searches[station] = (t_s, candidates, False)
        self._is_used = True

    def combined(self, t_s: float) -> list[CameraCandidate] | None:
        """Return the candidates of a pair at ``t_s``, once two cameras have searched; None until then.

        Without any search, as of labelled pixels, none are returned.
        """
        if not self._is_used:
            return []
        self._searches = {
            name: (at_s, found, True)
            for name, (at_s, found, waited) in self._searches.items()
            if t_s - at_s <= (_APART_S if waited else _PAIR_S)
        }
        if len(self._searches) < 2:
            return None
        together = [c for _, found, _ in self._searches.values() for c in found]
        self._searches.clear()
        return together

    def clear(self) -> None:
        """Forget what was found."""
        self._searches.clear()
