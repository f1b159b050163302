"""A Rerun recording as a file: whole under its name or not there, and given up where the disk takes no more.

Rerun's own file sink ends its thread on a full disk, and then waits for it for ever. Here Rerun writes into a pipe,
which always takes everything, and a thread of this module brings it to the disk.
"""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import rerun as rr

from groundstation.errors import InputError, SessionError, os_words
from groundstation.viewer.recording_draft import draft_of

_CHUNK_BYTES = 1 << 16


class RecordingFile:
    """Open a file for a recording stream, which must have no other sink; an older file is removed.

    Writing never fails: `fault` says why the file was given up, None as long as it was not.
    Raises `OSError` if the file cannot be made.
    """

    def __init__(self, path: Path, stream: rr.RecordingStream) -> None:
        self._path, self._stream = path, stream
        self._draft = draft_of(path)
        self.fault: str | None = None
        self._ended = False
        path.unlink(missing_ok=True)
        self._file = self._draft.open("wb", buffering=0)
        self._lock = threading.Lock()
        source, sink = os.pipe()
        self._thread = threading.Thread(target=self._drain, args=(source,), name="recording file", daemon=True)
        self._thread.start()
        try:
            stream.save(f"/dev/fd/{sink}")
        except BaseException:
            self.give_up("not opened")
            raise
        finally:
            os.close(sink)

    def give_up(self, reason: str) -> None:
        """Delete what is written, which frees its space, and write no more; the first reason stays."""
        with self._lock:
            self._give_up(reason)

    def close(self) -> None:
        """Bring everything to the disk and give the file its name; does nothing once it was given up or discarded."""
        if not self._end():
            return
        with self._lock:
            if self.fault is None:
                try:
                    os.fsync(self._file.fileno())
                    self._file.close()
                    self._draft.replace(self._path)
                except OSError as fault:
                    self._give_up(os_words(fault))

    def discard(self) -> None:
        """Delete the draft, unless it has been closed."""
        if not self._ended:
            self.give_up("interrupted")
            self._end()

    def _end(self) -> bool:
        """End the stream and wait until all of it has come through; returns False if that was done before."""
        if self._ended:
            return False
        self._ended = True
        self._stream.flush()
        self._stream.disconnect()
        self._thread.join()
        return True

    def _give_up(self, reason: str) -> None:
        if self.fault is None:
            self.fault = reason
            with suppress(OSError):
                self._file.close()
            with suppress(OSError):
                self._draft.unlink(missing_ok=True)

    def _drain(self, source: int) -> None:
        """Write to the disk what comes through the pipe, until its other end is closed."""
        with os.fdopen(source, "rb", buffering=0) as pipe:
            while data := pipe.read(_CHUNK_BYTES):
                with self._lock:
                    if self.fault is None:
                        self._write(data)

    def _write(self, data: bytes) -> None:
        try:
            done = 0
            while done < len(data):
                done += self._file.write(data[done:])
        except OSError as fault:
            self._give_up(os_words(fault))


@contextmanager
def written_recording(path: Path, application: str, name: str) -> Iterator[rr.RecordingStream]:
    """Yield a stream that is written to a file under its name ``name``; no clock but the session's is in it.

    Raises `InputError` if the file cannot be made or written; it is then not there.
    """
    stream = rr.RecordingStream(application, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    file = open_recording_file(path, stream)
    try:
        stream.send_recording_name(name)
        yield stream
        file.close()
    finally:
        file.discard()
    if file.fault is not None:
        raise InputError(str(path), got=file.fault, wanted="a file that can be written")


def open_recording_file(path: Path, stream: rr.RecordingStream) -> RecordingFile:
    """Open the file of a stream; raises `InputError` if it cannot be made."""
    try:
        return RecordingFile(path, stream)
    except (OSError, RuntimeError) as fault:
        got = os_words(fault)
        raise SessionError(str(path), got=got, wanted="a file that can be written") from fault
