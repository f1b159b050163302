"""A camera kept running: opened, watched, reopened; its frames numbered, stamped and handed on one step at a time."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.sources.cameras.camera import (
    CameraCounts,
    CameraDevice,
    CameraEndedError,
    CameraError,
    CameraEvent,
    CameraEventKind,
    CameraFrame,
    CameraSupervision,
    CameraTiming,
    Clock,
    GrabbedFrame,
    SettingsReadBack,
)
from groundstation.sources.cameras.frame_ids import FrameNumbers, FrameOrder
from groundstation.sources.cameras.host_clock_fit import ClockChange, ClockFitState
from groundstation.sources.cameras.pixel_formats import picture_of
from groundstation.sources.cameras.stamping import Stamper

# one step waits no longer, so that it can be stopped
_STEP_S = 0.1
_FEWEST_FROZEN = 5


class SupervisedCamera:
    """One camera's life, advanced by `step` from one thread.

    Parameters
    ----------
    connect : opens and starts the device; raises `CameraError`.
    clock : the host's monotonic clock, s.
    wait : waits for so many seconds, or less if it is to be stopped.
    on_event : called with each event as it happens.
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], CameraDevice],
        timing: CameraTiming,
        care: CameraSupervision,
        clock: Clock,
        wait: Callable[[float], object],
        on_event: Callable[[CameraEvent], None],
    ) -> None:
        self.name = name
        self.read_back: SettingsReadBack | None = None
        self.ended = False
        self._connect = connect
        self._care = care
        self._clock = clock
        self._wait = wait
        self._on_event = on_event
        self._stamper = Stamper(timing)
        self._numbers = FrameNumbers()
        self._counts = CameraCounts()
        self._device: CameraDevice | None = None
        self._backoff_s = care.backoff_s
        self._retry_s = 0.0
        self._heard_s = 0.0
        self._last_pixels: ImageArray | None = None
        self._same_since_s: float | None = None
        self._same = 0
        self._unnumbered = 0

    def open(self) -> None:
        """Open the camera for the first time; raises `CameraError`."""
        self._device = self._connect()
        self._take_over(self._device, CameraEventKind.OPENED)

    def wait_before_reopening(self, error: CameraError) -> None:
        """Report that the camera could not be opened, and continue trying."""
        self._not_opened(error)

    def close(self) -> None:
        """Let the device go."""
        device, self._device = self._device, None
        if device is not None:
            device.close()

    @property
    def clock_state(self) -> ClockFitState | None:
        """The device's clock against the host's."""
        return self._stamper.clock

    def counts(self) -> CameraCounts:
        """Return a copy of the counts."""
        return replace(self._counts, events=dict(self._counts.events))

    def count_dropped(self) -> None:
        """Count a frame that was handed on and then dropped from a queue."""
        self._counts.dropped += 1

    def step(self) -> CameraFrame | None:
        """Execute the next step, in bounded time: a frame, or None."""
        device = self._device
        if device is None:
            self._reopen()
            return None
        try:
            grab = device.grab(_STEP_S)
        except CameraEndedError as end:
            self.ended = True
            self._emit(CameraEventKind.ENDED, str(end))
            return None
        except CameraError as error:
            self._lose(CameraEventKind.LOST, str(error))
            return None
        now = self._clock()
        if grab is None:
            silent_s = now - self._heard_s
            if silent_s >= self._care.silent_after_s:
                self._lose(CameraEventKind.SILENT, f"no frame for {silent_s:.1f} s")
            return None
        self._heard_s = now
        return self._frame(device, grab, now)

    def _frame(self, device: CameraDevice, grab: GrabbedFrame, now: float) -> CameraFrame | None:
        """Number, check and stamp one frame."""
        if grab.pixels is None and grab.frame_id is None:
            # its number is missing in the count, too
            self._counts.incomplete += 1
            self._unnumbered += 1
            return None
        number = self._numbers.take(grab.frame_id)
        self._counts.lost += max(number.lost - self._unnumbered, 0)
        self._unnumbered = 0
        if number.order is FrameOrder.RESTARTED:
            self._emit(CameraEventKind.RECOUNTED, f"the camera restarted its frame count at {grab.frame_id}")
        if number.order in (FrameOrder.REPEATED, FrameOrder.OVERTAKEN):
            self._counts.overtaken += 1
            return None
        if grab.pixels is None:
            self._counts.incomplete += 1
            return None
        repeated = device.checks_frozen and self._watch(grab.pixels, now)
        if self._device is None:
            return None
        exposure_s = device.read_back.exposure_s
        stamp = self._stamper.stamp(grab, now, exposure_s, device.transfer_s, device.transfer_sigma_s)
        if stamp.change is not ClockChange.NONE:
            reset = stamp.change is ClockChange.RESET
            kind = CameraEventKind.CLOCK_RESET if reset else CameraEventKind.CLOCK_JUMP
            self._emit(kind, f"the camera's clock {'restarted' if reset else 'jumped'}; fitted again")
        self._counts.frames += 1
        # what works for a while earns a short first pause the next time
        self._backoff_s = self._care.backoff_s
        return CameraFrame(
            camera=self.name,
            t_s=stamp.t_s,
            sigma_s=stamp.sigma_s,
            index=number.index,
            lost=number.lost,
            opening=self._counts.reconnects,
            device_ns=grab.device_ns,
            arrival_s=now,
            exposure_s=exposure_s,
            gain=device.read_back.gain,
            picture=picture_of(grab.pixels, grab.pattern),
            repeated=repeated,
        )

    def _watch(self, pixels: ImageArray, now: float) -> bool:
        """Return whether a picture is the same as the last; a stream of such pictures is lost as frozen."""
        last, self._last_pixels = self._last_pixels, pixels
        # an unlit or blinded sensor is flat, and not frozen for it
        same = last is not None and np.array_equal(last, pixels) and bool(pixels.min() != pixels.max())
        if not same:
            self._same_since_s, self._same = now, 0
            return False
        self._same += 1
        self._counts.repeated += 1
        same_s = now - (self._same_since_s or now)
        if self._same >= _FEWEST_FROZEN and same_s >= self._care.frozen_after_s:
            self._lose(
                CameraEventKind.FROZEN, f"{self._same + 1} pictures in {same_s:.1f} s are the same to the last bit"
            )
        return True

    def _lose(self, kind: CameraEventKind, text: str) -> None:
        """Let the device go and seek it again after a pause, or never where it cannot come back."""
        device = self._device
        self.close()
        if device is not None and not device.may_reopen:
            self.ended = True
            self._emit(kind, text)
            return
        self._emit(kind, f"{text}; opened again in {self._backoff_s:.2g} s")
        self._later()

    def _reopen(self) -> None:
        """Try to open the camera when it is due; otherwise wait for a short time."""
        left_s = self._retry_s - self._clock()
        if left_s > 0.0:
            self._wait(min(left_s, _STEP_S))
            return
        try:
            self._device = self._connect()
        except CameraError as error:
            self._not_opened(error)
            return
        self._counts.reconnects += 1
        self._take_over(self._device, CameraEventKind.REOPENED)

    def _take_over(self, device: CameraDevice, kind: CameraEventKind) -> None:
        """Start afresh with a device that has just been opened."""
        self.read_back = device.read_back
        self._heard_s = self._clock()
        self._numbers.restart()
        self._stamper.restart()
        self._last_pixels, self._same, self._same_since_s = None, 0, None
        self._emit(kind, device.read_back.model)

    def _not_opened(self, error: CameraError) -> None:
        self._emit(CameraEventKind.NOT_OPENED, f"{error}; tried again in {self._backoff_s:.2g} s")
        self._later()

    def _later(self) -> None:
        self._retry_s = self._clock() + self._backoff_s
        self._backoff_s = min(2.0 * self._backoff_s, self._care.most_backoff_s)

    def _emit(self, kind: CameraEventKind, text: str) -> None:
        self._counts.events[kind] = self._counts.events.get(kind, 0) + 1
        self._on_event(CameraEvent(t_s=self._clock(), camera=self.name, kind=kind, text=text))
