"""`groundstation convert`: a session folder into a recording, or the reverse."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.path_arguments import NEW_FOLDER, READ
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span

_CONVERT = """Turn a session folder into a recording, or a recording into a session folder.
Into a recording go whole frames, without loss, which takes far more space than
the videos; a folder gets what a recording has as PNG pictures, black where
detection never looked."""
_CONVERT_MORE = """examples:
  groundstation convert recordings/landing-1 landing-1.mcap --to 10
  groundstation convert flight.mcap flight/

KML and GeoJSON of the track are among the results of `groundstation replay` and
of `groundstation evaluate --out`.

exit code: 0 done; 1 the session is at fault, and what came before the fault is
written; 2 wrong usage; 130 interrupted"""


def add_convert(commands: Commands) -> None:
    """Add `convert`."""
    convert = add_command(
        commands,
        "convert",
        run_convert,
        "a session folder in, a recording out, or the other way",
        _CONVERT,
        _CONVERT_MORE,
    )
    convert.add_argument(
        "source", type=READ, metavar="IN", help="a session folder, a recording (.mcap), or the folder of a live run"
    )
    convert.add_argument(
        "out", type=NEW_FOLDER, metavar="OUT", help="the other: a file ending in .mcap, or a new folder"
    )
    add_span(convert)


def run_convert(options: argparse.Namespace) -> int:
    """Convert, and say what the new form does not have."""
    from groundstation.conversion.convert import convert

    require_span(options)
    with ProgressLine(sys.stderr, "convert") as line:
        done = convert(options.source, options.out, from_s=options.from_s, to_s=options.to_s, progress=line.update)
    for note in done.notes:
        print(f"note: {note}")
    print(f"wrote {done.out}: {done.events} events")
    if done.fault is not None:
        print(f"groundstation: fault in the session: {done.fault}", file=sys.stderr)
    return 0 if done.fault is None else 1
