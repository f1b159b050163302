"""`groundstation calibrate combine`: rigs of several sources made one, with one covariance."""

import argparse
import math

from groundstation.cli.command_arguments import Commands, add_calibrated_rig, add_command, print_files
from groundstation.cli.number_arguments import positive_number
from groundstation.cli.path_arguments import READ

_COMBINE = """Make one rig with one covariance of several that calibrate the same heads: by
marks, the stars, airliners, a flight. Each counts by the covariance that it
states; rigs that contradict each other are refused."""
_MORE = """examples:
  groundstation calibrate combine marks.toml flight.toml --out rig.toml
  groundstation calibrate combine marks.toml --north stars.toml --north sky.toml \\
      --heading 1 --out rig.toml
  groundstation calibrate combine stars.toml sky.toml --out rig.toml

how: a rig is taken for what it says of where its cameras look, whatever it has of
errors of the axes; these, clocks, and all that no rig states a sigma of are the
first's. Rigs must not share data or what was known before: calibrate each from the
workshop's rig, not from one another's. --north names rigs whose azimuth is that
of [origin] (calibrate stars, calibrate sky), where the others' frame is that of the
marks: the two may be turned against each other by --heading.

exit code: 0 done; 1 rigs are of other heads or contradict each other, and no rig is
written; 2 wrong usage; 130 interrupted"""


def add_combine(kinds: Commands) -> None:
    """Add `calibrate combine`."""
    parser = add_command(
        kinds, "combine", run_calibrate_combine, "one rig of several sources, with one covariance", _COMBINE, _MORE
    )
    parser.add_argument("rigs", type=READ, nargs="+", metavar="RIG", help="rig files, in one frame")
    parser.add_argument(
        "--north", type=READ, action="append", default=[], metavar="RIG", help="a rig with true north's azimuth"
    )
    parser.add_argument(
        "--heading",
        type=positive_number,
        default=1.0,
        metavar="DEG",
        help="1 sigma of the frame's turn against --north's, deg (1)",
    )
    add_calibrated_rig(parser)


def run_calibrate_combine(options: argparse.Namespace) -> int:
    """Combine, print what each rig says and what is known together, write the rig."""
    from calibration.combination.fusion import RigSource, combine
    from calibration.combination.html_report import write_combination_page
    from calibration.combination.text_report import format_combination
    from calibration.rig_output import require_toml_name, require_writable
    from calibration.stars.calibrate import write_noted_rig
    from groundstation.rig.rig import load_rig

    require_toml_name(options.out)
    require_writable(options.out, options.report)
    sources = [RigSource(name=path.name, rig=load_rig(path)) for path in options.rigs]
    sources += [RigSource(name=path.name, rig=load_rig(path), from_north=True) for path in options.north]
    found = combine(sources, math.radians(options.heading))
    print(format_combination(found))
    write_noted_rig(options.out, found.rig, ["# combined: " + ", ".join(source.name for source in sources)])
    print(f"\nwrote {options.out}")
    if options.report is not None:
        print_files(write_combination_page(options.report, found))
    return 0
