"""`groundstation autopilot WHAT …`: a vehicle's autopilot, before anything is sent to it."""

import argparse
import sys

from groundstation.autopilot.settings import AutopilotMode, load_autopilot, with_link
from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.number_arguments import positive_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.wrong_usage import refused_as_usage

_CHECK = """Ask a vehicle for its parameters, and say which of them make its autopilot ignore or
misuse the position that `live --autopilot` would send. Nothing is changed on it."""
_CHECK_MORE = """examples:
  groundstation autopilot check udpin:14550 --mode gps_input --out vehicle.parm
  groundstation autopilot check /dev/ttyUSB0:57600 --mode odometry
  groundstation autopilot check udpout:192.168.0.7:14550 --settings autopilot.toml

modes: gps_input (ArduPilot), global_position (PX4), vision, odometry
URL: udpin:[HOST:]PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/SERIAL[:BAUD];
settings, messages and what each autopilot does with them: docs/autopilot.md

exit code: 0 done; 1 no vehicle answers, or a parameter makes it ignore or misuse
the position; 2 wrong usage; 130 interrupted"""
_MODE = "which message carries the position: " + ", ".join(AutopilotMode)


def add_autopilot(commands: Commands) -> None:
    """Add `autopilot` and its subcommand."""
    autopilot = commands.add_parser("autopilot", help="an aircraft's autopilot: will it use the position sent to it")
    kinds = autopilot.add_subparsers(dest="autopilot", metavar="WHAT", required=True)
    check = add_command(kinds, "check", run_check_vehicle, "ask for its parameters", _CHECK, _CHECK_MORE)
    check.add_argument("url", metavar="URL", help="the link to the vehicle, see below")
    check.add_argument("--mode", choices=[str(m) for m in AutopilotMode], metavar="MODE", help=_MODE)
    check.add_argument("--settings", type=READ, metavar="FILE", help="autopilot file, TOML, with the mode and more")
    check.add_argument(
        "--patience", type=positive_number, default=10.0, metavar="S", help="how long to wait for it, s (10)"
    )
    check.add_argument("--out", type=WRITTEN_FILE, metavar="FILE", help="write the parameters recommended")


def run_check_vehicle(options: argparse.Namespace) -> int:
    """Check a vehicle, print the findings; returns the exit code."""
    from groundstation.autopilot.link_url import parse_link_url
    from groundstation.autopilot.parameter_check import check_vehicle
    from groundstation.files.whole_file import write_text_whole

    with refused_as_usage():
        parse_link_url(options.url)
    file = None if options.settings is None else load_autopilot(options.settings)
    result = check_vehicle(with_link(file, options.url, options.mode), options.patience)
    print(result.vehicle)
    for finding in result.findings:
        print(finding.text())
    print(result.clock.text())
    if options.out is not None:
        write_text_whole(options.out, result.parameter_file)
        print(f"wrote {options.out}")
    if not result.whole:
        print("groundstation: the autopilot would ignore or misuse the position; see above", file=sys.stderr)
    return 0 if result.whole else 1
