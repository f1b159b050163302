"""Online pairing of frames of free-running or triggered cameras by exposure time.

A frame joins the pair that is open if its station is not in it yet and it is no further than half a period from it;
else it opens the next. A pair is closed when every camera that delivers is in it, or once a newer pair is open.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from groundstation.messages import Epoch

# a camera that has not delivered for so many periods is not waited for
_MISSED = 5


@dataclass(slots=True)
class _Open:
    """A pair that may still grow."""

    number: int
    first_s: float
    begun_s: float
    stamps: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedFrame:
    """The number of a frame's pair, and the pairs that are closed now: some before the frame, some by it."""

    epoch: int
    closed_before: tuple[Epoch, ...]
    closed_after: tuple[Epoch, ...]


class FramePairer:
    """Gives each frame the number of its pair.

    Parameters
    ----------
    cameras : stations whose frames are expected.
    period_s : time from frame to frame.
    """

    def __init__(self, cameras: Sequence[str], period_s: float) -> None:
        self._cameras = tuple(cameras)
        self._period_s = period_s
        self._open: _Open | None = None
        self._next = 0
        self._newest: dict[str, float] = {}
        self._began_s = math.inf

    def joins(self, station: str, t_s: float) -> bool:
        """Return whether a frame would join the pair that is open."""
        pair = self._open
        return pair is not None and station not in pair.stamps and abs(t_s - pair.first_s) <= 0.5 * self._period_s

    def delivered(self, station: str, t_s: float) -> None:
        """Note that a station delivers: it has exposed a frame at ``t_s``, whether or not that is taken."""
        if not math.isfinite(t_s):
            # nothing would be newer
            return
        self._newest[station] = max(self._newest.get(station, t_s), t_s)
        self._began_s = min(self._began_s, t_s)

    def frame(self, station: str, t_s: float, now_s: float | None = None) -> PairedFrame:
        """Place a frame of ``station``, exposed at ``t_s`` and taken at ``now_s``, its exposure by default."""
        before: list[Epoch] = []
        pair = self._open
        if pair is None or not self.joins(station, t_s):
            before += self._close()
            begun_s = t_s if now_s is None else max(now_s, t_s)
            pair = self._open = _Open(number=self._next, first_s=t_s, begun_s=begun_s)
            self._next += 1
        pair.stamps[station] = t_s
        self.delivered(station, t_s)
        whole = all(name in pair.stamps for name in self._cameras if self._delivers(name, t_s))
        return PairedFrame(
            epoch=pair.number, closed_before=tuple(before), closed_after=tuple(self._close()) if whole else ()
        )

    def flush(self) -> tuple[Epoch, ...]:
        """Close what is open: nothing more will come, or not soon."""
        return tuple(self._close())

    def overdue(self, now_s: float) -> bool:
        """Return whether a pair has been open for longer than a period: the missing frames will not come.

        ``now_s`` is the time up to which everything delivered was taken: what waits may hold them, however late it is.
        """
        return self._open is not None and now_s > self._open.begun_s + 1.5 * self._period_s

    def _delivers(self, station: str, t_s: float) -> bool:
        # one that has never delivered had the same time to begin
        return t_s - self._newest.get(station, self._began_s) <= _MISSED * self._period_s

    def _close(self) -> list[Epoch]:
        pair, self._open = self._open, None
        if pair is None:
            return []
        stations = tuple(name for name in self._cameras if name in pair.stamps)
        stamps = [pair.stamps[name] for name in stations]
        return [Epoch(t_s=sum(stamps) / len(stamps), epoch=pair.number, stations=stations)]


class LoadShedder:
    """Leaves whole pairs out while the pipeline is behind: one frame of a pair is worth little without the other.

    Parameters
    ----------
    pairing : that the frames will go to.
    most : so many frames may wait when a new pair is begun.
    """

    def __init__(self, pairing: FramePairer, period_s: float, most: int) -> None:
        self.pairs = 0
        self._pairing = pairing
        self._period_s = period_s
        self._most = most
        self._left_out: dict[str, float] = {}

    def drops(self, station: str, t_s: float, waiting: int) -> bool:
        """Return whether a frame is not to be taken, with so many waiting behind it."""
        # a camera whose frames are left out delivers all the same: the next pair waits for it
        self._pairing.delivered(station, t_s)
        if self._pairing.joins(station, t_s):
            return False
        near = [t for name, t in self._left_out.items() if name != station]
        mate = any(abs(t - t_s) <= 0.5 * self._period_s for t in near)
        if not mate and waiting < self._most:
            return False
        self.pairs += not mate
        self._left_out[station] = t_s
        return True
