"""`groundstation plan`: a site's description in, the accuracy to expect over range out."""

import argparse

from groundstation.cli.command_arguments import Commands, add_command, print_files
from groundstation.cli.path_arguments import READ, WrittenFolder

_PLAN = """Plan a site: which accuracy to expect at which range, from stations, lens,
pan-tilt units, the quality of the calibration, and the aircraft; before anyone
drives out."""
_PLAN_MORE = """example:
  groundstation plan docs/site-example.toml --out out/plan

DIR gets plan.csv, and the picture plan.png and plan.svg. For each accuracy that
the site asks for it says which sources of a calibration are needed: marks,
airliners, stars, a flight.

exit code: 0 done; 1 the site's file is at fault; 2 wrong usage; 130 interrupted"""


def add_plan(commands: Commands) -> None:
    """Add `plan`."""
    plan = add_command(
        commands, "plan", run_plan, "a site on paper in, the accuracy to expect over range out", _PLAN, _PLAN_MORE
    )
    plan.add_argument("site", type=READ, metavar="SITE", help="the site, TOML (example: docs/site-example.toml)")
    plan.add_argument(
        "--out",
        type=WrittenFolder(("plan.csv", "plan.png", "plan.svg")),
        metavar="DIR",
        help="where table and picture go; made if missing",
    )


def run_plan(options: argparse.Namespace) -> int:
    """Print the forecast and the paths."""
    from groundstation.planning.calibration_sources import format_sources, source_forecasts
    from groundstation.planning.plan import plan
    from groundstation.planning.plan_table import format_plan

    result = plan(options.site, options.out)
    print(format_plan(result.site, result.forecast))
    if text := format_sources(result.site, source_forecasts(result.site)):
        print(f"\n{text}")
    if result.files:
        print()
    print_files(result.files)
    return 0
