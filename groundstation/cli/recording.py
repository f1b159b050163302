"""The part of the command line that looks after recordings: `groundstation recover` and `groundstation convert`."""

import argparse
import sys

from groundstation.cli.path_arguments import NEW_FOLDER, READ, WRITTEN_FILE
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span

_RECOVER = """Make a whole recording of one that was cut short by a crash, a kill or a power
cut: every complete chunk is copied, counted, and counted again in the new file.
The old file is never changed."""
_RECOVER_MORE = """example:
  groundstation recover flight.mcap

writes flight-recovered.mcap

exit code: 0 done, or the file is whole already; 1 nothing can be recovered;
2 wrong usage"""
_CONVERT = """Turn a session folder into a recording, or a recording into a session folder.
Into a recording go whole frames, without loss, which takes far more space than
the videos; a folder gets what a recording has as PNG pictures, black where
detection never looked."""
_CONVERT_MORE = """examples:
  groundstation convert recordings/landing-1 landing-1.mcap --to 10
  groundstation convert flight.mcap flight/

exit code: 0 done; 1 the session is at fault, and what came before the fault is
written; 2 wrong usage; 130 interrupted"""


def add_recover(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `recover`."""
    recover = commands.add_parser(
        "recover",
        help="a recording cut short in, a whole one out",
        description=_RECOVER,
        epilog=_RECOVER_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    recover.add_argument("file", type=READ, metavar="FILE", help="the recording, .mcap")
    recover.add_argument("--out", type=WRITTEN_FILE, metavar="FILE", help="the new one (default: FILE-recovered.mcap)")


def add_convert(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `convert`."""
    convert = commands.add_parser(
        "convert",
        help="a session folder in, a recording out, or the other way",
        description=_CONVERT,
        epilog=_CONVERT_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    convert.add_argument("source", type=READ, metavar="IN", help="a session folder, or a recording (.mcap)")
    convert.add_argument(
        "out", type=NEW_FOLDER, metavar="OUT", help="the other: a file ending in .mcap, or a new folder"
    )
    add_span(convert)


def run_recover(options: argparse.Namespace) -> int:
    """Recover, and say what was found."""
    from groundstation.recording.recovery import recover

    done = recover(options.file, options.out)
    total = sum(done.messages.values())
    if done.out is None:
        print(f"{options.file} is whole: {total} messages in {done.chunks} chunks; nothing written")
        return 0
    width = max(map(len, done.messages), default=0)
    for topic, count in done.messages.items():
        print(f"{topic:{width}}  {count}")
    lost = f"{done.lost_bytes} bytes after the last whole record ({done.fault})" if done.fault else "nothing at its end"
    print(f"\n{total} messages in {done.chunks - done.skipped} chunks, counted again in the new file")
    print(f"lost: {lost}" + (f", {done.skipped} damaged chunks" if done.skipped else ""))
    print(f"wrote {done.out}")
    return 0


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
