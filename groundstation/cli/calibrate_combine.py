"""`groundstation calibrate combine`: rigs of several sources made one, with one covariance."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_calibrated_rig, add_command, print_files
from groundstation.cli.number_arguments import positive_number
from groundstation.cli.path_arguments import READ
from groundstation.errors import UsageError

# beyond it a turn about one axis is not what the combination is linear in
_MOST_HEADING_DEG = 20.0
_COMBINE = """Make one rig with one covariance of several that calibrate the same heads: by
marks, the stars, airliners, a flight. Each counts by the covariance that it
states; rigs that contradict each other are refused."""
_MORE = """examples:
  groundstation calibrate combine marks.toml flight.toml --out rig.toml
  groundstation calibrate combine marks.toml --north stars.toml --north sky.toml \\
      --heading 1 --out rig.toml
  groundstation calibrate combine stars.toml sky.toml --prior workshop.toml \\
      --out rig.toml

how: a rig is taken for what it says of where its cameras look, whatever it has of
errors of the axes; these, clocks, and all that no rig states a sigma of are the
first's. Rigs must not share data: calibrate each from the workshop's rig, not from
one another's. What that rig states of its lenses and mounts is in each of them:
with --prior it is taken out of each that began with it, and counts once. --north names rigs whose azimuth is that
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
    parser.add_argument("--prior", type=READ, metavar="RIG", help="the rig that the others began with, counted once")
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
    from calibration.combination.fusion import combine
    from calibration.combination.html_report import write_combination_page
    from calibration.combination.shared_prior import RigSource
    from calibration.combination.text_report import format_combination
    from calibration.rig_output import require_toml_name, require_writable
    from calibration.stars.calibrate import write_noted_rig
    from groundstation.rig.rig import load_rig

    require_toml_name(options.out)
    require_writable(options.out, options.report)
    if options.heading > _MOST_HEADING_DEG:
        wanted = f"at most {_MOST_HEADING_DEG:g}: turn the rig by an azimuth first (calibrate survey)"
        raise UsageError("--heading", got=f"{options.heading:g} deg", wanted=wanted)
    paths = [*options.rigs, *options.north, *([] if options.prior is None else [options.prior])]
    _require_each_once(paths)
    short = len({path.name for path in paths}) == len(paths)
    names = {path: path.name if short else str(path) for path in paths}
    sources = [RigSource(name=names[path], rig=load_rig(path)) for path in options.rigs]
    sources += [RigSource(name=names[path], rig=load_rig(path), from_north=True) for path in options.north]
    prior = None if options.prior is None else RigSource(name=names[options.prior], rig=load_rig(options.prior))
    found = combine(sources, math.radians(options.heading), prior)
    print(format_combination(found))
    write_noted_rig(options.out, found.rig, ["# combined: " + ", ".join(source.name for source in found.sources)])
    print(f"\nwrote {options.out}")
    if options.report is not None:
        print_files(write_combination_page(options.report, found))
    return 0


def _require_each_once(paths: Sequence[Path]) -> None:
    """Raise `UsageError` for one file that is given twice, by whatever path."""
    seen: dict[Path, Path] = {}
    for path in paths:
        before = seen.setdefault(path.resolve(), path)
        if before is not path:
            raise UsageError(str(path), got=f"the same file as {before}", wanted="each rig once: twice it counts twice")
