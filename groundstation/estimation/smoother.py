"""The whole flight, looked at from its end: what the filter would have said had it known what came later.

Rauch, Tung & Striebel's backward pass over the filter's own models, along its history
(`groundstation.estimation.smoother_history`). It begins where a target was given up or the flight ends and stops where
it was begun. Linearisations are the filter's.

- With several modes it is the mixture's mean and covariance that are smoothed, in one step for all: a moment-matched
  approximation, as the filter's output is.
- Errors of calibration and clocks have no noise, so C is the identity for them: what was learnt of them later holds
  before. Where they are only considered nothing is learnt: they keep value and variance, and what they cause in the
  track stays in its covariance, however long the flight. There the rest is approximate, since Rauch's formula supposes
  the optimal gain, which is not Schmidt's.

Memory: the tape takes 24 n² bytes for each step of n states. Beyond ``max_bytes`` the older half of what is held is
smoothed and let go: for it the future ends where the tape ended then, far later than a target remembers.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator

from groundstation.arrays import FloatArray
from groundstation.estimation.smoother_history import Cut, MotionOver, Record, Transition, back, back_into

Found = Callable[[float, FloatArray, FloatArray], None]
_ROUNDING_S = 1e-9
_BYTES = 8
_MATRICES = 3
_LEAST_STEPS = 200


class Smoother:
    """Takes a tape as it is let go, and gives means and covariances at wanted times.

    Parameters
    ----------
    motion_over : (dt in s, mode weights) → F, Q, as `StationEkf.motion_over`.
    found : takes each answer: time in s, mean (n,), covariance (n, n). Times without a target get none.
    max_bytes : how much of the tape may be held.
    """

    def __init__(self, motion_over: MotionOver, found: Found, max_bytes: float = 2.5e8) -> None:
        self._motion_over = motion_over
        self._found = found
        self._max_bytes = max_bytes
        self._held: deque[Transition] = deque()
        self._wanted: list[float] = []

    def want(self, t_s: float) -> None:
        """Ask for an answer at a time; to be asked before the tape has gone past it by half its bound."""
        self._wanted.insert(bisect_left(self._wanted, t_s), t_s)

    def take(self, record: Record) -> None:
        """Take the next record that nothing will change any more."""
        if isinstance(record, Cut):
            self._smooth(record.t_s, record.x, record.P, keep=0)
            return
        self._held.append(record)
        n = record.x.size
        if len(self._held) > max(_LEAST_STEPS, self._max_bytes / (_MATRICES * _BYTES * n * n)):
            newest = self._held[-1]
            self._smooth(newest.t_s, newest.x, newest.P, keep=len(self._held) // 2)

    def _smooth(self, t_s: float, x: FloatArray, P: FloatArray, keep: int) -> None:
        """Go back from the newest state; answer and let go of all but the newest ``keep`` steps."""
        steps = list(self._held)
        count = len(steps) - keep
        until_s = self._held[count].t_s if keep else math.inf
        if keep:
            # the state before the newest step is the one begun with
            steps.pop()
        else:
            for wanted in self._taken(t_s - _ROUNDING_S, t_s + _ROUNDING_S):
                self._found(wanted, x, P)
        for step in reversed(steps):
            for wanted in self._taken(step.t_s, min(step.next_s, until_s)):
                self._found(wanted, *back_into(step, wanted, x, P, self._motion_over))
            x, P = back(step, x, P)
        for _ in range(count):
            self._held.popleft()
        # what lies before the first step had no target
        if steps:
            del self._wanted[: bisect_left(self._wanted, steps[0].t_s)]

    def _taken(self, from_s: float, to_s: float) -> Iterator[float]:
        """Take the wanted times of [from, to) off the list."""
        first, last = bisect_left(self._wanted, from_s), bisect_left(self._wanted, to_s)
        taken = self._wanted[first:last]
        del self._wanted[first:last]
        return iter(taken)
