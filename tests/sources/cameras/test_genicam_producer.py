"""GenICam against an independent camera: the GenTL test producer that the genicam wheel ships."""

import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from groundstation.sources.cameras.camera import (
    CameraError,
    CameraEvent,
    CameraEventKind,
    CameraFrame,
    CameraLostError,
    CameraSettings,
)
from groundstation.sources.cameras.listing import list_cameras
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.sources.cameras.open_camera import open_camera

genicam = pytest.importorskip("genicam", reason="extra genicam is not installed")
pytest.importorskip("harvesters.core", reason="extra genicam is not installed")

CTI = Path(genicam.__file__).parent / "viky.cti"
GREY = CameraSettings(pixel_format="Mono8", rate_hz=50.0)
pytestmark = pytest.mark.skipif(not CTI.is_file(), reason=f"{CTI} is not part of this genicam wheel")


def camera(serial: str, settings: CameraSettings, events: list[CameraEvent] | None = None) -> LiveCamera:
    tell = (lambda event: None) if events is None else events.append
    return open_camera(f"genicam:{serial}?cti={CTI}", settings, clock=time.monotonic, on_event=tell, name=serial)


def some(source: LiveCamera, count: int) -> list[CameraFrame]:
    got = [source.read(5.0) for _ in range(count)]
    frames = [f for f in got if f is not None]
    assert len(frames) == count
    return frames


def test_settings_are_set_and_read_back() -> None:
    settings = CameraSettings(pixel_format="Mono8", roi_px=(0, 0, 320, 200), rate_hz=40.0, trigger="off")
    with camera("1", settings) as green:
        found, frame = green.read_back, some(green, 1)[0]
    assert found is not None
    assert (found.size_px, found.pixel_format, found.rate_hz) == ((320, 200), "Mono8", 40.0)
    assert found.serial == "1"
    assert frame.picture.size_px == (320, 200)


def test_two_cameras_deliver_and_each_has_its_colour() -> None:
    with camera("0", CameraSettings(rate_hz=50.0)) as red, camera("2", CameraSettings(rate_hz=50.0)) as blue:
        reds, blues = some(red, 5), some(blue, 5)
    for frames, channel in ((reds, 2), (blues, 0)):
        image = frames[0].picture.whole()
        others = [c for c in range(3) if c != channel]
        assert image[..., channel].min() > image[..., others].min()
        # it has no clock: arrivals are all that there is
        assert all(f.device_ns is None and f.t_s < f.arrival_s for f in frames)
        assert all(b.index > a.index for a, b in pairwise(frames))
        assert not np.array_equal(frames[0].picture.whole(), frames[-1].picture.whole())


def test_frames_that_nobody_fetched_in_time_are_counted() -> None:
    with camera("0", GREY) as red:
        first = some(red, 1)[0]
        time.sleep(0.5)
        later = some(red, 6)
        counts = red.counts
    assert counts.dropped > 5
    assert later[-1].index - first.index >= counts.dropped
    assert counts.frames >= later[-1].index - first.index - counts.lost


def test_a_camera_that_is_opened_again_leaves_the_other_alone() -> None:
    with camera("0", GREY) as red:
        some(red, 2)
        for _ in range(3):
            with camera("1", GREY) as green:
                some(green, 2)
        some(red, 2)
        assert list(red.counts.events) == [CameraEventKind.OPENED]


def test_a_fault_of_the_producer_is_a_lost_camera_that_returns(monkeypatch: pytest.MonkeyPatch) -> None:
    """The producer cannot be unplugged, so one grab fails as an unplugged one would."""
    from groundstation.sources.cameras.genicam_producer import GenicamCamera

    real, pulled = GenicamCamera.grab, [False]

    def grab(self: GenicamCamera, timeout_s: float) -> object:
        if pulled[0] and self.read_back.serial == "0":
            pulled[0] = False
            raise CameraLostError("pulled")
        return real(self, timeout_s)

    monkeypatch.setattr(GenicamCamera, "grab", grab)
    events: list[CameraEvent] = []
    with camera("0", GREY, events) as red, camera("1", GREY) as green:
        some(red, 2)
        pulled[0] = True
        frames = some(red, 20)
        some(green, 2)
    assert CameraEventKind.REOPENED in [e.kind for e in events]
    assert frames[-1].opening == 1


@pytest.mark.parametrize(
    ("serial", "settings", "complaint"),
    [
        ("77", GREY, "got none of that name .there: 0, 1, 2.; wanted a camera"),
        ("0", CameraSettings(exposure_s=0.01), "got a camera without ExposureTime"),
        ("0", CameraSettings(pixel_format="BayerRG8"), "got a refusal of PixelFormat"),
        ("0", CameraSettings(roi_px=(0, 0, 7, 7)), "got a refusal of Width"),
        ("0", CameraSettings(trigger="Line1"), "got a camera without TriggerMode"),
    ],
)
def test_what_it_cannot_do_is_one_line(serial: str, settings: CameraSettings, complaint: str) -> None:
    with pytest.raises(CameraError, match=complaint) as error, camera(serial, settings):
        pass
    assert "\n" not in str(error.value)
    with camera("0", GREY) as red:
        some(red, 1)


def test_one_camera_cannot_be_had_twice() -> None:
    with camera("0", GREY) as red:
        with pytest.raises(CameraError, match="wanted a camera that no other program has"), camera("0", GREY):
            pass
        some(red, 2)


def test_a_file_that_is_no_producer(tmp_path: Path) -> None:
    (tmp_path / "a.cti").write_text("text")
    source = open_camera(f"genicam:0?cti={tmp_path / 'a.cti'}", GREY, clock=time.monotonic, on_event=lambda event: None)
    with pytest.raises(CameraError, match="wanted a GenTL producer"), source:
        pass


def test_its_cameras_are_listed(tmp_path: Path) -> None:
    (tmp_path / "video3").touch()
    found = list_cameras([str(CTI)], {}, tmp_path)
    urls = [url for url, _ in found.cameras]
    assert [u for u in urls if u.startswith("genicam")] == [f"genicam:{i}?cti={CTI}" for i in range(3)]
    assert f"opencv:{tmp_path / 'video3'}" in urls
