"""Where the program begins: Ctrl-C ends it quietly from here on, also while it is still being read."""

import os
import sys

# The libraries of linear algebra start a thread for each core, and those wait by counting. Matrices here have ten to
# some hundred rows, too few to share: the threads would only take cores from what has to be done in time.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "VECLIB_MAXIMUM_THREADS": "1"}


def main() -> int:
    """Run the command line; returns the exit code."""
    # what the user has set stays; it is read when numpy is first imported
    os.environ.update(ONE_THREAD | os.environ)
    try:
        from groundstation.cli import main as run

        return run()
    except KeyboardInterrupt:
        print("groundstation: interrupted", file=sys.stderr)
        return 130
