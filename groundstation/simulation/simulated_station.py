"""`groundstation live --simulate`: simulated devices in place of a station's own, and the score of the flight."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from groundstation.live.abandonable import abandonable
from groundstation.live.station_file import StationFile, load_station
from groundstation.live.station_simulator import StationSimulator
from groundstation.rig.rig import Rig, load_rig
from groundstation.simulation.device_faults import TimedFault
from groundstation.simulation.device_simulator import DeviceSimulator, DeviceSimulatorConfig
from groundstation.simulation.fault_timetable import check_timetable
from groundstation.simulation.flights import FlightModelKind
from groundstation.simulation.render_rate import FEWEST_PAIRS_HZ, FULL_RATE_HZ
from groundstation.simulation.repeated_landings import landings
from groundstation.simulation.simulated_receiver import ReceiverModel
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.simulation.simulation_score import EstimateRecorder, SimulationScore, score
from groundstation.sinks.sink import Sink
from groundstation.sources.cameras.camera import CameraDevice
from groundstation.tracking.config import load_config
from groundstation.tracking.search_cost import search_pair_s


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedStationConfig:
    """Configuration of the simulated station.

    Attributes
    ----------
    seconds : how long the landings go on, s; None for as long as the operation.
    rig, rate_hz : of a set-up without a station file: its rig file (None for the standard rig), pictures a second
        (None for what this machine renders).
    tuning : of such a set-up: its tuning file; None for the default tuning.
    ptu_faults : names of `ptu_drivers.simulated.faults`, each over and over on each unit's line.
    receiver : a reference receiver on the aircraft; None for none.
    timetable : what fails when, s from the flight's time zero.
    wind_m_s, aircraft : what moves the aircraft.
    """

    seconds: float | None = None
    rig: Path | None = None
    tuning: Path | None = None
    rate_hz: float | None = 30.0
    seed: int = 0
    ptu_faults: tuple[str, ...] = ()
    receiver: ReceiverModel | None = None
    timetable: tuple[TimedFault, ...] = ()
    wind_m_s: float = 0.0
    aircraft: FlightModelKind = FlightModelKind.WAVES


class SimulatedStation(StationSimulator):
    """Repeated landings observed by rendered cameras on simulated pan-tilt units, in real time.

    Raises
    ------
    NoFlightModelError : the aircraft is JSBSim's and JSBSim is not installed.

    ``stop`` is whether an end is requested; a start that is under way then raises KeyboardInterrupt.
    """

    def __init__(self, config: SimulatedStationConfig, stop: Callable[[], bool] = lambda: False) -> None:
        self._config, self._stop = config, stop
        self._flight = landings(
            config.seconds or 1e9, seed=config.seed, wind_m_s=config.wind_m_s, aircraft=config.aircraft
        )
        self._kept = EstimateRecorder()
        self._rig: Rig | None = None
        self._range: DeviceSimulator | None = None
        self._begin_s = 0.0
        self.delivery_s = 0.0
        self._measures_rate = False

    def station_file(self, station: Path | None, out: Path) -> StationFile:
        """Return the given station file, or write a simulated one to ``out`` and return it."""
        if station is not None:
            return load_station(station)
        self._measures_rate = self._config.rate_hz is None
        rig = None if self._config.rig is None else load_rig(self._config.rig)
        # a file that cannot be read is at fault by its own name, not by that of the simulated station's
        load_config(self._config.tuning)
        rate_hz, dgps = self._config.rate_hz or FULL_RATE_HZ, self._config.receiver is not None
        return replace(simulated_station_file(out, rate_hz, rig, dgps=dgps), config=self._config.tuning)

    def check(self, rig: Rig) -> None:
        """Raise `InputError` if the fault timetable names a device that the rig does not have."""
        check_timetable(self._config.timetable, rig)
        self._rig = rig

    def open(self, file: StationFile, out: Path, opened: ExitStack, say: Callable[[str], None]) -> StationFile:
        """Start the device simulator in its own process; returns the file with the rate of its pictures."""
        say("building the simulated range")
        hardware = DeviceSimulatorConfig(
            rig=file.rig,
            folder=out,
            flight=self._flight,
            frame_rate_hz=None if self._measures_rate else file.rate_hz,
            seed=self._config.seed,
            ptu_faults=self._config.ptu_faults,
            receiver=self._config.receiver,
            timetable=self._config.timetable,
        )
        # known before it is ready: it may have to be ended while it starts
        self._range = DeviceSimulator(hardware, lambda: self._search_s(file), self._stop)
        opened.enter_context(self._range)
        self.delivery_s = self._range.delivery_s
        rate_hz = self._range.frame_rate_hz
        if self._measures_rate:
            say(f"{rate_hz:g} pairs/s is what this machine renders and searches: using it{_few(rate_hz)}")
        return replace(file, rate_hz=rate_hz)

    def _search_s(self, file: StationFile) -> float:
        """Return how long the station takes here to search a pair of pictures, s."""
        lenses = [station.lens for station in load_rig(file.rig).stations]
        detector = load_config(file.config).detection.detector
        # takes seconds on a busy machine
        return abandonable(lambda: search_pair_s(lenses, time.perf_counter, detector), self._stop)

    def kill(self) -> None:
        """End the devices' process at once, from any thread."""
        if self._range is not None:
            self._range.kill()

    @property
    def missing_pictures(self) -> int:
        """Pictures that were due and did not come, of all cameras: not rendered in time, or a fault's."""
        return 0 if self._range is None else sum(truth.missing for truth in self._range.truth.values())

    def sinks(self) -> tuple[Sink, ...]:
        """Return the sink that records the estimates for `score`."""
        return (self._kept,)

    def begin(self, start_s: float) -> float:
        """Start the first landing; return its time zero on the host clock, s."""
        self._begin_s = self._running().begin(start_s)
        return self._begin_s

    def connect(self, name: str) -> CameraDevice:
        """Return one camera's connection."""
        return self._running().connect(name)

    def score(self, begin_s: float) -> SimulationScore | None:
        """Compare with the truth; ``begin_s`` is the flight's time zero, session time. None if nothing was flown."""
        if self._range is None or self._rig is None:
            return None
        return score(self._flight, begin_s, self._kept.rows(), self._range.truth, self._rig, self._begin_s)

    def _running(self) -> DeviceSimulator:
        if self._range is None:
            raise RuntimeError("the simulated range is used before it is opened")
        return self._range


def _few(rate_hz: float) -> str:
    """Return what follows where the rate is too low for a track that holds."""
    if rate_hz >= FEWEST_PAIRS_HZ:
        return ""
    return " (too few to find and hold an aircraft for sure; programs that run next to it take the rest)"
