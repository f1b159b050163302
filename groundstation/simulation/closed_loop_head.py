"""Pan-tilt head of the closed-loop simulation: delayed rate commands and limited acceleration, in virtual time."""

import math
from collections import deque

import numpy as np

from groundstation.arrays import FloatArray


class ClosedLoopHead:
    """A head that applies rate commands after a latency, with limited acceleration."""

    def __init__(self, angles: FloatArray, *, latency_s: float, acceleration_deg_s2: float) -> None:
        self.angles = angles
        self.rates = np.zeros(2)
        self._wanted = np.zeros(2)
        self._waiting: deque[tuple[float, FloatArray]] = deque()
        self._latency_s = latency_s
        self._steepest = math.radians(acceleration_deg_s2)
        self._at_s = 0.0

    def tell(self, t_s: float, rates: FloatArray) -> None:
        """Queue a rate command (2,) in rad/s."""
        self._waiting.append((t_s + self._latency_s, rates))

    def run_to(self, t_s: float) -> None:
        """Integrate the motion until ``t_s`` in steps of at most 2 ms."""
        while self._at_s < t_s:
            dt = min(0.002, t_s - self._at_s)
            while self._waiting and self._waiting[0][0] <= self._at_s:
                self._wanted = self._waiting.popleft()[1]
            step = self._steepest * dt
            self.rates = self.rates + np.minimum(np.maximum(self._wanted - self.rates, -step), step)
            self.angles = self.angles + self.rates * dt
            self._at_s += dt

    def home(self, until_s: float) -> None:
        """Discard all commands and hold zero angles until ``until_s``."""
        self._waiting.clear()
        self._wanted, self.rates, self.angles = np.zeros(2), np.zeros(2), np.zeros(2)
        self._at_s = max(self._at_s, until_s)
