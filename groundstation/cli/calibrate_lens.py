"""`groundstation calibrate intrinsics` and `calibrate convert-lens`: a camera's lens."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command, add_report, print_files
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.cli.wrong_usage import refused_as_usage
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
_UNCARRIED = (
    "the lens's covariance is not carried: Kalibr's camchain has no place for it (.toml and OpenCV's .yaml have)"
)
_HOLDABLE = ("k2", "k3", "p")


def add_intrinsics(kinds: Commands) -> None:
    """Add `intrinsics`."""
    intrinsics = add_command(
        kinds, "intrinsics", run_intrinsics, "pictures of a board in, the lens out", _INTRINSICS, _INTRINSICS_MORE
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
    add_report(intrinsics)


def add_convert_lens(kinds: Commands) -> None:
    """Add `convert-lens`."""
    convert = add_command(kinds, "convert-lens", run_convert_lens, "a lens file in, another format out", _CONVERT)
    convert.add_argument("source", type=READ, metavar="IN", help="a lens file, a rig.toml or a camchain")
    convert.add_argument("out", type=WRITTEN_FILE, metavar="OUT", help="the lens: .toml or .yaml")
    _add_format(convert)
    convert.add_argument("--name", metavar="NAME", help="which station or camera, where there are several")
    convert.add_argument("--refit", action="store_true", help="put k3 into k1 and k2 where the format has none")


def _add_format(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--format", choices=("toml", "opencv", "kalibr"), help="of the lens; .yaml is opencv unless stated"
    )


def _held(text: str) -> frozenset[str]:
    """Return the coefficients of --hold."""
    names = frozenset(text.split(","))
    if not names <= set(_HOLDABLE):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted some of {', '.join(_HOLDABLE)}")
    return names


def run_intrinsics(options: argparse.Namespace) -> int:
    """Calibrate a lens, print the verdict and what was written."""
    from calibration.lens.advice import advise
    from calibration.lens.boards import parse_board
    from calibration.lens.html_report import write_lens_report
    from calibration.lens.intrinsics import calibrate_intrinsics
    from calibration.lens.lens_files import format_of, require_no_rig, write_lens
    from calibration.lens.rig import other_size, require_station, write_rig_with_lens
    from calibration.lens.summary import format_intrinsics
    from calibration.pictures import read_pictures
    from groundstation.rig.rig import load_rig

    _require_whole_rig(options)
    with refused_as_usage():
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
        if note := other_size(rig, options.station, found.calibrated):
            print(f"groundstation: {options.images}: {note}", file=sys.stderr)
        write_rig_with_lens(options.out, rig, options.station, found.calibrated)
        if "orientation" in rig[options.station].known:
            print(f"next: {options.station} was aimed with its lens of before: calibrate mount or survey it again")
    print(f"wrote {options.out}")
    if options.report is not None:
        print_files(write_lens_report(options.report, found, options.out.stem))
    return 0


def _require_whole_rig(options: argparse.Namespace) -> None:
    """Raise `UsageError` for one of --rig and --station without the other, or with another file than a rig's."""
    if (options.rig is None) != (options.station is None):
        got = "--rig without --station" if options.station is None else "--station without --rig"
        raise UsageError("--rig, --station", got=got, wanted="both, or neither for the lens alone")
    if options.rig is not None and (options.out.suffix != ".toml" or options.format not in (None, "toml")):
        raise UsageError("--rig", got=f"--out {options.out} for a rig", wanted="--out rig.toml, in the format toml")


def run_convert_lens(options: argparse.Namespace) -> int:
    """Convert a lens file."""
    import numpy as np

    from calibration.lens.lens_files import format_of, read_lens, write_lens
    from calibration.lens.model import without_k3
    from groundstation.rig.rig_limits import focal_wanted

    with refused_as_usage():
        form = format_of(options.out, options.format)
    calibrated = read_lens(options.source, options.name)
    if wanted := focal_wanted(np.array(calibrated.lens.image_size_px), calibrated.lens.focal_px):
        got = f"a focal length of {calibrated.lens.focal_px[0]:g}, {calibrated.lens.focal_px[1]:g} px"
        raise InputError(str(options.source), got=got, wanted=wanted)
    if form == "kalibr" and options.refit and calibrated.lens.distortion[4] != 0.0:
        reduced = without_k3(calibrated)
        calibrated = reduced.calibrated
        print(f"k3 is now in k1 and k2; a pixel moves by at most {reduced.worst_px:.3f} px")
    write_lens(options.out, calibrated, form)
    print(f"wrote {options.out}")
    if form == "kalibr" and calibrated.covariance.any():
        print(_UNCARRIED)
    return 0
