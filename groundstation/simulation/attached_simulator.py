"""A simulated range that somebody else runs: whoever operates it may end, however that is, and another may begin."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

from groundstation.live.station_file import StationFile
from groundstation.live.station_simulator import StationSimulator
from groundstation.rig.rig import Rig
from groundstation.simulation.device_simulator import DeviceSimulator, SimulatedCameraDevice
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.sources.cameras.camera import CameraDevice


class AttachedSimulator(StationSimulator):
    """The range as one station after the other meets it; it goes to a process when that is made, not later.

    Parameters
    ----------
    lender : running, and kept running. file : the station that stands there.
    begin_s : the flight's time zero, which the lender has set, on the host's clock.
    """

    def __init__(self, lender: DeviceSimulator, file: StationFile, begin_s: float) -> None:
        self.file = file
        self.delivery_s = lender.delivery_s
        self.truth = {name: NoseTruth() for name in lender.truth}
        self._begin_s = begin_s
        self._ends: Mapping[str, tuple[str, Connection, tuple[int, int]]] = lender.ends()
        self._memory: dict[str, SharedMemory] = {}

    def station_file(self, station: Path | None, out: Path) -> StationFile:
        """Return the station that stands there, whatever else is asked for."""
        return self.file

    def check(self, rig: Rig) -> None:
        """Any rig fits: nothing is to fail by a timetable."""

    def open(self, file: StationFile, out: Path, opened: ExitStack, say: Callable[[str], None]) -> None:
        """It runs already."""

    def begin(self, start_s: float) -> float:
        """Return when the flight began: it goes on as it was."""
        return self._begin_s

    def connect(self, name: str) -> CameraDevice:
        """Return one camera's connection; pictures that nobody took are gone."""
        block, pipe, size_px = self._ends[name]
        while pipe.poll(0):
            pipe.recv()
        self._memory[name] = self._memory.get(name) or SharedMemory(name=block)
        return SimulatedCameraDevice(name, self._memory[name], pipe, size_px, self.truth[name])
