"""History of the filter's transitions, for the backward pass of Rauch, Tung & Striebel (1965).

Between two measurements the state changes from x with P to x⁺ = F x + noise with P⁺, by a prediction or by a reset of
some states. The smoothed estimate after it, x̂⁺ with P̂⁺, gives the one before it with C = P Fᵀ (P⁺)⁻¹:

    x̂ = x + C (x̂⁺ − x⁺),   P̂ = P + C (P̂⁺ − P⁺) Cᵀ

A reset of some states is a transition whose F has zero rows for them: the columns of C vanish, and later measurements
do not affect those states before the reset.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray

# added to the diagonal of a correlation matrix, which keeps it positive definite for exactly known states
RELATIVE_FLOOR = 1e-13


# five per epoch: not frozen, since frozen ones take twice as long to create
@dataclass(slots=True, kw_only=True, eq=False)
class Transition:
    """A transition of the filter without a measurement, from ``t_s`` to ``next_s``.

    ``x`` (n,) and ``P`` (n, n) are the filtered estimate before it, ``F`` (n, n) its matrix, ``x_next`` and ``P_next``
    the estimate right after it, ``weights`` (r,) the mode weights of a prediction. Arrays are read-only.
    """

    t_s: float
    next_s: float
    x: FloatArray
    P: FloatArray
    F: FloatArray
    x_next: FloatArray
    P_next: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackEnd:
    """The end of a track at ``t_s``: its last state ``x`` (n,) with ``P`` (n, n); smoothing does not cross it."""

    t_s: float
    x: FloatArray
    P: FloatArray


Record = Transition | TrackEnd
MotionOver = Callable[[float, FloatArray], tuple[FloatArray, FloatArray]]
SmoothAcross = Callable[[Transition, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


class SmootherHistory:
    """Records in order: the newest can be removed again, the oldest are released once they are final.

    ``archive`` receives the released records.
    """

    def __init__(self) -> None:
        self.archive: Callable[[Record], None] | None = None
        self._records: deque[Record] = deque()
        self._released = 0

    def __len__(self) -> int:
        return len(self._records)

    def __reversed__(self) -> Iterator[Record]:
        return reversed(self._records)

    @property
    def mark(self) -> int:
        """Number of records so far, for `truncate` and `release`."""
        return self._released + len(self._records)

    def append(self, record: Record) -> None:
        """Add a record."""
        self._records.append(record)

    def truncate(self, mark: int) -> None:
        """Remove all records after a `mark`."""
        while self.mark > mark and self._records:
            self._records.pop()

    def release(self, mark: int) -> None:
        """Release all records before a `mark` to the archive."""
        while self._released < mark and self._records:
            record = self._records.popleft()
            self._released += 1
            if self.archive is not None:
                self.archive(record)


def smooth_across(step: Transition, x_later: FloatArray, P_later: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return smoothed mean (n,) and covariance (n, n) before a transition, given those after it."""
    C = _gain(step.P, step.F, step.P_next)
    P = step.P + C @ (P_later - step.P_next) @ C.T
    return step.x + C @ (x_later - step.x_next), 0.5 * (P + P.T)


def smooth_within(
    step: Transition,
    t_s: float,
    x_later: FloatArray,
    P_later: FloatArray,
    motion_over: MotionOver,
    across: SmoothAcross = smooth_across,
) -> tuple[FloatArray, FloatArray]:
    """Return smoothed mean and covariance at a time inside a prediction, given those after it.

    ``across`` is the backward step over a transition.
    """
    F, Q = motion_over(t_s - step.t_s, step.weights)
    x, P = F @ step.x, F @ step.P @ F.T + Q
    rest, _ = motion_over(step.next_s - t_s, step.weights)
    part = Transition(
        t_s=t_s,
        next_s=step.next_s,
        x=x,
        P=P,
        F=rest,
        x_next=step.x_next,
        P_next=step.P_next,
        weights=step.weights,
    )
    return across(part, x_later, P_later)


def _gain(P: FloatArray, F: FloatArray, P_next: FloatArray) -> FloatArray:
    """Return C = P Fᵀ (P⁺)⁻¹, solved in units of the sigmas, since states range from 10⁻⁶ rad to 10³ m."""
    sigma = np.sqrt(np.maximum(np.diag(P_next), 0.0))
    # an exactly known state has no gain
    inverse = np.where(sigma > 0.0, 1.0 / np.maximum(sigma, 1e-150), 0.0)
    correlation = P_next * np.outer(inverse, inverse)
    diagonal = np.arange(len(sigma))
    correlation[diagonal, diagonal] = 1.0 + RELATIVE_FLOOR
    scaled = np.linalg.solve(correlation, (P @ F.T * inverse).T).T
    return np.asarray(scaled * inverse)
