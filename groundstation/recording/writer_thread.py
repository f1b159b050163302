"""The recorder's thread: writes the queue to the file and retries after disk faults."""

import time
from collections.abc import Callable

from groundstation.errors import os_words
from groundstation.messages import TrackEstimate
from groundstation.recording.buffered_output import BufferedOutput
from groundstation.recording.data_rates import DataRateMeter
from groundstation.recording.mcap_writer import McapWriter
from groundstation.recording.recorder_status import RecorderConfig, RecorderState, left_to_recover
from groundstation.recording.write_queue import OutputItem, WriteQueue

# between measurements of the disk's free space
_MEASURE_S = 1.0


class WriterThread:
    """Runs in the recorder's thread; ``set_state`` is called with each new state and its reason."""

    def __init__(
        self,
        queue: WriteQueue,
        output: BufferedOutput,
        messages: McapWriter,
        config: RecorderConfig,
        free_bytes: Callable[[], int],
        clock: Callable[[], float],
        set_state: Callable[[RecorderState, str], None],
        rates: DataRateMeter,
    ) -> None:
        self._queue = queue
        self._output = output
        self._messages = messages
        self._config = config
        self._free_bytes = free_bytes
        self._clock = clock
        self._set_state = set_state
        self._rates = rates
        self._flushed_s = self._synced_s = clock()
        self._looked_s = -1e9
        self._give_up_s: float | None = None
        self._refused = ""

    def run(self) -> None:
        """Write until the queue is drained, then write the index."""
        while True:
            if not self._may_write():
                if self._out_of_time():
                    self._fail()
                    return
                time.sleep(self._config.retry_s)
                continue
            item = self._queue.take(self._config.chunk_s / 4)
            for first, last in self._queue.take_lost():
                self._messages.note_lost(first, last)
            if item is not None:
                self._messages.put(item, png=self._queue.fill() < self._config.png_fill)
                if isinstance(item, OutputItem) and isinstance(item.content, TrackEstimate):
                    self._rates.add_estimate(item.content, self._output.tell())
            elif self._queue.drained:
                break
            self._flush()
        self._messages.finish()
        while not self._commit(sync=True):
            if self._out_of_time():
                self._fail()
                return
            time.sleep(self._config.retry_s)
        self._set_state(RecorderState.CLOSED, "")

    def _fail(self) -> None:
        """Set the failed state with its reason and advice on recovery."""
        why = f"the disk accepted no data at the end ({self._refused})"
        self._set_state(RecorderState.FAILED, why + left_to_recover(self._output.written_bytes))

    def _out_of_time(self) -> bool:
        """Return whether the time limit for the disk on closing has passed."""
        if not self._queue.closed:
            return False
        if self._queue.abandoned:
            return True
        if self._give_up_s is None:
            limit_s = self._config.refused_close_s
            self._give_up_s = self._clock() + (0.5 * self._config.close_s if limit_s is None else limit_s)
        return self._clock() > self._give_up_s

    def _flush(self) -> None:
        """Close the chunk at its maximum age, and write complete chunks to the file."""
        now_s = self._clock()
        if now_s - self._flushed_s >= self._config.chunk_s:
            self._flushed_s = now_s
            self._messages.flush()
        # without further input the last data are synced as well
        sync = now_s - self._synced_s >= self._config.sync_s
        if (self._output.waiting_bytes or sync) and self._commit(sync=sync) and sync:
            self._synced_s = now_s

    def _may_write(self) -> bool:
        """Return whether the disk accepts data; measures its free space once a second."""
        now_s = self._clock()
        if now_s - self._looked_s >= _MEASURE_S or self._output.waiting_bytes:
            self._looked_s = now_s
            try:
                free = self._free_bytes()
            except OSError as fault:
                return self._refuse(f"the disk is gone ({os_words(fault)})")
            if free < self._config.stop_free_bytes:
                return self._refuse(f"disk full, {free / 1e6:.0f} MB free")
            if free < self._config.keep_free_bytes:
                self._queue.refuse_pictures = "disk nearly full"
                self._set_state(RecorderState.NO_PICTURES, f"disk nearly full, {free / 1e6:.0f} MB free")
            else:
                self._queue.refuse_pictures = ""
                self._set_state(RecorderState.RECORDING, "")
        return self._commit(sync=False) if self._output.waiting_bytes else True

    def _refuse(self, reason: str) -> bool:
        self._refused = reason
        self._queue.refuse_pictures = reason
        self._set_state(RecorderState.WAITING, reason)
        return False

    def _commit(self, *, sync: bool) -> bool:
        """Write all pending data to the file; on failure set the waiting state and retry later."""
        try:
            self._output.commit()
            if sync:
                self._output.sync()
        except OSError as fault:
            return self._refuse(f"the disk accepts no data ({os_words(fault)})")
        return True
