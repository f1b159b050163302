"""What an interrupted command has written to its `--out`, for its last line."""

import argparse
from pathlib import Path

# the exit code of an interrupted command
INTERRUPTED = 130
# a file system may count in whole seconds
_FILE_CLOCK_S = 1.0


def left_by(options: argparse.Namespace, began_s: float) -> str:
    """Return what an interrupted command has written to `--out` since ``began_s``; "" if that is not known."""
    out = getattr(options, "out", None)
    if not isinstance(out, Path):
        return ""
    try:
        files = [out] if out.is_file() else [file for file in out.rglob("*") if file.is_file()]
        written = any(file.stat().st_mtime >= began_s - _FILE_CLOCK_S for file in files)
    except OSError:
        return ""
    return f"; {out} holds what was done until then" if written else f"; nothing was written to {out}"
