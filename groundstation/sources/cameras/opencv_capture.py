"""USB cameras, network streams and files through OpenCV: without device time, so that arrivals have to do.

Exposure and gain are in the driver's own unit for most USB cameras; Linux counts exposure in 100 µs.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from groundstation.sources.cameras.camera import (
    CameraDevice,
    CameraEndedError,
    CameraError,
    CameraLostError,
    CameraSettings,
    Clock,
    GrabbedFrame,
    SettingsReadBack,
)

_OPEN_MS, _READ_MS = 5000, 2000
# Video4Linux: exposure_time_absolute in 100 µs; exposure_auto 1 is manual
_EXPOSURE_STEP_S = 1e-4
_MANUAL = 1.0
# from the end of an exposure to the arrival, and one sigma, s: assumed, because no camera reports it
_USB_TRANSFER_S, _USB_SIGMA_S = 0.030, 0.020
_STREAM_TRANSFER_S, _STREAM_SIGMA_S = 0.200, 0.150


class OpencvCamera(CameraDevice):
    """A USB camera by index or path, or a stream by its address."""

    def __init__(self, source: int | str, settings: CameraSettings, name: str) -> None:
        self._where = name
        stream = isinstance(source, str) and "://" in source
        refuse_settings(
            settings, name, {"roi_px", "rate_hz", *(() if stream else ("exposure_s", "gain", "pixel_format"))}
        )
        if stream:
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_MS]
            self._capture = cv2.VideoCapture(str(source), cv2.CAP_FFMPEG, limits)
        else:
            self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            raise CameraError(f"{name}: got nothing that opens; wanted a camera or a stream that OpenCV reads")
        self.transfer_s = _STREAM_TRANSFER_S if stream else _USB_TRANSFER_S
        self.transfer_sigma_s = _STREAM_SIGMA_S if stream else _USB_SIGMA_S
        # an encoder repeats an unmoved scene to the last bit
        self.checks_frozen = not stream
        # a stale frame is worse than none
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        try:
            self.read_back = self._set_up(settings)
        except CameraError:
            self.close()
            raise

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame; OpenCV waits as long as its driver does, `timeout_s` is not asked."""
        try:
            good, image = self._capture.read()
        except cv2.error as error:
            raise CameraLostError(" ".join(str(error).split())) from error
        if not good or image is None:
            raise CameraLostError("OpenCV reads no more frames")
        # this delay is part of the assumed transfer time; the bytes of an image do not give that of a coded stream
        return GrabbedFrame(frame_id=None, device_ns=None, pixels=_bgr(image), pattern=None, payload_bytes=0)

    def close(self) -> None:
        """Let the camera go."""
        self._capture.release()

    def _set_up(self, settings: CameraSettings) -> SettingsReadBack:
        """Write the settings and read them back."""
        capture = self._capture
        if settings.pixel_format is not None:
            self._set("pixel format", cv2.CAP_PROP_FOURCC, float(_fourcc(settings.pixel_format, self._where)))
        if settings.roi_px is not None:
            x, y, w, h = settings.roi_px
            if x or y:
                raise CameraError(f"{self._where}: region: got a corner at {x}, {y}; wanted 0, 0 for OpenCV")
            self._set("width", cv2.CAP_PROP_FRAME_WIDTH, w)
            self._set("height", cv2.CAP_PROP_FRAME_HEIGHT, h)
        if settings.rate_hz is not None:
            self._set("rate", cv2.CAP_PROP_FPS, settings.rate_hz)
        if settings.exposure_s is not None:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL)
            self._set("exposure in 100 µs", cv2.CAP_PROP_EXPOSURE, settings.exposure_s / _EXPOSURE_STEP_S)
        if settings.gain is not None:
            self._set("gain", cv2.CAP_PROP_GAIN, settings.gain)
        found = _found(capture)
        if settings.exposure_s is None:
            return found
        # defined here, so that its unit is known
        return replace(found, exposure_s=capture.get(cv2.CAP_PROP_EXPOSURE) * _EXPOSURE_STEP_S)

    def _set(self, what: str, key: int, value: float) -> None:
        accepted = self._capture.set(key, value)
        got = self._capture.get(key)
        if not accepted or abs(got - value) > 0.02 * abs(value) + 0.5:
            raise CameraError(f"{self._where}: {what}: got {got:g}; wanted {value:g}")


class FileCamera(CameraDevice):
    """A video file, played at its own pace as if it were a camera; its end is its end."""

    checks_frozen = False
    may_reopen = False

    def __init__(
        self, path: str, settings: CameraSettings, name: str, clock: Clock, wait: Callable[[float], object]
    ) -> None:
        refuse_settings(settings, name, set())
        # a folder or a missing file is reported before OpenCV writes to the terminal
        self._capture = cv2.VideoCapture(path)
        if not self._capture.isOpened():
            raise CameraError(f"{name}: got no video that opens; wanted a file that OpenCV reads")
        self.read_back = _found(self._capture)
        self._clock = clock
        self._wait = wait
        self._start_s: float | None = None
        self._next: GrabbedFrame | None = None
        self._count = 0

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame when it is due, None as long as it is not."""
        if self._next is None:
            self._next = self._decoded()
        due_s = self._next.due_s or 0.0
        left_s = due_s - self._clock()
        if left_s > 0.0:
            self._wait(min(left_s, timeout_s))
        if due_s > self._clock():
            return None
        grab, self._next = self._next, None
        return grab

    def close(self) -> None:
        """Close the file."""
        self._capture.release()

    def _decoded(self) -> GrabbedFrame:
        good, image = self._capture.read()
        if not good or image is None:
            raise CameraEndedError(f"the file ends after {self._count} frames")
        time_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
        if self._start_s is None:
            self._start_s = self._clock() - time_s
        self._count += 1
        return GrabbedFrame(
            frame_id=self._count,
            device_ns=round(time_s * 1e9),
            pixels=_bgr(image),
            pattern=None,
            payload_bytes=image.nbytes,
            due_s=self._start_s + time_s,
        )


def refuse_settings(settings: CameraSettings, where: str, able: set[str]) -> None:
    """Raise `CameraError` for settings that this kind of camera cannot do."""
    for name in CameraSettings.__dataclass_fields__:
        value = getattr(settings, name)
        if value is not None and name not in able and not (name == "trigger" and value == "off"):
            raise CameraError(f"{where}: got {name} = {value}; wanted it left out, this kind of camera cannot set it")


def _found(capture: cv2.VideoCapture) -> SettingsReadBack:
    w, h = (int(capture.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    letters = "".join(chr(code >> 8 * i & 0xFF) for i in range(4)) if code > 0 else ""
    return SettingsReadBack(
        model=f"OpenCV ({capture.getBackendName()})",
        size_px=(w, h),
        pixel_format=letters.strip("\0 ") if letters.isprintable() else None,
        rate_hz=capture.get(cv2.CAP_PROP_FPS) or None,
    )


def _fourcc(text: str, where: str) -> int:
    if len(text) != 4 or not text.isascii():
        raise CameraError(f"{where}: pixel format: got {text!r}; wanted four letters, as MJPG")
    return int(cv2.VideoWriter.fourcc(*text))


def _bgr(image: np.ndarray) -> np.ndarray:
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    return np.ascontiguousarray(colour, np.uint8)
