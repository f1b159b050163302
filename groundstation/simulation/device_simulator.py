"""Real-time simulator of a station's devices: PTUs and a receiver on ptys, cameras through shared memory.

It runs in a process of its own, so that the station in operation is alone in hers, as it would be in the field: they
meet at ptys, and at pictures that arrive through shared memory with a frame number and a device's stamp, like those of
a camera on a network. The truth is sent with each picture, for the evaluation only.
"""

import contextlib
import math
import multiprocessing as mp
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from statistics import median
from types import TracebackType

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.compilation import compilation_sent, reported
from groundstation.live.child_process import group_signals_blocked, terminal_signals_blocked
from groundstation.live.simulated_latency import DelayLine
from groundstation.rig.rig import Rig, load_rig
from groundstation.simulation.delayed_trajectory import DelayedTrajectory
from groundstation.simulation.device_faults import (
    CAMERA_CLOCK_STEPPED,
    CAMERA_FROZEN,
    CAMERA_LATE,
    CAMERA_LOST,
    TimedFault,
    is_there,
    size_s,
    strike,
)
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.simulation.render_rate import FULL_RATE_HZ, sustainable_rate_hz
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.simulated_camera_device import SLOTS, SimulatedCameraDevice
from groundstation.simulation.simulated_receiver import ReceiverModel, SimulatedReceiver
from groundstation.simulation.trajectory import Trajectory
from groundstation.sources.cameras.camera import CameraDevice, CameraError
from groundstation.thread_scheduling import give_way, short_gil_switch_interval
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer

_MEASURED_PAIRS = 15
_READY_S, _LOOK_S, _END_S = 600.0, 0.1, 0.5
_ARCSEC = 3600.0
# distance of the aircraft before the flight starts, m
_FAR_OFF_S = 3600.0
# history of head angles that is kept, s
_REMEMBERED_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSimulatorConfig:
    """Configuration of the simulated devices.

    Attributes
    ----------
    rig : the rig file; the simulated hardware is exactly that.
    folder : where the links to the ptys are made.
    flight : the target point over time; started by `DeviceSimulator.begin`; far away before.
    frame_rate_hz : of both cameras, triggered together; None for what this machine renders next to the pipeline.
    delivery_s : from mid-exposure to the picture's arrival; longer where rendering takes longer.
    baud : of the PTUs' lines.
    ptu_faults, ptu_faults_per_minute : names of `ptu_drivers.simulated.faults.FAULTS`, and how often one strikes a PTU
        once the flight has begun.
    receiver : the reference receiver on the aircraft's nose, at the link ``dgps``; None for none.
    timetable : faults at stated times of the flight.
    """

    rig: Path
    folder: Path
    flight: Trajectory
    frame_rate_hz: float | None = 30.0
    delivery_s: float = 0.035
    baud: int = 115200
    ptu_faults: tuple[str, ...] = ()
    ptu_faults_per_minute: float = 6.0
    receiver: ReceiverModel | None = None
    timetable: tuple[TimedFault, ...] = ()
    seed: int = 0


class DeviceSimulator:
    """The simulator as the station connects to it; a context manager. Raises `CameraError` if it cannot be started.

    ``search_s`` measures how long the station takes to search a pair of pictures, s, where the rate is to be measured.
    ``stop`` is whether an end is requested; the start then raises KeyboardInterrupt.
    """

    def __init__(
        self,
        config: DeviceSimulatorConfig,
        search_s: Callable[[], float] = lambda: 0.0,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self._config, self._search_s, self._stop = config, search_s, stop
        rig = load_rig(config.rig)
        self.urls = {s.name: str(config.folder / f"ptu-{s.name}") for s in rig.stations if not s.fixed}
        self.truth = {name: NoseTruth() for name in rig.names}
        self._sizes = {s.name: s.lens.image_size_px for s in rig.stations}
        self._memory: dict[str, SharedMemory] = {}
        self._pipes: dict[str, Connection] = {}
        self._process: BaseProcess | None = None
        self._control: Connection | None = None
        self.frame_rate_hz = config.frame_rate_hz or FULL_RATE_HZ

    def __enter__(self) -> "DeviceSimulator":
        self._config.folder.mkdir(parents=True, exist_ok=True)
        context = mp.get_context("spawn")
        ends: dict[str, Connection] = {}
        for name, (w, h) in self._sizes.items():
            with terminal_signals_blocked():
                self._memory[name] = SharedMemory(create=True, size=SLOTS * w * h)
            self._pipes[name], ends[name] = context.Pipe(duplex=False)
        self._control, other = context.Pipe()
        blocks = {name: memory.name for name, memory in self._memory.items()}
        process = context.Process(target=serve_devices, args=(self._config, blocks, ends, other), daemon=True)
        with group_signals_blocked():  # SIGTERM for good: heads are parked on its units
            process.start()
        self._process = process
        for end in (*ends.values(), other):
            end.close()
        try:
            pair_s = self._answer(self._control)
            self.frame_rate_hz = self._config.frame_rate_hz or sustainable_rate_hz(pair_s, self._search_s())
            self._control.send(self.frame_rate_hz)
        except (EOFError, OSError) as fault:
            self.__exit__(None, None, None)
            raise CameraError("simulated range: it ended while starting; its own words are above") from fault
        except BaseException:
            # it hears no request to stop while it builds the range
            process.kill()
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            if self._control is not None and self._process.is_alive():
                with contextlib.suppress(OSError):
                    self._control.send("stop")
            self._process.join(_END_S)
            if self._process.is_alive():
                self._process.kill()
        for memory in self._memory.values():
            memory.close()
            memory.unlink()
        self._memory = {}

    def _answer(self, control: Connection) -> float:
        """Return what its process measured; raises `CameraError` where none comes, KeyboardInterrupt for a stop."""
        until_s = time.monotonic() + _READY_S
        while not self._stop():
            if time.monotonic() > until_s:
                raise CameraError("simulated range: got no answer; wanted it to start")
            if control.poll(_LOOK_S) and (answer := reported(control.recv())) is not None:
                return float(answer)
        raise KeyboardInterrupt

    def kill(self) -> None:
        """End its process at once, from any thread; the context is not left by that."""
        process = self._process
        if process is not None:
            process.kill()
            wait([process.sentinel], _END_S)

    @property
    def delivery_s(self) -> float:
        """Minimum delay from mid-exposure to the arrival of a picture, s."""
        return self._config.delivery_s

    def begin(self, start_s: float) -> float:
        """Set time zero of the flight to an instant of the host clock, s, and return it."""
        if self._control is not None:
            self._control.send(start_s)
        return start_s

    def ends(self) -> dict[str, tuple[str, Connection, tuple[int, int]]]:
        """Return the shared memory name, pipe and size in px of each camera, for use in another process."""
        return {name: (self._memory[name].name, self._pipes[name], size) for name, size in self._sizes.items()}

    def connect(self, name: str) -> CameraDevice:
        """Return one camera's connection; raises `CameraError` if the simulator has ended."""
        if self._process is None or not self._process.is_alive():
            raise CameraError(f"{name}: the simulated range has ended")
        return SimulatedCameraDevice(name, self._memory[name], self._pipes[name], self._sizes[name], self.truth[name])


# ---------------------------------------------------------------------------------------- its own process
@dataclass(slots=True)
class _Station:
    """One simulated station."""

    name: str
    camera: RenderedCamera
    unit: SimulatedUnit
    server: SimulatedServer
    arcsec: float

    def angles(self, t_s: float) -> tuple[float, float, float, float]:
        """Return pan, tilt and their rates, rad and rad/s, at a past time."""
        scale = math.radians(self.arcsec / _ARCSEC)
        with self.server.lock:
            axes = self.unit.flir.axes
            pan, tilt = axes["P"], axes["T"]
            values = (pan.head(t_s), tilt.head(t_s), pan.speed(t_s), tilt.speed(t_s))
            for axis in (pan, tilt):
                axis.forget_before(t_s - _REMEMBERED_S)
        return values[0] * scale, values[1] * scale, values[2] * scale, values[3] * scale


def serve_devices(
    config: DeviceSimulatorConfig, blocks: Mapping[str, str], pipes: Mapping[str, Connection], control: Connection
) -> None:
    """Run the devices until a stop request, or until the pipe to the parent process is closed."""
    rig = load_rig(config.rig)
    flight = DelayedTrajectory(config.flight, time.monotonic() + _FAR_OFF_S)
    world = RenderedScene(trajectory=flight)
    stations = [_made(rig, number, world, config) for number in range(len(rig.stations))]
    stop = threading.Event()
    memories = {name: SharedMemory(name=block) for name, block in blocks.items()}
    with compilation_sent(control.send):
        for station in stations:
            # compile the kernels before the first picture is due
            station.camera.picture(time.monotonic(), 0.0, 0.0)
    try:
        control.send(0.0 if config.frame_rate_hz else _rendered_pair_s(stations))
        rate_hz = control.recv()
    except (EOFError, OSError):
        return
    first_s = time.monotonic() + 0.5
    threads = [
        threading.Thread(
            target=_deliver, args=(s, memories[s.name], pipes[s.name], config, rate_hz, flight, first_s, stop)
        )
        for s in stations
    ]
    threads += [threading.Thread(target=s.server.run, daemon=True) for s in stations]
    if config.receiver is not None:
        receiver = SimulatedReceiver(
            config.folder / "dgps", config.receiver, flight, lambda: flight.start_s, config.seed
        )
        threads.append(threading.Thread(target=receiver.run, args=(stop,), daemon=True))
    for thread in threads:
        thread.daemon = True
        thread.start()
    with short_gil_switch_interval(), contextlib.suppress(EOFError, OSError):
        while (message := control.recv()) != "stop":
            flight.start_s = float(message)
            for number, s in enumerate(stations):
                strike(s.server, config.timetable, s.name, flight.start_s, config.seed + number)
                s.server.strike(config.ptu_faults, config.ptu_faults_per_minute)
    stop.set()
    for station in stations:
        station.server.stop()
    for thread in threads:
        thread.join(1.0)


def _made(rig: Rig, number: int, world: RenderedScene, config: DeviceSimulatorConfig) -> _Station:
    station = rig.stations[number]
    arcsec = math.degrees(station.ptu_resolution_rad) * _ARCSEC or FlirModel().arcsec
    counts = round(90.0 * _ARCSEC / arcsec)
    model = FlirModel(arcsec=arcsec, pan=(-counts, counts), tilt=(-counts // 3, counts // 2), min_rate=0, homing_s=8.0)
    unit = SimulatedUnit(model, LineModel(baud=config.baud), seed=config.seed + number)
    line = VirtualLine(unit, config.baud, start_s=time.monotonic(), seed=config.seed + number)
    server = SimulatedServer(
        line,
        config.folder / f"ptu-{station.name}",
        seed=config.seed + number,
    )
    camera = RenderedCamera(world, station, seed=config.seed, number=number)
    camera.draw_surroundings()
    return _Station(name=station.name, camera=camera, unit=unit, server=server, arcsec=arcsec)


def _rendered_pair_s(stations: Sequence[_Station]) -> float:
    """Return how long this machine renders one picture of each station now, as it will in operation, s."""
    times_s: list[float] = []
    together = threading.Barrier(len(stations), action=lambda: times_s.append(time.monotonic()))

    def render(station: _Station) -> None:
        give_way()
        try:
            for _ in range(_MEASURED_PAIRS):
                together.wait()
                station.camera.picture(time.monotonic(), 0.0, 0.0)
            together.wait()
        except threading.BrokenBarrierError:
            return
        except BaseException:
            together.abort()
            raise

    threads = [threading.Thread(target=render, args=(station,), daemon=True) for station in stations]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return median(after - before for before, after in pairwise(times_s))


def _deliver(
    station: _Station,
    memory: SharedMemory,
    pipe: Connection,
    config: DeviceSimulatorConfig,
    rate_hz: float,
    flight: DelayedTrajectory,
    first_s: float,
    stop: threading.Event,
) -> None:
    """Expose, render and deliver frames; a frame that cannot be rendered in time is dropped."""
    (w, h), period_s, number = station.camera.station.lens.image_size_px, 1.0 / rate_hz, 0
    slots = np.ndarray((SLOTS, h, w), np.uint8, buffer=memory.buf)
    frozen: ImageArray | None = None
    line = DelayLine(pipe, time.monotonic)
    give_way()  # lowers the priority of rendering only: delivery stays punctual
    while not stop.is_set() and not line.broken:
        t_s = first_s + number * period_s
        wait_s = t_s - time.monotonic()
        if wait_s > 0:
            stop.wait(wait_s)
        elif wait_s < -3.0 * period_s:
            # machine too slow for this rate: drop frames, as a real camera does on a busy bus
            number += math.ceil(-wait_s / period_s)
            continue
        since_s = t_s - flight.start_s
        if is_there(config.timetable, CAMERA_LOST, station.name, since_s):
            number += 1
            continue
        frozen = frozen if is_there(config.timetable, CAMERA_FROZEN, station.name, since_s) else None
        angles = station.angles(t_s)
        picture = station.camera.picture(t_s, *angles)
        shown = picture.recordable(Box(0, 0, w, h)).pixels if frozen is None else frozen
        if is_there(config.timetable, CAMERA_FROZEN, station.name, since_s):
            frozen = shown
        slots[number % SLOTS] = shown
        truth = station.camera.truth(t_s, *angles, silhouette=False)
        u, v = (math.nan, math.nan) if truth.pixel_px is None else (float(x) for x in truth.pixel_px)
        late_s = size_s(config.timetable, CAMERA_LATE, station.name, since_s)
        stamp_s = t_s + size_s(config.timetable, CAMERA_CLOCK_STEPPED, station.name, since_s)
        line.send(t_s + config.delivery_s + late_s, (number % SLOTS, number, round(stamp_s * 1e9), t_s, u, v))
        number += 1
    line.close()
