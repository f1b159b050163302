"""Which frames are searched as a whole, and which searches of two cameras belong together.

Without a target each frame is searched. A search takes as long as many detections: next to a target that is followed,
all cameras search their frames of the same epoch, and then none for a while, so that pairs do not get lost for it.

Candidates are combined within an epoch. Where one loses all but one of its frames, that camera's candidates wait for
the next search of another camera; what only one camera has searched is no evidence against a tentative track.
"""

from collections import deque

from groundstation.estimation.initialise import CameraCandidate

# between the beginnings of searches next to a target
_EVERY_S = 0.15
# candidates of frames so far apart, at most, are combined: of the same pair, and of two pairs that lost a frame each
_PAIR_S, _APART_S = 0.5, 0.09
# a time of three frame intervals is one of three frames, whatever their stamps' last digit
_ROUNDING_S = 1e-3
# epochs whose frames may still arrive
_EPOCHS = 8


class SearchSchedule:
    """Decides on searches, and keeps each camera's newest one until two cameras have searched."""

    def __init__(self) -> None:
        self._began_s = float("-inf")
        self._searched_epoch: int | None = None
        self._decided: deque[int] = deque(maxlen=_EPOCHS)
        # newest frame of each station
        self._delivered: dict[str, float] = {}
        self._is_repeated = False
        self._taken: set[str] = set()
        # by station: time, candidates, whether its pair is over
        self._searches: dict[str, tuple[float, list[CameraCandidate], bool]] = {}
        self._is_used = False

    def is_due(self, station: str, t_s: float, *, epoch: int, has_target: bool) -> bool:
        """Return whether a station's frame of an epoch, at ``t_s``, is searched."""
        if not has_target:
            return True
        age_s = t_s - self._began_s
        self._delivered[station] = t_s
        if epoch not in self._decided:
            # the first frame of an epoch decides for all of them
            self._decided.append(epoch)
            early = -_PAIR_S < age_s < _EVERY_S - _ROUNDING_S
            repeats = age_s > 0.0 and early and self._needs_another(t_s)
            if repeats or not early:
                self._began_s, self._searched_epoch, self._is_repeated = t_s, epoch, repeats
                self._taken.clear()
        return epoch == self._searched_epoch and abs(t_s - self._began_s) <= _PAIR_S and self._take(station)

    def _needs_another(self, t_s: float) -> bool:
        """Return whether the last search stayed with one camera, though others deliver: one may have half the rate."""
        others = sum(abs(t_s - at_s) <= _PAIR_S for name, at_s in self._delivered.items() if name not in self._taken)
        return len(self._taken) == 1 and others > 0 and not self._is_repeated

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
        before = self._searches
        self._searches = {
            name: (at_s, found, True)
            for name, (at_s, found, waited) in before.items()
            if t_s - at_s <= (_APART_S if waited else _PAIR_S)
        }
        if len(self._searches) < 2:
            return None
        fresh = [found for name, (_, found, _) in self._searches.items() if not before[name][2]]
        together = fresh if len(fresh) >= 2 else [found for _, found, _ in self._searches.values()]
        self._searches.clear()
        return [c for found in together for c in found]

    def clear(self) -> None:
        """Forget what was found."""
        self._searches.clear()
