"""The part of the command line that judges the whole program: `groundstation bank BANK.toml`."""

import argparse
import re
import sys
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from groundstation import __version__
from groundstation.cli.command_arguments import Commands, add_command, add_result_folder, print_files
from groundstation.cli.number_arguments import count
from groundstation.cli.path_arguments import READ, READ_TEXT, WRITTEN_FILE, WrittenFolder
from groundstation.cli.progress import ProgressLine
from groundstation.cli.wrong_usage import refuse_with
from groundstation.errors import UsageError

if TYPE_CHECKING:
    from groundstation.bank.run_bank import BankOutcome

_BANK = """Draw many worlds, render, replay and score each, on all cores or a Dask cluster:
how the program does on airframes, sceneries, skies, cameras and flights that it was
not made for. Goes on where an earlier run into the same folder was interrupted."""
_MORE = """examples:
  groundstation bank validate.toml --out out/validate
  groundstation bank validate.toml --out out/validate --workers 4 --csrt-python csrt/bin/python
  groundstation bank validate.toml --out out/slow-pan --config slow-pan.toml --worlds out/worlds
  groundstation bank test.toml --out out/test --test-log benchmarks/bank/test-runs.csv

BANK.toml:
  format = "groundstation-bank/1"
  world_set = "validate"   # train, validate or test: which million of seeds
  sessions = 200           # how many worlds of it
  first = 0                # number of the first; optional, as are the next four
  duration_s = 20.0
  frame_hz = 10.0
  limit_s = 3600.0         # longest time of one session
  worst = 10               # sessions shown with pictures

writes rows.parquet (a row for each world), bank.html, bank.json; sessions/ holds what
has finished. Every run of the test set is added to the file of --test-log.
Needs groundstation[cluster], and groundstation[world] for H.264.

exit code: 0 done; 1 settings at fault, or a session failed; 2 wrong usage; 130
interrupted: the same command goes on"""

_ADDRESS = re.compile(r"(?:\w+://)?(?:\[[0-9a-fA-F:]+\]|[\w.-]+):\d{1,5}")


def add_bank(commands: Commands) -> None:
    """Add `bank`."""
    bank = add_command(
        commands, "bank", run_bank_command, "many drawn worlds in, distributions of all figures out", _BANK, _MORE
    )
    bank.add_argument("settings", type=READ, metavar="BANK.toml", help="which worlds, see below")
    add_result_folder(bank, ("rows.parquet", "bank.html", "bank.json"))
    bank.add_argument("--workers", type=count, metavar="N", help="processes (default: one for each core)")
    bank.add_argument("--scheduler", type=READ_TEXT, metavar="ADDRESS", help="a Dask scheduler, tcp://HOST:PORT")
    bank.add_argument("--config", type=READ, metavar="FILE", help="tuning of the replays (default: as built in)")
    bank.add_argument(
        "--csrt-python",
        type=READ,
        metavar="FILE",
        help="a Python with opencv-contrib-python-headless below 5: also scores the baseline, CSRT started by hand",
    )
    bank.add_argument(
        "--worlds",
        type=WrittenFolder(("world-*",)),
        metavar="DIR",
        help="keep rendered worlds there, and use them again: rendering takes most of the time",
    )
    bank.add_argument("--test-log", type=WRITTEN_FILE, metavar="FILE", help="log of runs of the test set")


def run_bank_command(options: argparse.Namespace) -> int:
    """Run a bank and print its figures; returns the exit code."""
    from groundstation.bank.bank_page import figure_text, interval_text
    from groundstation.bank.bank_settings import load_bank_settings
    from groundstation.bank.pooled_figures import POOLED, pooled
    from groundstation.bank.program_commit import program_commit
    from groundstation.bank.run_bank import BankRequest, run_bank
    from groundstation.bank.run_log import require_log
    from groundstation.simulation.world.world_sets import WorldSet

    if options.scheduler is not None and _ADDRESS.fullmatch(options.scheduler) is None:
        raise UsageError("--scheduler", got=repr(options.scheduler), wanted="tcp://HOST:PORT")
    if options.scheduler is not None:
        refuse_with(options, "--scheduler", {"workers": None}, "a scheduler has its own workers")
    settings = load_bank_settings(options.settings)
    testing = settings.world_set is WorldSet.TEST
    if testing and options.test_log is None:
        raise UsageError("--test-log", got="nothing", wanted="the file that lists the runs of the test set")
    if testing:
        require_log(options.test_log)
    now, commit = datetime.now(UTC), program_commit()
    request = BankRequest(
        settings=settings,
        out=options.out,
        workers=options.workers,
        scheduler=options.scheduler,
        config=options.config,
        csrt_python=options.csrt_python,
        worlds=options.worlds,
    )
    words = f"groundstation {__version__}, commit {commit}, {now:%Y-%m-%d %H:%M} UTC"
    with ProgressLine(sys.stderr, "bank", "session") as line:
        outcome = run_bank(request, words, line.update)
    rows = outcome.result.rows
    for ratio in POOLED:
        figure = pooled(rows, ratio)
        interval = interval_text(figure.low, figure.high, ratio.percent)
        print(f"{ratio.title + ':':<52} {figure_text(figure):>9}   {interval}")
    print(f"{len(rows)} sessions, {outcome.reused} of them finished before; rows {outcome.digest[:12]}")
    if testing:
        _log(options, outcome, now, commit)
    for failure in outcome.result.failures:
        print(f"groundstation: {failure.name}: {failure.kind.value}: {failure.reason}", file=sys.stderr)
    print_files(outcome.files)
    return 1 if outcome.result.failures else 0


def _log(options: argparse.Namespace, outcome: "BankOutcome", now: datetime, commit: str) -> None:
    """Add a run of the test set to its log."""
    from groundstation.bank.bank_page import figure_text
    from groundstation.bank.pooled_figures import HIT, MISLEADING, WRONG, pooled
    from groundstation.bank.run_log import LoggedRun, append_run

    rows = outcome.result.rows
    hit, wrong, misleading = (figure_text(pooled(rows, ratio)) for ratio in (HIT, WRONG, MISLEADING))
    run = LoggedRun(
        date=now.isoformat(timespec="seconds"),
        commit=commit,
        version=__version__,
        first=outcome.result.settings.first,
        sessions=len(rows),
        hit=hit,
        wrong=wrong,
        misleading=misleading,
        rows_sha256=outcome.digest,
    )
    append_run(options.test_log, run)
