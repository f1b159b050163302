"""A camera that follows a script, and a clock that only advances in waits."""

from collections.abc import Callable, Iterator

import numpy as np

from groundstation.sources.cameras.camera import (
    CameraDevice,
    CameraError,
    CameraEvent,
    CameraEventKind,
    CameraFrame,
    CameraSupervision,
    CameraTiming,
    GrabbedFrame,
    SettingsReadBack,
)
from groundstation.sources.cameras.supervised import SupervisedCamera

Step = GrabbedFrame | CameraError | None


class Time:
    """The host's clock, s."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def clock(self) -> float:
        return self.now_s

    def wait(self, seconds: float) -> None:
        self.now_s += seconds


def grab(
    number: int | None, *, level: int | None = None, device_s: float | None = None, whole: bool = True
) -> GrabbedFrame:
    """A frame of 6 × 4 px that differs from others by ``level``, else by its number."""
    pixels = np.arange(24, dtype=np.uint8).reshape(4, 6) + np.uint8((level if level is not None else number or 0) % 200)
    stamp = None if device_s is None else round(device_s * 1e9)
    return GrabbedFrame(
        frame_id=number, device_ns=stamp, pixels=pixels if whole else None, pattern=None, payload_bytes=1_000_000
    )


class ScriptedDevice(CameraDevice):
    """Gives one step of a script per grab, 40 ms apart; nothing once it has ended."""

    def __init__(self, script: list[Step], time: Time) -> None:
        self.read_back = SettingsReadBack(model="scripted", exposure_s=0.004, gain=3.0)
        self.closed = False
        self._script: Iterator[Step] = iter(script)
        self._time = time

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        step = next(self._script, None)
        self._time.wait(timeout_s if step is None else 0.04)
        if isinstance(step, CameraError):
            raise step
        return step

    def close(self) -> None:
        self.closed = True


class Life:
    """A supervised camera of one script per opening; an error instead of a script is one that refuses to open."""

    def __init__(
        self,
        *scripts: list[Step] | CameraError,
        care: CameraSupervision | None = None,
        timing: CameraTiming | None = None,
    ) -> None:
        self.time = Time()
        self.events: list[CameraEvent] = []
        self.devices: list[ScriptedDevice] = []
        self.attempts_s: list[float] = []
        self._scripts = iter(scripts)
        self.camera = SupervisedCamera(
            "left",
            self.connect,
            timing or CameraTiming(),
            care or CameraSupervision(),
            self.time.clock,
            self.time.wait,
            self.events.append,
        )

    def connect(self) -> CameraDevice:
        self.attempts_s.append(self.time.now_s)
        script = next(self._scripts, CameraError("got nothing; wanted a camera"))
        if isinstance(script, CameraError):
            raise script
        self.devices.append(ScriptedDevice(script, self.time))
        return self.devices[-1]

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> list[CameraFrame]:
        """Step for so long by the camera's clock; the frames that came."""
        end_s = self.time.now_s + seconds
        frames = []
        while self.time.now_s < end_s and not self.camera.ended and not until():
            frame = self.camera.step()
            if frame is not None:
                frames.append(frame)
        return frames

    @property
    def kinds(self) -> list[CameraEventKind]:
        return [e.kind for e in self.events]
