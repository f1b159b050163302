"""One camera of the device simulator, as the station in operation reads it."""

from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory

import numpy as np

from groundstation.picture import BayerPattern
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.sources.cameras.camera import CameraDevice, CameraLostError, GrabbedFrame, SettingsReadBack

# pictures of one camera in shared memory
SLOTS = 8
PATTERN = BayerPattern.RG


class SimulatedCameraDevice(CameraDevice):
    """One simulated camera with the interface of `groundstation.sources.cameras`."""

    def __init__(
        self, name: str, memory: SharedMemory, pipe: Connection, size_px: tuple[int, int], nose_truth: NoseTruth
    ) -> None:
        self._name = name
        self._pipe = pipe
        self._nose_truth = nose_truth
        w, h = size_px
        self._slots = np.ndarray((SLOTS, h, w), np.uint8, buffer=memory.buf)
        self.read_back = SettingsReadBack(
            model="simulated camera", size_px=size_px, pixel_format=PATTERN.value, device_clock=True
        )

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame, or None after the timeout."""
        try:
            if not self._pipe.poll(timeout_s):
                return None
            slot, number, device_ns, t_s, u_px, v_px = self._pipe.recv()
        except (EOFError, OSError) as fault:
            raise CameraLostError(f"{self._name}: the simulated range has ended") from fault
        self._nose_truth.add(number, t_s, u_px, v_px)
        pixels = self._slots[slot].copy()
        return GrabbedFrame(
            frame_id=number, device_ns=device_ns, pixels=pixels, pattern=PATTERN, payload_bytes=int(pixels.nbytes)
        )

    def close(self) -> None:
        """Release the shared memory; the simulator keeps running."""
