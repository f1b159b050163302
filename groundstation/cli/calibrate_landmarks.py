"""The command line of what is calibrated on landmarks: `groundstation calibrate survey` and `check`."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from groundstation.cli.command_arguments import Commands, Run, add_calibrated_rig, add_command, add_report, print_files
from groundstation.cli.number_arguments import positive_number
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.errors import UsageError

if TYPE_CHECKING:
    from calibration.landmarks.jobs import ComparisonOutcome
    from calibration.sightings import Landmark, LandmarkSighting
    from groundstation.rig.rig import Rig

_SURVEY = """Poses of stations, from surveyed landmarks in their pictures: all
stations and landmarks in one adjustment, no first guess needed."""
_SURVEY_MORE = """example:
  groundstation calibrate survey sightings.csv --landmarks landmarks.csv \\
      --rig lenses.toml --out rig.toml --report out/survey

how: aim each station at four or more landmarks in different directions; at
each, wait until it stands and note 40 or more rows of angles and pixel; leave
for the next one, and come back to the first at the end. A station's position is
found too unless the rig has known = ["position", ...]; its covariance there is
how well. The sightings are kept next to the rig, for check. LIST, with commas:
position, boresight, focal: find these within the rig's covariance (else
0.3 m, 1 deg, 1 %), though they are known.
Tables: docs/formats.md

exit code: 0 done; 1 the tables are at fault or determine no pose, and no rig
is written; 2 wrong usage"""
_CHECK = """Two minutes before a session: whether any mount has moved since the rig was
calibrated, by two or more landmarks from each station."""
_CHECK_MORE = """examples:
  groundstation calibrate check today.csv --landmarks landmarks.csv --rig rig.toml
  groundstation calibrate check today.csv --landmarks landmarks.csv \\
      --rig rig.toml --out today.toml
  groundstation calibrate check --stars tonight/ --site field.toml --rig stars.toml

how: from each station aim at the landmarks (the runway's corners will do) and
note 40 or more rows at each, six landmarks better than two. They are compared
with the sightings of the survey, which it has kept next to the rig (rig.toml has
rig.sightings.csv), or with another such table, --reference: errors of the
landmarks' coordinates then do not matter, and six times 40 rows find 0.01 deg
about any axis. Without any (--reference none) only 0.03 deg or so are seen.
--stars compares with the sky, by pictures as calibrate stars takes them.
False alarms: at most 1 in 100 checks, over all stations and axes together.
Without --out, a mount that moved is refused; with it, a corrected rig is
written. Every check adds a line to the record.

exit code: 0 as calibrated, or corrected; 1 refused, or a table at fault;
2 wrong usage"""


def add_landmark_kinds(kinds: Commands) -> None:
    """Add `survey` and `check`."""
    survey = _add(
        kinds,
        "survey",
        run_calibrate_survey,
        "from surveyed landmarks: positions and orientations",
        _SURVEY,
        _SURVEY_MORE,
    )
    survey.add_argument("--free", default="", metavar="LIST", help="find these as well")
    survey.add_argument(
        "--oriented",
        type=positive_number,
        metavar="DEG",
        help="the heads stand as the rig has them (calibrate stars): its orientations and their covariance count, too, "
        "but for a heading that all share, known to DEG",
    )
    add_calibrated_rig(survey)
    check = add_command(
        kinds, "check", run_calibrate_check, "before a session: has a mount moved?", _CHECK, _CHECK_MORE
    )
    _add_tables(check, required=False)
    check.add_argument("--stars", type=READ, metavar="DIR", help="pictures of the stars with pictures.csv, for tables")
    check.add_argument("--site", type=READ, metavar="FILE", help="with --stars: a file with [origin]")
    check.add_argument(
        "--clock-sigma", type=positive_number, metavar="S", help="with --stars: 1 sigma of the stamps, s (0.1)"
    )
    check.add_argument(
        "--out", type=WRITTEN_FILE, metavar="FILE", help="write the rig there, corrected where mounts moved"
    )
    check.add_argument(
        "--reference",
        type=READ,
        metavar="FILE",
        help="sightings of the same landmarks when the rig was calibrated (default: next to the rig, .sightings.csv)",
    )
    check.add_argument(
        "--record",
        type=WRITTEN_FILE,
        metavar="FILE",
        help="where to add the record (default: next to the rig, .checks.jsonl)",
    )
    add_report(check)
    check.add_argument(
        "--runway",
        metavar="NAMES",
        help="these landmarks, four or more with commas, are the runway's corners, all seen in one look: each camera's "
        "pose by them must agree with the rig's, too, or the rig is refused",
    )
    check.add_argument(
        "--alarm-deg",
        type=float,
        default=0.01,
        metavar="DEG",
        help="report whether a turn this small could have been missed (default 0.01)",
    )


def _add(kinds: Commands, name: str, run: Run, summary: str, description: str, more: str) -> argparse.ArgumentParser:
    parser = add_command(kinds, name, run, summary, description, more)
    _add_tables(parser, required=True)
    return parser


def _add_tables(parser: argparse.ArgumentParser, *, required: bool) -> None:
    many = None if required else "?"
    parser.add_argument(
        "sightings", type=READ, nargs=many, metavar="SIGHTINGS", help="table of what was seen: sightings.csv"
    )
    parser.add_argument("--landmarks", type=READ, required=required, metavar="FILE", help="table of the landmarks")
    parser.add_argument("--rig", type=READ, required=True, metavar="FILE", help="the rig file")


def run_calibrate_survey(options: argparse.Namespace) -> int:
    """Survey, print what was found and the paths."""
    from calibration.landmarks.jobs import SurveyRequest, run_survey

    done = run_survey(
        SurveyRequest(
            sightings=options.sightings,
            landmarks=options.landmarks,
            rig=options.rig,
            out=options.out,
            free=options.free,
            report=options.report,
            heading_sigma_deg=options.oriented,
        )
    )
    print(done.text)
    print()
    print_files(done.written)
    return 0


def run_calibrate_check(options: argparse.Namespace) -> int:
    """Check, print the verdict; 1 where the rig is refused."""
    with ExitStack() as stack:
        return _checked(options, *_check_tables(options, stack))


def _checked(options: argparse.Namespace, sightings: Path, landmarks: Path) -> int:
    """Check by two tables; 1 where the rig is refused."""
    from calibration.landmarks.jobs import CheckRequest, run_check

    names = None if options.runway is None else [name.strip() for name in options.runway.split(",")]

    def ask(rig: "Rig", seen: "Sequence[LandmarkSighting]", marks: "Mapping[str, Landmark]") -> "ComparisonOutcome":
        from groundstation.cli.calibrate_runway import ask_runway

        return ask_runway(rig, seen, marks, names or (), sightings)

    done = run_check(
        CheckRequest(
            sightings=sightings,
            landmarks=landmarks,
            rig=options.rig,
            out=options.out,
            reference=options.reference if options.stars is None else Path("none"),
            record=options.record,
            report=options.report,
            alarm_deg=options.alarm_deg,
            keep=options.stars is None,
        ),
        None if names is None else ask,
    )
    print(done.text)
    print_files(done.written)
    return 0 if done.good else 1


def _check_tables(options: argparse.Namespace, stack: ExitStack) -> tuple[Path, Path]:
    """Return the tables of sightings and landmarks; of --stars those of its pictures, which end with ``stack``."""
    if options.stars is None and options.clock_sigma is not None:
        raise UsageError("--clock-sigma", got="no --stars", wanted="it: landmarks have no clock")
    if options.stars is None:
        if options.sightings is None or options.landmarks is None or options.site is not None:
            wanted = "SIGHTINGS and --landmarks, or --stars and --site"
            raise UsageError("calibrate check", got="some of the tables", wanted=wanted)
        return options.sightings, options.landmarks
    if options.sightings is not None or options.landmarks is not None or options.reference is not None:
        raise UsageError("--stars", got="tables as well", wanted="one of them")
    if options.site is None:
        raise UsageError("--stars", got="no --site", wanted="a file with [origin], as the station file is")
    from calibration.stars.calibrate import CLOCK_SIGMA_S, sky_uncertainty
    from calibration.stars.night import read_night
    from calibration.stars.night_landmarks import write_night_tables
    from calibration.stars.site_file import read_site
    from groundstation.rig.rig import load_rig

    rig, site = load_rig(options.rig), read_site(options.site)
    with ProgressLine(sys.stderr, "stars", "picture") as line:
        pictures = read_night(options.stars, rig, line.update)
    clock = CLOCK_SIGMA_S if options.clock_sigma is None else options.clock_sigma
    uncertain = sky_uncertainty(site, clock, each_clock=False)
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="groundstation-")))
    tables = write_night_tables(folder, rig, pictures, site, uncertain)
    for text in tables.without:
        print(f"not used: {text}")
    return tables.sightings, tables.landmarks
