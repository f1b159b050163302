"""Implementation of `groundstation live`: open all devices, operate until a stop is requested, return a summary."""

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from groundstation.approach.approach_options import (
    ApproachOptions,
    SessionTime,
    open_approach,
    station_options,
)
from groundstation.errors import InputError
from groundstation.estimation.parameters import ParameterPrior
from groundstation.live.abandonable import abandonable
from groundstation.live.core import live_config
from groundstation.live.devices import check_against_rig, of_one_host
from groundstation.live.guarded_sink import GuardedSink
from groundstation.live.head_manager import CLOSE_S, HeadManager
from groundstation.live.keep_out_zones import with_keep_out
from groundstation.live.live_stars import StarLoader, registered_heads
from groundstation.live.memory import configure_allocator
from groundstation.live.opened_cameras import opened_cameras
from groundstation.live.operation import ApproachOpener, Operation, OperationOutputs, OperationResult, StatusSink
from groundstation.live.operator_screen import StatusCallback, open_screen
from groundstation.live.out_folder import StartingFolder, operation_folder, removed_unless_started, written_files
from groundstation.live.provenance_file import write_provenance
from groundstation.live.record import LiveRecorder, live_header, live_reference, open_recorder
from groundstation.live.reference_set_up import ReferenceReceiver, reference_tuning
from groundstation.live.set_up_report import report_set_up
from groundstation.live.shutdown import Shutdown
from groundstation.live.station_file import StationFile, load_station
from groundstation.live.station_simulator import StationSimulator
from groundstation.live.status_board import LiveStatus
from groundstation.recording.mcap_metadata import RecordingHeader
from groundstation.replay.reference_prior import ReferencePrior
from groundstation.rig.rig import Rig
from groundstation.session.load import LIVE_RECORDING
from groundstation.sinks.sink import Sink
from groundstation.sinks.track_files import TrackFilesSink
from groundstation.tracking.config import Config, load_config, with_weights
from groundstation.tracking.warm_up import warm_up

_BEGIN_AFTER_S = 3.0
# ends the program; gets a line about that, and whether the operation had begun
ForceExit = Callable[[str, bool], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveRequest:
    """Options of one run of `groundstation live`.

    ``station`` None only with a simulator. ``out`` None is a folder of its own below the station file's [record]
    folder. ``seconds`` None continues until ``stop``. ``screen`` is "desktop", "browser" or "none",
    ``web_port`` the browser's page's port, None for any. ``weights``
    are one's own for the learned channel, which then detects. ``approach`` is what is wanted of an approach, over what
    the station file asks for. ``command`` is the command line without the program, empty if there is none. ``stars``
    loads what takes head angles from stars, which the station file may ask for.
    """

    station: Path | None
    out: Path | None
    seconds: float | None = None
    screen: str = "none"
    record: bool = True
    weights: Path | None = None
    web_port: int | None = None
    approach: ApproachOptions = field(default_factory=ApproachOptions)
    command: tuple[str, ...] = ()
    stars: StarLoader | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveResult:
    """Result of a run: the operation's figures and the files written.

    ``files`` are those with something in them. ``incomplete`` states in a line each what the disk did not take,
    ``recorded`` how much it took, and how much a second; ``lost`` is that a recording was wanted and nothing of it is
    there. ``begin_s`` is when the operation began, with a simulator the flight's time zero, session time. ``losses``
    states in a line each which of the heads' processes were lost, and which head may still turn.
    """

    operation: OperationResult
    files: tuple[Path, ...]
    begin_s: float = 0.0
    incomplete: tuple[str, ...] = ()
    recorded: str = ""
    lost: bool = False
    losses: tuple[str, ...] = ()


def live(
    request: LiveRequest,
    stop: Callable[[], bool],
    tell: Callable[[LiveStatus], None],
    say: Callable[[str], None],
    simulator: StationSimulator | None = None,
    force_exit: ForceExit | None = None,
) -> LiveResult:
    """Operate a station. ``tell`` receives the status twice a second, ``say`` progress lines during start-up.

    ``simulator`` stands in for the devices. ``force_exit`` ends the program
    at once where its end hangs beyond the time for it (`Shutdown`); it then gets a line about that, and whether the
    operation had begun. Before that, the folder is left as it was.

    Raises `InputError`, `ConfigError` or `DeviceError`, one line each, where it cannot begin, and KeyboardInterrupt
    where ``stop`` is set before it has begun.
    """
    out = operation_folder(request.out, request.station)
    configure_allocator()
    with removed_unless_started(out) as folder:
        forced = None if force_exit is None else partial(_forced, force_exit, folder, simulator)
        return _live(request, out, folder.keep, stop, tell, partial(_step, stop, say), simulator, forced)


def _live(
    request: LiveRequest,
    out: Path,
    begun: Callable[[], None],
    stop: Callable[[], bool],
    tell: Callable[[LiveStatus], None],
    say: Callable[[str], None],
    simulator: StationSimulator | None,
    force_exit: Callable[[str], None] | None,
) -> LiveResult:
    """Operate into ``out``; ``begun`` is called once everything is open."""
    station = _load(request, out, simulator)
    # not before all files are known to be good
    out.mkdir(parents=True, exist_ok=True)
    with ExitStack() as opened:
        shutdown = Shutdown(stop, station.file.park_s, force_exit=force_exit)
        # after everything else, however it ends
        opened.callback(shutdown.done)
        # the bound holds from here on: compiling and opening can hang as operating can
        shutdown.watch()
        if simulator is not None:
            station = _described(simulator.open(station.file, out, opened, say), station.rig, request)
        file, rig = station.file, station.rig
        start_s = time.monotonic()
        # they are opened while this process compiles
        heads = HeadManager({s.name: s.head for s in file.stations if s.head is not None}, start_s)
        opened.callback(heads.close)
        shutdown.on_begin(heads.announce_end)
        heads.begin()
        abandonable(partial(warm_up, station.config.detection.detector), stop)
        outputs = _Outputs(out, opened, tell, simulator, station.approach(request.approach, start_s))
        write_provenance(out, request.command, request.station, file, outputs.faults)
        if (recorder := outputs.open_recorder(station) if request.record else None) is not None:
            shutdown.watch_recorder(lambda: recorder.status.written_bytes)
        outputs.open_screen(request, station, shutdown, say)
        operation = station.operation(request, outputs.of_operation(), start_s)
        report_set_up(file, rig, station.reference, operation.log, say)
        reference = ReferenceReceiver(
            file, station.reference, operation.input_queue, start_s=start_s, folder=out, faults=outputs.faults
        )
        opened.callback(reference.close)
        say("opening the PTUs")
        heads.opened(stop)
        say("opening the cameras")
        cameras = opened.enter_context(opened_cameras(file, operation, simulator, shutdown))
        # halted before anything else is closed
        opened.callback(lambda: heads.close(shutdown.left_s(CLOSE_S)))
        begin_s = time.monotonic() + _BEGIN_AFTER_S
        if simulator is not None:
            begin_s = simulator.begin(begin_s)
        begun()
        end_s = math.inf if request.seconds is None else begin_s + request.seconds
        result = operation.run(
            cameras, heads, lambda: shutdown.requested() or time.monotonic() >= end_s, reference.worker, shutdown
        )
        reference.close(recorder)
    return outputs.result(result, begin_s - start_s, tuple(heads.log.losses))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LiveStation:
    """What a station's files say, before anything is opened."""

    file: StationFile
    rig: Rig
    config: Config
    header: RecordingHeader
    reference: ReferencePrior

    def reference_errors(self) -> ParameterPrior | None:
        """Return the prior of the reference's errors; None if the filter does not learn from it."""
        return self.reference.errors if self.header.learns_from_reference else None

    def operation(self, request: LiveRequest, outputs: OperationOutputs, start_s: float) -> Operation:
        """Return the operation; ``start_s`` is session zero, monotonic."""
        return Operation(
            self.file,
            self.rig,
            self.config,
            outputs,
            start_s=start_s,
            reference_errors=self.reference_errors(),
            heads=registered_heads(self.file, self.rig, request.stars, _unix_s(start_s)),
        )

    def approach(self, asked: ApproachOptions, start_s: float) -> ApproachOpener | None:
        """Return what opens the outputs of an approach, None for none; ``start_s`` is session zero, monotonic."""
        file = self.file
        options = station_options(asked, file.landing_site, file.autopilot)
        if not options.wanted:
            return None
        unix_s = _unix_s(start_s)
        return lambda estimate_at, now_s: open_approach(
            options,
            self.rig,
            file.span_m,
            file.origin,
            file.geoid_separation_m,
            SessionTime(now_s=now_s, link_s=start_s, unix_s=unix_s),
            estimate_at,
        )


def _unix_s(monotonic_s: float) -> float:
    """Return the Unix time of a monotonic one, by the clock as it is now."""
    return time.time() - (time.monotonic() - monotonic_s)


def _load(request: LiveRequest, out: Path, simulator: StationSimulator | None) -> _LiveStation:
    """Read and check the files of a station; raises `InputError` or `ConfigError`."""
    file = _file(request) if simulator is None else simulator.station_file(request.station, out)
    check_against_rig(file, rig := file.load_rig())
    # a panorama or stars that cannot be used are an error before any device is opened
    registered_heads(file, rig, request.stars, time.time())
    file = with_keep_out(file, rig, time.monotonic(), time.time())
    if simulator is not None:
        simulator.check(rig)
    return _described(file, of_one_host(rig), request)


def _described(file: StationFile, rig: Rig, request: LiveRequest) -> _LiveStation:
    """Return what follows from the files of a station, and from the rate at which its pictures come."""
    tuning = with_weights(load_config(file.config), request.weights)
    config = live_config(reference_tuning(tuning, file.reference), file.rate_hz, rig)
    header = live_header(file, config)
    return _LiveStation(file=file, rig=rig, config=config, header=header, reference=live_reference(header, rig, config))


class _Outputs:
    """Track files, recorder and screen of an operation; ``faults`` collects what the disk did not take."""

    def __init__(
        self,
        out: Path,
        opened: ExitStack,
        tell: Callable[[LiveStatus], None],
        simulator: StationSimulator | None,
        approach: ApproachOpener | None,
    ) -> None:
        self.faults: list[str] = []
        self._out, self._opened = out, opened
        tables = GuardedSink(TrackFilesSink(out), self.faults)
        opened.callback(tables.close)
        self._sinks: list[Sink] = [tables, *(() if simulator is None else simulator.sinks())]
        self._operators: list[StatusSink] = [StatusCallback(tell)]
        self._recorder: LiveRecorder | None = None
        self._screen_status: Callable[[], str] = str
        self._keep_images = False
        self._approach = approach

    def open_recorder(self, station: _LiveStation) -> LiveRecorder:
        """Open the recorder."""
        self._recorder = self._opened.enter_context(
            open_recorder(self._out / LIVE_RECORDING, station.rig, station.header)
        )
        self._sinks.append(self._recorder)
        return self._recorder

    def open_screen(
        self, request: LiveRequest, station: _LiveStation, shutdown: Shutdown, say: Callable[[str], None]
    ) -> None:
        """Open the operator's screen that is requested."""
        self._keep_images = request.screen != "none"
        self._screen_status = open_screen(
            request.screen,
            station.rig,
            station.file,
            self._opened,
            shutdown,
            self._sinks,
            self._operators,
            say,
            request.web_port,
        )

    def of_operation(self) -> OperationOutputs:
        """Return the outputs that were opened."""
        return OperationOutputs(
            sinks=self._sinks,
            recorders=[] if self._recorder is None else [self._recorder],
            operators=self._operators,
            approach=self._approach,
            extra_status=self._status,
            keep_images=self._keep_images,
        )

    def result(self, result: OperationResult, begin_s: float, losses: tuple[str, ...]) -> LiveResult:
        """Return the result of the run, after everything was closed."""
        if result.approach is not None:
            try:
                result.approach.write(self._out)
            except InputError as fault:
                self.faults.append(str(fault))
        recorder = self._recorder
        if recorder is not None and recorder.status.trouble:
            self.faults.insert(0, f"{LIVE_RECORDING}: {recorder.summary()}")
        return LiveResult(
            operation=result,
            files=written_files(self._out),
            begin_s=begin_s,
            incomplete=tuple(self.faults),
            recorded="" if recorder is None else recorder.written_summary(),
            lost=recorder is not None and recorder.status.written_bytes == 0,
            losses=losses,
        )

    def _status(self) -> str:
        recording = "not recording" if self._recorder is None else self._recorder.summary()
        return ", ".join(w for w in (recording, self._screen_status(), *self.faults) if w)


def _forced(force_exit: ForceExit, folder: StartingFolder, simulator: StationSimulator | None, line: str) -> None:
    """End by force; of a start nothing is left, and nothing that could still write into its folder."""
    begun = folder.kept
    if not begun:
        if simulator is not None:
            simulator.kill()
        folder.restore()
    force_exit(line, begun)


def _step(stop: Callable[[], bool], say: Callable[[str], None], text: str) -> None:
    """Report the next step; raises KeyboardInterrupt if a stop was requested."""
    if stop():
        raise KeyboardInterrupt
    say(text)


def _file(request: LiveRequest) -> StationFile:
    if request.station is None:
        raise InputError("STATION", got="none", wanted="a station file, or --simulate")
    return load_station(request.station)
