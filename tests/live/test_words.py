"""The operator's display of the recording, the screen and the counts, in plain words; and where it is shown."""

import itertools
import math
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.live.camera_worker import CameraWorker
from groundstation.live.input_queue import InputQueue
from groundstation.live.record import LiveRecorder
from groundstation.live.status_watchdog import StatusWatchdog
from groundstation.messages import Epoch, TrackStatus
from groundstation.recording.data_rates import DataRateMeter
from groundstation.recording.recorder import RecorderConfig
from groundstation.simulation.standard_cases import standard_rig
from groundstation.sources.cameras.camera import (
    CameraDevice,
    CameraSupervision,
    CameraTiming,
    GrabbedFrame,
    SettingsReadBack,
)
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.tracking.config import Config
from groundstation.tracking.count_descriptions import describe_counts
from groundstation.tracking.pipeline import Pipeline
from groundstation.viewer.live_view import LiveView
from tests.recording.recorded import events, header, looked_at, small_rig


def test_the_recorder_reports_rate_and_free_disk(tmp_path: Path) -> None:
    """Expected: MB, MB/s, free GB and how long they last; in the end both rates."""
    path, now = tmp_path / "flight.mcap", [0.0]
    config = RecorderConfig(png_fill=0.0, keep_free_bytes=2 * 10**9, chunk_s=0.0)
    with LiveRecorder(path, small_rig(), header(), config, free_bytes=lambda: 82 * 10**9) as recorder:
        recorder._now = lambda: now[0]
        recorder.summary()
        for event in recorder.taken(events(120, np.random.default_rng(1))):
            recorder.write(looked_at(event))
        while recorder.status.fill > 0.0 or recorder.status.free_bytes is None:
            time.sleep(0.001)
        now[0] = 2.0
        words = recorder.summary()
    assert words.startswith("recording, ")
    assert "MB/s, disk 82.0 GB free, enough for " in words
    # nothing of these pictures is whole or tracked
    assert "MB/s while searching (4 s)" in recorder.written_summary()
    assert "tracking" not in recorder.written_summary()


def test_a_recorder_of_nothing_says_so_once(tmp_path: Path) -> None:
    """Expected: no rate, and no amount in the summary of the end, where the disk has taken nothing."""
    with LiveRecorder(
        tmp_path / "flight.mcap", small_rig(), header(), RecorderConfig(), free_bytes=lambda: 0
    ) as recorder:
        for _ in recorder.taken(events(3, np.random.default_rng(1))):
            pass
    assert recorder.status.written_bytes == 0
    assert recorder.summary().count("0.0 MB") == 1
    assert recorder.written_summary() == ""


def test_written_bytes_are_counted_by_the_tracks_status() -> None:
    answers = looked_at(Epoch(t_s=0.0, epoch=0, stations=())).estimates
    book = DataRateMeter()
    at = 0
    for k in range(401):
        tracking = 100 < k <= 300
        status = TrackStatus.TRACKING if tracking else TrackStatus.SEARCHING
        at += 100_000 if tracking else 2_000_000
        # a gap of the clock, and a step back, belong to no camera
        t_s = 0.05 * k + (50.0 if k > 350 else 0.0)
        book.add_estimate(replace(answers[0], t_s=t_s, status=status), at)
    rates = book.rates
    assert rates.tracking_s == pytest.approx(200 * 0.05)
    assert rates.searching_s == pytest.approx(199 * 0.05)
    assert rates.tracking_bytes / rates.tracking_s == pytest.approx(2e6)
    assert rates.line() == "2.0 MB/s while tracking (10 s), 40.0 MB/s while searching (10 s)"


def test_skipped_reports_of_the_display_are_reported() -> None:
    import rerun as rr

    view = LiveView(rr.RecordingStream("test"), standard_rig(), "test")
    try:
        assert view.status_text() == ""
        view.left_out = 7
        assert view.status_text() == "screen: 7 reports not drawn, it is too slow"
    finally:
        view.close()


def test_each_count_of_the_pipeline_has_its_words() -> None:
    """Expected: no name of the code reaches the operator."""
    counts = Pipeline(standard_rig(), Config()).counts
    lines = describe_counts(dict.fromkeys(counts, 3))
    assert len(lines) == len(counts)
    for name, line in zip(counts, lines, strict=True):
        assert name.replace("_", " ") not in line
    assert describe_counts({"ptu_spikes": 0}) == []
    assert describe_counts({"something_new": 2}) == ["2 something new"]


def test_the_watch_reports_while_no_status_arrives() -> None:
    now, reported = [100.0], list[float]()
    watch = StatusWatchdog(reported.append, lambda: now[0])
    watch.check()
    now[0] = 200.0
    watch.check()
    assert reported == [], "before the first there is nothing to be old"
    watch.notify()
    for now[0] in (201.0, 202.0, 202.1, 205.0):
        watch.check()
    assert reported == pytest.approx([2.1, 5.0])
    watch.notify()
    watch.check()
    assert len(reported) == 2


def test_the_watch_checks_in_its_own_thread_and_ends() -> None:
    now, spoken = [0.0], threading.Event()
    with StatusWatchdog(lambda age_s: spoken.set(), lambda: now[0]) as watch:
        watch.notify()
        now[0] = 10.0
        assert spoken.wait(60.0)
    assert not watch._thread.is_alive()


def test_the_display_reports_that_it_is_outdated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: with nothing to draw and no status for two seconds, that; at the time it would have had."""
    import rerun as rr

    now = [50.0]
    view = LiveView(rr.RecordingStream("test"), standard_rig(), "test", lambda: now[0])
    view.close()
    logged: list[tuple[float, list[str]]] = []
    monkeypatch.setattr(view, "_log_status", lambda t_s, lines: logged.append((t_s, list(lines))))
    view._check_age()
    view.show_status(10.0, ["tracking"])
    now[0] = 52.0
    view._check_age()
    assert logged == []
    now[0] = 52.5
    view._check_age()
    assert logged == [(12.5, ["NO STATUS for 2 s: what is shown is old"])]


class Flood(CameraDevice):
    """A camera that delivers at once, so many frames."""

    def __init__(self) -> None:
        self.read_back = SettingsReadBack(model="flood", device_clock=False)
        self._left: Iterator[int] = iter(range(50))

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        number = next(self._left, None)
        if number is None:
            time.sleep(timeout_s)
            return None
        pixels = np.full((4, 4), number, np.uint8)
        pixels[0, 0] = 255
        return GrabbedFrame(frame_id=number, device_ns=None, pixels=pixels, pattern=None, payload_bytes=16)

    def close(self) -> None:
        """Nothing is held."""


def test_what_a_camera_dropped_before_anybody_listened_is_no_loss() -> None:
    clock = itertools.count(0.0, 0.001)
    camera = LiveCamera(
        "left", Flood, CameraTiming(), CameraSupervision(silent_after_s=math.inf), lambda: next(clock), lambda _: None
    )
    with camera:
        while camera.counts.dropped < 46:
            time.sleep(0.001)
        worker = CameraWorker("left", camera, InputQueue(), 0.0)
        worker.start()
        worker.stop()
        assert worker.counts_before.dropped == 46
        assert camera.counts.dropped == 46


def test_a_viewer_that_has_ended_does_not_break_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: Rerun's error on a closed connection stays in the thread that draws; pytest makes of it a failure."""
    import rerun as rr

    view = LiveView(rr.RecordingStream("test"), standard_rig(), "test")

    def gone() -> None:
        raise RuntimeError("gRPC connection gracefully disconnected")

    monkeypatch.setattr(view._sink, "close", gone)
    view.close()
    assert not view._thread.is_alive()
