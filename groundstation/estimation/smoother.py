"""Fixed-interval smoother: estimates of the whole flight, given the measurements before and after each time.

Rauch-Tung-Striebel backward pass over the models of the filter, along its history
(`groundstation.estimation.smoother_history`). A pass begins where a track ends and stops where it was started. The
linearisation points are those of the filter.

- With several modes, mean and covariance of the mixture are smoothed in one step: a moment-matched approximation, as
  is the output of the filter.
- Errors of calibration and clocks have no process noise, so that C is the identity for them: later estimates hold for
  all earlier times. Consider parameters keep value and variance, and their contribution stays in the covariance of the
  track for any length of flight. The other states are then approximate, since the Rauch-Tung-Striebel equations assume
  the optimal gain, not that of Schmidt.

Memory: the history takes 24 n² bytes for each step of n states. Beyond ``max_bytes`` the older half of the buffered
steps is smoothed and released: measurements after that point do not reach it. The lag is much longer than the memory
of the target states.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator

from groundstation.arrays import FloatArray
from groundstation.estimation.smoother_history import (
    MotionOver,
    Record,
    SmoothAcross,
    TrackEnd,
    Transition,
    smooth_across,
    smooth_within,
)

SmoothedCallback = Callable[[float, FloatArray, FloatArray], None]
_ROUNDING_S = 1e-9
_BYTES = 8
_MATRICES = 3
_LEAST_STEPS = 200


class Smoother:
    """Receives the released records of a filter history and computes means and covariances at requested times.

    Parameters
    ----------
    motion_over : (dt in s, mode weights) → F, Q, as `StationEkf.motion_over`.
    found : receives each result: time in s, mean (n,), covariance (n, n); not called for times without a target.
    max_bytes : maximum size of the buffered records.
    across : backward step over a transition.
    """

    def __init__(
        self,
        motion_over: MotionOver,
        found: SmoothedCallback,
        max_bytes: float = 2.5e8,
        across: SmoothAcross = smooth_across,
    ) -> None:
        self._motion_over, self._across = motion_over, across
        self._found = found
        self._max_bytes = max_bytes
        self._held: deque[Transition] = deque()
        self._requested: list[float] = []

    def request(self, t_s: float) -> None:
        """Request an estimate at a time; to be called before the buffer has advanced past it by half its size."""
        self._requested.insert(bisect_left(self._requested, t_s), t_s)

    def take(self, record: Record) -> None:
        """Add the next final record."""
        if isinstance(record, TrackEnd):
            self._smooth(record.t_s, record.x, record.P, keep=0)
            return
        self._held.append(record)
        n = record.x.size
        if len(self._held) > max(_LEAST_STEPS, self._max_bytes / (_MATRICES * _BYTES * n * n)):
            newest = self._held[-1]
            self._smooth(newest.t_s, newest.x, newest.P, keep=len(self._held) // 2)

    def _smooth(self, t_s: float, x: FloatArray, P: FloatArray, keep: int) -> None:
        """Smooth backwards from the newest state; release all but the newest ``keep`` steps."""
        steps = list(self._held)
        count = len(steps) - keep
        until_s = self._held[count].t_s if keep else math.inf
        if keep:
            # the pass starts with the state before the newest step
            steps.pop()
        else:
            for wanted in self._pop_requested(t_s - _ROUNDING_S, t_s + _ROUNDING_S):
                self._found(wanted, x, P)
        for step in reversed(steps):
            for wanted in self._pop_requested(step.t_s, min(step.next_s, until_s)):
                self._found(wanted, *smooth_within(step, wanted, x, P, self._motion_over, self._across))
            x, P = self._across(step, x, P)
        for _ in range(count):
            self._held.popleft()
        # before the first step there was no target
        if steps:
            del self._requested[: bisect_left(self._requested, steps[0].t_s)]

    def _pop_requested(self, from_s: float, to_s: float) -> Iterator[float]:
        """Remove and return the requested times in [from, to)."""
        first, last = bisect_left(self._requested, from_s), bisect_left(self._requested, to_s)
        taken = self._requested[first:last]
        del self._requested[first:last]
        return iter(taken)
