"""The command line's `calibrate`: one sub-command for each way to find what a rig file holds."""

import argparse
from pathlib import Path

from groundstation.errors import InputError

_CALIBRATE = "Find what a rig file holds."
_FLIGHT = """Calibrate stations on an aircraft's DGPS track and the pixels that they saw:
orientation, position, clocks; whatever the rig's `known` leaves open."""
_FLIGHT_MORE = """example:
  groundstation calibrate flight SESSION --to 342 --out rig.toml

LIST, with commas: orientation, position, boresight, camera_clock, drift,
ptu_clock, readout, lens, antenna. Of what is freed though it is known, the
rig's covariance (else 1 deg, 0.3 m, 0.1 s, 1 % of focal) stays as knowledge.
Stations without a pose: positions, shutters, drifts and lenses are freed where
the pixels contradict them; --hold keeps them.

exit code: 0 done; 1 the flight cannot teach that; 2 wrong usage"""


def add_calibrate(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `calibrate` and its sub-commands to the command line."""
    calibrate = commands.add_parser("calibrate", help="find what a rig file holds", description=_CALIBRATE)
    kinds = calibrate.add_subparsers(dest="kind", metavar="KIND", required=True)
    _add_flight(kinds)


def run_calibrate(options: argparse.Namespace) -> int:
    """Run one kind of calibration; returns the exit code."""
    return _KINDS[options.kind](options)


def _add_flight(kinds: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    flight = kinds.add_parser(
        "flight",
        help="from an aircraft's DGPS track and the pixels that saw it",
        description=_FLIGHT,
        epilog=_FLIGHT_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    flight.add_argument("session", type=Path, metavar="SESSION", help="session folder with dgps.csv")
    flight.add_argument("--out", type=Path, required=True, metavar="FILE", help="the rig file to write")
    flight.add_argument("--rig", type=Path, metavar="FILE", help="another rig than the session's rig.toml")
    flight.add_argument(
        "--detections", type=Path, metavar="FILE", help="pixels of an earlier replay: its detections.csv"
    )
    flight.add_argument("--from", type=float, dest="from_s", metavar="S", help="start at this session time, s")
    flight.add_argument("--to", type=float, dest="to_s", metavar="S", help="stop at this session time, s")
    flight.add_argument("--free", default="", metavar="LIST", help="find these as well")
    flight.add_argument(
        "--hold", action="store_true", help="take surveyed positions as exact, even where the pixels contradict them"
    )


def _flight(options: argparse.Namespace) -> int:
    """Calibrate on a flight, print the report and the path."""
    from calibration.flight_session import FlightRequest, calibrate_flight

    if options.out.resolve() == (options.session / "rig.toml").resolve():
        wanted = "another file: a recording keeps the rig that it was made with"
        raise InputError(str(options.out), got="the session's own rig", wanted=wanted)
    request = FlightRequest(
        session=options.session,
        out=options.out,
        rig=options.rig,
        detections=options.detections,
        from_s=options.from_s,
        to_s=options.to_s,
        free=options.free,
        hold=options.hold,
    )
    print(calibrate_flight(request).report)
    print(f"\nwrote {options.out}")
    return 0


_KINDS = {"flight": _flight}
