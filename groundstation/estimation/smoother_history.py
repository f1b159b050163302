"""What the filter has gone through, kept so that one can go back along it (Rauch, Tung & Striebel 1965).

Between two measurements a state goes from x with P to x⁺ = F x + noise with P⁺: by a prediction, or by a reset that
forgets. What is known later, x̂⁺ with P̂⁺, is carried back by C = P Fᵀ (P⁺)⁻¹:

    x̂ = x + C (x̂⁺ − x⁺),   P̂ = P + C (P̂⁺ − P⁺) Cᵀ

A reset of some states is a transition whose F has zero rows there: C's columns vanish, and nothing that was learnt
after it reaches what those states were before.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray

# of a correlation matrix: keeps it positive where a state is known exactly
_RELATIVE_FLOOR = 1e-13


# five for each pair of frames: not frozen, which would take making one twice as long
@dataclass(slots=True, kw_only=True, eq=False)
class Transition:
    """A step of the filter without a measurement, from ``t_s`` to ``next_s``.

    ``x`` (n,) and ``P`` (n, n) before it, all measurements until then included; ``F`` (n, n); ``x_next`` and ``P_next``
    right after it. ``weights`` (r,) are those of the modes in a prediction. Not to be written to.
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
class Cut:
    """The end of a target at ``t_s``: its last state ``x`` (n,) with ``P`` (n, n); nothing goes back across it."""

    t_s: float
    x: FloatArray
    P: FloatArray


Record = Transition | Cut
MotionOver = Callable[[float, FloatArray], tuple[FloatArray, FloatArray]]


class SmootherHistory:
    """Records in order; the newest can be taken back, the oldest are let go once nothing can change them.

    ``archive`` is given what is let go.
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
        """How many records there have been: a place to come back to."""
        return self._released + len(self._records)

    def append(self, record: Record) -> None:
        """Add the newest."""
        self._records.append(record)

    def truncate(self, mark: int) -> None:
        """Take back everything after a `mark`."""
        while self.mark > mark and self._records:
            self._records.pop()

    def release(self, mark: int) -> None:
        """Let go of everything before a `mark`."""
        while self._released < mark and self._records:
            record = self._records.popleft()
            self._released += 1
            if self.archive is not None:
                self.archive(record)


def back(step: Transition, x_later: FloatArray, P_later: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (n,) and covariance (n, n) before a step, given those known after it."""
    C = _gain(step.P, step.F, step.P_next)
    P = step.P + C @ (P_later - step.P_next) @ C.T
    return step.x + C @ (x_later - step.x_next), 0.5 * (P + P.T)


def back_into(
    step: Transition, t_s: float, x_later: FloatArray, P_later: FloatArray, motion_over: MotionOver
) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance at a time inside a prediction, given those known after it."""
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
    return back(part, x_later, P_later)


def _gain(P: FloatArray, F: FloatArray, P_next: FloatArray) -> FloatArray:
    """Return P Fᵀ (P⁺)⁻¹; states range from 10⁻⁶ rad to 10³ m, so it is solved in units of their sigmas."""
    sigma = np.sqrt(np.maximum(np.diag(P_next), 0.0))
    # a state that is known exactly learns nothing
    inverse = np.where(sigma > 0.0, 1.0 / np.maximum(sigma, 1e-150), 0.0)
    correlation = P_next * np.outer(inverse, inverse)
    diagonal = np.arange(len(sigma))
    correlation[diagonal, diagonal] = 1.0 + _RELATIVE_FLOOR
    scaled = np.linalg.solve(correlation, (P @ F.T * inverse).T).T
    return np.asarray(scaled * inverse)
