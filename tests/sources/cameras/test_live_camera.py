"""A camera on its own thread: a short queue that drops the oldest, reads that end, faults that are seen."""

import threading
import time

import pytest

from groundstation.sources.cameras.camera import (
    CameraDevice,
    CameraEndedError,
    CameraError,
    CameraEvent,
    CameraEventKind,
    CameraSupervision,
    CameraTiming,
    GrabbedFrame,
    SettingsReadBack,
)
from groundstation.sources.cameras.live_camera import LiveCamera
from tests.sources.cameras.scripted import grab


class GatedDevice(CameraDevice):
    """Gives frames 1 … n, then waits for its gate and ends."""

    def __init__(self, count: int, gate: threading.Event, fault: Exception | None = None) -> None:
        self.read_back = SettingsReadBack(model="gated")
        self.closed = threading.Event()
        self._count, self._gate, self._fault = count, gate, fault
        self._given = 0

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        if self._given < self._count:
            self._given += 1
            return grab(self._given)
        if not self._gate.wait(timeout_s):
            return None
        raise self._fault or CameraEndedError("done")

    def close(self) -> None:
        self.closed.set()


def live(device: CameraDevice, care: CameraSupervision | None = None) -> tuple[LiveCamera, list[CameraEvent]]:
    events: list[CameraEvent] = []
    return LiveCamera(
        "c", lambda: device, CameraTiming(), care or CameraSupervision(), time.monotonic, events.append
    ), events


def test_the_oldest_is_dropped_and_counted() -> None:
    gate = threading.Event()
    device = GatedDevice(10, gate)
    camera, events = live(device, CameraSupervision(queue=3))
    with camera:
        gate.set()
        assert device.closed.wait(5.0)
        got = [camera.read(1.0) for _ in range(3)]
        assert [f.index for f in got if f] == [7, 8, 9]
        assert camera.read(5.0) is None
        assert camera.ended
    assert camera.counts.frames == 10
    assert camera.counts.dropped == 7
    assert [e.kind for e in events] == [CameraEventKind.OPENED, CameraEventKind.ENDED]


def test_a_read_without_a_frame_ends_and_leaving_closes() -> None:
    device = GatedDevice(1, threading.Event())
    camera, _ = live(device)
    with camera:
        assert camera.read(5.0) is not None
        assert camera.read(0.01) is None
        assert not camera.ended
        assert camera.read_back is not None
    assert device.closed.is_set()


def test_a_fault_inside_is_raised_where_frames_are_read() -> None:
    gate = threading.Event()
    gate.set()
    camera, _ = live(GatedDevice(1, gate, ZeroDivisionError("a mistake of ours")))
    with camera:
        assert camera.read(5.0) is not None
        with pytest.raises(ZeroDivisionError, match="a mistake of ours"):
            camera.read(5.0)
        assert camera.ended


def test_a_camera_that_is_not_there_is_an_error_unless_it_is_waited_for() -> None:
    def nothing() -> CameraDevice:
        raise CameraError("c: got no answer; wanted a camera")

    events: list[CameraEvent] = []
    with (
        pytest.raises(CameraError, match="no answer"),
        LiveCamera("c", nothing, CameraTiming(), CameraSupervision(), time.monotonic, events.append),
    ):
        pass
    assert not events
    care = CameraSupervision(wait_at_start=True)
    with LiveCamera("c", nothing, CameraTiming(), care, time.monotonic, events.append) as camera:
        assert camera.read(0.01) is None
        assert camera.read_back is None
    assert events[0].kind is CameraEventKind.NOT_OPENED
