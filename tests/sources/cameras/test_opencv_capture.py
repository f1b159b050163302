"""Files and network streams through OpenCV: paced, ended, lost and found again; what it cannot set is refused."""

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.sources.cameras.camera import (
    CameraEndedError,
    CameraError,
    CameraEvent,
    CameraEventKind,
    CameraSettings,
)
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.sources.cameras.open_camera import open_camera
from groundstation.sources.cameras.opencv_capture import FileCamera
from tests.sources.cameras.scripted import Time


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames at 25 Hz, each of its own grey."""
    path = tmp_path_factory.mktemp("video") / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for i in range(12):
        writer.write(np.full((48, 64, 3), 10 + 20 * i, np.uint8))
    writer.release()
    return path


def test_a_file_is_played_at_its_own_pace(video: Path) -> None:
    host = Time()
    device = FileCamera(str(video), CameraSettings(), "file", host.clock, host.wait)
    grabs, waited = [], 0
    while len(grabs) < 12:
        grab = device.grab(0.01)
        if grab is None:
            waited += 1
        else:
            grabs.append((host.now_s - 1000.0, grab))
    with pytest.raises(CameraEndedError, match="ends after 12 frames"):
        device.grab(0.01)
    device.close()
    assert waited > 20
    assert [g.frame_id for _, g in grabs] == list(range(1, 13))
    for i, (at_s, grab) in enumerate(grabs):
        assert grab.due_s == pytest.approx(1000.0 + 0.04 * i, abs=1e-6)
        assert at_s == pytest.approx(0.04 * i, abs=1e-3)
        assert grab.pixels is not None
        assert abs(float(grab.pixels.mean()) - (10 + 20 * i)) < 3.0


def test_a_file_by_url_ends(video: Path) -> None:
    events: list[CameraEvent] = []
    with open_camera(f"file:{video}", CameraSettings(), clock=time.monotonic, on_event=events.append) as camera:
        frames = []
        while not camera.ended or len(frames) + camera.counts.dropped < 12:
            frame = camera.read(0.5)
            if frame is not None:
                frames.append(frame)
    assert camera.counts.frames == 12
    assert frames[-1].index == 11
    assert [f.sigma_s for f in frames] == [0.0] * len(frames)
    assert [e.kind for e in events] == [CameraEventKind.OPENED, CameraEventKind.ENDED]


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        (CameraSettings(exposure_s=0.01), "got exposure_s = 0.01; wanted it left out"),
        (CameraSettings(roi_px=(0, 0, 8, 8)), "got roi_px"),
        (CameraSettings(trigger="Line1"), "got trigger = Line1"),
    ],
)
def test_a_file_cannot_be_set(video: Path, settings: CameraSettings, complaint: str) -> None:
    camera = open_camera(f"file:{video}", settings, clock=time.monotonic, on_event=lambda event: None)
    with pytest.raises(CameraError, match=complaint), camera:
        pass


def test_what_is_no_video_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_text("no video")
    camera = open_camera(
        f"file:{tmp_path / 'v.mp4'}", CameraSettings(), clock=time.monotonic, on_event=lambda event: None
    )
    with pytest.raises(CameraError, match="got no video that opens"), camera:
        pass


def test_a_video_device_that_is_not_there() -> None:
    camera = open_camera("opencv:/dev/video77", CameraSettings(), clock=time.monotonic, on_event=lambda event: None)
    with pytest.raises(CameraError, match="got nothing that opens"), camera:
        pass


class Stream(BaseHTTPRequestHandler):
    """Motion JPEG as network cameras send it; a connection ends when the cable is pulled."""

    plugged = threading.Event()

    def do_GET(self) -> None:
        if not self.plugged.is_set():
            self.send_error(503)
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        level = 0
        while self.plugged.is_set():
            level = (level + 5) % 250
            data = cv2.imencode(".jpg", np.full((48, 64, 3), level, np.uint8))[1].tobytes()
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
            try:
                self.wfile.write(head.encode() + data + b"\r\n")
            except OSError:
                return
            time.sleep(0.02)

    def log_message(self, *args: object) -> None:
        pass


@pytest.fixture
def stream() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Stream)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    Stream.plugged.set()
    yield f"http://127.0.0.1:{server.server_port}/stream.mjpg"
    Stream.plugged.clear()
    server.shutdown()
    server.server_close()
    thread.join()


def first_frame(camera: LiveCamera, opening: int) -> bool:
    """Whether a frame of this opening comes within half a minute."""
    for _ in range(150):
        frame = camera.read(0.2)
        if frame is not None and frame.opening == opening:
            return True
    return False


def test_a_network_stream_pulled_and_put_back(stream: str) -> None:
    events: list[CameraEvent] = []
    with open_camera(stream, CameraSettings(), clock=time.monotonic, on_event=events.append) as camera:
        assert first_frame(camera, 0)
        Stream.plugged.clear()
        for _ in range(150):
            camera.read(0.2)
            if CameraEventKind.NOT_OPENED in [e.kind for e in events]:
                break
        Stream.plugged.set()
        assert first_frame(camera, 1)
    kinds = [e.kind for e in events]
    assert kinds[:3] == [CameraEventKind.OPENED, CameraEventKind.LOST, CameraEventKind.NOT_OPENED]
    assert CameraEventKind.REOPENED in kinds
    assert camera.read_back is not None
    assert camera.read_back.size_px == (64, 48)


def test_arrivals_of_a_stream_have_a_large_sigma(stream: str) -> None:
    with open_camera(stream, CameraSettings(), clock=time.monotonic, on_event=lambda event: None) as camera:
        frame = camera.read(10.0)
    assert frame is not None
    assert frame.sigma_s == pytest.approx(0.15)
    assert frame.arrival_s - frame.t_s == pytest.approx(0.2)
