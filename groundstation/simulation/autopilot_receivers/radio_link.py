"""A radio that loses messages and delays each by another time, in the order in which they were sent."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.autopilot.message import MavlinkMessage


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioLinkModel:
    """Share of the messages that is lost, and the bounds of the delay, s, within which it is uniform."""

    loss: float = 0.05
    delay_s: tuple[float, float] = (0.03, 0.2)


class RadioLink:
    """Messages on their way; a later one does not overtake an earlier one."""

    def __init__(self, model: RadioLinkModel, generator: np.random.Generator) -> None:
        self.sent = 0
        self.lost = 0
        self._model, self._random = model, generator
        self._on_their_way: deque[tuple[float, MavlinkMessage]] = deque()
        self._last_s = -np.inf

    def send(self, message: MavlinkMessage, now_s: float) -> bool:
        """Send a message at ``now_s``; False if it is lost."""
        self.sent += 1
        delay_s = float(self._random.uniform(*self._model.delay_s))
        if self._random.random() < self._model.loss:
            self.lost += 1
            return False
        self._last_s = max(self._last_s, now_s + delay_s)
        self._on_their_way.append((self._last_s, message))
        return True

    def arrived(self, until_s: float) -> Iterator[tuple[float, MavlinkMessage]]:
        """Take the messages that arrive until then, each with its time."""
        while self._on_their_way and self._on_their_way[0][0] <= until_s:
            yield self._on_their_way.popleft()
