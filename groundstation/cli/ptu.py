"""Pan-tilt units on the command line: `groundstation ptu WHAT …`."""

import argparse
import math
import signal
import sys
import time

from groundstation.cli.command_arguments import Commands, Run, add_command
from groundstation.cli.number_arguments import finite_number, port_or_any, positive_number
from groundstation.cli.path_arguments import WRITTEN_FILE
from groundstation.cli.ptu_open import open_unit, warn_unguarded
from groundstation.errors import GroundstationError, UsageError

_PROBE = """Ask a pan-tilt unit what it is and how fast it answers: model, range, step, speeds,
what it can do, a histogram of the round trips, failures. Nothing moves."""
_MONITOR = """Watch a unit: where it is, how far from its limits, round trips, failures. Nothing moves."""
_JOG = """Turn a unit carefully, and report lag, stiction, missed steps. It is
halted on every way out: an error, Ctrl-C, a closed terminal."""
_SIMULATE = """Simulate a pan-tilt unit, on a pty or a TCP port of this machine, as it leaves the
factory: echo on, verbose, 9600 baud with its line times. Ends with Ctrl-C."""
_MORE = """examples:
  groundstation ptu simulate --link /tmp/unit &
  groundstation ptu probe /tmp/unit
  groundstation ptu monitor socket://192.168.0.20:4000 --seconds 10
  groundstation ptu jog /dev/ttyUSB0 --pan 10 --tilt -5 --rate 2
  groundstation ptu jog --station field.toml left --pan 10 --rate 2
  groundstation ptu probe /dev/ttyUSB1 --protocol pelco-d --option address=3
  groundstation ptu probe http://mount.local:11111 --protocol alpaca

URL: /dev/ttyUSB0, a pty, socket://HOST:PORT, rfc2217://HOST:PORT; for Alpaca
http://HOST:PORT

exit code: 0 done; 1 the unit, its line or a setting for it is at fault, or a
move missed its target; 2 wrong usage; 130 interrupted"""


def add_ptu(commands: Commands) -> None:
    """Add `ptu` and its subcommands."""
    ptu = commands.add_parser("ptu", help="pan-tilt units: what is it, how does it do, move it, simulate one")
    kinds = ptu.add_subparsers(dest="ptu", metavar="WHAT", required=True)
    probe = add_command(
        kinds, "probe", _handle_faults(_probe), "what is it, and how fast does it answer", _PROBE, _MORE
    )
    _add_line(probe)
    probe.add_argument("--seconds", type=positive_number, default=3.0, metavar="S", help="how long to ask, s (3)")
    monitor = add_command(kinds, "monitor", _handle_faults(_monitor), "watch it", _MONITOR, _MORE)
    _add_line(monitor)
    monitor.add_argument("--seconds", type=positive_number, metavar="S", help="stop after so long, s; else with Ctrl-C")
    jog = add_command(kinds, "jog", _handle_faults(_jog), "move it carefully", _JOG, _MORE)
    _add_line(jog)
    jog.add_argument("--pan", type=finite_number, metavar="DEG", help="pan to turn to, deg")
    jog.add_argument("--tilt", type=finite_number, metavar="DEG", help="tilt to turn to, deg")
    jog.add_argument("--by", action="store_true", help="turn by so much, from where it stands")
    slowly = "speed, deg/s; else a tenth of its fastest, or its own where it takes none"
    jog.add_argument("--rate", type=positive_number, metavar="DEG_S", help=slowly)
    jog.add_argument("--back", action="store_true", help="and turn back, to see what was lost")
    _add_simulate(kinds)


def _add_line(parser: argparse.ArgumentParser) -> None:
    from ptu_drivers.open import PROTOCOLS

    parser.add_argument("url", nargs="?", metavar="URL", help="the line, see below")
    parser.add_argument(
        "--station",
        nargs=2,
        metavar=("FILE", "NAME"),
        help="in place of URL: the head of a station file, with its settings, kept from the Sun and closed sectors",
    )
    parser.add_argument("--protocol", choices=tuple(PROTOCOLS), default="flir", help="protocol (flir)")
    parser.add_argument(
        "--baud", type=_baud, default=0, metavar="N", help="speed of the line; FLIR units are raised to it"
    )
    parser.add_argument(
        "--patience", type=positive_number, default=5.0, metavar="S", help="how long to look for it, s (5)"
    )
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        type=_option,
        metavar="NAME=VALUE",
        help="what only this protocol has, as address=3; may be repeated; a wrong name lists them",
    )
    for axis in ("pan", "tilt"):
        parser.add_argument(f"--{axis}-limits", type=_range, metavar="LOW,HIGH", help=f"keep {axis} between these, deg")


def _add_simulate(kinds: Commands) -> None:
    from ptu_drivers.simulated.faults import FAULTS
    from ptu_drivers.simulated.lines import OTHERS

    simulate = add_command(kinds, "simulate", _handle_faults(_simulate), "simulate one", _SIMULATE, _MORE)
    simulate.add_argument("--protocol", choices=("flir", *OTHERS), default="flir", help="what to speak (flir)")
    where = simulate.add_mutually_exclusive_group(required=True)
    where.add_argument("--link", type=WRITTEN_FILE, metavar="PATH", help="make a pty, and a link to it here")
    where.add_argument("--tcp", type=port_or_any, metavar="PORT", help="listen on this port of 127.0.0.1")
    simulate.add_argument("--series", choices=("e", "d"), help="E series, or D: 10 commands/s (e)")
    simulate.add_argument("--latency-ms", type=_latency, metavar="LOW,HIGH", help="of replies (2,8)")
    simulate.add_argument("--backlash-deg", type=finite_number, default=0.0, metavar="DEG", help="play of the head (0)")
    simulate.add_argument("--no-combined", action="store_true", help="supports neither B nor BT")
    simulate.add_argument("--banner", default="", metavar="TEXT", help="sent to each client that connects (TCP)")
    simulate.add_argument("--seed", type=int, default=0, metavar="N", help="of latencies and faults (0)")
    simulate.add_argument(
        "--fault",
        action="append",
        default=[],
        choices=tuple(FAULTS),
        metavar="NAME",
        help="strike this at random; may be repeated: " + ", ".join(FAULTS),
    )
    simulate.add_argument("--faults-per-minute", type=positive_number, default=6.0, metavar="N", help="how often (6)")


def _handle_faults(command: Run) -> Run:
    """Return a command that ends with a message on a fault of the unit, and quietly on Ctrl-C."""

    def run(options: argparse.Namespace) -> int:
        from ptu_drivers import errors

        try:
            return command(options)
        except errors.PtuError as fault:
            raise GroundstationError(str(fault)) from fault
        except KeyboardInterrupt:
            print("groundstation: interrupted", file=sys.stderr)
            return 130

    return run


def _probe(options: argparse.Namespace) -> int:
    """Print the identity and the response times of a unit."""
    from ptu_drivers.monitor import format_description, format_watched, watch

    with open_unit(options) as unit:
        print(format_description(unit.describe()))
        print()
        print(format_watched(watch(unit, options.seconds, time.monotonic, time.sleep), unit.describe()))
    return 0


def _monitor(options: argparse.Namespace) -> int:
    """Print a line a second, and the summary at the end."""
    from ptu_drivers import NoReading
    from ptu_drivers.monitor import PollMonitor, format_watched

    with open_unit(options) as unit:
        seen = PollMonitor(unit, time.monotonic)
        shown = time.monotonic()
        try:
            while options.seconds is None or seen.duration_s < options.seconds:
                got = seen.step(time.sleep)
                if time.monotonic() - shown >= 1.0:
                    shown = time.monotonic()
                    if isinstance(got, NoReading):
                        print(f"no angle: {got.reason}, {got.state}", flush=True)
                    else:
                        pan, tilt = math.degrees(got.pan.angle_rad), math.degrees(got.tilt.angle_rad)
                        print(f"pan {pan:9.4f}  tilt {tilt:9.4f} deg  {seen.rate_hz:5.1f}/s", flush=True)
        except KeyboardInterrupt:
            print()
        print(format_watched(seen.result(), unit.describe()))
    return 0


def _jog(options: argparse.Namespace) -> int:
    """Turn a unit and print the result; returns 1 if it missed its target."""
    from ptu_drivers import Axis, Capability
    from ptu_drivers.monitor import MoveResult, first_reading, format_moved, halted, move

    wanted = {axis: math.radians(v) for axis, v in zip(Axis, (options.pan, options.tilt), strict=True) if v is not None}
    if not wanted:
        raise UsageError("jog", got="no angle", wanted="--pan, --tilt or both")
    reports: list[MoveResult] = []
    with open_unit(options) as unit:
        reported = unit.describe()
        start = first_reading(unit, time.monotonic, time.sleep, options.patience)
        warn_unguarded(options)
        at = {Axis.PAN: start.pan.angle_rad, Axis.TILT: start.tilt.angle_rad}
        if options.by:
            wanted = {axis: at[axis] + value for axis, value in wanted.items()}
        axes = [reported.axis(axis) for axis in wanted]
        slow = max(0.1 * min(a.max_rate_rad_s for a in axes), *(a.min_rate_rad_s for a in axes))
        rate: float | None = math.radians(options.rate) if options.rate else slow
        if options.rate is None and Capability.SPEED not in reported.capabilities:
            rate = None
        try:
            for targets in (wanted, {axis: at[axis] for axis in wanted}) if options.back else (wanted,):
                for moved in move(unit, targets, rate, time.monotonic, time.sleep):
                    print(format_moved(moved), flush=True)
                    reports.append(moved)
        except KeyboardInterrupt:
            print(f"groundstation: interrupted; {halted(unit)}", file=sys.stderr)
            return 130
    return 1 if any(m.lost_steps > 1 for m in reports) else 0


def _simulate(options: argparse.Namespace) -> int:
    """Serve a simulated unit until interrupted."""
    from ptu_drivers.simulated.server import SimulatedServer

    name, line = _simulated_flir(options) if options.protocol == "flir" else _simulated_other(options)
    server = SimulatedServer(
        line,
        options.tcp if options.link is None else options.link,
        faults=options.fault,
        faults_per_minute=options.faults_per_minute if options.fault else 0.0,
        seed=options.seed,
        on_fault=lambda name: print(f"fault: {name}", flush=True),
    )
    # the link is removed however it ends
    signal.signal(signal.SIGTERM, lambda *_: server.stop())
    print(f"{name} simulated at {server.url}", flush=True)
    server.run()
    return 0


def _simulated_other(options: argparse.Namespace):  # type: ignore[no-untyped-def] # as for open_unit
    from ptu_drivers.simulated.lines import simulated_line

    for name, value in (
        ("--fault", options.fault[0] if options.fault else ""),
        ("--series", options.series or ""),
        ("--latency-ms", "{:g},{:g}".format(*options.latency_ms) if options.latency_ms else ""),
        ("--no-combined", "it" if options.no_combined else ""),
        ("--banner", options.banner),
    ):
        if value:
            raise GroundstationError(f"{name}: got {value} for protocol {options.protocol}; wanted flir")
    line = simulated_line(
        options.protocol,
        start_s=time.monotonic(),
        network=options.link is None,
        play_deg=options.backlash_deg,
        seed=options.seed,
    )
    return options.protocol, line


def _simulated_flir(options: argparse.Namespace):  # type: ignore[no-untyped-def] # as for open_unit
    from ptu_drivers.simulated.flir import D_SERIES, FlirModel
    from ptu_drivers.simulated.flir_line import DEFAULT_BAUD, LineModel, SimulatedUnit
    from ptu_drivers.simulated.line import VirtualLine

    base = D_SERIES if options.series == "d" else FlirModel()
    knows = base.combined and not options.no_combined
    model = base.replace(combined=knows, device_clock=knows, play=options.backlash_deg * 3600.0 / base.arcsec)
    low, high = options.latency_ms or (2.0, 8.0)
    baud = 0 if options.link is None else DEFAULT_BAUD
    line_model = LineModel(
        baud=baud,
        latency_s=(low / 1e3, high / 1e3),
        commands_per_s=10.0 if options.series == "d" else 0.0,
        banner=options.banner,
    )
    unit = SimulatedUnit(model, line_model, seed=options.seed)
    return model.model or "PTU-D46", VirtualLine(unit, baud, start_s=time.monotonic(), seed=options.seed)


def _latency(text: str) -> tuple[float, float]:
    low, high = _range(text)
    if low < 0:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted LOW,HIGH, 0 or more")
    return low, high


def _option(text: str) -> tuple[str, object]:
    """Return name and value of --option."""
    name, sep, value = text.partition("=")
    if not (sep and name.isidentifier()):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted NAME=VALUE")
    if value in ("true", "false"):
        return name, value == "true"
    for kind in (int, float):
        try:
            return name, kind(value)
        except ValueError:
            continue
    return name, value


def _baud(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted a speed in bit/s, as 9600")
    return int(text)


def _range(text: str) -> tuple[float, float]:
    parts = text.split(",")
    if len(parts) != 2 or not finite_number(parts[0]) < finite_number(parts[1]):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted LOW,HIGH, LOW below HIGH")
    return finite_number(parts[0]), finite_number(parts[1])
