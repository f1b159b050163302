"""Bounded queue from the device threads to the pipeline, in order of arrival; the oldest frame is dropped first.

A picture that waits is worth less than the next one: where a camera's frames pile up, the oldest is dropped and
counted. Readings are small and are dropped only if the pipeline stands still for minutes.
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
    """

    def __init__(self, frames: int = 4, others: int = 20_000) -> None:
        if frames < 1 or others < 1:
            raise ValueError("an input queue holds at least one frame of each camera, and one of anything else")
        self._frames, self._others = frames, others
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
                    self._drop(lambda old: isinstance(old, TimedPicture) and old.station == item.station)
                    self._dropped[f"frames of {item.station}"] += 1
                    self._waiting[item.station] -= 1
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

    def _drop(self, which: Callable[[Item], bool]) -> None:
        for k, old in enumerate(self._items):
            if which(old):
                del self._items[k]
                return
