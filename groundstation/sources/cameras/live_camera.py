"""A supervised camera with its own thread and a short queue: reading it never waits longer than requested."""

import threading
from collections import deque
from collections.abc import Callable
from types import TracebackType

from groundstation.sources.cameras.camera import (
    Camera,
    CameraCounts,
    CameraDevice,
    CameraError,
    CameraEvent,
    CameraFrame,
    CameraSupervision,
    CameraTiming,
    Clock,
    SettingsReadBack,
)
from groundstation.sources.cameras.host_clock_fit import ClockFitState
from groundstation.sources.cameras.supervised import SupervisedCamera

# a device that hangs in its driver is left behind after so long
_JOIN_S = 3.0


class LiveCamera(Camera):
    """One camera that delivers on its own thread.

    Parameters
    ----------
    connect : opens and starts the device; raises `CameraError`.
    clock : the host's monotonic clock, s.
    on_event : called with each event as it happens, on the camera's thread.
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], CameraDevice],
        timing: CameraTiming,
        care: CameraSupervision,
        clock: Clock,
        on_event: Callable[[CameraEvent], None],
    ) -> None:
        self.name = name
        self._care = care
        self._stop = threading.Event()
        self._life = SupervisedCamera(name, connect, timing, care, clock, self._stop.wait, on_event)
        self._queue: deque[CameraFrame] = deque()
        self._arrived = threading.Condition()
        self._fault: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name=f"camera {name}", daemon=True)

    def __enter__(self) -> "LiveCamera":
        """Open the camera and start its thread; raises `CameraError` unless it is to be waited for."""
        try:
            self._life.open()
        except CameraError as error:
            if not self._care.wait_at_start:
                raise
            self._life.wait_before_reopening(error)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the thread, which closes the device."""
        self.stop()
        self.close(_JOIN_S)

    def stop(self) -> None:
        """Request the thread to end; never waits."""
        self._stop.set()

    def close(self, within_s: float) -> None:
        """Wait for the thread, which closes the device; one that hangs in its driver is left behind."""
        self.stop()
        if self._thread.is_alive():
            self._thread.join(within_s)

    def read(self, timeout_s: float) -> CameraFrame | None:
        """Return the next frame, None where none arrived in time; raises an error of the camera's thread."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._queue or self.ended, timeout_s)
            if self._queue:
                return self._queue.popleft()
        if self._fault is not None:
            raise self._fault
        return None

    @property
    def ended(self) -> bool:
        """Whether no frame will ever come again, apart from those that wait."""
        return self._life.ended or self._fault is not None

    @property
    def counts(self) -> CameraCounts:
        """Return a copy of the counts so far."""
        return self._life.counts()

    @property
    def read_back(self) -> SettingsReadBack | None:
        """Return the settings that were read back last."""
        return self._life.read_back

    @property
    def clock_state(self) -> ClockFitState | None:
        """Return the device's clock against the host's; None without one."""
        return self._life.clock_state

    def _run(self) -> None:
        try:
            while not self._stop.is_set() and not self._life.ended:
                frame = self._life.step()
                if frame is not None:
                    self._hand_on(frame)
        except BaseException as fault:  # noqa: BLE001 - a thread's fault is raised where its frames are read
            self._fault = fault
        finally:
            self._life.close()
            with self._arrived:
                self._arrived.notify_all()

    def _hand_on(self, frame: CameraFrame) -> None:
        with self._arrived:
            if len(self._queue) >= self._care.queue:
                self._queue.popleft()
                self._life.count_dropped()
            self._queue.append(frame)
            self._arrived.notify()
