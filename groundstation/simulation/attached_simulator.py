"""Access of one station process after another to a device simulator that the parent process runs."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

from groundstation.live.station_file import StationFile
from groundstation.live.station_simulator import StationSimulator
from groundstation.rig.rig import Rig
from groundstation.simulation.device_simulator import DeviceSimulator
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.simulation.simulated_camera_device import SimulatedCameraDevice
from groundstation.sources.cameras.camera import CameraDevice


class AttachedSimulator(StationSimulator):
    """A running device simulator as seen by a station process; it is passed to the process at its creation.

    Parameters
    ----------
    simulator : started, and kept running by the parent process. file : the station file of its devices.
    begin_s : time zero of the flight on the host clock.
    """

    def __init__(self, simulator: DeviceSimulator, file: StationFile, begin_s: float) -> None:
        self.file = file
        self.delivery_s = simulator.delivery_s
        self.truth = {name: NoseTruth() for name in simulator.truth}
        self._begin_s = begin_s
        self._ends: Mapping[str, tuple[str, Connection, tuple[int, int]]] = simulator.ends()
        self._memory: dict[str, SharedMemory] = {}

    def station_file(self, station: Path | None, out: Path) -> StationFile:
        """Return the station file of the simulator; the arguments are ignored."""
        return self.file

    def check(self, rig: Rig) -> None:
        """Do nothing: there is no fault timetable."""

    def open(self, file: StationFile, out: Path, opened: ExitStack, say: Callable[[str], None]) -> StationFile:
        """Return the file: the simulator is already running."""
        return file

    def kill(self) -> None:
        """Do nothing: the simulator belongs to the parent process."""

    def begin(self, start_s: float) -> float:
        """Return the start time of the flight, which is not changed."""
        return self._begin_s

    def connect(self, name: str) -> CameraDevice:
        """Return one camera's connection; pictures that were not fetched are discarded."""
        block, pipe, size_px = self._ends[name]
        while pipe.poll(0):
            pipe.recv()
        self._memory[name] = self._memory.get(name) or SharedMemory(name=block)
        return SimulatedCameraDevice(name, self._memory[name], pipe, size_px, self.truth[name])
