"""The cameras of a station in operation: opened one after the other, closed together."""

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial

from groundstation.live.camera_worker import reported
from groundstation.live.devices import camera_of
from groundstation.live.head_device import DeviceError
from groundstation.live.operation import Operation
from groundstation.live.shutdown import Shutdown
from groundstation.live.station_file import StationFile
from groundstation.live.station_simulator import StationSimulator
from groundstation.sources.cameras.camera import CameraError, CameraEvent, CameraSupervision, CameraTiming, StampPoint
from groundstation.sources.cameras.live_camera import LiveCamera

# of the time for shutdown, what a camera's driver gets
_CAMERA_S = 0.8


@contextmanager
def opened_cameras(
    file: StationFile, operation: Operation, simulated: StationSimulator | None, shutdown: Shutdown
) -> Iterator[Mapping[str, LiveCamera]]:
    """Open all cameras, in the end asking all to stop before one is waited for. Raises `DeviceError`: one fails."""

    def tell(event: CameraEvent) -> None:
        operation.input_queue.put(reported(event, -operation.start_s))

    with ExitStack() as stack:
        cameras: dict[str, LiveCamera] = {}
        for station in file.stations:
            if simulated is None:
                camera = camera_of(station, time.monotonic, tell, rate_hz=file.rate_hz)
            else:
                timing = CameraTiming(stamp=StampPoint.MIDDLE, transfer_s=simulated.delivery_s)
                connect = partial(simulated.connect, station.name)
                camera = LiveCamera(station.name, connect, timing, CameraSupervision(), time.monotonic, tell)
            try:
                cameras[station.name] = stack.enter_context(camera)
            except CameraError as fault:
                raise DeviceError(f"{station.name} camera: {fault}") from fault
        try:
            yield cameras
        finally:
            for camera in cameras.values():
                camera.stop()
            for camera in cameras.values():
                camera.close(shutdown.left_s(_CAMERA_S))
