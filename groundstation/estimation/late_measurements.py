"""Late measurements fused where they belong: back to just before them, and everything after them again.

The window keeps, for `horizon_s` back from the filter's time, each reading, frame and decision with the filter as it
was before it. A measurement that comes late but inside the horizon is put in its place: the filter goes back, takes
it, and takes everything after it once more, each pixel and reading judged anew by the gates. What comes out is the
filter that got everything in order. Beyond the horizon a measurement is refused.

What goes back is the filter and the judge of the readings (`EncoderFeed`): a suspect reading is settled by the next one
in order of stamps, whatever came first. What does not: the detector, which does not look again at pictures that are
gone, and decisions: when a target was begun or given up.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum

from groundstation.estimation.encoders import EncoderFeed, EncoderState
from groundstation.estimation.recorded_ekf import FilterStep, RecordedEkf, RecordedState, StartStep
from groundstation.messages import PtuSample

# for the stamp of a pair, which lies before its second exposure, a little is kept in any case
_LEAST_KEPT_S = 0.2


class _Rank(IntEnum):
    """What goes first at one instant."""

    READING = 0
    FRAME = 1
    DECISION = 2


@dataclass(slots=True)
class _Reading:
    """A reading that was handed to the judge, and the line for the log that came of it."""

    sample: PtuSample
    note: str | None


_Step = FilterStep | _Reading


@dataclass(slots=True)
class _Entry:
    """What was done at one instant, and filter and judge as they were before it; ``station`` is None for a decision."""

    t_s: float
    rank: _Rank
    station: str | None
    before: RecordedState
    judge: EncoderState
    steps: list[_Step]


class LateMeasurementBuffer:
    """The recent past of one filter.

    Parameters
    ----------
    ekf, encoders : the filter and the judge of its readings.
    stations : names in the rig's order, which is that of frames with one stamp.
    horizon_s : how late a measurement may come; 0 refuses all that is late.
    max_entries : and no more instants than this are kept, however short the time that they cover.
    max_gap_s : a reading further than this behind a frame is not taken at the frame's time (as in `Synchroniser`).
    say : takes lines for the log: time in s, text.
    """

    def __init__(
        self,
        ekf: RecordedEkf,
        encoders: EncoderFeed,
        *,
        stations: tuple[str, ...],
        horizon_s: float,
        max_entries: int,
        max_gap_s: float,
        say: Callable[[float, str], None],
    ) -> None:
        self._ekf = ekf
        self._encoders = encoders
        self._stations = stations
        self._horizon_s = horizon_s
        self._kept_s = max(horizon_s, _LEAST_KEPT_S)
        self._max_entries = max_entries
        self._max_gap_s = max_gap_s
        self._say = say
        self._entries: list[_Entry] = []

    def __len__(self) -> int:
        return len(self._entries)

    # ------------------------------------------------------------------------------------- in order
    def reading(self, t_s: float, station: str) -> "_Noting":
        """What is done inside belongs to a reading of ``station`` at ``t_s``."""
        return _Noting(self, len(self._entries), t_s, _Rank.READING, station, trims=True)

    def frame(self, t_s: float, station: str) -> "_Noting":
        """What is done inside belongs to a frame of ``station`` at ``t_s``."""
        return _Noting(self, len(self._entries), t_s, _Rank.FRAME, station, trims=True)

    @contextmanager
    def decision(self) -> Iterator[None]:
        """What is done inside was decided at the filter's time: to begin a target, to drop it."""
        if self._ekf.time_s is None:
            yield
            return
        with _Noting(self, len(self._entries), self._ekf.time_s, _Rank.DECISION, None):
            yield
        if not self._entries[-1].steps:
            self._entries.pop()

    def read(self, sample: PtuSample) -> None:
        """Hand a reading to the judge, at or before its time."""
        note = self._encoders.read(sample)
        self._ekf.steps.append(_Reading(sample, note))
        if note is not None:
            self._say(sample.t_s, note)

    # ----------------------------------------------------------------------------------------- late
    def reaches(self, t_s: float) -> bool:
        """Return whether something of ``t_s`` can still be put in its place."""
        if self._horizon_s == 0.0 or not self._entries or self._ekf.time_s is None:
            return False
        if t_s < self._ekf.time_s - self._horizon_s:
            return False
        oldest = self._entries[0].before.time_s
        return oldest is None or oldest <= t_s

    @contextmanager
    def late_frame(self, t_s: float, station: str) -> Iterator[None]:
        """Inside, the filter is as it was before ``t_s``; afterwards everything later is done again."""
        where = bisect_left(self._entries, self._place(t_s, _Rank.FRAME, station), key=self._place_of)
        self._go_back(where)
        with _Noting(self, where, t_s, _Rank.FRAME, station):
            yield
        self._again(where + 1)

    @contextmanager
    def late_decision(self, t_s: float) -> Iterator[None]:
        """As `late_frame`, for what was to be decided at ``t_s``: to learn from a reference position."""
        where = bisect_left(self._entries, self._place(t_s, _Rank.DECISION, None), key=self._place_of)
        self._go_back(where)
        with _Noting(self, where, t_s, _Rank.DECISION, None):
            yield
        self._again(where + 1)

    def late_reading(self, sample: PtuSample, release: Callable[[PtuSample], bool]) -> None:
        """Put a reading in its place.

        A frame may so lose a reading that it had taken from the future: ``release`` is asked whether that one still
        waits for its own time, and lets it.
        """
        changed = self._assign(sample, release)
        self._go_back(changed)
        self._again(changed)

    def claim_following(self, station: str, t_s: float) -> PtuSample | None:
        """Return the reading that a late frame takes at its own time, as it would have in order, and take it away.

        That is the station's next one, unless an earlier frame has it or one has the frame's very stamp.
        """
        if any(s.t_s == t_s for s in self._readings(station)):
            return None
        for entry in self._entries:
            for step in entry.steps:
                if isinstance(step, _Reading) and step.sample.station == station and step.sample.t_s > t_s:
                    if entry.t_s <= t_s or step.sample.t_s - t_s > self._max_gap_s:
                        return None
                    entry.steps.remove(step)
                    return step.sample
        return None

    def has_reading_after(self, station: str, t_s: float) -> bool:
        """Return whether a later reading of a station has been passed on already."""
        return any(sample.t_s > t_s for sample in self._readings(station))

    def _readings(self, station: str) -> list[PtuSample]:
        return [
            step.sample
            for entry in self._entries
            for step in entry.steps
            if isinstance(step, _Reading) and step.sample.station == station
        ]

    def completes(self, sample: PtuSample) -> bool:
        """Return whether a reading that comes in time is the next after a frame that could not wait for it."""
        return self.reaches(sample.t_s) and self._frame_for(sample) is not None

    def _frame_for(self, sample: PtuSample) -> int | None:
        """Return the index of the first frame of the station after which this reading is the next."""
        near_s = sample.t_s - self._max_gap_s
        previous_s = near_s
        frames: list[int] = []
        for k in range(len(self._entries) - 1, -1, -1):
            entry = self._entries[k]
            # a frame as far back again may hold the reading before this one
            if entry.t_s < near_s - self._max_gap_s:
                break
            if entry.station != sample.station:
                continue
            if not frames and entry.rank is _Rank.READING and entry.t_s <= sample.t_s:
                # as nearly always: no frame since the reading before
                return None
            if entry.rank is _Rank.FRAME and entry.t_s < sample.t_s:
                frames.append(k)
            for step in entry.steps:
                if isinstance(step, _Reading) and step.sample.t_s <= sample.t_s:
                    previous_s = max(previous_s, step.sample.t_s)
            if entry.rank is _Rank.READING and entry.t_s <= sample.t_s:
                break
        return next((k for k in reversed(frames) if self._entries[k].t_s > previous_s), None)

    def _assign(self, sample: PtuSample, release: Callable[[PtuSample], bool]) -> int:
        """Give a reading to the first frame that it follows, else an entry of its own; return the first that changes.

        These are the rules of `Synchroniser`, applied to what has been passed on.
        """
        station, t_s = sample.station, sample.t_s
        k = self._frame_for(sample)
        if k is not None:
            steps = self._entries[k].steps
            own = next((s for s in steps if isinstance(s, _Reading)), None)
            if own is None:
                # before the pixel, after a start that was due
                steps.insert(sum(isinstance(s, StartStep) for s in steps), _Reading(sample, None))
            else:
                steps[steps.index(own)] = _Reading(sample, None)
                self._assign(own.sample, release)
            return k
        self._let_go_at(sample, release)
        if release(sample):
            return len(self._entries)
        where = bisect_left(self._entries, self._place(t_s, _Rank.READING, station), key=self._place_of)
        # its own state before it is set when it is done
        after = self._entries[where] if where < len(self._entries) else None
        before = self._ekf.snapshot() if after is None else after.before
        judge = self._encoders.snapshot() if after is None else after.judge
        self._entries.insert(where, _Entry(t_s, _Rank.READING, station, before, judge, [_Reading(sample, None)]))
        return where

    def _let_go_at(self, sample: PtuSample, release: Callable[[PtuSample], bool]) -> None:
        """Take the next reading away from a frame that turns out to have one at its very stamp."""
        for entry in self._entries:
            if entry.rank is _Rank.FRAME and entry.station == sample.station and entry.t_s == sample.t_s:
                own = next((s for s in entry.steps if isinstance(s, _Reading)), None)
                if own is not None:
                    entry.steps.remove(own)
                    self._assign(own.sample, release)

    # ------------------------------------------------------------------------------------ mechanism
    def begin(self, t_s: float, rank: _Rank, station: str | None) -> "_Entry":
        """Return an entry for what is done from now on."""
        self._ekf.steps.clear()
        return _Entry(t_s, rank, station, self._ekf.snapshot(), self._encoders.snapshot(), [])

    def end(self, where: int, entry: "_Entry", *, trims: bool) -> None:
        """Put in its place the entry of what has been done since it was begun."""
        entry.steps = self._ekf.steps  # type: ignore[assignment]  # the filter's own steps, and our readings
        self._ekf.steps = []
        self._entries.insert(where, entry)
        if trims:
            self._trim()

    def _place(self, t_s: float, rank: _Rank, station: str | None) -> tuple[float, int, int]:
        """Return what decides the order: the stamp; at one instant readings, frames in the rig's order, decisions."""
        return t_s, rank, 0 if station is None else self._stations.index(station)

    def _place_of(self, entry: _Entry) -> tuple[float, int, int]:
        return self._place(entry.t_s, entry.rank, entry.station)

    def _go_back(self, where: int) -> None:
        if where < len(self._entries):
            self._ekf.restore(self._entries[where].before)
            self._encoders.restore(self._entries[where].judge)

    def _again(self, where: int) -> None:
        """Do again what was done from the entry ``where`` on, but for readings that a frame has taken over."""
        self._entries[where:] = [e for e in self._entries[where:] if e.rank is not _Rank.READING or e.steps]
        for entry in self._entries[where:]:
            entry.before, entry.judge = self._ekf.snapshot(), self._encoders.snapshot()
            self._ekf.predict_to(entry.t_s)
            for step in entry.steps:
                if isinstance(step, _Reading):
                    self._judge_again(step)
                else:
                    step.apply(self._ekf)
            self._ekf.steps.clear()

    def _judge_again(self, step: _Reading) -> None:
        note = self._encoders.read(step.sample)
        if note is not None and note != step.note:
            self._say(step.sample.t_s, note)
        step.note = note

    def _trim(self) -> None:
        """Keep what a late measurement could still go back to: one entry beyond the horizon, too."""
        now_s = self._ekf.time_s
        if now_s is None:
            return
        oldest_s = now_s - self._kept_s
        drop = max(0, len(self._entries) - self._max_entries)
        while drop + 1 < len(self._entries) and self._entries[drop + 1].t_s < oldest_s:
            drop += 1
        if drop:
            del self._entries[:drop]
            self._ekf.tape.release(self._entries[0].before.mark)


class _Noting:
    """What is done inside becomes an entry of a window, unless it fails.

    A class and no generator: a dozen times for each pair of frames, half of what entering costs.
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
