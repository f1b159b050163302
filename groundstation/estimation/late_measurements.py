"""Out-of-sequence measurements: the filter is rewound to the measurement's time and the later ones are replayed.

The buffer keeps each reading, frame and track decision of the last `horizon_s`, with a snapshot of the filter before
it. A late measurement inside the horizon is inserted at its own time: the filter is restored to the snapshot before
it, updated with it, and updated again with everything after it; the gates are evaluated again. The result equals that
of a filter which received all measurements in order. Measurements beyond the horizon are rejected.

The filter and the outlier logic of the readings (`EncoderFeed`) are rewound together: a suspect reading is resolved by
the next one in order of stamps, not of arrival. Detections are not repeated, since the images are no longer available,
and decisions stay as they were taken: the start and the loss of a track.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeGuard

from groundstation.estimation.ekf_snapshot import EkfSnapshot
from groundstation.estimation.encoders import EncoderFeed, EncoderState
from groundstation.estimation.journal import FilterJournal, JournalRecord, TargetStart
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import PtuSample

# minimum length: the stamp of an epoch is earlier than its second exposure
_LEAST_KEPT_S = 0.2


class _Rank(IntEnum):
    """Order of entries with the same stamp."""

    READING = 0
    FRAME = 1
    DECISION = 2


@dataclass(slots=True)
class _Reading:
    """A PTU reading and the log line that resulted from it."""

    sample: PtuSample
    note: str | None


_Step = JournalRecord | _Reading


def _of_encoder(step: _Step) -> TypeGuard[_Reading]:
    """Return whether a step is an encoder's reading; one of a frame's picture stays with its frame."""
    return isinstance(step, _Reading) and step.sample.sigma_rad is None


@dataclass(slots=True)
class _Entry:
    """The operations at one instant, with snapshots taken before them; ``station`` is None for a decision."""

    t_s: float
    rank: _Rank
    station: str | None
    before: EkfSnapshot
    encoder_state: EncoderState
    steps: list[_Step]


class LateMeasurementBuffer:
    """Buffers the recent operations of one filter, for measurements that arrive out of sequence.

    Parameters
    ----------
    ekf, journal, encoders : the filter, its journal and the feed of its PTU readings.
    stations : names in the order of the rig, which is the order of frames with equal stamps.
    horizon_s : maximum delay of a measurement; 0 rejects all late ones.
    max_entries : maximum number of buffered instants.
    max_gap_s : maximum time from a frame to the reading that is fused at its time (as in `Synchroniser`).
    log : receives time in s and text of a log line.
    """

    def __init__(
        self,
        ekf: StationEkf,
        journal: FilterJournal,
        encoders: EncoderFeed,
        *,
        stations: tuple[str, ...],
        horizon_s: float,
        max_entries: int,
        max_gap_s: float,
        log: Callable[[float, str], None],
    ) -> None:
        self._ekf, self._journal = ekf, journal
        self._encoders = encoders
        self._stations = stations
        self._horizon_s = horizon_s
        self._kept_s = max(horizon_s, _LEAST_KEPT_S)
        self._max_entries = max_entries
        self._max_gap_s = max_gap_s
        self._log = log
        self._entries: list[_Entry] = []

    def __len__(self) -> int:
        return len(self._entries)

    # ------------------------------------------------------------------------------------- in order
    def reading(self, t_s: float, station: str) -> "_EntryScope":
        """Record the operations inside the block as a reading of ``station`` at ``t_s``."""
        return _EntryScope(self, len(self._entries), t_s, _Rank.READING, station, trims=True)

    def frame(self, t_s: float, station: str) -> "_EntryScope":
        """Record the operations inside the block as a frame of ``station`` at ``t_s``."""
        return _EntryScope(self, len(self._entries), t_s, _Rank.FRAME, station, trims=True)

    @contextmanager
    def decision(self) -> Iterator[None]:
        """Record the operations inside the block as a decision at the filter time: start or loss of a track."""
        if self._ekf.time_s is None:
            yield
            return
        with _EntryScope(self, len(self._entries), self._ekf.time_s, _Rank.DECISION, None):
            yield
        if not self._entries[-1].steps:
            self._entries.pop()

    def read(self, sample: PtuSample) -> None:
        """Fuse a reading, with the filter at or before its time."""
        note = self._encoders.read(sample)
        self._journal.measurements.append(_Reading(sample, note))
        if note is not None:
            self._log(sample.t_s, note)

    # ----------------------------------------------------------------------------------------- late
    def reaches(self, t_s: float) -> bool:
        """Return whether a measurement of ``t_s`` is within the horizon."""
        if self._horizon_s == 0.0 or not self._entries or self._ekf.time_s is None:
            return False
        if t_s < self._ekf.time_s - self._horizon_s:
            return False
        oldest = self._entries[0].before.time_s
        return oldest is None or oldest <= t_s

    @contextmanager
    def late_frame(self, t_s: float, station: str) -> Iterator[None]:
        """Rewind the filter to ``t_s`` inside the block, and replay all later entries after it."""
        where = bisect_left(self._entries, self._place(t_s, _Rank.FRAME, station), key=self._place_of)
        self._rewind(where)
        with _EntryScope(self, where, t_s, _Rank.FRAME, station):
            yield
        self._replay(where + 1)

    @contextmanager
    def late_decision(self, t_s: float) -> Iterator[None]:
        """As `late_frame`, for an update with a reference position at ``t_s``."""
        where = bisect_left(self._entries, self._place(t_s, _Rank.DECISION, None), key=self._place_of)
        self._rewind(where)
        with _EntryScope(self, where, t_s, _Rank.DECISION, None):
            yield
        self._replay(where + 1)

    def late_reading(self, sample: PtuSample, release: Callable[[PtuSample], bool]) -> None:
        """Insert an out-of-sequence reading at its own time and replay the later entries.

        It may replace a later reading that was fused at the time of a frame; ``release`` returns whether that later
        reading is still waiting in the synchroniser, and returns it to the queue.
        """
        changed = self._assign(sample, release)
        self._rewind(changed)
        self._replay(changed)

    def claim_following(self, station: str, t_s: float) -> PtuSample | None:
        """Remove and return the reading that is fused at the time of a late frame, as it would be in order.

        It is the station's next reading, unless an earlier frame uses it or a reading has the stamp of the frame.
        """
        if any(s.t_s == t_s for s in self._readings(station)):
            return None
        for entry in self._entries:
            for step in entry.steps:
                if _of_encoder(step) and step.sample.station == station and step.sample.t_s > t_s:
                    if entry.t_s <= t_s or step.sample.t_s - t_s > self._max_gap_s:
                        return None
                    entry.steps.remove(step)
                    return step.sample
        return None

    def has_reading_after(self, station: str, t_s: float) -> bool:
        """Return whether a later reading of a station was already fused."""
        return any(sample.t_s > t_s for sample in self._readings(station))

    def _readings(self, station: str) -> list[PtuSample]:
        return [
            step.sample
            for entry in self._entries
            for step in entry.steps
            if _of_encoder(step) and step.sample.station == station
        ]

    def completes(self, sample: PtuSample) -> bool:
        """Return whether a reading in order is the next one after a frame that was processed without it."""
        return self.reaches(sample.t_s) and self._frame_for(sample) is not None

    def _frame_for(self, sample: PtuSample) -> int | None:
        """Return the index of the station's first frame whose next reading is this one."""
        near_s = sample.t_s - self._max_gap_s
        previous_s = near_s
        frames: list[int] = []
        for k in range(len(self._entries) - 1, -1, -1):
            entry = self._entries[k]
            # a frame up to another gap earlier may contain the previous reading
            if entry.t_s < near_s - self._max_gap_s:
                break
            if entry.station != sample.station:
                continue
            if not frames and entry.rank is _Rank.READING and entry.t_s <= sample.t_s:
                # the usual case: no frame since the previous reading
                return None
            if entry.rank is _Rank.FRAME and entry.t_s < sample.t_s:
                frames.append(k)
            for step in entry.steps:
                if _of_encoder(step) and step.sample.t_s <= sample.t_s:
                    previous_s = max(previous_s, step.sample.t_s)
            if entry.rank is _Rank.READING and entry.t_s <= sample.t_s:
                break
        return next((k for k in reversed(frames) if self._entries[k].t_s > previous_s), None)

    def _assign(self, sample: PtuSample, release: Callable[[PtuSample], bool]) -> int:
        """Assign a reading to the first frame that it follows, else to a new entry; return the first changed index.

        The rules are those of `Synchroniser`, applied to records that were already processed.
        """
        station, t_s = sample.station, sample.t_s
        k = self._frame_for(sample)
        if k is not None:
            steps = self._entries[k].steps
            own = next((s for s in steps if _of_encoder(s)), None)
            if own is None:
                # before the pixel, after the start of a target
                steps.insert(sum(isinstance(s, TargetStart) for s in steps), _Reading(sample, None))
            else:
                steps[steps.index(own)] = _Reading(sample, None)
                self._assign(own.sample, release)
            return k
        self._release_at(sample, release)
        if release(sample):
            return len(self._entries)
        where = bisect_left(self._entries, self._place(t_s, _Rank.READING, station), key=self._place_of)
        # the snapshots of this entry are taken again during the replay
        after = self._entries[where] if where < len(self._entries) else None
        before = self._ekf.snapshot() if after is None else after.before
        encoder_state = self._encoders.snapshot() if after is None else after.encoder_state
        self._entries.insert(
            where, _Entry(t_s, _Rank.READING, station, before, encoder_state, [_Reading(sample, None)])
        )
        return where

    def _release_at(self, sample: PtuSample, release: Callable[[PtuSample], bool]) -> None:
        """Remove the following reading from a frame whose own stamp has a reading."""
        for entry in self._entries:
            if entry.rank is _Rank.FRAME and entry.station == sample.station and entry.t_s == sample.t_s:
                own = next((s for s in entry.steps if _of_encoder(s)), None)
                if own is not None:
                    entry.steps.remove(own)
                    self._assign(own.sample, release)

    # ------------------------------------------------------------------------------------ mechanism
    def begin(self, t_s: float, rank: _Rank, station: str | None) -> "_Entry":
        """Open an entry with snapshots of the current state."""
        self._journal.measurements.clear()
        return _Entry(t_s, rank, station, self._ekf.snapshot(), self._encoders.snapshot(), [])

    def end(self, where: int, entry: "_Entry", *, trims: bool) -> None:
        """Close an entry and insert it with the operations since `begin`."""
        entry.steps = self._journal.measurements  # type: ignore[assignment]  # the filter's own steps, and our readings
        self._journal.measurements = []
        self._entries.insert(where, entry)
        if trims:
            self._trim()

    def _place(self, t_s: float, rank: _Rank, station: str | None) -> tuple[float, int, int]:
        """Return the sort key: stamp; for equal stamps readings, frames in the order of the rig, decisions."""
        return t_s, rank, 0 if station is None else self._stations.index(station)

    def _place_of(self, entry: _Entry) -> tuple[float, int, int]:
        return self._place(entry.t_s, entry.rank, entry.station)

    def _rewind(self, where: int) -> None:
        if where < len(self._entries):
            self._ekf.restore(self._entries[where].before)
            self._encoders.restore(self._entries[where].encoder_state)

    def _replay(self, where: int) -> None:
        """Repeat the operations from the entry ``where`` on; entries of readings moved to a frame are dropped."""
        self._entries[where:] = [e for e in self._entries[where:] if e.rank is not _Rank.READING or e.steps]
        for entry in self._entries[where:]:
            entry.before, entry.encoder_state = self._ekf.snapshot(), self._encoders.snapshot()
            self._ekf.predict_to(entry.t_s)
            for step in entry.steps:
                if isinstance(step, _Reading):
                    self._replay_reading(step)
                else:
                    self._ekf.repeat(step)
            self._journal.measurements.clear()

    def _replay_reading(self, step: _Reading) -> None:
        note = self._encoders.read(step.sample)
        if note is not None and note != step.note:
            self._log(step.sample.t_s, note)
        step.note = note

    def _trim(self) -> None:
        """Discard entries beyond the horizon except the newest of them, which a late measurement may need."""
        now_s = self._ekf.time_s
        if now_s is None:
            return
        oldest_s = now_s - self._kept_s
        drop = max(0, len(self._entries) - self._max_entries)
        while drop + 1 < len(self._entries) and self._entries[drop + 1].t_s < oldest_s:
            drop += 1
        if drop:
            del self._entries[:drop]
            self._journal.release(self._entries[0].before.journal)


class _EntryScope:
    """Context manager that records the operations inside it as one entry, unless they raise.

    A class instead of a generator, since it is entered a dozen times per epoch and costs half as much.
    """

    __slots__ = ("_entry", "_rank", "_station", "_t_s", "_trims", "_where", "_window")

    def __init__(
        self,
        window: LateMeasurementBuffer,
        where: int,
        t_s: float,
        rank: _Rank,
        station: str | None,
        *,
        trims: bool = False,
    ) -> None:
        self._window, self._where, self._trims = window, where, trims
        self._t_s, self._rank, self._station = t_s, rank, station
        self._entry: _Entry

    def __enter__(self) -> None:
        self._entry = self._window.begin(self._t_s, self._rank, self._station)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._window.end(self._where, self._entry, trims=self._trims)
