"""Where the program begins: Ctrl-C ends it quietly from here on, also while it is still being read."""

import sys


def main() -> int:
    """Run the command line; returns the exit code."""
    try:
        from groundstation.cli import main as run

        return run()
    except KeyboardInterrupt:
        print("groundstation: interrupted", file=sys.stderr)
        return 130
