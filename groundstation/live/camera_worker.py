"""One station's camera on its way into the input queue: stamps into session time; repeated pictures are left out."""

import math
import threading

from groundstation.live.input_queue import DeviceLogLine, InputQueue, TimedPicture
from groundstation.sources.cameras.camera import CameraEvent, CameraEventKind
from groundstation.sources.cameras.live_camera import LiveCamera

# a read waits for a tenth of a second
_END_S = 0.5
_GOOD = (CameraEventKind.OPENED, CameraEventKind.REOPENED)


def reported(event: CameraEvent, session_from_host_s: float) -> DeviceLogLine:
    """Return what a camera has to say, for the operator."""
    level = "info" if event.kind in _GOOD else "warning"
    return DeviceLogLine(t_s=event.t_s + session_from_host_s, level=level, text=f"{event.camera}: camera {event.text}")


class CameraWorker:
    """Hands one camera's frames on."""

    def __init__(self, station: str, camera: LiveCamera, input_queue: InputQueue, session_from_host_s: float) -> None:
        self.station = station
        self.camera = camera
        self.frames = 0
        self.newest_s = -math.inf
        self.counts_before = camera.counts
        """What the camera had counted when its frames began to be taken."""
        self._input_queue = input_queue
        self._zero_s = session_from_host_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"frames-{station}", daemon=True)

    def start(self) -> None:
        """Start; frames that the camera's short queue dropped before are not counted as lost."""
        self.counts_before = self.camera.counts
        self._thread.start()

    def stop(self) -> None:
        """Stop; the caller closes the camera."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=_END_S)

    def _work(self) -> None:
        try:
            while not self._stop.is_set() and not self.camera.ended:
                frame = self.camera.read(0.1)
                if frame is None or frame.repeated:
                    continue
                self.frames += 1
                t_s = frame.t_s + self._zero_s
                self.newest_s = t_s if math.isfinite(t_s) else self.newest_s
                self._input_queue.put(
                    TimedPicture(
                        t_s=t_s,
                        arrived_s=frame.arrival_s + self._zero_s,
                        station=self.station,
                        picture=frame.picture,
                    )
                )
        except Exception as fault:  # noqa: BLE001 - one camera less is no reason to stop the others
            t_s = max(self.newest_s, 0.0)
            self._input_queue.put(
                DeviceLogLine(t_s=t_s, level="error", text=f"{self.station}: camera: {type(fault).__name__}: {fault}")
            )
