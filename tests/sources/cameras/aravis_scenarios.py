"""Cameras of Aravis, an independent program, delivering into this source; prints the result as JSON.

Run in a separate network namespace (`test_gige_fakes.py` does), so that two cameras can have port 3956 on two
addresses, and no other cameras respond: `python -m tests.sources.cameras.aravis_scenarios NAME`.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from groundstation.box import Box
from groundstation.picture import RawPicture
from groundstation.sources.cameras.camera import (
    CameraError,
    CameraEvent,
    CameraFrame,
    CameraSettings,
    CameraSupervision,
    CameraTiming,
    StampPoint,
)
from groundstation.sources.cameras.gige import discover_gige
from groundstation.sources.cameras.live_camera import LiveCamera
from groundstation.sources.cameras.open_camera import open_camera

LEFT, RIGHT = "127.0.0.1", "127.0.0.2"
PROGRAM = "arv-fake-gv-camera-0.8"
# the fake stamps what it sends, in ns of the wall clock
TIMING = CameraTiming(stamp=StampPoint.END, transfer_s=0.0, transfer_sigma_s=0.0)


class FakeCamera:
    """A process of Aravis's fake camera."""

    def __init__(self, address: str, serial: str, lost_per_thousand: int = 0) -> None:
        self._command = [PROGRAM, "-i", address, "-s", serial, "-r", str(lost_per_thousand)]
        self._address = address
        self.plug()

    def plug(self) -> None:
        self._process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for _ in range(20):
            if any(info.ip == self._address for info in discover_gige(loopback=True)):
                return
        raise RuntimeError(f"{self._command} does not answer")

    def unplug(self) -> None:
        self._process.kill()
        self._process.wait()


def opened(
    address: str,
    settings: CameraSettings,
    events: list[CameraEvent],
    care: CameraSupervision | None = None,
    query: str = "",
) -> LiveCamera:
    url = f"gige:{address}{query}"
    return open_camera(
        url, settings, clock=time.monotonic, on_event=events.append, timing=TIMING, care=care, name=address
    )


def collect(cameras: list[LiveCamera], seconds: float, until: Callable[[], bool] = lambda: False) -> list[CameraFrame]:
    """Read all cameras in turn, until time is up or enough has been seen."""
    frames = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and not until():
        for camera in cameras:
            frame = camera.read(0.02)
            if frame is not None:
                frames.append(frame)
    return frames


def whole(frame: CameraFrame) -> bool:
    """Whether a picture is the fake's moving diagonal gradient everywhere: each row is the one above, moved by one."""
    assert isinstance(frame.picture, RawPicture)
    raw = frame.picture.recordable(Box(0, 0, *frame.picture.size_px)).pixels
    return bool(np.array_equal(raw[1:, :-1], raw[:-1, 1:]))


def outcome_of(camera: LiveCamera, frames: list[CameraFrame], events: list[CameraEvent]) -> dict[str, Any]:
    """What came from one camera, and how its stamps compare with the fake's wall clock."""
    mine = [f for f in frames if f.camera == camera.name]
    counts, found = camera.counts, camera.read_back
    wall_s = time.time() - time.monotonic()
    settled = [f for f in mine if f.device_ns is not None][-50:]
    errors = [f.t_s + (f.exposure_s or 0.0) / 2.0 + wall_s - (f.device_ns or 0) * 1e-9 for f in settled]
    raw = [f.arrival_s + wall_s - (f.device_ns or 0) * 1e-9 for f in settled]
    return {
        "frames": len(mine),
        "counts": {
            k: getattr(counts, k) for k in ("frames", "incomplete", "lost", "overtaken", "dropped", "reconnects")
        },
        "events": [e.kind for e in events],
        "texts": [e.text for e in events],
        "indices_rise": all(b.index > a.index for a, b in pairwise(mine)),
        "last_index": mine[-1].index if mine else None,
        "openings": sorted({f.opening for f in mine}),
        "size_px": mine[-1].picture.size_px if mine else None,
        "whole": all(whole(f) for f in mine),
        "read_back": None
        if found is None
        else {
            k: getattr(found, k)
            for k in ("serial", "exposure_s", "gain", "roi_px", "pixel_format", "rate_hz", "trigger")
        },
        "stamp_error_ms": [1e3 * float(np.median(errors)), 1e3 * float(np.std(errors))] if errors else None,
        "arrival_error_ms": [1e3 * float(np.median(raw)), 1e3 * float(np.std(raw))] if raw else None,
        "sigma_ms": 1e3 * mine[-1].sigma_s if mine else None,
        "rate_hz": (mine[-1].index - mine[0].index) / (mine[-1].t_s - mine[0].t_s) if len(mine) > 1 else None,
    }


def two(seconds: float = 4.0) -> dict[str, Any]:
    """Two cameras at 1280 × 960 in raw colours, together."""
    fakes = [FakeCamera(LEFT, "GV01"), FakeCamera(RIGHT, "GV02")]
    settings = CameraSettings(
        exposure_s=0.004, gain=3.0, roi_px=(16, 8, 1280, 960), pixel_format="BayerRG8", rate_hz=25.0, trigger="off"
    )
    logs: list[list[CameraEvent]] = [[], []]
    try:
        with opened(LEFT, settings, logs[0]) as left, opened(RIGHT, settings, logs[1]) as right:
            frames = collect([left, right], seconds)
            return {"left": outcome_of(left, frames, logs[0]), "right": outcome_of(right, frames, logs[1])}
    finally:
        for fake in fakes:
            fake.unplug()


def loss(seconds: float = 3.0) -> dict[str, Any]:
    """Five packets of a thousand never come; small packets, so that most frames lack some."""
    fake = FakeCamera(LEFT, "GV01", lost_per_thousand=5)
    events: list[CameraEvent] = []
    try:
        settings = CameraSettings(roi_px=(0, 0, 512, 512))
        with opened(LEFT, settings, events, query="?packet=1400") as left:
            return {"left": outcome_of(left, collect([left], seconds), events)}
    finally:
        fake.unplug()


def unplugged() -> dict[str, Any]:
    """Two cameras; the left one is unplugged and plugged in, twice; the right one continues."""
    fakes = [FakeCamera(LEFT, "GV01"), FakeCamera(RIGHT, "GV02")]
    logs: list[list[CameraEvent]] = [[], []]
    care = CameraSupervision(silent_after_s=0.6)
    settings = CameraSettings(exposure_s=0.002)
    try:
        with opened(LEFT, settings, logs[0], care) as left, opened(RIGHT, settings, logs[1], care) as right:
            frames = collect([left, right], 1.0)
            for times in (1, 2):
                fakes[0].unplug()
                frames += collect([left, right], 20.0, lambda: not_opened(logs[0]) >= times)  # noqa: B023
                fakes[0].plug()
                frames += collect([left, right], 20.0, lambda: left.counts.reconnects >= times)  # noqa: B023
                frames += collect([left, right], 1.0)
            return {"left": outcome_of(left, frames, logs[0]), "right": outcome_of(right, frames, logs[1])}
    finally:
        for fake in fakes:
            fake.unplug()


def not_opened(events: list[CameraEvent]) -> int:
    """How often the camera went away and then could not be opened."""
    return sum(a.kind in ("silent", "lost") and b.kind == "not opened" for a, b in pairwise(events))


def refused() -> dict[str, Any]:
    """Settings that the camera does not support, and a camera that another program has open."""
    fake = FakeCamera(LEFT, "GV01")
    wrong = {
        "exposure": CameraSettings(exposure_s=1e6),
        "format": CameraSettings(pixel_format="BayerRG12"),
        "region": CameraSettings(roi_px=(0, 0, 9999, 480)),
        "trigger": CameraSettings(trigger="Line9"),
    }
    reported = {}
    try:
        for name, settings in wrong.items():
            reported[name] = complaint(LEFT, settings)
        reported["absent"] = complaint("127.0.0.9", CameraSettings())
        with opened(LEFT, CameraSettings(), []) as left:
            reported["busy"] = complaint(LEFT, CameraSettings())
            reported["frames"] = str(len(collect([left], 1.0)))
        return reported
    finally:
        fake.unplug()


def complaint(address: str, settings: CameraSettings) -> str:
    try:
        with opened(address, settings, []):
            return ""
    except CameraError as error:
        return str(error)


def colours() -> dict[str, Any]:
    """How far green and red lag behind blue along the gradient, as the camera colours it and in each raw pattern."""
    fake = FakeCamera(LEFT, "GV01")
    lags = {}
    try:
        for name in ("RGB8", "BayerRG8", "BayerGR8", "BayerGB8", "BayerBG8"):
            with opened(LEFT, CameraSettings(pixel_format=name, roi_px=(0, 0, 512, 512)), []) as left:
                image = collect([left], 0.4)[-1].picture.whole().astype(float)
            # it repeats every 256 px and moves on from frame to frame: phases against each other stay
            phases = np.angle(np.fft.rfft(image[100], axis=0)[2])
            lags[name] = [float(np.angle(np.exp(1j * (phases[k] - phases[0])))) for k in (1, 2)]
        return lags
    finally:
        fake.unplug()


SCENARIOS: dict[str, Callable[[], dict[str, Any]]] = {
    "two": two,
    "loss": loss,
    "unplugged": unplugged,
    "refused": refused,
    "colours": colours,
}

if __name__ == "__main__":
    print(json.dumps(SCENARIOS[sys.argv[1]]()))
