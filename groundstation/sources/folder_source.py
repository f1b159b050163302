"""A recorded session as time-ordered events.

Stamps are mapped to session time here, by the rig's and the session's clocks; all later stages use this one
clock. A fault of the recording is raised after all usable events before it have been yielded.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.messages import Epoch, Event, Frame
from groundstation.picture import BgrPicture
from groundstation.session import Session
from groundstation.session.time_units import unit_hint
from groundstation.sources.asked_span import asked_span
from groundstation.sources.camera_gaps import camera_notes
from groundstation.sources.external_detections import detection_events, read_detections, rowless_notes
from groundstation.sources.frame_angles_table import FrameAnglesTable
from groundstation.sources.frame_table import FrameTable, read_frames
from groundstation.sources.picture_reader import PictureReader
from groundstation.sources.ptu_readings import PtuReadings

__all__ = ["FolderSource", "FrameTable", "read_detections", "read_frames"]

# PTU rows from this long before the first frame to this long after the last are sent, so that all angles are known
LEAD_S = 1.0


class FolderSource:
    """Events of one session, or of the part of it between two session times.

    A context manager; iterate it once. ``epoch_count`` and ``span_s`` (first and last epoch) are known on entry.
    Entering raises `SessionError` if nothing can be replayed.
    """

    def __init__(self, session: Session, from_s: float | None = None, to_s: float | None = None) -> None:
        self.epoch_count = 0
        self.span_s = (0.0, 0.0)
        self._session = session
        self._from = -np.inf if from_s is None else from_s
        self._to = np.inf if to_s is None else to_s
        self._open = ExitStack()
        self._readings: PtuReadings
        self._fault: SessionError | None = None
        self._whole = False
        self._listed: dict[str, int] = {}
        self._readers: dict[str, PictureReader] = {}
        self._table: FrameTable | None = None
        self._angles: FrameAnglesTable
        self._angle_notes: list[str] = []
        self._labels: dict[str, FloatArray] = {}
        self._unseen: list[str] = []
        # stamps of the first and the last picture or pixel; an epoch's own stamp is a mean
        self._observed_span_s = (0.0, 0.0)
        # of the newest event that was handed out
        self._newest_s = -np.inf
        if not self._from < self._to:
            raise SessionError(
                session.name, got=f"a part {asked_span(self._from, self._to)}", wanted="a start before the end"
            )

    def __enter__(self) -> "FolderSource":
        self._readings = PtuReadings(self._session)
        self._angles = FrameAnglesTable(self._session)
        if self._session.media:
            self._enter_frames()
        else:
            self._enter_labels()
        self._readings.start(self._observed_span_s[0] - LEAD_S, self._observed_span_s[1] + LEAD_S)
        with ExitStack() as opened:
            if self._table is not None:
                self._start_decoders(opened, self._table)
            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._open.close()

    def notes(self, most_apart_s: float) -> list[str]:
        """Return what the tables lack: pictures of a camera, stretches without readings, frames that angles are of.

        Between readings further apart than ``most_apart_s`` nothing is interpolated. Where pictures end the recording
        early, readings after that were not asked for.
        """
        from_s, to_s = self._observed_span_s
        cameras = [] if self._table is None else camera_notes(self._table.stamps_s, self._newest_s)
        cameras += [f"{name}: no pixel in this part of detections.csv" for name in self._unseen]
        cameras += rowless_notes(self._labels, self._leader) if self._labels else []
        return cameras + self._readings.notes((from_s, min(to_s, self._newest_s)), most_apart_s) + self._angle_notes

    def unit_fault(self) -> str:
        """Return in which unit the readings' times are, where their spacing is that of another than seconds; or ""."""
        return self._readings.unit_fault()

    def __iter__(self) -> Iterator[Event]:
        """Yield all events in order of session time, then raise the fault of the recording, if any."""
        last = self._observed_span_s[0]
        for t_s, event in self._observation_events():
            yield from self._readings.until(t_s)
            if self._readings.ended_before(t_s):
                # frames after the fault have no angles; those before it are usable
                self._fault = self._readings.fault
                break
            last = self._newest_s = t_s
            yield event
        yield from self._readings.until(last + LEAD_S)
        fault = self._fault or self._readings.fault or self._angles.fault
        if fault is not None:
            raise fault

    def _observation_events(self) -> Iterator[tuple[float, Event]]:
        """Return the frames or pixels and the epochs, each with the time that orders it."""
        if self._table is not None:
            return self._frame_events(self._table)
        return detection_events(self._labels, self._leader)

    # ---------------------------------------------------------------------------------------- frames
    def _enter_frames(self) -> None:
        """Read frames.csv and select the requested rows."""
        table = read_frames(self._session)
        times = table.epoch_times()
        # rows without any stamp only count their frames
        timed = np.isfinite(times)
        beyond = bool(np.any(times[timed] > self._to))
        self._fault = None if beyond else table.fault
        self._check_range("frames.csv", times[timed])
        if table.fault is None:
            self._angle_notes = self._angles.notes(table.stamps_s)
        everything = table.fault is None and not np.isfinite(self._from) and not np.isfinite(self._to)
        self._whole = everything and bool(timed[-1])
        self._listed = {n: int(numbers.max()) + 1 for n, numbers in table.numbers.items()}
        chosen = timed & (times >= self._from) & (times <= self._to)
        self._table = table = table.rows(chosen)
        times = times[chosen]
        self.epoch_count = len(times)
        self.span_s = (float(times.min()), float(times.max()))
        stamps = np.array(list(table.stamps_s.values()))
        self._observed_span_s = (float(np.nanmin(stamps)), float(np.nanmax(stamps)))

    def _check_range(self, name: str, times: FloatArray) -> None:
        """Raise if the requested time span is empty."""
        if not np.any((times >= self._from) & (times <= self._to)):
            if self._fault is not None:
                raise self._fault
            there = f"times from {times.min():.13g} to {times.max():.13g} s" if len(times) else "no row with a time"
            if len(times) > 1:
                first, second = np.sort(times)[:2]
                there += unit_hint(float(first), float(second), max(self._from, 0.0), self._to)
            wanted = f"some {asked_span(self._from, self._to)}" if len(times) else "at least one"
            raise SessionError(f"{self._session.name}: {name}", got=there, wanted=wanted)

    def _start_decoders(self, opened: ExitStack, table: FrameTable) -> None:
        """Start one decoder for each station."""
        for station in self._session.rig.stations:
            there = np.isfinite(table.stamps_s[station.name])
            numbers = table.numbers[station.name]
            reader = PictureReader(
                self._session.media[station.name],
                numbers[there],
                table.line[there],
                station.lens.image_size_px,
                listed=self._listed[station.name],
                # a last frame without a stamp may or may not be in the video
                whole=self._whole and bool(there[-1] or numbers[-1] < 0),
            )
            self._readers[station.name] = opened.enter_context(reader)

    def _frame_events(self, table: FrameTable) -> Iterator[tuple[float, Event]]:
        """Yield frames, and each epoch after the last of its frames; stops at a fault."""
        names = self._session.rig.names
        epoch_times = table.epoch_times()
        # one column for each station's frames and one for the epochs, whose rank puts them last
        moments = np.column_stack([*(table.stamps_s[n] for n in names), table.last_times()])
        rows, ranks = np.nonzero(np.isfinite(moments))
        times = moments[rows, ranks]
        for k in np.lexsort((rows, ranks, times)):
            t, row, rank = float(times[k]), int(rows[k]), int(ranks[k])
            epoch = int(table.index[row])
            if rank == len(names):
                seen = tuple(n for n in names if np.isfinite(table.stamps_s[n][row]))
                yield t, Epoch(t_s=float(epoch_times[row]), epoch=epoch, stations=seen)
                continue
            try:
                picture = self._readers[names[rank]].next()
            except SessionError as fault:
                self._fault = fault
                return
            if picture is not None:
                angles = self._angles.of_frame(names[rank], t)
                if angles is not None:
                    yield t, angles
                yield t, Frame(t_s=t, station=names[rank], epoch=epoch, image=BgrPicture(picture.image))
        self._check_ends()

    def _check_ends(self) -> None:
        """Request one more picture of each decoder: a medium longer than its table is a fault."""
        for reader in self._readers.values():
            try:
                reader.next()
            except SessionError as fault:
                self._fault = self._fault or fault

    # ---------------------------------------------------------------------------------------- labels
    @property
    def _leader(self) -> str:
        """The first station listed that has pixels; its stamps are the epochs."""
        return next(n for n in self._session.rig.names if n in self._labels)

    def _enter_labels(self) -> None:
        """Read detections.csv and select the requested rows."""
        labels, self._fault = read_detections(self._session)
        self._check_range("detections.csv", np.concatenate([a[:, 0] for a in labels.values()]))
        within = {n: a[(a[:, 0] >= self._from) & (a[:, 0] <= self._to)] for n, a in labels.items()}
        self._labels = {n: a for n, a in within.items() if len(a)}
        self._unseen = [n for n in within if n not in self._labels]
        times = self._labels[self._leader][:, 0]
        self.epoch_count = len(times)
        self.span_s = (float(times[0]), float(times[-1]))
        self._observed_span_s = (
            min(float(a[0, 0]) for a in self._labels.values()),
            max(float(a[-1, 0]) for a in self._labels.values()),
        )
