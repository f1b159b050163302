"""What stands in for a station's devices: the cameras and the station file of a simulated range."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from groundstation.live.station_file import StationFile
from groundstation.rig.rig import Rig
from groundstation.sinks.sink import Sink
from groundstation.sources.cameras.camera import CameraDevice


class StationSimulator(ABC):
    """A simulated range; its pan-tilt units and its receiver are opened by the URLs of the station file it returns.

    Attributes
    ----------
    delivery_s : from a picture's exposure to its delivery, s.
    """

    delivery_s: float

    @abstractmethod
    def station_file(self, station: Path | None, out: Path) -> StationFile:
        """Return the range's equipment: that of a station file, None for the simulator's own set-up."""

    @abstractmethod
    def check(self, rig: Rig) -> None:
        """Raise `InputError` where what is to be simulated does not fit the rig."""

    @abstractmethod
    def open(self, file: StationFile, out: Path, opened: ExitStack, say: Callable[[str], None]) -> StationFile:
        """Start the devices; ``opened`` ends them. Returns the file with the rate at which their pictures come."""

    def sinks(self) -> tuple[Sink, ...]:
        """Return what takes the reports of the operation, besides the operation's own files."""
        return ()

    @abstractmethod
    def kill(self) -> None:
        """End the devices' processes at once, from any thread: the station is ended by force while it starts."""

    @abstractmethod
    def begin(self, start_s: float) -> float:
        """Let the flight begin at ``start_s`` on the host's clock; returns when it does."""

    @abstractmethod
    def connect(self, name: str) -> CameraDevice:
        """Return one camera's connection."""
