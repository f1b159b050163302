"""When a recording is on its way: what a killed process and what a power cut may lose, by a clock of the test's own."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import RecordingError
from groundstation.messages import PtuSample
from groundstation.recording.mcap_metadata import EVENTS_TOPIC
from groundstation.recording.mcap_reader import McapReader
from groundstation.recording.recorder import Recorder, RecorderConfig
from tests.recording.recorded import events, header, looked_at, small_rig

LARGE = 10**9  # a chunk that is never full
CONFIG = RecorderConfig(chunk_bytes=LARGE, chunk_s=0.25, sync_s=0.5)


@dataclass
class Disk:
    """A recorder whose clock stands still but for `pass_time`, how often it was read, and how many bytes
    each fdatasync found in the file."""

    path: Path
    now_s: float = 100.0
    synced: list[int] = field(default_factory=list)
    clock_reads: int = 0

    def recorder(self, config: RecorderConfig) -> Recorder:
        return Recorder(self.path, small_rig(), header(), config, free_bytes=lambda: 10**12, clock=self.clock)

    def clock(self) -> float:
        self.clock_reads += 1
        return self.now_s

    def fdatasync(self, descriptor: int) -> None:
        self.synced.append(os.fstat(descriptor).st_size)

    def recorded_events(self) -> int:
        """How many events a reader finds in the file now."""
        found = 0
        try:
            with McapReader(self.path) as reader:
                for message in reader.messages():
                    found += message.topic == EVENTS_TOPIC
        except RecordingError:
            # it has not been closed
            pass
        return found


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Disk:
    made = Disk(tmp_path / "flight.mcap")
    monkeypatch.setattr(os, "fdatasync", made.fdatasync)
    return made


def reading(k: int) -> PtuSample:
    return PtuSample(t_s=100.0 + 0.01 * k, station="left", pan_rad=0.1, tilt_rad=0.2)


def until(condition: Callable[[], bool]) -> bool:
    """Wait for the writer's thread; only a fault lets the time run out."""
    end_s = time.monotonic() + 20.0
    while not condition():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.001)
    return True


def taken_by_the_writer(recorder: Recorder) -> bool:
    return until(lambda: recorder.status.fill == 0.0)


def test_a_chunk_is_closed_when_it_is_old(disk: Disk) -> None:
    """Expected: events that fill no chunk are in the file a quarter of a second later, by the recorder's clock."""
    recorder = disk.recorder(CONFIG)
    for k in range(5):
        recorder.take(reading(k))
    assert taken_by_the_writer(recorder)
    disk.now_s += 0.24
    recorder.take(reading(5))
    assert taken_by_the_writer(recorder)
    assert disk.recorded_events() == 0
    disk.now_s += 0.02
    assert until(lambda: disk.recorded_events() == 6)
    # and the next one is as old only after as long again
    recorder.take(reading(6))
    disk.now_s += 0.24
    assert taken_by_the_writer(recorder)
    assert disk.recorded_events() == 6
    disk.now_s += 0.02
    assert until(lambda: disk.recorded_events() == 7)
    recorder.close()


def test_a_chunk_is_closed_when_it_is_full(disk: Disk) -> None:
    """Expected: where the clock stands still, all but what one chunk may hold."""
    recorder = disk.recorder(RecorderConfig(chunk_bytes=2000, chunk_s=1e9, sync_s=1e9))
    for k in range(200):
        recorder.take(reading(k))
    assert until(lambda: disk.recorded_events() > 150)
    assert disk.recorded_events() < 200
    recorder.close()
    assert disk.recorded_events() == 200


def test_what_is_written_is_brought_onto_the_disk_itself(disk: Disk) -> None:
    """Expected: half a second after the last time, also where nothing has come since, and not again for nothing."""
    recorder = disk.recorder(CONFIG)
    recorder.take(reading(0))
    assert taken_by_the_writer(recorder)
    disk.now_s += 0.3
    assert until(lambda: disk.recorded_events() == 1)
    assert disk.synced == []
    disk.now_s += 0.21
    assert until(lambda: disk.synced == [disk.path.stat().st_size])
    disk.now_s += 10.0
    seen = disk.clock_reads
    assert until(lambda: disk.clock_reads > seen + 6)
    assert len(disk.synced) == 1
    recorder.take(reading(1))
    assert taken_by_the_writer(recorder)
    disk.now_s += 0.6
    assert until(lambda: disk.recorded_events() == 2)
    assert until(lambda: disk.synced[1:] == [disk.path.stat().st_size])
    recorder.close()


def test_a_closed_recording_is_on_the_disk_to_its_last_byte(disk: Disk) -> None:
    """Expected: index and closing magic too, which come after the last chunk."""
    recorder = disk.recorder(CONFIG)
    for event in recorder.taken(events(3, np.random.default_rng(1))):
        recorder.write(looked_at(event))
    recorder.close()
    assert disk.synced[-1] == disk.path.stat().st_size
    assert disk.path.read_bytes().endswith(b"\x89MCAP0\r\n")


def test_the_files_name_is_on_the_disk_from_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the folder is synced once the file is there, or a power cut loses the file's name."""
    synced, sync = [], os.fsync

    def fsync(descriptor: int) -> None:
        place = Path(f"/proc/self/fd/{descriptor}").readlink()
        synced.append((place, sorted(p.name for p in place.iterdir())))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    Disk(tmp_path / "flight.mcap").recorder(CONFIG).close()
    assert synced == [(tmp_path, ["flight.mcap"])]
