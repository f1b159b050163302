"""`groundstation reproduce`: the papers' figures and tables on our recordings."""

import argparse
import sys
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.path_arguments import READ, WrittenFolder
from groundstation.cli.progress import StatusLine
from groundstation.cli.terminal import print_table
from groundstation.cli.time_span import add_span, require_span
from groundstation.errors import UsageError

_REPRODUCE = """Do the papers' experiments on our recordings: every figure and table that they allow,
numbered as in the paper, ours next to theirs, with the differences in set-up named."""
_REPRODUCE_MORE = """examples:
  groundstation reproduce --out out/reproduce
  groundstation reproduce --only roi ekf
  groundstation reproduce --only online --take-off flights/take-off
  groundstation reproduce --list

DIR gets reproduce.html, a CSV for each table and a PNG for each figure. All but
processor times repeats to the last digit. The whole takes some minutes.

exit code: 0 done; 1 the session is at fault; 2 wrong usage; 130 interrupted"""


def add_reproduce(commands: Commands) -> None:
    """Add `reproduce`."""
    reproduce = add_command(
        commands,
        "reproduce",
        run_reproduce,
        "the papers' experiments on our recordings, ours next to theirs",
        _REPRODUCE,
        _REPRODUCE_MORE,
    )
    reproduce.add_argument(
        "--out",
        type=WrittenFolder(("*.html", "*.csv", "*.png")),
        default=Path("out/reproduce"),
        metavar="DIR",
        help="where page, tables and figures go; made if missing (default: out/reproduce)",
    )
    reproduce.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only these experiments (see --list)")
    reproduce.add_argument("--list", action="store_true", help="list the experiments, and run none")
    reproduce.add_argument(
        "--session",
        type=READ,
        metavar="SESSION",
        help="a rendered session with truth.csv and masks.npz (default: the bundled landing)",
    )
    reproduce.add_argument(
        "--take-off",
        type=READ,
        metavar="SESSION",
        help="a rendered take-off of that kind, for `online` (default: its pixels are simulated)",
    )
    add_span(reproduce)


def run_reproduce(options: argparse.Namespace) -> int:
    """Do the experiments, print their tables' titles and the paths; returns the exit code."""
    from groundstation.experiments.registry import EXPERIMENTS
    from groundstation.experiments.reproduce import ReproduceRequest, reproduce

    require_span(options)
    names = [e.name for e in EXPERIMENTS]
    if options.list:
        print_table([(e.name, e.numbers, f"{e.title} ({e.paper.value})") for e in EXPERIMENTS])
        return 0
    unknown = [name for name in options.only if name not in names]
    if unknown:
        raise UsageError("--only", got=unknown[0], wanted="one of " + ", ".join(names))
    request = ReproduceRequest(
        out=options.out,
        only=tuple(options.only),
        session=options.session,
        from_s=options.from_s,
        to_s=options.to_s,
        take_off=options.take_off,
    )
    with StatusLine(sys.stderr) as status_line:
        done = reproduce(request, status_line.show)
    for (experiment, findings), elapsed_s in zip(done.found, done.elapsed_s, strict=True):
        print(f"{experiment.title} ({experiment.numbers}): {len(findings.tables)} tables, {elapsed_s:.0f} s")
    print(f"wrote {done.files[0]} and {len(done.files) - 1} other files")
    return 0
