"""Bounded queue from the device threads to the pipeline, in order of arrival; the oldest frame is dropped first.

A picture that waits is worth less than the next one: where a camera's frames pile up, the oldest is dropped and
counted, and with it those that the other cameras exposed at the same time: one frame alone is no fix. Readings are
small and are dropped only if the pipeline stands still for minutes.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

from groundstation.messages import PtuSample, ReferenceFix
from groundstation.picture import Picture


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedPicture:
    """A camera's picture before it has a pair: exposed at ``t_s`` of the session, here since ``arrived_s``."""

    t_s: float
    arrived_s: float
    station: str
    picture: Picture


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceLogLine:
    """A log line of a device thread for the operator."""

    t_s: float
    level: str
    text: str


Item = TimedPicture | PtuSample | ReferenceFix | DeviceLogLine


class InputQueue:
    """A queue from many threads to one.

    Parameters
    ----------
    frames : how many frames of one camera may wait.
    others : how many of anything else.
    together_s : frames of two cameras exposed within this time are of the same pair.
    """

    def __init__(self, frames: int = 4, others: int = 20_000, together_s: float = 0.0) -> None:
        if frames < 1 or others < 1:
            raise ValueError("an input queue holds at least one frame of each camera, and one of anything else")
        self._frames, self._others, self._together_s = frames, others, together_s
        self._items: deque[Item] = deque()
        self._waiting: Counter[str] = Counter()
        self._readings = 0
        self._dropped: Counter[str] = Counter()
        self._changed = threading.Condition()

    def put(self, item: Item) -> None:
        """Add something; never waits."""
        with self._changed:
            if isinstance(item, TimedPicture):
                if self._waiting[item.station] >= self._frames:
                    self._drop_oldest_pair(item.station)
                self._waiting[item.station] += 1
            else:
                if self._readings >= self._others:
                    self._drop(lambda old: not isinstance(old, TimedPicture))
                    self._dropped["readings"] += 1
                    self._readings -= 1
                self._readings += 1
            self._items.append(item)
            self._changed.notify()

    def get(self, timeout_s: float) -> Item | None:
        """Return the oldest, or None if nothing comes within ``timeout_s``."""
        with self._changed:
            if not self._items:
                self._changed.wait(timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
            if isinstance(item, TimedPicture):
                self._waiting[item.station] -= 1
            else:
                self._readings -= 1
            return item

    @property
    def dropped(self) -> dict[str, int]:
        """What was dropped so far, by kind."""
        with self._changed:
            return dict(self._dropped)

    @property
    def frames_waiting(self) -> int:
        """How many frames wait, of all cameras."""
        with self._changed:
            return sum(self._waiting.values())

    def __len__(self) -> int:
        return len(self._items)

    def _drop_oldest_pair(self, station: str) -> None:
        pictures = [old for old in self._items if isinstance(old, TimedPicture)]
        oldest = next(old for old in pictures if old.station == station)
        partners = {
            old.station: old
            for old in reversed(pictures)
            if old.station != station and abs(old.t_s - oldest.t_s) < self._together_s
        }
        pair = (oldest, *partners.values())
        # compared by identity, as these messages are
        self._items = deque(item for item in self._items if item not in pair)
        for gone in pair:
            self._dropped[f"frames of {gone.station}"] += 1
            self._waiting[gone.station] -= 1

    def _drop(self, which: Callable[[Item], bool]) -> None:
        for k, old in enumerate(self._items):
            if which(old):
                del self._items[k]
                return
