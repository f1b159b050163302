"""`groundstation recover`: a recording cut short in, a closed one out."""

import argparse

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.path_arguments import READ, WRITTEN_FILE
from groundstation.cli.terminal import print_table

_RECOVER = """Make a whole recording of one that was cut short by a crash, a kill or a power
cut: every complete chunk is copied, counted, and counted again in the new file.
The old file is never changed."""
_RECOVER_MORE = """example:
  groundstation recover flight.mcap

writes flight-recovered.mcap

exit code: 0 done, or the file is whole already; 1 nothing can be recovered;
2 wrong usage"""


def add_recover(commands: Commands) -> None:
    """Add `recover`."""
    recover = add_command(
        commands, "recover", run_recover, "a recording cut short in, a whole one out", _RECOVER, _RECOVER_MORE
    )
    recover.add_argument("file", type=READ, metavar="FILE", help="the recording, .mcap")
    recover.add_argument("--out", type=WRITTEN_FILE, metavar="FILE", help="the new one (default: FILE-recovered.mcap)")


def run_recover(options: argparse.Namespace) -> int:
    """Recover, and say what was found."""
    from groundstation.recording.recovery import recover

    done = recover(options.file, options.out)
    total = sum(done.messages.values())
    if done.out is None:
        print(f"{options.file} is whole: {total} messages in {done.chunks} chunks; nothing written")
        return 0
    print_table([(topic, str(count)) for topic, count in done.messages.items()])
    lost = f"{done.lost_bytes} bytes after the last whole record ({done.fault})" if done.fault else "nothing at its end"
    print(f"\n{total} messages in {done.chunks - done.skipped} chunks, counted again in the new file")
    print(f"lost: {lost}" + (f", {done.skipped} damaged chunks" if done.skipped else ""))
    print(f"wrote {done.out}")
    return 0
