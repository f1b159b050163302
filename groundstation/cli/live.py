"""`groundstation live`: the operation of a station."""

import argparse
import os
import sys
import time
from collections.abc import Collection
from typing import TYPE_CHECKING

from groundstation.cli.approach_arguments import add_approach, approach_options
from groundstation.cli.command_arguments import (
    Commands,
    add_command,
    add_port,
    add_simulated_flight,
    add_weights_option,
    require_web,
)
from groundstation.cli.left_files import INTERRUPTED, left_by
from groundstation.cli.number_arguments import duration_s
from groundstation.cli.path_arguments import NEW_FOLDER, READ
from groundstation.cli.star_loader import load_stars
from groundstation.cli.status_display import StatusDisplay
from groundstation.cli.stop_request import StopRequest
from groundstation.cli.terminal import print_line

if TYPE_CHECKING:
    from groundstation.live.command import LiveResult
    from groundstation.live.status_board import LiveStatus
    from groundstation.simulation.simulated_station import SimulatedStation
    from groundstation.simulation.simulation_score import SimulationScore

# a simulated aircraft is in view from the start, and found within some seconds
_LEAST_FLIGHT_S = 8.0
# of the pairs of a landing that is tracked late, half are tracked; of one that is lost at once, some in a hundred
_LEAST_SHARE = 0.1
_LIVE = """Operate a station: cameras and PTUs in, the aircraft's track out, live; heads
follow it, everything is recorded. Ctrl-C parks the heads and ends it within 3 s,
before it has begun once the step under way is done; parking may take longer
(park_s in the station file). So does a terminal that is
closed (unless under nohup); a second Ctrl-C does not park."""
_LIVE_MORE = """examples:
  groundstation live field.toml --view
  groundstation live field.toml --for 1800 --web
  groundstation live --simulate --out out/live --for 60 --web
  groundstation live --simulate --out out/gusts --for 60 --aircraft jsbsim --wind 6

--simulate needs no hardware: simulated PTUs on real serial lines (ptys), rendered
cameras that look where the PTUs look, one landing after the other.
--faults takes the file of `groundstation simulate`; its times count from the
moment the first landing begins. Of its faults there are here camera_lost,
camera_frozen, camera_late (pictures come late, with their right stamps),
camera_clock_step, ptu_silent, and with --dgps dgps_gap and dgps_clock_step; what
else befalls a PTU's line is --ptu-fault.
The station file: docs/live.md

exit code: 0 done; 1 a device or a file is at fault, nothing at all could be
recorded, a process that drives the heads was lost, even if it was begun again,
or a simulated flight was hardly tracked; 2 wrong usage; 130 interrupted
before a pair of pictures had come"""


def add_live(commands: Commands) -> None:
    """Add `live`."""
    live = add_command(commands, "live", run_live, "operate a station: track, point, record, live", _LIVE, _LIVE_MORE)
    live.add_argument("station", type=READ, nargs="?", metavar="STATION", help="station file, TOML")
    live.add_argument("--out", type=NEW_FOLDER, metavar="DIR", help="where it is recorded; new or empty")
    add_weights_option(live)
    live.add_argument("--for", type=duration_s, dest="seconds", metavar="S", help="end after so many seconds")
    live.add_argument("--simulate", action="store_true", help="with a range that is not there")
    live.add_argument("--rig", type=READ, metavar="FILE", help="with --simulate: another rig than the built-in one")
    live.add_argument(
        "--config", type=READ, metavar="FILE", help="with --simulate: tuning, TOML; otherwise the station file names it"
    )
    add_simulated_flight(live, None, "with --simulate: ")
    live.add_argument(
        "--ptu-fault",
        action="append",
        default=[],
        metavar="NAME",
        help="with --simulate: strikes each PTU's line six times a minute once it flies; may be repeated",
    )
    live.add_argument(
        "--faults", type=READ, metavar="FILE", help="with --simulate: what fails when, TOML as in simulate; see below"
    )
    live.add_argument("--dgps", action="store_true", help="with --simulate: a reference receiver on the aircraft")
    live.add_argument("--no-record", action="store_true", help="keep the track, not the pictures")
    live.add_argument(
        "--details", action="store_true", help="show each device's rate and clock, also if it is in order"
    )
    screen = live.add_mutually_exclusive_group()
    screen.add_argument("--view", action="store_true", help="the operator's screen in the desktop viewer")
    screen.add_argument("--web", action="store_true", help="the operator's screen in a browser on this machine")
    add_port(live)
    add_approach(live, "[origin] in the station file")


def run_live(options: argparse.Namespace) -> int:
    """Operate until the time is over or a stop is requested; returns the exit code."""
    require_web(options)
    from groundstation.live.command import LiveRequest, live
    from groundstation.live.status_watchdog import StatusWatchdog
    from ptu_drivers.simulated.faults import FAULTS

    wrong = _wrong_usage(options, FAULTS)
    if wrong:
        print(f"groundstation live: {wrong}", file=sys.stderr)
        return 2
    if options.port is not None:
        # before a range is built, which takes long
        from groundstation.viewer.viewer_process import free_port

        free_port(options.port)
    request = LiveRequest(
        station=options.station,
        out=options.out,
        seconds=options.seconds,
        screen="desktop" if options.view else "browser" if options.web else "none",
        record=not options.no_record,
        weights=options.weights,
        command=options.words,
        web_port=options.port,
        approach=approach_options(options),
        stars=load_stars,
    )
    began_s, stop = time.time(), StopRequest()
    simulator = _simulator(options, stop) if options.simulate else None

    def force_exit(line: str, begun: bool) -> None:
        words = line if begun else f"interrupted; {line}{left_by(options, began_s)}"
        end_by_force(words, 1 if begun else INTERRUPTED)

    with stop, StatusDisplay(sys.stderr, details=options.details) as display, StatusWatchdog(display.silent) as watch:

        def show_status(status: "LiveStatus") -> None:
            watch.notify()
            display.show(status)

        result = live(request, stop, show_status, lambda text: display.message(f"{text} …"), simulator, force_exit)
        display.close()
        score, missing = (
            (None, 0) if simulator is None else (simulator.score(result.begin_s), simulator.missing_pictures)
        )
        print_line(_result_text(result, score, missing), sys.stdout)
    if stop() and not result.operation.epochs and not result.losses:
        print_line("groundstation: interrupted; no pair of pictures had come", sys.stderr)
        return INTERRUPTED
    if result.lost:
        print_line("groundstation: nothing could be recorded", sys.stderr)
    for line in result.losses:
        print_line(f"groundstation: {line}", sys.stderr)
    untracked = _why_untracked(result) if simulator is not None else ""
    if untracked:
        print_line(f"groundstation: {untracked}", sys.stderr)
    return 1 if result.lost or result.losses or untracked else 0


def _simulator(options: argparse.Namespace, stop: StopRequest) -> "SimulatedStation":
    """Return the simulated range that the options ask for; raises `InputError` for faults that are none."""
    from groundstation.simulation.fault_timetable import simulated_device_faults
    from groundstation.simulation.flights import FlightModelKind
    from groundstation.simulation.render_flight import load_faults
    from groundstation.simulation.simulated_receiver import ReceiverModel
    from groundstation.simulation.simulated_station import SimulatedStation, SimulatedStationConfig

    failing = simulated_device_faults(
        () if options.faults is None else load_faults(options.faults),
        ReceiverModel() if options.dgps else None,
        str(options.faults),
    )
    return SimulatedStation(
        SimulatedStationConfig(
            seconds=options.seconds,
            rig=options.rig,
            tuning=options.config,
            rate_hz=options.rate,
            seed=options.seed,
            ptu_faults=tuple(options.ptu_fault),
            receiver=failing.receiver,
            timetable=failing.timetable,
            wind_m_s=options.wind,
            aircraft=FlightModelKind(options.aircraft),
        ),
        stop,
    )


def end_by_force(line: str, code: int) -> None:
    """End this process at once, if its regular end is blocked by a hanging thread."""
    print_line(f"groundstation: {line}", sys.stderr)
    os._exit(code)


def _wrong_usage(options: argparse.Namespace, faults: Collection[str]) -> str:
    """Return the conflict between options that are valid separately; "" for none."""
    if not options.simulate:
        if options.station is None:
            return "got no STATION; wanted a station file, or --simulate"
        defaults: dict[str, object] = {
            "rig": None,
            "config": None,
            "rate": None,
            "seed": 0,
            "wind": 0.0,
            "aircraft": "waves",
            "ptu_fault": [],
            "faults": None,
            "dgps": False,
        }
        alone = [name for name, default in defaults.items() if getattr(options, name) != default]
        return f"got --{alone[0].replace('_', '-')} without --simulate; wanted both" if alone else ""
    if options.station is not None:
        return f"got {options.station} and --simulate; wanted one of them: what is simulated has no station file"
    if options.out is None:
        return "got no --out; wanted a folder for what is recorded"
    unknown = [name for name in options.ptu_fault if name not in faults]
    return f"--ptu-fault: got {unknown[0]!r}; wanted one of {', '.join(faults)}" if unknown else ""


def _why_untracked(result: "LiveResult") -> str:
    """Return why a simulated flight was hardly tracked; "" if it was, or if it ended before it could be."""
    done = result.operation
    if done.tracked > _LEAST_SHARE * done.epochs or (done.epochs > 0 and done.elapsed_s < _LEAST_FLIGHT_S):
        return ""
    from groundstation.simulation.render_rate import FEWEST_PAIRS_HZ

    behind, rate_hz = done.dropped.get("pairs, being behind", 0), done.epochs / max(done.elapsed_s, 1e-9)
    if not done.epochs:
        reason = "no pair of pictures came"
    elif behind > done.epochs // 2:
        reason = f"the computer was behind, and {behind} pairs were dropped: try a lower --rate, or end other programs"
    elif rate_hz < FEWEST_PAIRS_HZ:
        reason = f"{rate_hz:.1f} pairs per s are too few to find and hold an aircraft: end other programs"
    else:
        seen = f"in {done.tracked or 'none'} of {done.epochs} pairs ({rate_hz:.1f} per s)"
        reason = f"{seen} was the aircraft found by both cameras"
    return f"{'hardly any' if done.tracked else 'no'} track: {reason}"


def _result_text(result: "LiveResult", score: "SimulationScore | None" = None, missing: int = 0) -> str:
    """Return the summary of a live run; ``missing`` pictures of a simulator did not come."""
    from groundstation.live.status_board import dropped_text
    from groundstation.simulation.simulation_score import format_score
    from groundstation.tracking.count_descriptions import describe_counts

    done = result.operation
    share = 100.0 * done.tracked / done.epochs if done.epochs else 0.0
    lines = [f"{done.epochs} pairs in {done.elapsed_s:.1f} s, tracking in {share:.1f} % of them"]
    if done.latency_p99_ms:
        lines.append(
            f"delay from a pair's first frame to its answer: median {done.latency_p50_ms:.1f} ms, "
            f"99 % within {done.latency_p99_ms:.1f} ms"
        )
    if done.tracking_p99_ms:
        lines.append(
            f"the same while tracking: median {done.tracking_p50_ms:.1f} ms, 99 % within {done.tracking_p99_ms:.1f} ms"
        )
    lines.append(f"the pipeline computed {100 * done.busy_s / done.elapsed_s:.0f} % of the time")
    if result.recorded:
        lines.append(f"recorded: {result.recorded}")
    if missing:
        lines.append(f"simulated pictures that did not come (not rendered in time, or a fault's): {missing}")
    if done.dropped:
        lines.append(dropped_text(done.dropped))
    lines += [f"counted: {what}" for what in describe_counts(done.counts)]
    if done.approach is not None and done.approach.text:
        lines += ["", done.approach.text]
    if score is not None:
        lines += ["", format_score(score)]
    lines += ["", *(f"wrote {path}" for path in result.files)]
    lines += [f"not whole: {what}" for what in result.incomplete]
    return "\n".join(lines)
