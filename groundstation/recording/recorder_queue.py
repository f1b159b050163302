"""What waits for the recorder's writer: bounded, never blocking, and what is too much is dropped by a stated rule.

Pictures go first, the oldest of them; everything else only when so much waits that the disk must be gone.
"""

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from groundstation.picture import BayerPattern, Kept, Picture


@dataclass(slots=True, kw_only=True, eq=False)
class FramePixels:
    """The pixels of frame number ``of``: its kept parts or, of one read as a whole, the picture; None once dropped."""

    of: int
    station: str
    t_s: float
    pattern: BayerPattern | None
    source: Sequence[Kept] | Picture | None
    dropped: str = ""
    size_bytes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class EventLine:
    """Event number ``n`` as plain values, at ``t_s``."""

    n: int
    t_s: float
    values: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class QueueAnswer:
    """Something that the pipeline answered: a report's part, or a file to attach."""

    content: Any


Item = EventLine | FramePixels | QueueAnswer


@dataclass(slots=True)
class QueueCounts:
    """What was dropped: pictures, other records, and the numbers of the events among these, as ranges."""

    pictures: int = 0
    records: int = 0
    events: int = 0
    lost: list[list[int]] = field(default_factory=list)


class RecorderQueue:
    """Takes items from one thread and gives them to another, in order.

    Parameters
    ----------
    max_picture_bytes : so much of pictures may wait; beyond it the oldest are dropped.
    max_items : so many items may wait at all.
    """

    def __init__(self, *, max_picture_bytes: int, max_items: int) -> None:
        self._max_bytes = max_picture_bytes
        self._max_items = max_items
        self._changed = threading.Condition()
        self._items: deque[Item] = deque()
        self._pictures: deque[FramePixels] = deque()
        self._bytes = 0
        self._closed = False
        self._counts = QueueCounts()
        # why pictures are not taken now; empty where they are
        self.refuse_pictures = ""

    def put(self, item: Item) -> None:
        """Add an item; never waits."""
        with self._changed:
            self._items.append(item)
            if isinstance(item, FramePixels) and item.source is not None:
                self._add_picture(item)
            while len(self._items) > self._max_items:
                self._lose(self._items.popleft())
            self._changed.notify()

    def take(self, timeout_s: float) -> Item | None:
        """Return the oldest item; None where none comes in time."""
        with self._changed:
            if not self._items and not self._closed:
                self._changed.wait(timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
            if isinstance(item, FramePixels):
                self._forget(item)
            return item

    def close(self) -> None:
        """Say that nothing more will come: `take` no longer waits."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def closed(self) -> bool:
        """Whether nothing more will come."""
        return self._closed

    @property
    def drained(self) -> bool:
        """Whether nothing waits and nothing more will come; `closed` may become true with much still to be taken."""
        with self._changed:
            return self._closed and not self._items

    def fill(self) -> float:
        """Return how full it is, 0 to 1, of pictures or of items, whichever is more."""
        with self._changed:
            return max(self._bytes / self._max_bytes, len(self._items) / self._max_items)

    def take_lost(self) -> list[tuple[int, int]]:
        """Return the numbers of the events that were lost since last asked, first and last of each run of them."""
        with self._changed:
            lost, self._counts.lost = self._counts.lost, []
        return [(first, last) for first, last in lost]

    def counts(self) -> tuple[int, int, int]:
        """Return how many pictures, other records and, among these, events were dropped."""
        with self._changed:
            return self._counts.pictures, self._counts.records, self._counts.events

    def drop_picture(self, item: FramePixels, why: str) -> None:
        """Drop the pixels of one item, and count it."""
        with self._changed:
            self._drop(item, why)

    def _add_picture(self, item: FramePixels) -> None:
        if self.refuse_pictures:
            self._drop(item, self.refuse_pictures)
            return
        self._pictures.append(item)
        self._bytes += item.size_bytes
        while self._bytes > self._max_bytes:
            self._drop(self._pictures[0], "too slow")

    def _drop(self, item: FramePixels, why: str) -> None:
        self._forget(item)
        item.source, item.dropped = None, why
        self._counts.pictures += 1

    def _forget(self, item: FramePixels) -> None:
        """Take a picture out of what is counted as waiting."""
        if self._pictures and self._pictures[0] is item:
            self._pictures.popleft()
            self._bytes -= item.size_bytes

    def _lose(self, item: Item) -> None:
        """Count an item that is gone."""
        self._counts.records += 1
        if isinstance(item, FramePixels):
            if item.source is not None:
                self._drop(item, "disk gone")
        elif isinstance(item, EventLine):
            self._counts.events += 1
            lost = self._counts.lost
            if lost and lost[-1][1] == item.n - 1:
                lost[-1][1] = item.n
            else:
                lost.append([item.n, item.n])
