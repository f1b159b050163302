"""The recorder on disks that are full, slow, or gone; and killed at random moments."""

import errno
import itertools
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import InputError
from groundstation.messages import Epoch, Frame
from groundstation.recording.recorder import Recorder, RecorderConfig, RecorderState
from groundstation.recording.recovery import recover
from groundstation.recording.write_queue import QueueItem, WriteQueue
from tests.recording.recorded import events, header, looked_at, played, same, small_rig

PLENTY = 10**12
QUICK = {"retry_s": 0.001, "chunk_s": 0.001, "close_s": 20.0}


class FaultyFile:
    """A real file that calls ``before`` with each write, and writes at most ``most`` bytes at once."""

    def __init__(self, path: Path, before: Callable[[], None], most: int = 1 << 30) -> None:
        self._file = path.open("xb", buffering=0)
        self._before = before
        self._most = most

    def write(self, data: memoryview, /) -> int | None:
        self._before()
        return self._file.write(data[: self._most])

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


def feed(recorder: Recorder, pairs: int, seed: int = 1) -> int:
    """Record a flight of so many pairs; returns how many events that were."""
    number = 0
    for event in recorder.taken(events(pairs, np.random.default_rng(seed))):
        recorder.write(looked_at(event))
        number += 1
    return number


def full(times: int) -> Callable[[], None]:
    """A disk that is full for so many writes."""
    left = [times]

    def before() -> None:
        left[0] -= 1
        if left[0] >= 0:
            raise OSError(errno.ENOSPC, "No space left on device")

    return before


def test_a_temporarily_full_disk_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    # besides, it takes only some bytes of each write
    file = FaultyFile(path, full(20), most=1000)
    config = RecorderConfig(chunk_bytes=4096, **QUICK)
    with Recorder(path, small_rig(), header(), config, output=file, free_bytes=lambda: PLENTY) as recorder:
        feed(recorder, 20)
    assert recorder.status.state is RecorderState.CLOSED
    back, source = played(path)
    given = list(events(20, np.random.default_rng(1)))
    if not recorder.status.pictures_dropped:
        assert all(same(one, other) for one, other in zip(given, back, strict=True))
    assert source.missing.events == 0
    assert source.missing.frames == recorder.status.pictures_dropped
    assert len(back) == len(given) - source.missing.frames


def test_a_disk_that_refuses_all_data_does_not_stop_the_flight(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    file = FaultyFile(path, full(10**9))
    config = RecorderConfig(queue_items=50, retry_s=0.001, close_s=0.2)
    recorder = Recorder(path, small_rig(), header(), config, output=file, free_bytes=lambda: PLENTY)
    number = feed(recorder, 60)
    recorder.close()
    status = recorder.status
    assert status.state is RecorderState.FAILED
    assert status.events_lost > 0
    assert status.records_lost >= status.events_lost
    assert status.events_lost <= number
    assert "the disk accepted no data" in status.line()
    # a file of no bytes is nothing that could be recovered, and would be taken for a recording
    assert status.written_bytes == 0
    assert not path.exists()
    assert "(the disk accepts no data (No space left on device)); nothing could be recorded, 0.0 MB" in status.line()
    assert "recover`" not in status.line()


def test_a_disk_that_is_full_from_some_byte_on_leaves_something_to_recover(tmp_path: Path) -> None:
    path, taken = tmp_path / "flight.mcap", [3]

    def before() -> None:
        taken[0] -= 1
        if taken[0] < 0:
            raise OSError(errno.ENOSPC, "No space left on device")

    config = RecorderConfig(chunk_bytes=4096, retry_s=0.001, chunk_s=0.001, close_s=0.2)
    with Recorder(
        path, small_rig(), header(), config, output=FaultyFile(path, before), free_bytes=lambda: PLENTY
    ) as recorder:
        feed(recorder, 20)
    assert 0 < recorder.status.written_bytes == path.stat().st_size
    assert "; see `recover`, " in recorder.status.line()


def test_while_the_disk_hangs_pictures_go_first_and_every_event_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    free = threading.Event()
    file = FaultyFile(path, lambda: free.wait(60.0) and None)
    config = RecorderConfig(chunk_bytes=4096, queue_picture_bytes=40_000, chunk_s=0.001)
    recorder = Recorder(path, small_rig(), header(), config, output=file, free_bytes=lambda: PLENTY)
    # nothing gets through meanwhile: were a step to wait for the disk, this would never end
    number = feed(recorder, 100)
    dropped = recorder.status.pictures_dropped
    assert dropped > 50
    assert recorder.status.records_lost == 0
    assert "pictures dropped" in recorder.status.line()
    free.set()
    recorder.close()
    assert recorder.status.state is RecorderState.CLOSED
    back, source = played(path)
    assert source.missing.events == 0
    assert source.missing.frames == recorder.status.pictures_dropped
    assert len(back) == number - source.missing.frames
    # the oldest went first: the newest pictures are there
    newest = [e for e in back if isinstance(e, Frame)][-2:]
    assert [e.epoch for e in newest] == [99, 99]


def test_events_that_are_lost_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    free = threading.Event()
    file = FaultyFile(path, lambda: free.wait(60.0) and None)
    config = RecorderConfig(chunk_bytes=4096, queue_items=100, chunk_s=0.001)
    recorder = Recorder(path, small_rig(), header(), config, output=file, free_bytes=lambda: PLENTY)
    number = feed(recorder, 100)
    lost = recorder.status.events_lost
    free.set()
    recorder.close()
    back, source = played(path)
    assert lost > 100
    assert source.missing.events == recorder.status.events_lost == lost
    assert len(back) + source.missing.frames + lost == number


def test_little_space_stops_pictures_first_then_everything(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    space = [PLENTY]
    seen: list[RecorderState] = []
    # no second passes between checks
    clock = itertools.count(0.0, 2.0)
    config = RecorderConfig(keep_free_bytes=1000, stop_free_bytes=100, retry_s=0.001, sync_s=1e12)
    recorder = Recorder(path, small_rig(), header(), config, free_bytes=lambda: space[0], clock=lambda: next(clock))
    looked = threading.Event()

    def settled(state: RecorderState) -> None:
        while recorder.status.state is not state:
            looked.wait(0.001)
        seen.append(recorder.status.state)

    feed(recorder, 10)
    space[0] = 500
    settled(RecorderState.NO_PICTURES)
    assert "disk nearly full" in recorder.status.line()
    before = recorder.status.pictures_dropped
    feed_again = list(events(5, np.random.default_rng(2)))
    for event in recorder.taken(feed_again):
        recorder.write(looked_at(event))
    assert recorder.status.pictures_dropped == before + 10
    space[0] = 50
    settled(RecorderState.WAITING)
    assert "disk full" in recorder.status.line()
    space[0] = PLENTY
    settled(RecorderState.RECORDING)
    recorder.close()
    back, source = played(path)
    assert source.missing.events == 0
    assert sum(isinstance(e, Epoch) for e in back) == 15


def test_a_recording_is_never_written_over(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(InputError, match="a file that exists"):
        Recorder(path, small_rig(), header())
    assert path.read_bytes() == b"precious"


def test_a_waiting_recorder_reports_that_the_disk_is_full(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    file = FaultyFile(path, full(10**9))
    config = RecorderConfig(patient=True, chunk_bytes=4096, retry_s=0.001, close_s=0.2)
    recorder = Recorder(path, small_rig(), header(), config, output=file, free_bytes=lambda: PLENTY)
    with pytest.raises(InputError, match="wanted a disk with space"):
        feed(recorder, 10_000)
    recorder.close()


CHILD = """
import sys, time
from pathlib import Path
import numpy as np
from groundstation.recording.recorder import Recorder, RecorderConfig
from tests.recording.recorded import events, header, looked_at, small_rig
config = RecorderConfig(chunk_bytes=2**15, chunk_s=0.05, sync_s=0.1)
recorder = Recorder(Path(sys.argv[1]), small_rig(), header(), config)
number = 0
for event in recorder.taken(events(10**6, np.random.default_rng(1))):
    recorder.write(looked_at(event))
    number += 1
    if number % 7 == 0:
        print(number, recorder.status.written_bytes, flush=True)
        time.sleep(0.005)
"""


@pytest.mark.parametrize("lines", [20, 45, 90])
def test_killed_at_any_moment_all_that_was_written_is_recovered(lines: int, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    # the first write is the header; then so many lines
    reported = [child.stdout.readline()]
    while int(reported[-1].split()[1]) < 10_000:
        reported.append(child.stdout.readline())
    reported += [child.stdout.readline() for _ in range(lines)]
    child.send_signal(signal.SIGKILL)
    child.stdout.close()
    child.wait()
    number, written = map(int, reported[-1].split())
    assert path.stat().st_size >= written
    done = recover(path)
    assert done.out is not None
    back, source = played(done.out)
    given = [e for e, _ in zip(events(10**6, np.random.default_rng(1)), range(len(back)), strict=False)]
    complete = len(back) - source.missing.frames
    assert all(same(one, other) for one, other in zip(given[:complete], back[:complete], strict=True))
    assert source.missing.events == 0
    # records reported as written are in the file, except for the chunk that was being written
    assert done.lost_bytes <= 2**15 + 20_000
    assert done.messages["/groundstation/events"] > len(back)
    assert path.stat().st_size - done.lost_bytes >= written - 2**15 - 20_000
    assert number > 0


def test_data_between_an_idle_moment_and_the_end_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a writer that found nothing, and then finds the queue closed, checks once more."""
    taken, idle, go_on = WriteQueue.take, threading.Event(), threading.Event()

    def held_up(queue: WriteQueue, timeout_s: float) -> QueueItem | None:
        item = taken(queue, timeout_s)
        if item is None and not idle.is_set():
            idle.set()
            assert go_on.wait(20.0)
        return item

    monkeypatch.setattr(WriteQueue, "take", held_up)
    path = tmp_path / "flight.mcap"
    recorder = Recorder(path, small_rig(), header(), RecorderConfig(**QUICK), free_bytes=lambda: PLENTY)
    assert idle.wait(20.0)
    feed(recorder, 5)
    closing = threading.Thread(target=recorder.close)
    closing.start()
    while not recorder._queue.closed:
        closing.join(0.001)
    go_on.set()
    closing.join()
    back, source = played(path)
    assert not source.missing
    assert all(same(one, other) for one, other in zip(events(5, np.random.default_rng(1)), back, strict=True))
