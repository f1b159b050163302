"""Check that a Rerun recording can be read to its end, in a separate process.

Rerun's reader aborts its process on some damaged files, which a caller cannot catch, and believes the lengths in them:
the process may use a limited amount of memory.
"""

import os
import resource
import subprocess
import sys
from pathlib import Path

from groundstation.errors import InputError
from groundstation.viewer.merge_recordings import chunks

# a file of 200 MB is read in some seconds
_WITHIN_S = 600.0
# memory beyond that of the process before it reads, and per byte of the file; a file of 26 MB needed 71 MB
_MEMORY_BYTES, _MEMORY_PER_BYTE = 256 << 20, 16
# Rerun's allocator reserves 1 GiB of addresses at a time, which a limit of addresses would have to admit; in KiB
ALLOCATOR = {"MIMALLOC_ARENA_RESERVE": "32768"}
_WANTED = "a Rerun recording (.rrd)"


def check_recording(path: Path) -> None:
    """Read a file to its end in another process; raises `InputError` if it is missing or damaged."""
    command = [sys.executable, "-m", "groundstation.viewer.recording_check", str(path.resolve())]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_WITHIN_S,
            check=False,
            env={**os.environ, **ALLOCATOR},
        )
    except subprocess.TimeoutExpired as late:
        raise InputError(str(path), got=f"a recording that is not read in {_WITHIN_S:g} s", wanted=_WANTED) from late
    if done.returncode != 0:
        output = done.stdout.splitlines()
        got = output[0] if done.returncode == 1 and output else "a damaged recording, on which Rerun's reader ends"
        raise InputError(str(path), got=got, wanted=_WANTED)


def read_to_end(path: Path) -> None:
    """Read a file to its end in this process; raises `InputError`, or ends the process."""
    for _ in chunks(path):
        pass


def limit_memory(file_bytes: int) -> None:
    """Limit the memory of this process to what reading a file of this size may need beyond what it has now."""
    mapped = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    most = mapped + _MEMORY_BYTES + _MEMORY_PER_BYTE * file_bytes
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


if __name__ == "__main__":
    try:
        recording = Path(sys.argv[1])
        limit_memory(recording.stat().st_size if recording.is_file() else 0)
        read_to_end(recording)
    except InputError as fault:
        sys.stdout.write(f"{fault.got}\n")
        sys.exit(1)
