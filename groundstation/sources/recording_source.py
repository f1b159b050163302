"""A recording as a source: the recorded events in the same order, with the recorded pixels.

A frame's pixels follow its head in the file, since they depend on the detection; so events are held here until the
frames before them are complete. A frame without recorded pixels is counted and not yielded.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from types import TracebackType

import numpy as np

from groundstation.errors import RecordingError, SessionError
from groundstation.files.image_header import MAX_PICTURE_PX
from groundstation.files.read_budget import ReadBudget
from groundstation.messages import Epoch, Event, Frame, PixelMeasurement, ReferenceFix
from groundstation.picture import PartialPicture, PicturePart
from groundstation.recording.event_codec import (
    DroppedNote,
    FrameHeader,
    LostNote,
    Note,
    NumberedEvent,
    PixelsNote,
    parse_line,
    part_inside,
)
from groundstation.recording.image_codec import decode_image
from groundstation.recording.mcap_metadata import EVENTS_TOPIC, STATES_TOPIC, TRACK_TOPIC
from groundstation.recording.mcap_reader import McapMessage, McapReader
from groundstation.session import Session
from groundstation.session.folder import RecordingInfo
from groundstation.sources.asked_span import asked_span
from groundstation.sources.recorrection import Recorrection

# PTU readings from this long before the part asked for to this long after it, so that all angles are known
LEAD_S = 1.0
# limit of events that wait for a frame's pixels: more than any recorder leaves
_MAX_WAITING = 100_000
_MAX_WAITING_BYTES = 128 * 2**20


@dataclass(slots=True, kw_only=True)
class MissingData:
    """MissingData data of a recording: number of frames without pixels, of events, and the first epoch affected."""

    frames: int = 0
    events: int = 0
    first_epoch: int | None = None

    def __bool__(self) -> bool:
        return bool(self.frames or self.events)


@dataclass(slots=True, kw_only=True, eq=False)
class _Waiting:
    """An event that is held back; a frame until its pixels are complete."""

    number: int
    event: Event | FrameHeader
    note: PixelsNote | None = None
    pictures: list[bytes] = field(default_factory=list)
    missing: bool = False

    @property
    def ready(self) -> bool:
        """Whether nothing more is to come for it."""
        if not isinstance(self.event, FrameHeader) or self.missing:
            return True
        return self.note is not None and len(self.pictures) == len(self.note.parts)


class RecordingSource:
    """Events of one recording, or of the part of it between two session times.

    A context manager; iterate it once. ``epoch_count`` and ``span_s`` (first and last epoch) are known on entry,
    ``missing`` at the end. A fault of the file is raised after all intact events before it.

    Parameters
    ----------
    session : with ``recorded``.
    on_output : called with each recorded output of an epoch or a heartbeat, a line of JSON.
    reference : makes the position of a reference receiver by the session's rig of a recorded one, if they differ.
    """

    def __init__(
        self,
        session: Session,
        recorded: RecordingInfo,
        from_s: float | None = None,
        to_s: float | None = None,
        *,
        on_output: Callable[[bytes], None] = lambda line: None,
        reference: Callable[[ReferenceFix], ReferenceFix] | None = None,
    ) -> None:
        self.epoch_count = 0
        self.span_s = (0.0, 0.0)
        self.missing = MissingData()
        self._session = session
        self._recorded = recorded
        self._from = -np.inf if from_s is None else from_s
        self._to = np.inf if to_s is None else to_s
        self._on_output = on_output
        # without another rig an early recording is replayed as it was flown
        before = recorded.rig if recorded.rig_replaced else session.rig
        self._recorrection = Recorrection(before, session.rig, session.applied_axes, reference)
        self._sizes = {s.name: s.lens.image_size_px for s in session.rig.stations}
        self._open = ExitStack()
        self._reader: McapReader
        self._line: _EventReassembly

    def __enter__(self) -> "RecordingSource":
        with ExitStack() as opened:
            self._reader = opened.enter_context(McapReader(self._recorded.path))
            self._count_epochs()
            self._open = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def __iter__(self) -> Iterator[Event]:
        """Yield all events in the order in which they were recorded, then raise the fault of the file, if any."""
        budget = self._budget()
        queue = _EventReassembly(self._sizes, self.missing, budget)
        fault: RecordingError | None = None
        try:
            for message in self._reader.messages():
                if message.topic in (TRACK_TOPIC, STATES_TOPIC):
                    budget.line(len(message.data))
                    self._on_output(message.data)
                else:
                    queue.take(message)
                    yield from self._asked(queue.ready())
        except RecordingError as error:
            fault = error
        yield from self._asked(queue.rest())
        if fault is not None:
            raise fault

    def _asked(self, events: Iterator[Event]) -> Iterator[Event]:
        """Yield the events in the requested time span, by the clocks and axes of the session's rig."""
        for event in self._recorrection.of(events) if self._recorrection.is_needed else events:
            lead = 0.0 if isinstance(event, Frame | PixelMeasurement | Epoch) else LEAD_S
            if self._from - lead <= event.t_s <= self._to + lead:
                yield event

    def _count_epochs(self) -> None:
        """Set the number of epochs, the first and the last; counts them if the file has no closing record."""
        known = self._recorded
        if known.epochs and known.span_s is not None and self._from == -np.inf and self._to == np.inf:
            self.epoch_count, self.span_s = known.epochs, known.span_s
            return
        times: list[float] = []
        there_s = (np.inf, -np.inf)
        fault: RecordingError | None = None
        budget = self._budget()
        try:
            for message in self._reader.messages():
                if message.topic == EVENTS_TOPIC and b'"kind":"epoch"' in message.data:
                    budget.line(len(message.data))
                    parsed = parse_line(message.data, self._sizes, self._reader.path.name)
                    if isinstance(parsed, NumberedEvent):
                        there_s = (min(there_s[0], parsed.event.t_s), max(there_s[1], parsed.event.t_s))
                        if self._from <= parsed.event.t_s <= self._to:
                            times.append(parsed.event.t_s)
        except RecordingError as error:
            # raised again at the end of the events; those before it can be used
            fault = error
        if not times and fault is not None:
            raise fault
        if not times:
            some = there_s[0] <= there_s[1]
            got = f"times from {there_s[0]:.13g} to {there_s[1]:.13g} s" if some else "no pair of pictures"
            wanted = f"some {asked_span(self._from, self._to)}" if some else "at least one"
            raise SessionError(self._session.name, got=got, wanted=wanted)
        self.epoch_count, self.span_s = len(times), (min(times), max(times))

    def _budget(self) -> ReadBudget:
        """Return the limits of reading the file once."""
        return ReadBudget(self._reader.path.name, self._reader.path.stat().st_size)


class _EventReassembly:
    """The events in their order, each leaving when it is whole and all before it have left."""

    def __init__(self, sizes_px: dict[str, tuple[int, int]], missing: MissingData, budget: ReadBudget) -> None:
        self._sizes = sizes_px
        self._missing = missing
        self._budget = budget
        self._where = budget.where
        self._line: deque[_Waiting] = deque()
        self._frames: dict[int, _Waiting] = {}
        self._arriving: _Waiting | None = None
        self._next = 0
        self._bytes = 0
        self._touched = False

    def take(self, message: McapMessage) -> None:
        """Take one message of the file; those of others are passed over. Raises `RecordingError`."""
        if message.topic == EVENTS_TOPIC:
            self._budget.line(len(message.data))
            parsed = parse_line(message.data, self._sizes, self._where)
            if isinstance(parsed, NumberedEvent):
                self._enter(parsed)
            else:
                self._note(parsed)
        elif self._arriving is not None and message.topic.startswith("/stations/"):
            self._picture(self._arriving, message)

    def ready(self) -> Iterator[Event]:
        """Yield the events whose turn has come."""
        while self._line and (self._line[0].ready or self._crowded()):
            yield from self._leave(self._line.popleft())

    def rest(self) -> Iterator[Event]:
        """Yield what still waits: nothing more will come."""
        while self._line:
            yield from self._leave(self._line.popleft())

    def _crowded(self) -> bool:
        return len(self._line) > _MAX_WAITING or self._bytes > _MAX_WAITING_BYTES

    def _enter(self, numbered: NumberedEvent) -> None:
        if numbered.n < self._next:
            got, wanted = f"event {numbered.n} after event {self._next - 1}", "each once and in order"
            raise RecordingError(self._where, got=got, wanted=wanted)
        self._lost(numbered.n - self._next)
        self._next = numbered.n + 1
        waiting = _Waiting(number=numbered.n, event=numbered.event)
        self._line.append(waiting)
        if isinstance(numbered.event, FrameHeader):
            self._frames[numbered.n] = waiting

    def _note(self, note: Note) -> None:
        if isinstance(note, LostNote):
            # counted where the numbers jump
            return
        frame = self._frames.get(note.of)
        if frame is None or frame.note is not None:
            # its head was lost, or has left without it
            return
        if isinstance(note, DroppedNote):
            frame.missing = True
            return
        head = frame.event
        if not isinstance(head, FrameHeader) or not all(part_inside(part, head.size_px) for part in note.parts):
            got = f"parts of frame {note.of} outside its picture"
            raise RecordingError(self._where, got=got, wanted="parts inside it")
        pixels = sum(part.w * part.h for part in note.parts)
        if pixels > MAX_PICTURE_PX:
            got = f"parts of frame {note.of} with {pixels} pixels"
            raise RecordingError(self._where, got=got, wanted=f"at most {MAX_PICTURE_PX}")
        self._budget.decode(pixels)
        frame.note = note
        self._arriving = frame if note.parts else None

    def _picture(self, frame: _Waiting, message: McapMessage) -> None:
        """Put a picture to its frame; they stand in the order of the note, right behind it."""
        note, head = frame.note, frame.event
        if note is None or not isinstance(head, FrameHeader):
            return
        part = note.parts[len(frame.pictures)]
        topic = f"/stations/{head.station}/{part.topic}"
        if message.topic != topic or message.sequence != frame.number & 0xFFFFFFFF:
            return
        frame.pictures.append(message.data)
        self._bytes += len(message.data)
        if frame.ready:
            self._arriving = None

    def _lost(self, count: int) -> None:
        if count:
            self._missing.events += count
            self._touched = True

    def _leave(self, waiting: _Waiting) -> Iterator[Event]:
        """Yield the event, if it is whole."""
        event = waiting.event
        if not isinstance(event, FrameHeader):
            if isinstance(event, Epoch) and self._touched and self._missing.first_epoch is None:
                self._missing.first_epoch = event.epoch
            yield event
            return
        self._frames.pop(waiting.number, None)
        self._bytes -= sum(map(len, waiting.pictures))
        if waiting.missing or not waiting.ready or waiting.note is None:
            self._missing.frames += 1
            self._touched = True
            return
        yield Frame(
            t_s=event.t_s,
            station=event.station,
            epoch=event.epoch,
            image=_picture_of(event, waiting.note, waiting.pictures, f"{self._where}: frame {waiting.number}"),
        )


def _picture_of(head: FrameHeader, note: PixelsNote, pictures: list[bytes], where: str) -> PartialPicture:
    """Return the picture composed of the recorded parts."""
    parts = []
    for part, data in zip(note.parts, pictures, strict=True):
        png = not part.topic.endswith("/raw")
        pixels = decode_image(data, png=png, size_px=(part.w, part.h), colour=note.colour, where=where)
        parts.append(PicturePart(x=part.x, y=part.y, pixels=pixels))
    return PartialPicture(head.size_px, parts, head.pattern)
