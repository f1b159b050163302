"""The part of the command line that compares runs: `groundstation evaluate SESSION|OUT…`."""

import argparse
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command, add_runs, print_files
from groundstation.cli.path_arguments import READ_TEXT, WRITTEN_FILE
from groundstation.cli.progress import ProgressDisplay

_EVALUATE = """Compare runs: many sessions, many tunings, or what was replayed before with what
is replayed now. For each: errors per axis and range, ANEES, NIS, coverage,
delay, misses by reason; and the difference to the first, or to --baseline.
With --out also a page with plots of all runs on the same axes, the tables as
Markdown, CSV and JSON, and the tracks as KML and GeoJSON."""
_MORE = """examples:
  groundstation evaluate out/monday out/tuesday --out out/compared
  groundstation evaluate recordings/landing-1 --config soft.toml --config stiff.toml
  groundstation evaluate recordings/landing-1 --baseline out/last-month --json now.json

SOURCE is the output folder of a replay, a session folder, a recording (.mcap) or a
live run's folder with its flight.mcap; the last three are replayed first, once with
each --config. The columns "± %" state by how much an error is larger (+) or smaller (−)
than the baseline's. Runs of other length are compared unchanged, with a note.

--out DIR always writes comparison.html (plots of errors over time and range,
distributions, NEES), plots/ (the same as SVG and PNG), table.md, comparison.csv
and comparison.json; what could not be computed is in the notes of page and table.
It writes tracks.kml and tracks.geojson where a session states where its frame
lies on Earth, by [origin] in session.toml.

exit code: 0 done; 1 a source is at fault; 2 wrong usage; 130 interrupted"""


def add_evaluate(commands: Commands) -> None:
    """Add `evaluate`."""
    evaluate = add_command(
        commands,
        "evaluate",
        run_evaluate,
        "many runs in, one table of their figures and differences out",
        _EVALUATE,
        _MORE,
    )
    add_runs(
        evaluate,
        "what to compare",
        "write page, plots, tables and maps there, and what is replayed, a folder for each run",
    )
    evaluate.add_argument(
        "--baseline", type=READ_TEXT, metavar="RUN", help="a run's name, or a folder of results (default: the first)"
    )
    evaluate.add_argument("--csv", type=WRITTEN_FILE, metavar="FILE", help="write every figure as a table")
    evaluate.add_argument("--json", type=WRITTEN_FILE, metavar="FILE", help="write every figure as JSON")


def run_evaluate(options: argparse.Namespace) -> int:
    """Evaluate, print the tables and the paths; returns the exit code."""
    from groundstation.evaluation.comparison_text import format_comparison
    from groundstation.replay.compare import (
        CompareRequest,
        check_folders,
        compare,
        comparison_csv,
        comparison_json,
        write_comparison_files,
    )
    from groundstation.replay.comparison_folder import write_comparison_folder

    # before the replays, which take minutes
    check_folders([path for path in (options.csv, options.json) if path is not None])
    with tempfile.TemporaryDirectory(prefix="groundstation-evaluate-") as folder:
        request = CompareRequest(
            sources=tuple(options.sources),
            work=options.out or Path(folder),
            configs=tuple(options.config),
            rig=options.rig,
            baseline=options.baseline,
            keep=options.out is not None,
        )
        with ProgressDisplay(sys.stderr) as progress:
            result = compare(request, progress.update)
    print(format_comparison(result.runs, result.baseline))
    _print_notes(result.notes)
    files = []
    if options.csv is not None:
        files.append((options.csv, comparison_csv(result)))
    if options.json is not None:
        files.append((options.json, comparison_json(result)))
    write_comparison_files(files)
    written = [path for path, _ in files]
    if options.out is not None:
        kept = write_comparison_folder(options.out, result)
        _print_notes(kept.notes)
        written += [path for path in kept.files if path not in written]
    if written:
        print()
    print_files(written)
    return 0


def _print_notes(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
