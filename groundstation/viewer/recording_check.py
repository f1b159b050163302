"""Check that a Rerun recording can be read to its end, in a separate process.

Rerun's reader aborts its process on some damaged files, which a caller cannot catch.
"""

import subprocess
import sys
from pathlib import Path

from groundstation.errors import InputError
from groundstation.viewer.merge import chunks

# a file of 200 MB is read in some seconds
_WITHIN_S = 600.0
_WANTED = "a Rerun recording (.rrd)"


def check_recording(path: Path) -> None:
    """Read a file to its end in another process; raises `InputError` if it is missing or damaged."""
    command = [sys.executable, "-m", "groundstation.viewer.recording_check", str(path.resolve())]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_WITHIN_S, check=False
        )
    except subprocess.TimeoutExpired as late:
        raise InputError(str(path), got=f"a recording that is not read in {_WITHIN_S:g} s", wanted=_WANTED) from late
    if done.returncode != 0:
        said = done.stdout.splitlines()
        got = said[0] if done.returncode == 1 and said else "a damaged recording, on which Rerun's reader ends"
        raise InputError(str(path), got=got, wanted=_WANTED)


def read_to_end(path: Path) -> None:
    """Read a file to its end in this process; raises `InputError`, or ends the process."""
    for _ in chunks(path):
        pass


if __name__ == "__main__":
    try:
        read_to_end(Path(sys.argv[1]))
    except InputError as fault:
        sys.stdout.write(f"{fault.got}\n")
        sys.exit(1)
