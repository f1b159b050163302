"""Calibration on the command line: `groundstation calibrate WHAT …`."""

import argparse
import sys
from collections.abc import Callable

from groundstation.cli.calibrate_landmarks import add_landmark_kinds, run_calibrate_check, run_calibrate_survey
from groundstation.cli.calibrate_mount import add_mount, run_mount
from groundstation.cli.calibrate_timing import add_timing, run_timing
from groundstation.cli.number_arguments import parse_number
from groundstation.cli.path_arguments import READ, REPORT_FOLDER, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span
from groundstation.errors import InputError, UsageError

_INTRINSICS = """The lens of a camera from pictures of a board: corners to a fraction of a pixel,
views chosen, OpenCV's model k1 k2 p1 p2 k3, its covariance, and what it is good
for, judged on views that the lens was not fitted to."""
_INTRINSICS_MORE = """examples:
  groundstation calibrate intrinsics shots/ --out left.toml --report out/left \\
      --board charuco:9x7:0.04:0.03:DICT_4X4_50
  groundstation calibrate intrinsics board.mp4 --out cam.yaml --format kalibr \\
      --board chessboard:8x6:0.03
  groundstation calibrate intrinsics shots/ --board charuco:9x7:0.04:0.03 \\
      --rig rig.toml --station left --out better.toml

with --rig and --station, FILE is that rig with the station's lens and its
covariance replaced; without, a lens alone, never written over a rig

the board: charuco:COLSxROWS:SQUARE_M:MARKER_M[:DICT], counted in squares, or
chessboard:COLSxROWS:SQUARE_M, counted in inner corners; lengths in m

exit code: 0 done; 1 the pictures are at fault, and nothing is written; 2 wrong
usage; 130 interrupted"""
_CONVERT = """A lens from one format into another: the lens keys of rig.toml (or a whole
rig.toml), OpenCV's or ROS's YAML, Kalibr's camchain (pinhole-radtan)."""
_FLIGHT = """Calibrate stations on an aircraft's DGPS track and the pixels that they saw:
orientation, position, clocks; whatever the rig's `known` leaves open."""
_FLIGHT_MORE = """examples:
  groundstation calibrate flight SESSION --to 342 --out rig.toml --report out/rig
  groundstation replay SESSION --rig believed.toml --out out/before
  groundstation calibrate flight SESSION --rig believed.toml --out rig.toml \\
      --detections out/before/detections.csv --free orientation

LIST, with commas: orientation, position, boresight, camera_clock, drift,
ptu_clock, readout, lens, antenna. Of what is freed though it is known, the
rig's covariance (else 1 deg, 0.3 m, 0.1 s, 1 % of focal) stays as knowledge.
Stations without a pose: positions, shutters, drifts and lenses are freed where
the pixels contradict them; --hold keeps them.

exit code: 0 done; 1 the flight cannot teach that; 2 wrong usage"""
_UNCARRIED = (
    "the lens's covariance is not carried: Kalibr's camchain has no place for it (.toml and OpenCV's .yaml have)"
)
_HOLDABLE = ("k2", "k3", "p")


def add_calibrate(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `calibrate` and its subcommands."""
    calibrate = commands.add_parser(
        "calibrate",
        help="find what a rig file holds",
        description="Find what a rig file holds.",
    )
    kinds = calibrate.add_subparsers(dest="calibrate", metavar="WHAT", required=True)
    _add_flight(kinds)
    add_mount(kinds)
    add_timing(kinds)
    add_landmark_kinds(kinds)
    intrinsics = kinds.add_parser(
        "intrinsics",
        help="pictures of a board in, the lens out",
        description=_INTRINSICS,
        epilog=_INTRINSICS_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    intrinsics.add_argument(
        "images", type=READ, nargs="+", metavar="IMAGES", help="pictures, folders of them, or videos"
    )
    intrinsics.add_argument(
        "--board",
        required=True,
        metavar="SPEC",
        help="the board, see below",
    )
    intrinsics.add_argument(
        "--out", type=WRITTEN_FILE, required=True, metavar="FILE", help="the lens: .toml or .yaml; with --rig a rig"
    )
    intrinsics.add_argument("--rig", type=READ, metavar="RIG", help="write this rig with the lens, not the lens alone")
    intrinsics.add_argument("--station", metavar="NAME", help="whose lens it is in the rig")
    _add_format(intrinsics)
    intrinsics.add_argument(
        "--hold", type=_held, default=frozenset(), metavar="K", help="coefficients that stay zero: k3, k2, p; as k3,p"
    )
    intrinsics.add_argument(
        "--report", type=REPORT_FOLDER, metavar="DIR", help="write report.html and its pictures there"
    )
    convert = kinds.add_parser("convert-lens", help="a lens file in, another format out", description=_CONVERT)
    convert.add_argument("source", type=READ, metavar="IN", help="a lens file, a rig.toml or a camchain")
    convert.add_argument("out", type=WRITTEN_FILE, metavar="OUT", help="the lens: .toml or .yaml")
    _add_format(convert)
    convert.add_argument("--name", metavar="NAME", help="which station or camera, where there are several")
    convert.add_argument("--refit", action="store_true", help="put k3 into k1 and k2 where the format has none")


def _add_flight(kinds: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    flight = kinds.add_parser(
        "flight",
        help="from an aircraft's DGPS track and the pixels that saw it",
        description=_FLIGHT,
        epilog=_FLIGHT_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    flight.add_argument("session", type=READ, metavar="SESSION", help="session folder with dgps.csv")
    flight.add_argument("--out", type=WRITTEN_FILE, required=True, metavar="FILE", help="the rig file to write")
    flight.add_argument("--rig", type=READ, metavar="FILE", help="another rig than the session's rig.toml")
    flight.add_argument(
        "--detections", type=READ, metavar="FILE", help="pixels of an earlier replay: its detections.csv"
    )
    add_span(flight)
    flight.add_argument("--report", type=REPORT_FOLDER, metavar="DIR", help="write report.html and its pictures there")
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


def _add_format(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--format", choices=("toml", "opencv", "kalibr"), help="of the lens; .yaml is opencv unless said"
    )


def _held(text: str) -> frozenset[str]:
    """Return the coefficients of --hold."""
    names = frozenset(text.split(","))
    if not names <= set(_HOLDABLE):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted some of {', '.join(_HOLDABLE)}")
    return names


def _length(text: str) -> float:
    """Return a length in m that is 0 or more."""
    return parse_number(text, "metres, 0 or more", lambda value: 0.0 <= value < 100.0)


def run_calibrate(options: argparse.Namespace) -> int:
    """Run one calibration; returns the exit code."""
    return _KINDS[options.calibrate](options)


def _flight(options: argparse.Namespace) -> int:
    """Calibrate on a flight, print the report and the path."""
    from calibration.flight.calibrate import FlightRequest, calibrate_flight

    require_span(options)
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
        report=options.report,
        point_sigma_m=options.point_sigma,
    )
    found = calibrate_flight(request)
    print(found.report)
    print()
    for path in found.files:
        print(f"wrote {path}")
    return 0


def _intrinsics(options: argparse.Namespace) -> int:
    """Calibrate a lens, print the verdict and what was written."""
    from calibration.lens.advice import advise
    from calibration.lens.boards import parse_board
    from calibration.lens.intrinsics import calibrate_intrinsics
    from calibration.lens.lens_files import format_of, require_no_rig, write_lens
    from calibration.lens.report import write_lens_report
    from calibration.lens.rig import require_station, write_rig_with_lens
    from calibration.lens.summary import format_intrinsics
    from calibration.pictures import read_pictures
    from groundstation.rig.rig import load_rig

    _require_whole_rig(options)
    board = parse_board(options.board)
    form = format_of(options.out, options.format)
    rig = None if options.rig is None else load_rig(options.rig)
    if rig is None:
        require_no_rig(options.out)
    else:
        require_station(rig, options.station)
    # Kalibr's model has no k3: better fitted without it than bent afterwards
    held = options.hold | {"k3"} if form == "kalibr" else options.hold
    with ProgressLine(sys.stderr, "corners", "picture") as line:
        found = calibrate_intrinsics(
            read_pictures(options.images), board, held=held, progress=lambda n: line.update(n, None)
        )
    print(format_intrinsics(found, advise(found)))
    print()
    if rig is None:
        write_lens(options.out, found.calibrated, form)
        if form == "kalibr":
            print(_UNCARRIED)
    else:
        write_rig_with_lens(options.out, rig, options.station, found.calibrated)
        if "orientation" in rig[options.station].known:
            print(f"next: {options.station} was aimed with its lens of before: calibrate mount or survey it again")
    print(f"wrote {options.out}")
    if options.report is not None:
        for path in write_lens_report(options.report, found, options.out.stem):
            print(f"wrote {path}")
    return 0


def _require_whole_rig(options: argparse.Namespace) -> None:
    """Raise `UsageError` for one of --rig and --station without the other, or with another file than a rig's."""
    if (options.rig is None) != (options.station is None):
        got = "--rig without --station" if options.station is None else "--station without --rig"
        raise UsageError("--rig, --station", got=got, wanted="both, or neither for the lens alone")
    if options.rig is not None and (options.out.suffix != ".toml" or options.format not in (None, "toml")):
        raise UsageError("--rig", got=f"--out {options.out} for a rig", wanted="--out rig.toml, in the format toml")


def _convert(options: argparse.Namespace) -> int:
    """Convert a lens file."""
    from calibration.lens.lens_files import format_of, read_lens, write_lens
    from calibration.lens.model import without_k3

    form = format_of(options.out, options.format)
    calibrated = read_lens(options.source, options.name)
    if form == "kalibr" and options.refit and calibrated.lens.distortion[4] != 0.0:
        reduced = without_k3(calibrated)
        calibrated = reduced.calibrated
        print(f"k3 is now in k1 and k2; a pixel moves by at most {reduced.worst_px:.3f} px")
    write_lens(options.out, calibrated, form)
    print(f"wrote {options.out}")
    if form == "kalibr" and calibrated.covariance.any():
        print(_UNCARRIED)
    return 0


_KINDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "flight": _flight,
    "survey": run_calibrate_survey,
    "check": run_calibrate_check,
    "intrinsics": _intrinsics,
    "mount": run_mount,
    "timing": run_timing,
    "convert-lens": _convert,
}
