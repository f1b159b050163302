"""A process that reads a file for another one, in a forked process, and reports the memory and time of it.

python -m tests.hostile.measured FOLDER: then a line READER for each file in the place where that reader expects it.
"""

import gc
import json
import os
import resource
import signal
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

from groundstation.errors import GroundstationError
from tests.hostile.readers import Reader, readers

# what ends a reader that would take all of a machine; the limits that are tested are far below
MOST_BYTES = 3 << 30
MOST_S = 40


def _usage() -> tuple[int, float]:
    """Return the most memory so far in bytes, and the processor's time in s."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_maxrss << 10, used.ru_utime + used.ru_stime


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def _measure(reader: Reader) -> dict[str, Any]:
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MOST_BYTES, mapped + MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S + 1))
    warnings.simplefilter("error")
    idle, (_, began) = _resident(), _usage()
    error, ours = "", True
    try:
        reader.read()
    except GroundstationError as fault:
        error = str(fault)
    except BaseException as fault:  # noqa: BLE001 - said to the parent, whatever it is
        place = traceback.extract_tb(fault.__traceback__)[-1]
        error, ours = f"{type(fault).__name__}: {fault} ({place.filename}:{place.lineno})", False
    most, ended = _usage()
    return {"error": error[:2000], "ours": ours, "bytes": max(0, most - idle), "seconds": ended - began}


def main() -> None:
    """Answer each line with one of JSON."""
    found = readers(Path(sys.argv[1]))
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    print(json.dumps({name: str(reader.path) for name, reader in found.items()}), file=out, flush=True)
    # a forked process collects its own garbage only, and copies no pages of what was there before
    gc.collect()
    gc.freeze()
    for line in sys.stdin:
        child = os.fork()
        if not child:
            print(json.dumps(_measure(found[line.strip()])), file=out, flush=True)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if status:
            name = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit code {status >> 8}"
            answer = {"error": f"the process ended: {name}", "ours": False, "bytes": 0, "seconds": float(MOST_S)}
            print(json.dumps(answer), file=out, flush=True)


if __name__ == "__main__":
    main()
