"""Which frames are searched as a whole, and which searches of two cameras belong together.

Without a target each frame is searched. A search takes as long as many detections: next to a target that is followed,
all cameras search their frames of the same epoch, and then none for a while, so that pairs do not get lost for it.

Candidates are combined within an epoch. Where one loses all but one of its frames, that camera's candidates wait for
the next search of another camera; what only one camera has searched is no evidence against a tentative track.
"""

from collections import deque

from groundstation.estimation.camera_candidate import CameraCandidate

# between the beginnings of searches next to a target
_EVERY_S = 0.15
# candidates of frames so far apart, at most, are combined: of the same pair, and of two pairs that lost a frame each
_PAIR_S, _APART_S = 0.5, 0.09
# a time of three frame intervals is one of three frames, whatever their stamps' last digit
_ROUNDING_S = 1e-3
# epochs whose frames may still arrive
_EPOCHS = 8
# of a camera's last frames the smallest step from epoch to epoch is its own, and the others have lost some
_STEPS = 4
# a search may be repeated so often for a camera that it lacks, which may have been lost
_REPEATS = 2


class SearchSchedule:
    """Decides on searches, and keeps each camera's newest one until two cameras have searched."""

    def __init__(self) -> None:
        self._began_s = float("-inf")
        self._searched_epoch: int | None = None
        self._decided: deque[int] = deque(maxlen=_EPOCHS)
        self._cameras: dict[str, _Camera] = {}
        self._repeats = 0
        self._taken: set[str] = set()
        # by station: time, candidates, whether its pair is over
        self._searches: dict[str, tuple[float, list[CameraCandidate], bool]] = {}
        self._is_used = False

    def is_due(self, station: str, t_s: float, *, epoch: int, has_target: bool) -> bool:
        """Return whether a station's frame of an epoch, at ``t_s``, is searched."""
        if not has_target:
            return True
        age_s = t_s - self._began_s
        if epoch not in self._decided:
            # the first frame of an epoch decides for all of them
            self._decided.append(epoch)
            early = -_PAIR_S < age_s < _EVERY_S - _ROUNDING_S
            repeats = early and age_s > 0.0 and self._repeats < _REPEATS and self._lacks_one_of(epoch, t_s)
            if repeats or not early:
                self._began_s, self._searched_epoch = t_s, epoch
                self._repeats = self._repeats + 1 if repeats else 0
                self._taken.clear()
        camera = self._cameras.get(station)
        if camera is None or abs(t_s - camera.t_s) > _PAIR_S:
            camera = self._cameras[station] = _Camera()
        camera.add(epoch, t_s)
        return epoch == self._searched_epoch and abs(t_s - self._began_s) <= _PAIR_S and self._take(station)

    def _lacks_one_of(self, epoch: int, t_s: float) -> bool:
        """Return whether the last search lacks a camera that is expected in this epoch and was not in that one.

        So does one of half the rate. A frame that was expected there may be under way, or is lost.
        """
        return any(
            name not in self._taken
            and t_s - camera.t_s <= _PAIR_S
            and camera.is_expected(epoch)
            and not camera.is_expected(self._searched_epoch)
            for name, camera in self._cameras.items()
        )

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


class _Camera:
    """Newest frame of a camera, and how far its frames are apart in epochs."""

    def __init__(self) -> None:
        self.t_s = float("-inf")
        self._epoch: int | None = None
        self._steps: deque[int] = deque(maxlen=_STEPS)

    def add(self, epoch: int, t_s: float) -> None:
        if self._epoch is not None and epoch > self._epoch:
            self._steps.append(epoch - self._epoch)
        self._epoch, self.t_s = epoch, t_s

    def is_expected(self, epoch: int | None) -> bool:
        if epoch is None or self._epoch is None:
            return False
        return epoch - self._epoch >= min(self._steps, default=1)
