"""Journal of the filter: its measurements, replayed for late data, and its transitions, used for smoothing."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from groundstation.arrays import FloatArray
from groundstation.estimation.smoother_history import (
    MotionOver,
    SmoothAcross,
    SmootherHistory,
    TrackEnd,
    Transition,
    smooth_across,
    smooth_within,
)
from groundstation.estimation.updates.measurements import (
    MissedDetection,
    ReferencePosition,
    SilhouetteWidth,
    TargetPixel,
)

# rounding of the mean stamp of an epoch against the stamps of its frames
ROUNDING_S = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class TargetStart:
    """The start of a target: (3,), (3,) in the runway frame, covariance (6, 6), valid ``age_s`` before the filter time.

    A ``triangulated`` state also contains the errors of the rig.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    covariance: FloatArray
    age_s: float
    triangulated: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetDrop:
    """The end of a target."""


JournalRecord = TargetPixel | SilhouetteWidth | MissedDetection | ReferencePosition | TargetStart | TargetDrop


class JournalMark(NamedTuple):
    """Numbers of transitions and measurements in the journal at one time."""

    transitions: int
    measurements: int


class FilterJournal:
    """Records of one filter.

    ``measurements`` are its operations since the list was emptied, accepted or not; `LateMeasurementBuffer` takes them
    and adds the PTU readings. ``history`` are the transitions while there was a target; ``smooth_across`` is the
    step of the smoother over one of them.
    """

    def __init__(self, smooth_across: SmoothAcross = smooth_across) -> None:
        self.smooth_across = smooth_across
        self.history = SmootherHistory()
        self.measurements: list[object] = []

    @property
    def mark(self) -> JournalMark:
        """The present position, for `truncate`."""
        return JournalMark(self.history.mark, len(self.measurements))

    def truncate(self, mark: JournalMark) -> None:
        """Remove all records after a `mark`."""
        self.history.truncate(mark.transitions)
        del self.measurements[mark.measurements :]

    def release(self, mark: JournalMark | None) -> None:
        """Release the transitions before a `mark`, by default all, to the archive of the history."""
        self.history.release(self.history.mark if mark is None else mark.transitions)

    def add(self, record: JournalRecord) -> None:
        """Add an operation of the filter."""
        self.measurements.append(record)

    def end_track(self, t_s: float, x: FloatArray, P: FloatArray) -> None:
        """Record the last state of a track: (n,), (n, n); smoothing does not cross it."""
        self.history.append(TrackEnd(t_s=t_s, x=x, P=P))

    def add_transition(
        self,
        times_s: tuple[float | None, float | None],
        before: tuple[FloatArray, FloatArray],
        F: FloatArray,
        after: tuple[FloatArray, FloatArray],
        weights: FloatArray,
    ) -> None:
        """Record a transition by ``F`` (n, n), from the state (n,), (n, n) ``before`` to the one ``after``."""
        start_s = -math.inf if times_s[0] is None else times_s[0]
        end_s = start_s if times_s[1] is None else times_s[1]
        x, P = before
        x_next, P_next = after
        self.history.append(
            Transition(t_s=start_s, next_s=end_s, x=x, P=P, F=F, x_next=x_next, P_next=P_next, weights=weights)
        )

    def smoothed_at(
        self, t_s: float, x: FloatArray, P: FloatArray, motion_over: MotionOver
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the smoothed state at an earlier time, given the present one (n,), (n, n).

        None before the start of the track and where the history was released.
        """
        for record in reversed(self.history):
            if isinstance(record, TrackEnd):
                return None
            if record.t_s <= t_s < record.next_s:
                return smooth_within(record, t_s, x, P, motion_over, self.smooth_across)
            x, P = self.smooth_across(record, x, P)
        return None
