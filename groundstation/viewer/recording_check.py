"""Check that a Rerun recording can be read to its end, in a separate process.

Rerun's reader aborts its process on some damaged files, which a caller cannot catch, and trusts the lengths in them:
a process that takes too much memory is ended. That process imports the compiled part of Rerun alone, which takes it a
thirtieth of the time of the whole.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

from rerun_bindings import RrdReaderInternal

from groundstation.errors import InputError, os_words

# a file of 200 MB is read in some seconds
_WITHIN_S = 600.0
# resident memory of a process with Rerun is 100 MB before it reads; a file of 26 MB needed 71 MB more
_MEMORY_BYTES, _MEMORY_PER_BYTE = 384 << 20, 16
_POLL_S = 0.02
_WANTED = "a Rerun recording (.rrd)"


def check_recording(path: Path) -> None:
    """Read a file to its end in another process; raises `InputError` if it is missing or damaged."""
    command = [sys.executable, "-m", "groundstation.viewer.recording_check", str(Path(os.path.realpath(path)))]
    most_bytes = _MEMORY_BYTES + _MEMORY_PER_BYTE * (path.stat().st_size if path.is_file() else 0)
    with tempfile.TemporaryFile() as answer:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=answer, stderr=subprocess.DEVNULL)
        trouble = _supervise(process, most_bytes)
        answer.seek(0)
        lines = answer.read(65_536).decode(errors="replace").splitlines()
    if process.returncode != 0:
        got = lines[0] if process.returncode == 1 and lines else "a damaged recording, on which Rerun's reader ends"
        raise InputError(str(path), got=trouble or got, wanted=_WANTED)


def _supervise(process: "subprocess.Popen[bytes]", most_bytes: int) -> str:
    """Wait for a process; end it if it takes too long or too much memory, and return which of the two."""
    until_s = time.monotonic() + _WITHIN_S
    while True:
        try:
            process.wait(_POLL_S)
        except subprocess.TimeoutExpired:
            trouble = ""
            if resident_bytes(process.pid) > most_bytes:
                trouble = f"a recording that takes more than {most_bytes >> 20} MB to read"
            elif time.monotonic() > until_s:
                trouble = f"a recording that is not read in {_WITHIN_S:g} s"
            if trouble:
                process.kill()
                process.wait()
                return trouble
        else:
            return ""


def resident_bytes(pid: int) -> int:
    """Return the resident memory of a process; 0 once it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0


def read_to_end(path: Path) -> None:
    """Read a file to its end in this process; raises `InputError`, or ends the process."""
    try:
        with warnings.catch_warnings():
            # a cut file warns of its missing end before it fails, and the failure is reported below
            warnings.simplefilter("ignore")
            reader = RrdReaderInternal(str(path))
        stores = [store for store in reader.store_entries() if store.kind == "recording"]
        if not stores:
            raise InputError(str(path), got="no recording in it", wanted=_WANTED)
        for chunk in reader.stream(store=stores[0]):
            # read, as by those who show it
            str(chunk.entity_path)
    except (RuntimeError, ValueError, OSError) as fault:
        raise InputError(str(path), got=os_words(fault), wanted=_WANTED) from fault


if __name__ == "__main__":
    try:
        read_to_end(Path(sys.argv[1]))
    except InputError as fault:
        sys.stdout.write(f"{fault.got}\n")
        sys.exit(1)
