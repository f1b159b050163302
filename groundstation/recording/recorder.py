"""The recorder: the pipeline's input events, in order, and its outputs, in a crash-safe file.

A separate thread writes the file; adding events and reports does not block. If the disk is too slow, pictures are first
written uncompressed, then dropped, the oldest first, with a note in the file; other records are dropped only if the
disk accepts nothing for minutes. Data reach the operating system within 0.25 s (the most that a killed process loses)
and the disk within another 0.5 s (the most that a power cut loses).
"""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from groundstation.errors import InputError
from groundstation.messages import Event, FilterReset, Frame, StepReport
from groundstation.recording.buffered_output import BufferedOutput, RawOutput, new_file
from groundstation.recording.data_rates import DataRateMeter
from groundstation.recording.event_codec import event_values
from groundstation.recording.mcap_metadata import RecordingHeader
from groundstation.recording.mcap_writer import McapWriter
from groundstation.recording.recorder_status import (
    PATIENT,
    RecorderConfig,
    RecorderState,
    RecorderStatus,
    left_to_recover,
)
from groundstation.recording.window_merging import merge_windows
from groundstation.recording.write_queue import EventItem, OutputItem, PixelsItem, WriteQueue
from groundstation.recording.writer_thread import WriterThread
from groundstation.rig.rig import Rig
from groundstation.thread_scheduling import give_way

_PATIENT_FILL = 0.5
_PATIENT_S = 0.005

__all__ = ["PATIENT", "Recorder", "RecorderConfig", "RecorderState", "RecorderStatus"]


class Recorder:
    """A sink of events and reports: each event is added before the pipeline step, each report after it.

    Parameters
    ----------
    path : a file that does not exist yet, .mcap.
    whole_frames : record every picture in full, whichever parts of it are read; for conversion.
    output, free_bytes, clock : replacements of the file, the disk's free space and the time, for tests.

    Raises `InputError` if the file cannot be created. Later faults are reported in `status`, not raised.
    """

    def __init__(
        self,
        path: Path,
        rig: Rig,
        header: RecordingHeader,
        config: RecorderConfig | None = None,
        *,
        whole_frames: bool = False,
        output: RawOutput | None = None,
        free_bytes: Callable[[], int] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        config = RecorderConfig() if config is None else config
        self._config = config
        self._path = path
        self._whole_frames = whole_frames
        raw = new_file(path) if output is None else output
        self._output = BufferedOutput(raw)
        try:
            self._messages = McapWriter(self._output, rig, header, config.chunk_bytes)
        except InputError:
            # nothing has been recorded: an empty file would block the next attempt
            raw.close()
            path.unlink(missing_ok=True)
            raise
        self._queue = WriteQueue(max_picture_bytes=config.queue_picture_bytes, max_items=config.queue_items)
        self._free_bytes = free_bytes if free_bytes is not None else lambda: _free_bytes(path.parent)
        self._clock = clock
        self._number = 0
        self._unseen: dict[tuple[str, int], deque[tuple[int, Frame]]] = {}
        self._state, self._reason = RecorderState.RECORDING, ""
        self._free: int | None = None
        self._rates = DataRateMeter()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # ------------------------------------------------------------------------------ the pipeline's side
    @property
    def status(self) -> RecorderStatus:
        """State of the recording."""
        pictures, records, events = self._queue.counts()
        return RecorderStatus(
            state=self._state,
            reason=self._reason,
            written_bytes=self._output.written_bytes,
            fill=self._queue.fill(),
            pictures_dropped=pictures,
            records_lost=records,
            events_lost=events,
            free_bytes=self._free,
            rates=self._rates.rates,
        )

    def take(self, event: Event) -> None:
        """Record an event; the pixels of a frame are recorded when the report on it arrives.

        Raises `InputError` only with ``patient``, if the disk accepts no data.
        """
        if self._config.patient:
            self._wait()
        number = self._number
        self._number += 1
        self._queue.put(EventItem(n=number, t_s=float(event.t_s), values=event_values(number, event)))
        if isinstance(event, FilterReset):
            # no report on the frames held until now will follow
            self._put_unseen()
        if not isinstance(event, Frame):
            return
        if self._whole_frames:
            self._put_pixels(number, event, whole=True)
        else:
            self._unseen.setdefault((event.station, event.epoch), deque()).append((number, event))

    def taken(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, each one recorded first."""
        for event in events:
            self.take(event)
            yield event

    def write(self, report: StepReport) -> None:
        """Record the output of one step, and the parts of its frames that were read."""
        for camera in report.cameras:
            waiting = self._unseen.get((camera.station, camera.epoch))
            if waiting:
                number, frame = waiting.popleft()
                if not waiting:
                    del self._unseen[camera.station, camera.epoch]
                self._put_pixels(number, frame, whole=frame.image.whole_read)
            self._queue.put(OutputItem(content=replace(camera, image=None)))
        for estimate in report.estimates:
            self._queue.put(OutputItem(content=estimate))
        for state in report.states:
            self._queue.put(OutputItem(content=state))
        for event in report.events:
            self._queue.put(OutputItem(content=event))

    def attach(self, name: str, data: bytes) -> None:
        """Attach a file after the start, such as the DGPS log of a flight."""
        self._queue.put(OutputItem(content=(name, data)))

    def close(self) -> None:
        """Write all queued records and close the file; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self._put_unseen()
        self._queue.close()
        self._thread.join(self._config.close_s)
        if self._thread.is_alive():
            self._state = RecorderState.FAILED
            self._reason = "the disk did not answer at the end" + left_to_recover(self._output.written_bytes)

    def abandon(self) -> None:
        """Close without waiting for the disk, and delete the file."""
        self._queue.abandoned = True
        self.close()
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _wait(self) -> None:
        """Wait while the queue is nearly full; raises `InputError` if the recording has failed."""
        while self._state is RecorderState.RECORDING and self._queue.fill() > _PATIENT_FILL:
            time.sleep(_PATIENT_S)
        if self._state is not RecorderState.RECORDING:
            raise InputError(str(self._path), got=self._reason, wanted="a disk with space for the recording")

    def _put_unseen(self) -> None:
        """Queue the parts read of the frames for which no report will follow."""
        for waiting in self._unseen.values():
            for number, frame in waiting:
                self._put_pixels(number, frame, whole=frame.image.whole_read)
        self._unseen.clear()

    def _put_pixels(self, number: int, frame: Frame, *, whole: bool) -> None:
        """Queue the recorded parts of a frame; windows are copied, which releases the picture's memory."""
        image = frame.image
        item = PixelsItem(of=number, station=frame.station, t_s=frame.t_s, pattern=image.pattern, source=None)
        if self._queue.refuse_pictures and (whole or image.read):
            self._queue.drop_picture(item, self._queue.refuse_pictures)
        elif whole:
            channels = 1 if image.pattern is not None else 3
            item.source, item.size_bytes = image, channels * image.size_px[0] * image.size_px[1]
        else:
            kept = [image.recordable(window) for window in merge_windows(image.read)]
            item.source, item.size_bytes = kept, sum(part.pixels.nbytes for part in kept)
        self._queue.put(item)

    # ------------------------------------------------------------------------------- the writer's side
    def _work(self) -> None:
        give_way()
        try:
            WriterThread(
                self._queue,
                self._output,
                self._messages,
                self._config,
                self._measure_free_space,
                self._clock,
                self._set_state,
                self._rates,
            ).run()
        except Exception as fault:  # noqa: BLE001 - whatever happens to the recording, the flight goes on
            self._set_state(RecorderState.FAILED, f"{type(fault).__name__}: {fault}")
            self._queue.refuse_pictures = "failed"
        finally:
            self._output.close()
            if self._state is RecorderState.FAILED and not self._output.written_bytes:
                # an empty file would be taken for a recording, and block the next one of its name
                self._remove_empty()

    def _remove_empty(self) -> None:
        with suppress(OSError):
            if self._path.stat().st_size == 0:
                self._path.unlink()

    def _measure_free_space(self) -> int:
        """Return the free space of the disk in bytes, and store it for the status."""
        try:
            self._free = self._free_bytes()
        except OSError:
            self._free = None
            raise
        return self._free

    def _set_state(self, state: RecorderState, reason: str) -> None:
        self._state, self._reason = state, reason


def _free_bytes(folder: Path) -> int:
    """Return the space in bytes that is free for this user on a folder's disk."""
    space = os.statvfs(folder)
    return space.f_bavail * space.f_frsize
