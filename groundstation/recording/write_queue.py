"""The queue of the recorder's writer: bounded and non-blocking.

On overflow the oldest pictures are dropped first; other records only at ``max_items``, when the disk is unavailable.
"""

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from groundstation.picture import BayerPattern, Picture, PicturePart


@dataclass(slots=True, kw_only=True, eq=False)
class PixelsItem:
    """The pixels of frame number ``of``: its kept parts or, of one read as a whole, the picture; None once dropped."""

    of: int
    station: str
    t_s: float
    pattern: BayerPattern | None
    source: Sequence[PicturePart] | Picture | None
    dropped: str = ""
    size_bytes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class EventItem:
    """Event number ``n`` as plain values, at ``t_s``."""

    n: int
    t_s: float
    values: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputItem:
    """An output of the pipeline (part of a report), or a file to attach."""

    content: Any


QueueItem = EventItem | PixelsItem | OutputItem


@dataclass(slots=True)
class DropCounts:
    """Number of dropped pictures and other records, and the ranges of the events among the latter."""

    pictures: int = 0
    records: int = 0
    events: int = 0
    lost: list[list[int]] = field(default_factory=list)


class WriteQueue:
    """First-in, first-out queue between two threads.

    Parameters
    ----------
    max_picture_bytes : limit of the queued pictures' size; beyond it the oldest are dropped.
    max_items : limit of the number of queued items.
    """

    def __init__(self, *, max_picture_bytes: int, max_items: int) -> None:
        self._max_bytes = max_picture_bytes
        self._max_items = max_items
        self._changed = threading.Condition()
        self._items: deque[QueueItem] = deque()
        self._pictures: deque[PixelsItem] = deque()
        self._bytes = 0
        self._closed = False
        self._counts = DropCounts()
        # the reason for refusing pictures; empty while they are accepted
        self.refuse_pictures = ""
        # whether the writer is not to wait for a disk that accepts no data
        self.abandoned = False

    def put(self, item: QueueItem) -> None:
        """Add an item; does not block."""
        with self._changed:
            self._items.append(item)
            if isinstance(item, PixelsItem) and item.source is not None:
                self._add_picture(item)
            while len(self._items) > self._max_items:
                self._lose(self._items.popleft())
            self._changed.notify()

    def take(self, timeout_s: float) -> QueueItem | None:
        """Return the oldest item; None if none arrives within the timeout."""
        with self._changed:
            if not self._items and not self._closed:
                self._changed.wait(timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
            if isinstance(item, PixelsItem):
                self._forget(item)
            return item

    def close(self) -> None:
        """Mark the end of the input: `take` no longer blocks."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    @property
    def closed(self) -> bool:
        """Whether the input has ended."""
        return self._closed

    @property
    def drained(self) -> bool:
        """Whether the input has ended and the queue is empty; `closed` alone does not imply the latter."""
        with self._changed:
            return self._closed and not self._items

    def fill(self) -> float:
        """Return the fill level, 0 to 1: of pictures or of items, whichever is higher."""
        with self._changed:
            return max(self._bytes / self._max_bytes, len(self._items) / self._max_items)

    def take_lost(self) -> list[tuple[int, int]]:
        """Return the ranges (first, last) of event numbers lost since the previous call."""
        with self._changed:
            lost, self._counts.lost = self._counts.lost, []
        return [(first, last) for first, last in lost]

    def counts(self) -> tuple[int, int, int]:
        """Return how many pictures, other records and, among these, events were dropped."""
        with self._changed:
            return self._counts.pictures, self._counts.records, self._counts.events

    def drop_picture(self, item: PixelsItem, why: str) -> None:
        """Drop the pixels of one item, and count it."""
        with self._changed:
            self._drop(item, why)

    def _add_picture(self, item: PixelsItem) -> None:
        if self.refuse_pictures:
            self._drop(item, self.refuse_pictures)
            return
        self._pictures.append(item)
        self._bytes += item.size_bytes
        while self._bytes > self._max_bytes:
            self._drop(self._pictures[0], "too slow")

    def _drop(self, item: PixelsItem, why: str) -> None:
        self._forget(item)
        item.source, item.dropped = None, why
        self._counts.pictures += 1

    def _forget(self, item: PixelsItem) -> None:
        """Subtract a picture from the queued size."""
        if self._pictures and self._pictures[0] is item:
            self._pictures.popleft()
            self._bytes -= item.size_bytes

    def _lose(self, item: QueueItem) -> None:
        """Count a dropped item."""
        self._counts.records += 1
        if isinstance(item, PixelsItem):
            if item.source is not None:
                self._drop(item, "disk gone")
        elif isinstance(item, EventItem):
            self._counts.events += 1
            lost = self._counts.lost
            if lost and lost[-1][1] == item.n - 1:
                lost[-1][1] = item.n
            else:
                lost.append([item.n, item.n])
