"""Time ordering of all records, and interpolation of the PTU angles at each exposure.

Rules, all in the session clock:

- Records are released in order of their stamps. A record is released when every stream (each camera, each PTU) has
  reached its stamp, or when the newest stamp is ``hold_s`` ahead of it, which limits the wait for a delayed stream.
  Within this time the order of arrival has no effect.
- A frame therefore also waits for the next PTU reading of its station, so that readings bracket the exposure; with a
  reading at its own stamp it needs no other.
- A record older than the last released one is late and is released as such: inside a horizon the filter is rewound for
  it (`groundstation.estimation.late_measurements`); beyond the horizon it is counted and not used.
- Without new records, waiting ones are released once the session clock is `IN_FLIGHT_S` and ``hold_s`` past them:
  until then others may still be in transit.
- Angles are interpolated linearly between two readings no further apart than ``max_gap_s``; before the
  first, after the last, or inside a longer gap there is no angle.
"""

import bisect
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from groundstation.geometry.angles import wrap_rad
from groundstation.messages import Arrival, Epoch, Frame, PixelMeasurement, PtuSample, ReferenceFix


@dataclass(frozen=True, slots=True, kw_only=True)
class SynchroniseConfig:
    """Tuning of ordering and interpolation.

    Attributes
    ----------
    hold_s : maximum time that a record waits for delayed streams.
    max_gap_s : readings further apart than this do not bracket an exposure.
    camera_gap_s : minimum time between frames of a camera, during which its next frame is not waited for; an earlier
        frame is late. In operation half a period; 0 makes no assumption.
    """

    hold_s: float = 0.15
    max_gap_s: float = 0.25
    camera_gap_s: float = 0.0

    def __post_init__(self) -> None:
        if self.hold_s < 0 or self.max_gap_s <= 0 or self.camera_gap_s < 0:
            raise ValueError("hold_s and camera_gap_s must be ≥ 0, max_gap_s > 0")


# as late as a record may be fused by default (`EstimationConfig.late_horizon_s`): longer under way, it is of little use
IN_FLIGHT_S = 0.5
# readings older than this before the newest record passed on are forgotten
_KEPT_S = 2.0


class AngleFault(StrEnum):
    """Why there is no angle at an instant."""

    NO_READING = "no PTU reading yet"
    GAP = "PTU readings too far apart"
    ENDED = "no PTU reading after the exposure"


@dataclass(frozen=True, slots=True, kw_only=True)
class InterpolatedAngles:
    """Pan and tilt at an instant, by linear interpolation; ``variance_share`` of one reading's variance."""

    pan_rad: float
    tilt_rad: float
    variance_share: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadyFrame:
    """A released record of a camera.

    ``following`` is the station's next PTU reading, which is not released again on its own; None if it has not arrived,
    or if the station is fixed. ``late`` marks a stamp before the last released one, ``revisited`` a frame for which the
    filter was rewound.
    """

    record: Frame | PixelMeasurement
    angles: InterpolatedAngles | AngleFault | None
    following: PtuSample | None
    late: bool = False
    revisited: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LateReading:
    """A PTU reading with a stamp before the last released one."""

    sample: PtuSample


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LateReference:
    """A reference position with a stamp before the last released one."""

    fix: ReferenceFix


Ready = PtuSample | LateReading | LateReference | ReadyFrame | ReferenceFix | Epoch


@dataclass(slots=True)
class LateCounts:
    """Numbers of late records, by kind."""

    ptu: int = 0
    frames: int = 0
    references: int = 0


class _Queued(NamedTuple):
    """A queue entry, ordered by time, then by arrival; unique numbers avoid a comparison of events."""

    t_s: float
    number: int
    event: Arrival


class Synchroniser:
    """Orders events by time and adds the interpolated angles to each frame.

    Parameters
    ----------
    turning : names of the stations that have a PTU.
    cameras : names of the stations whose frames are expected; others are waited for once they have been seen.
    """

    def __init__(self, turning: Sequence[str], config: SynchroniseConfig, cameras: Sequence[str] = ()) -> None:
        self.late = LateCounts()
        self._config = config
        self._history: dict[str, deque[PtuSample]] = {name: deque() for name in turning}
        self._streams = {("ptu", name): float("-inf") for name in turning}
        self._streams.update({("camera", name): float("-inf") for name in cameras})
        # how far the slowest of them has come
        self._all_reached_s = min(self._streams.values(), default=float("inf"))
        self._queue: list[_Queued] = []
        self._number = 0
        self._newest_s = float("-inf")
        self._passed_s = float("-inf")
        self._used: set[int] = set()

    @property
    def newest_s(self) -> float:
        """The newest stamp that has been seen, of a reference position none."""
        return self._newest_s

    def push(self, event: Arrival) -> Iterable[Ready]:
        """Add one event and return all records that are due, in time order."""
        if not isinstance(event, ReferenceFix):
            # a receiver has a clock of its own: that it is ahead does not make the cameras late
            self._newest_s = max(self._newest_s, event.t_s)
        if not isinstance(event, (Epoch, ReferenceFix)):
            reading = isinstance(event, PtuSample)
            stream = ("ptu" if reading else "camera", event.station)
            reached = event.t_s if reading else event.t_s + self._config.camera_gap_s
            self._streams[stream] = max(self._streams.get(stream, reached), reached)
            self._all_reached_s = min(self._streams.values())
        if event.t_s < self._passed_s and not isinstance(event, Epoch):
            return self._answer_late(event)
        self._enqueue(event)
        return self._drain(final=False) if self._may_pass(self._queue[0].t_s) else ()

    def pass_time(self, t_s: float) -> Iterable[Ready]:
        """Advance the session clock to ``t_s``, and return all records that are due, in time order."""
        self._newest_s = max(self._newest_s, t_s - IN_FLIGHT_S)
        return self._drain(final=False)

    def finish(self) -> Iterable[Ready]:
        """Return all waiting records, at the end of the input."""
        return self._drain(final=True)

    def angles_at(self, station: str, t_s: float) -> InterpolatedAngles | AngleFault | None:
        """Return interpolated angles at ``t_s``; None for a fixed station, which has none."""
        history = self._history.get(station)
        return None if history is None else interpolate(history, t_s, self._config.max_gap_s)

    def _enqueue(self, event: Arrival) -> None:
        """Insert by time; an epoch goes after all of its frames, whose mean its stamp is."""
        self._number += 1
        t = event.t_s
        if isinstance(event, Epoch):
            mates = [
                q.t_s
                for q in self._queue
                if isinstance(q.event, (Frame, PixelMeasurement)) and q.event.epoch == event.epoch
            ]
            t = max([t, self._passed_s, *mates])
        elif isinstance(event, PtuSample):
            self._remember(event)
        bisect.insort(self._queue, _Queued(t, self._number, event))

    def _remember(self, sample: PtuSample) -> None:
        """Store a reading for the interpolation."""
        history = self._history.get(sample.station)
        if history is None:
            return
        if not history or sample.t_s > history[-1].t_s:
            history.append(sample)
        else:
            ordered = sorted([*history, sample], key=lambda s: s.t_s)
            history.clear()
            history.extend(ordered)
        # waiting records are newer than the last released one
        while history and history[0].t_s < self._passed_s - _KEPT_S:
            history.popleft()

    def _answer_late(self, event: Arrival) -> Iterator[Ready]:
        if isinstance(event, PtuSample):
            self.late.ptu += 1
            self._remember(event)
            yield LateReading(sample=event)
        elif isinstance(event, ReferenceFix):
            self.late.references += 1
            yield LateReference(fix=event)
        elif not isinstance(event, Epoch):
            self.late.frames += 1
            angles = self.angles_at(event.station, event.t_s)
            yield ReadyFrame(record=event, angles=angles, following=None, late=True)

    def _drain(self, final: bool) -> Iterator[Ready]:
        while self._queue:
            event = self._queue[0].event
            if not (final or self._may_pass(self._queue[0].t_s)):
                return
            self._passed_s = max(self._passed_s, self._queue.pop(0).t_s)
            if isinstance(event, PtuSample):
                if id(event) in self._used:
                    self._used.discard(id(event))
                else:
                    yield event
            elif isinstance(event, (Epoch, ReferenceFix)):
                yield event
            else:
                yield self._ready_frame(event)

    def _may_pass(self, t_s: float) -> bool:
        """Return whether no earlier record than ``t_s`` is expected, or the hold time has passed."""
        return self._newest_s >= t_s + self._config.hold_s or self._all_reached_s >= t_s

    def _ready_frame(self, frame: Frame | PixelMeasurement) -> ReadyFrame:
        following = self.claim_following(frame)
        return ReadyFrame(record=frame, angles=self.angles_at(frame.station, frame.t_s), following=following)

    def release(self, sample: PtuSample) -> bool:
        """Return whether a claimed reading is still waiting; if so it is released at its own time."""
        waits = id(sample) in self._used
        self._used.discard(id(sample))
        return waits

    def claim_following(self, frame: Frame | PixelMeasurement) -> PtuSample | None:
        """Return the station's next waiting reading after a frame, which is then not released on its own.

        A frame with a reading at its own stamp needs no other.
        """
        for known in reversed(self._history.get(frame.station, ())):
            if known.t_s == frame.t_s:
                return None
            if known.t_s < frame.t_s:
                # in order: all before it are older still
                break
        for queued in self._queue:
            candidate = queued.event
            if isinstance(candidate, PtuSample) and candidate.station == frame.station:
                near = candidate.t_s - frame.t_s <= self._config.max_gap_s
                if near and id(candidate) not in self._used:
                    self._used.add(id(candidate))
                    return candidate
                return None
        return None


def interpolate(readings: Sequence[PtuSample], t_s: float, max_gap_s: float) -> InterpolatedAngles | AngleFault:
    """Interpolate pan and tilt at ``t_s`` between the two readings around it (sorted by time)."""
    after = next((i for i in range(len(readings) - 1, -1, -1) if readings[i].t_s < t_s), -1) + 1
    if after < len(readings) and readings[after].t_s == t_s:
        hit = readings[after]
        return InterpolatedAngles(pan_rad=hit.pan_rad, tilt_rad=hit.tilt_rad, variance_share=1.0)
    if after == 0:
        return AngleFault.NO_READING
    if after == len(readings):
        return AngleFault.ENDED
    a, b = readings[after - 1], readings[after]
    if b.t_s - a.t_s > max_gap_s:
        return AngleFault.GAP
    w = (t_s - a.t_s) / (b.t_s - a.t_s)
    return InterpolatedAngles(
        pan_rad=a.pan_rad + w * wrap_rad(b.pan_rad - a.pan_rad),
        tilt_rad=a.tilt_rad + w * wrap_rad(b.tilt_rad - a.tilt_rad),
        variance_share=(1.0 - w) ** 2 + w**2,
    )
