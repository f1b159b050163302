"""Mutated files through every reader: only project errors, of one line, in bounded memory and time.

python benchmarks/reader_fuzz.py [--inputs N] [--only READER …] [--minutes M] [--again READER K]

Input K of a reader depends on the seed, its name and K alone. Finished inputs are kept in --state, and a later run
continues from there. `make fuzz`.

A reader that runs a library in a child process, since it may abort, is run here without its child: the process that
reads is then the child, its abort is a refusal, and the next inputs are read by another process.
"""

import argparse
import json
import random
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.errors import GroundstationError  # noqa: E402
from tests.hostile.mutation import mutated  # noqa: E402
from tests.hostile.readers import Reader, readers  # noqa: E402
from tests.session.damage import Parts  # noqa: E402

MOST_BYTES = 512 << 20
MOST_S = 10.0
# time limit of a process without a reply; far beyond the effect of a busy machine on ten seconds
SILENT_S = 1200.0
# shared libraries and stacks of threads are mapped, not used
MAPPED_BYTES = 1 << 30
A_PROCESS = 20_000
# each recording that Rerun has written leaves two threads, with room of their own, until the process ends
MOST_THREADS = 64
MOST_KEPT = 20
RECORDING = "flight.mcap"
# readers with `Reader.in_child`
ABORTING = ("run.rrd",)


def input_of(reader: str, found: Reader, k: int, seed: int, parts: Parts | None) -> None:
    """Write input ``k`` to the reader's file."""
    chance = random.Random(f"{seed} {reader} {k}")
    if parts is not None and chance.random() < 0.5:
        parts.write(found.path, chance)
    else:
        found.path.write_bytes(mutated(found.path.name, found.seeds, chance))


def peak_bytes() -> int:
    """Return the most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def mapped_bytes() -> int:
    """Return how much address space this process has."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def threads() -> int:
    """Return how many threads this process has."""
    return len(list(Path("/proc/self/task").iterdir()))


def no_end(signum: int, frame: object) -> None:
    """Turn a reader that takes too long into a foreign error."""
    raise TimeoutError(f"more than {MOST_S:g} s")


def outcome_of(found: Reader) -> tuple[str, str]:
    """Read the file; return "read", "refused" or "foreign", and the message."""
    signal.setitimer(signal.ITIMER_VIRTUAL, MOST_S)
    try:
        (found.in_child or found.read)()
    except GroundstationError as fault:
        reported = str(fault)
        return ("refused", "") if reported.isprintable() else ("foreign", f"more than one line: {reported!r}")
    except Exception as error:  # noqa: BLE001 - what is no error of ours is what is looked for
        place = traceback.extract_tb(error.__traceback__)[-1]
        return "foreign", f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return "read", ""


def read_part(reader: str, first: int, last: int, seed: int, folder: Path) -> None:
    """Read some inputs, each reported in a line of JSON; the parent keeps the count."""
    signal.signal(signal.SIGVTALRM, no_end)
    warnings.simplefilter("error")
    found = readers(folder)[reader]
    found.path.write_bytes(found.seeds[0])
    outcome_of(found)
    parts = Parts(found.path) if reader == RECORDING else None
    if found.in_child is None:
        most = mapped_bytes() + MOST_BYTES + MAPPED_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    for k in range(first, last):
        if threads() > MOST_THREADS:
            print("null", flush=True)
            return
        input_of(reader, found, k, seed, parts)
        idle, began = peak_bytes(), time.process_time()
        outcome, reported = outcome_of(found)
        took, more = time.process_time() - began, peak_bytes() - idle
        if outcome != "foreign" and took > MOST_S:
            outcome, reported = "foreign", f"took {took:.1f} s"
        # the parent of a child that takes more ends it
        if outcome != "foreign" and more > MOST_BYTES and found.in_child is None:
            outcome, reported = "foreign", f"took {more >> 20} MB"
        print(json.dumps([k, outcome, reported[:500], round(took, 3), more >> 20]), flush=True)


class Study:
    """The finished inputs of each reader, kept in a file."""

    def __init__(self, state: Path, seed: int) -> None:
        self._path, self._seed = state, seed
        self.readers: dict[str, dict[str, Any]] = {}
        if state.is_file():
            kept = json.loads(state.read_text(encoding="utf-8"))
            if kept["seed"] == seed:
                self.readers = kept["readers"]

    def of(self, reader: str) -> dict[str, Any]:
        """Return the counts of one reader."""
        fresh = {"done": 0, "read": 0, "refused": 0, "foreign": [], "worst_s": 0.0, "worst_mb": 0}
        return self.readers.setdefault(reader, fresh)

    def add(self, reader: str, row: list[Any]) -> None:
        """Count one input."""
        k, outcome, reported, took, more = row
        own = self.of(reader)
        own["done"] = k + 1
        own["worst_s"], own["worst_mb"] = max(own["worst_s"], took), max(own["worst_mb"], more)
        if outcome == "foreign":
            own["foreign"].append([k, reported])
            print(f"{reader}: input {k}: {reported}", file=sys.stderr, flush=True)
        else:
            own[outcome] += 1

    def save(self) -> None:
        """Write the counts; an interrupted run leaves those of before or these."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        draft = self._path.with_suffix(".partial")
        draft.write_text(json.dumps({"seed": self._seed, "readers": self.readers}, indent=1), encoding="utf-8")
        draft.replace(self._path)


def read_apart(study: Study, reader: str, inputs: int, seed: int) -> None:
    """Read the next inputs in a process of their own; one that ends or hangs is counted, and its input kept."""
    first = study.of(reader)["done"]
    last = min(inputs, first + A_PROCESS)
    with tempfile.TemporaryDirectory(prefix="reader_fuzz_") as folder:
        part = json.dumps([reader, first, last, seed, folder])
        process = subprocess.Popen(
            [sys.executable, __file__, "--part", part],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert process.stdout is not None
        silent, fresh = "", False
        while True:
            ready, _, _ = select.select([process.stdout], [], [], SILENT_S)
            if not ready:
                silent = f"no answer for {SILENT_S:g} s"
                process.kill()
                break
            line = process.stdout.readline()
            if not line:
                break
            row = json.loads(line)
            if row is None:
                # the rest is for a process with fewer threads
                fresh = True
            else:
                study.add(reader, row)
        code = process.wait()
        done = study.of(reader)["done"]
        if done < last and not fresh:
            refused = reader in ABORTING and code == -signal.SIGABRT
            reported = silent or f"the process ended, exit code {code}"
            study.add(reader, [done, "refused" if refused else "foreign", reported, 0.0, 0])
    study.save()


def again(reader: str, k: int, seed: int) -> None:
    """Write one input to a file that stays, and read it with all messages."""
    folder = Path(tempfile.mkdtemp(prefix="reader_fuzz_"))
    found = readers(folder)[reader]
    found.path.write_bytes(found.seeds[0])
    parts = Parts(found.path) if reader == RECORDING else None
    input_of(reader, found, k, seed, parts)
    print(f"{found.path}, {found.path.stat().st_size} bytes")
    found.read()


def print_table(study: Study, names: list[str]) -> None:
    """Print a row for each reader."""
    print(f"{'reader':<22}{'inputs':>9}{'read':>9}{'refused':>9}{'foreign':>9}{'worst s':>9}{'worst MB':>10}")
    for name in names:
        own = study.of(name)
        row = (own["done"], own["read"], own["refused"], len(own["foreign"]))
        print(f"{name:<22}" + "".join(f"{n:>9}" for n in row) + f"{own['worst_s']:>9.2f}{own['worst_mb']:>10}")


def main() -> None:
    """Continue from the finished inputs, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=100_000, metavar="N", help="of each reader")
    parser.add_argument("--seed", type=int, default=22, metavar="S")
    parser.add_argument("--only", nargs="+", metavar="READER", help="only these")
    parser.add_argument("--minutes", type=float, default=1e9, metavar="M", help="no longer than this, this time")
    parser.add_argument("--state", type=Path, default=ROOT / "benchmarks" / "fuzz" / "readers.json", metavar="FILE")
    parser.add_argument("--again", nargs=2, metavar=("READER", "K"), help="write and read one input")
    parser.add_argument("--part", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        reader, first, last, seed, folder = json.loads(options.part)
        read_part(reader, first, last, seed, Path(folder))
        return
    if options.again:
        again(options.again[0], int(options.again[1]), options.seed)
        return
    with tempfile.TemporaryDirectory() as folder:
        names = options.only or list(readers(Path(folder)))
    study = Study(options.state, options.seed)
    ends = time.monotonic() + 60.0 * options.minutes
    # the one with the fewest first: an interrupted run has something of each
    while time.monotonic() < ends:
        name = min(names, key=lambda n: study.of(n)["done"])
        own = study.of(name)
        if own["done"] >= options.inputs:
            break
        if len(own["foreign"]) > MOST_KEPT:
            names.remove(name)
            continue
        read_apart(study, name, options.inputs, options.seed)
    names = list(study.readers)
    print_table(study, names)
    sys.exit(any(study.of(name)["foreign"] for name in names))


if __name__ == "__main__":
    main()
