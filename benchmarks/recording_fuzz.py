"""Recordings of mutated structure through convert, recover, replay and view: nothing outside, no traceback.

python benchmarks/recording_fuzz.py [--recordings N] [--minutes M] [--again K]

Names, lengths, kinds, order and checksums of a recording's records are changed, those in its chunks too. Finished ones
are kept in --state, and a later run continues from there. `make fuzz`.
"""

import argparse
import contextlib
import io
import json
import os
import random
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.cli.main import main as command_line  # noqa: E402
from tests.hostile.structure import Structure, small_recordings  # noqa: E402

COMMANDS = ("convert", "recover", "replay", "view")
MOST_BYTES = 512 << 20
MOST_S = 60.0
SILENT_S = 1200.0
A_PROCESS = 100


def arguments(command: str, recording: Path, out: Path) -> list[str]:
    """Return the command line that reads the recording and writes below ``out``."""
    return {
        "convert": ["convert", str(recording), str(out / "folder")],
        "recover": ["recover", str(recording), "--out", str(out / "whole.mcap")],
        "replay": ["replay", str(recording), "--out", str(out / "replayed")],
        "view": ["view", str(recording), "--save", str(out / "view.rrd")],
    }[command]


def outside(sandbox: Path, out: Path) -> dict[str, tuple[int, int]]:
    """Return the files in the sandbox besides those written on purpose: size and time of each."""
    found = {}
    for folder, folders, names in os.walk(sandbox):
        folders[:] = [name for name in folders if Path(folder) / name != out]
        for name in (*folders, *names):
            status = (Path(folder) / name).lstat()
            found[str(Path(folder) / name)] = (status.st_size if name in names else 0, status.st_ino)
    return found


def run(command: str, recording: Path, sandbox: Path) -> tuple[str, str]:
    """Run one command; return its exit code or "foreign" and its output."""
    out = sandbox / "inner" / "out"
    out.mkdir(parents=True)
    before = outside(sandbox, out)
    reported = io.StringIO()
    signal.setitimer(signal.ITIMER_VIRTUAL, MOST_S)
    code: object = None
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(reported):
            code = command_line(arguments(command, recording, out))
    except SystemExit as ended:
        code = ended.code
    except BaseException as error:  # noqa: BLE001 - what is no error of ours is what is looked for
        place = traceback.extract_tb(error.__traceback__)[-1]
        return "foreign", f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        after = outside(sandbox, out)
        links = [path for path in out.rglob("*") if path.is_symlink()]
        shutil.rmtree(out)
    if after != before or links:
        changed = sorted({*after} ^ {*before}) or [name for name in after if after[name] != before[name]]
        return "foreign", f"written outside: {changed or links}"
    if "Traceback" in reported.getvalue():
        return "foreign", reported.getvalue()[-400:]
    return f"exit code {code}", reported.getvalue()[-200:]


def read_part(first: int, last: int, seed: int, folder: Path) -> None:
    """Run the commands on some recordings, each reported in a line of JSON."""

    def no_end(signum: int, frame: object) -> None:
        raise TimeoutError(f"more than {MOST_S:g} s")

    signal.signal(signal.SIGVTALRM, no_end)
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", module="matplotlib")
    structures = [Structure(path) for path in small_recordings(folder)]
    sandbox = folder / "sandbox"
    sandbox.mkdir()
    canary = sandbox / "canary.txt"
    canary.write_text("nothing is written here")
    os.chdir(sandbox)
    for k in range(first, last):
        chance = random.Random(f"{seed} {k}")
        recording = sandbox / "flight.mcap"
        recording.write_bytes(chance.choice(structures).mutated(chance))
        row: dict[str, Any] = {}
        for command in COMMANDS:
            began, idle = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            outcome, reported = run(command, recording, sandbox)
            more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - idle
            if more << 10 > MOST_BYTES:
                outcome, reported = "foreign", f"took {more >> 10} MB"
            row[command] = [outcome, reported, round(time.process_time() - began, 2), more >> 10]
        print(json.dumps([k, row]), flush=True)


class Study:
    """The finished recordings, kept in a file."""

    def __init__(self, state: Path, seed: int) -> None:
        self._path, self._seed = state, seed
        self.done = 0
        self.outcomes: dict[str, Counter[str]] = {command: Counter() for command in COMMANDS}
        self.foreign: list[tuple[int, str, str]] = []
        self.worst_s = dict.fromkeys(COMMANDS, 0.0)
        if state.is_file():
            kept = json.loads(state.read_text(encoding="utf-8"))
            if kept["seed"] == seed:
                self.done, self.foreign = kept["done"], [tuple(row) for row in kept["foreign"]]
                self.outcomes = {command: Counter(counts) for command, counts in kept["outcomes"].items()}
                self.worst_s = kept["worst_s"]

    def add(self, k: int, row: dict[str, Any]) -> None:
        """Count one recording."""
        self.done = k + 1
        for command, (outcome, reported, took, _) in row.items():
            self.outcomes[command][outcome] += 1
            self.worst_s[command] = max(self.worst_s[command], took)
            if outcome == "foreign":
                self.foreign.append((k, command, reported))
                print(f"recording {k}: {command}: {reported}", file=sys.stderr, flush=True)

    def save(self) -> None:
        """Write the counts; an interrupted run leaves those of before or these."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        draft = self._path.with_suffix(".partial")
        values = {
            "seed": self._seed,
            "done": self.done,
            "foreign": self.foreign,
            "outcomes": self.outcomes,
            "worst_s": self.worst_s,
        }
        draft.write_text(json.dumps(values, indent=1), encoding="utf-8")
        draft.replace(self._path)


def run_apart(study: Study, recordings: int, seed: int) -> None:
    """Run the next recordings in a process of their own; one that ends or hangs is counted."""
    first, last = study.done, min(recordings, study.done + A_PROCESS)
    with tempfile.TemporaryDirectory(prefix="recording_fuzz_") as folder:
        part = json.dumps([first, last, seed, folder])
        process = subprocess.Popen(
            [sys.executable, __file__, "--part", part], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert process.stdout is not None
        why = ""
        while True:
            ready, _, _ = select.select([process.stdout], [], [], SILENT_S)
            if not ready:
                why = f"no answer for {SILENT_S:g} s"
                process.kill()
                break
            line = process.stdout.readline()
            if not line:
                break
            study.add(*json.loads(line))
            study.save()
        code = process.wait()
        if study.done < last:
            reported = why or f"the process ended, exit code {code}"
            study.add(study.done, {"replay": ["foreign", reported, 0.0, 0]})
    study.save()


def main() -> None:
    """Continue from the finished ones, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=1_000, metavar="N")
    parser.add_argument("--seed", type=int, default=22, metavar="S")
    parser.add_argument("--minutes", type=float, default=1e9, metavar="M", help="no longer than this, this time")
    parser.add_argument("--state", type=Path, default=ROOT / "benchmarks" / "fuzz" / "recordings.json", metavar="FILE")
    parser.add_argument("--again", type=int, metavar="K", help="write one recording to a file that stays")
    parser.add_argument("--part", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        first, last, seed, folder = json.loads(options.part)
        read_part(first, last, seed, Path(folder))
        return
    if options.again is not None:
        folder = Path(tempfile.mkdtemp(prefix="recording_fuzz_"))
        structures = [Structure(path) for path in small_recordings(folder)]
        chance = random.Random(f"{options.seed} {options.again}")
        path = folder / f"{options.again}.mcap"
        path.write_bytes(chance.choice(structures).mutated(chance))
        print(path)
        return
    study = Study(options.state, options.seed)
    ends = time.monotonic() + 60.0 * options.minutes
    while study.done < options.recordings and time.monotonic() < ends:
        run_apart(study, options.recordings, options.seed)
    print(f"{study.done} recordings of mutated structure")
    for command in COMMANDS:
        counts = ", ".join(f"{outcome} {n}" for outcome, n in sorted(study.outcomes[command].items()))
        print(f"{command:<10} {counts}; worst {study.worst_s[command]:.1f} s")
    sys.exit(bool(study.foreign))


if __name__ == "__main__":
    main()
