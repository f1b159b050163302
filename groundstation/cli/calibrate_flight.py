"""`groundstation calibrate flight`: a rig from an aircraft's DGPS track and the pixels of it."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_calibrated_rig, add_command, print_files, refuse_own_rig
from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import READ
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span

_FLIGHT = """Calibrate stations on an aircraft's DGPS track and their pixels of it:
orientation, position, clocks; whatever the rig's `known` leaves open."""
_FLIGHT_MORE = """examples:
  groundstation calibrate flight SESSION --to 342 --out rig.toml --report out/rig
  groundstation replay SESSION --rig stated.toml --out out/before
  groundstation calibrate flight SESSION --rig stated.toml --out rig.toml \\
      --detections out/before/detections.csv --free orientation

LIST, with commas: orientation, position, boresight, camera_clock, drift,
ptu_clock, readout, lens, antenna. Of what is freed though it is known, the
rig's covariance (else 1 deg, 0.3 m, 0.1 s, 1 % of focal) stays as knowledge,
of the antenna its sigmas in [reference] (else 0.5 m).
Stations without a pose: positions, shutters, drifts and lenses are freed where
the pixels contradict them; --hold keeps them.

exit code: 0 done; 1 the flight cannot teach that; 2 wrong usage"""


def add_flight(kinds: Commands) -> None:
    """Add `calibrate flight`."""
    flight = add_command(
        kinds, "flight", run_flight, "from an aircraft's DGPS track and its pixels", _FLIGHT, _FLIGHT_MORE
    )
    flight.add_argument("session", type=READ, metavar="SESSION", help="session folder with dgps.csv")
    flight.add_argument("--rig", type=READ, metavar="FILE", help="another rig than the session's rig.toml")
    flight.add_argument(
        "--detections", type=READ, metavar="FILE", help="pixels of an earlier replay: its detections.csv"
    )
    add_span(flight)
    add_calibrated_rig(flight)
    flight.add_argument("--free", default="", metavar="LIST", help="find these as well")
    flight.add_argument(
        "--hold", action="store_true", help="take surveyed positions as exact, even where the pixels contradict them"
    )
    flight.add_argument(
        "--point-sigma",
        type=_length,
        metavar="M",
        help="the point seen may lie so far along the body from where it is taken to be, 1 sigma (default 0.05 with "
        "--detections, else 0)",
    )


def _length(text: str) -> float:
    """Return a length in m that is 0 or more."""
    return parse_number(text, "metres, 0 or more", lambda value: 0.0 <= value < 100.0)


def run_flight(options: argparse.Namespace) -> int:
    """Calibrate on a flight, print the report and the path."""
    from calibration.flight.calibrate import FlightRequest, calibrate_flight

    require_span(options)
    refuse_own_rig(options)
    request = FlightRequest(
        session=options.session,
        out=options.out,
        rig=options.rig,
        detections=options.detections,
        from_s=options.from_s,
        to_s=options.to_s,
        free=options.free,
        hold=options.hold,
        report=options.report,
        point_sigma_m=options.point_sigma,
    )
    with ProgressLine(sys.stderr, "flight", "step") as line:
        found = calibrate_flight(request, line.update)
    print(found.report)
    print()
    print_files(found.files)
    return 0
