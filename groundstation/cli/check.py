"""`groundstation check`: a test of each device of a station before the flight."""

import argparse

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.number_arguments import duration_s
from groundstation.cli.path_arguments import READ
from groundstation.cli.star_loader import load_stars

_CHECK = """Test each device of a station before the flight: is it there, does it answer,
how fast, does its clock hold; one line each, and what to do about it."""
_CHECK_MORE = """example:
  groundstation check field.toml

The heads are read, not moved; --move turns each by half a degree and back.

exit code: 0 all is well; 1 something is not; 2 wrong usage"""


def add_check(commands: Commands) -> None:
    """Add `check`."""
    check = add_command(
        commands, "check", run_check, "test each device of a station before the flight", _CHECK, _CHECK_MORE
    )
    check.add_argument("station", type=READ, metavar="STATION", help="station file, TOML")
    check.add_argument("--for", type=duration_s, default=3.0, dest="seconds", metavar="S", help="look so long (3)")
    check.add_argument("--move", action="store_true", help="turn each head by half a degree and back")


def run_check(options: argparse.Namespace) -> int:
    """Test each device and print a line for it."""
    from groundstation.live.check import check_station

    wrong = 0
    for line in check_station(options.station, options.seconds, move=options.move, stars=load_stars):
        print(("ok     " if line.good else "WRONG  ") + line.text, flush=True)
        wrong += not line.good
    return 1 if wrong else 0
