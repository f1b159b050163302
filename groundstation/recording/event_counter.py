"""Number of events and epochs, and the time span of the epochs, for a recording's closing record."""

import json
import math
from typing import Any

from groundstation.files.read_budget import MAX_LINE_BYTES
from groundstation.recording.mcap_metadata import RecordingStatistics


class EventCounter:
    """Counts events, epochs and the span of the epochs."""

    def __init__(self) -> None:
        self._events = self._epochs = 0
        self._first_s, self._last_s = math.inf, -math.inf

    def add(self, values: dict[str, Any]) -> None:
        """Count an event given as plain values; a note, which has no number, is not counted."""
        if "n" not in values:
            return
        self._events += 1
        t_s = values.get("t_s")
        if values.get("kind") == "epoch" and isinstance(t_s, float):
            self._epochs += 1
            self._first_s, self._last_s = min(self._first_s, t_s), max(self._last_s, t_s)

    def add_line(self, line: bytes) -> None:
        """Count an event given as its JSON line; a damaged line is not counted."""
        if len(line) > MAX_LINE_BYTES:
            return
        try:
            values = json.loads(line)
        except (ValueError, RecursionError):
            return
        if isinstance(values, dict):
            self.add(values)

    def result(self) -> RecordingStatistics:
        """Return the closing record."""
        first, last = (self._first_s, self._last_s) if self._epochs else (0.0, 0.0)
        return RecordingStatistics(events=self._events, epochs=self._epochs, first_s=first, last_s=last)
