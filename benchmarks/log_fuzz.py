"""Damaged logs and session files, a million and more: only project errors and plausible numbers may result.

python benchmarks/log_fuzz.py [--inputs N] [--seed S] [--only logs|sessions|videos]

Videos are read in separate processes: a decoder that ends one by a signal is counted, and its input kept.
"""

import argparse
import collections
import contextlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.errors import GroundstationError, InputError  # noqa: E402
from groundstation.session.logs.fixes import LogOptions  # noqa: E402
from groundstation.session.logs.read import GnssLog, read_log  # noqa: E402
from tests.session.damage import SLOW, SUMMARY, VIDEOS, Parts, session_targets  # noqa: E402
from tests.session.logs.damage import altered, damaged, forged, seeds  # noqa: E402

OPTIONS = (
    LogOptions(),
    LogOptions(geoid_separation_m=37.7, base_deg_m=(35.68, 139.76, 60.0)),
    LogOptions(instance=1, height="ellipsoid"),
)

FOREIGN = "foreign error"
MOST_KEPT = 50
# thousands of times what any of these small files takes
MOST_S = 60.0
MOST_BYTES = 8 << 30
# so many videos are read by one process
A_PROCESS = 1000
RESULT = "input: "


def check(log: GnssLog) -> None:
    """Raise `AssertionError` for a log whose numbers cannot be."""
    numbers = (log.gps_s, log.lat_deg, log.lon_deg, log.height_m, log.sigma_enu_m, log.covariance_en_m2)
    assert all(np.all(np.isfinite(n)) for n in numbers)
    assert len(log.gps_s) == len(log.quality) > 0
    assert np.all(np.diff(log.gps_s) > 0)
    assert np.all(np.abs(log.lat_deg) <= 90)
    assert np.all(log.sigma_enu_m > 0)


@contextlib.contextmanager
def refused_in_words(ours: type[GroundstationError]) -> Iterator[list[str]]:
    """Accept a project error as an outcome, "refused"; raises `AssertionError` if it is not one printable line."""
    outcome = ["read"]
    signal.setitimer(signal.ITIMER_REAL, MOST_S)
    try:
        yield outcome
    except ours as fault:
        if not str(fault).isprintable():
            raise AssertionError(f"an error of more than one line: {fault!r}") from fault
        outcome.append("refused")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def no_end(signum: int, frame: object) -> None:
    """Turn a reader that does not come to an end into a foreign error."""
    raise RuntimeError(f"no end after {MOST_S:.0f} s")


def tell(done: int, what: str) -> None:
    """Print the progress now and then."""
    if done % 50_000 == 0 and done:
        print(f"{done} {what} without an error that is not ours", file=sys.stderr, flush=True)


def fuzz_logs(inputs: int, chance: random.Random, folder: Path, counts: collections.Counter[str]) -> None:
    """Read damaged logs of every format in turn, each of them from any of that format's small files."""
    found = seeds()
    kinds: dict[str, list[str]] = {}
    for name in found:
        kinds.setdefault(Path(name).suffix, []).append(name)
    for k in range(inputs):
        tell(k, "logs")
        suffix = list(kinds)[k % len(kinds)]
        name = chance.choice(kinds[suffix])
        content = forged(name, found[name], chance) if chance.random() < 0.4 else damaged(found[name], chance)
        path = folder / f"log{suffix}"
        path.write_bytes(content)
        try:
            with refused_in_words(GroundstationError) as outcome:
                check(read_log(path, OPTIONS[k // len(kinds) % len(OPTIONS)]))
            counts[f"{suffix} {outcome[-1]}"] += 1
        except Exception as error:  # noqa: BLE001 - counted, kept, and the run fails
            keep(path, f"input {k} of {name}", error, counts)


def keep(path: Path, what: str, error: Exception, counts: collections.Counter[str]) -> str:
    """Store an input that raised another error for inspection, and continue: a long run finds more than one."""
    counts[FOREIGN] += 1
    if counts[FOREIGN] > MOST_KEPT:
        raise error
    kept = Path(tempfile.mkdtemp(prefix="fuzz_failure_")) / path.name
    kept.write_bytes(path.read_bytes())
    places = traceback.extract_tb(error.__traceback__)
    where = f"{places[-1].filename}:{places[-1].lineno}" if places else "no place"
    reported = f"{what}: {type(error).__name__}: {error} ({where}); kept as {kept}"
    print(reported, file=sys.stderr)
    return reported


def fuzz_sessions(inputs: int, chance: random.Random, folder: Path, counts: collections.Counter[str]) -> None:
    """Read a small session, one of whose files is damaged, and a small recording."""
    targets = session_targets(folder)
    whole = {name: (folder / name).read_bytes() for name in targets}
    parts = Parts(folder / "flight.mcap")
    quick = [name for name in targets if name not in SLOW]
    slow = [name for name in SLOW if name not in VIDEOS]
    for k in range(inputs):
        tell(k, "session files")
        # pictures and recordings take a hundred times as long as a table
        name = chance.choice(slow) if k % 20 == 0 else quick[k % len(quick)]
        path = folder / name
        kind = name
        if name == "flight.mcap" and chance.random() < 0.5:
            kind = "its messages"
            parts.write(path, chance)
        else:
            spoil = altered if path.suffix in (".csv", ".toml", ".json") and chance.random() < 0.5 else damaged
            path.write_bytes(spoil(whole[name], chance))
        try:
            with refused_in_words(InputError) as outcome:
                targets[name]()
            counts[f"{kind} {outcome[-1]}"] += 1
        except Exception as error:  # noqa: BLE001 - counted, kept, and the run fails
            keep(path, f"input {k}, {kind}", error, counts)
        path.write_bytes(whole[name])


def fuzz_videos(inputs: int, seed: int, root: Path, counts: collections.Counter[str], *, summary: bool) -> None:
    """Read damaged videos of each kind, and summaries in turn with them, some hundreds in a process of their own."""
    names = [*VIDEOS, *([SUMMARY] if summary else [])]
    done = 0
    while done < inputs:
        folder = Path(tempfile.mkdtemp(dir=root))
        done = _apart(done, min(inputs, done + A_PROCESS), seed, names, folder, counts)
        shutil.rmtree(folder)
        print(f"{done} of {inputs} videos", file=sys.stderr, flush=True)


def _apart(first: int, last: int, seed: int, names: list[str], folder: Path, counts: collections.Counter[str]) -> int:
    """Read inputs ``first`` to ``last`` in a separate process; return the number of the next."""
    part = f"{first} {last} {seed} {folder} {' '.join(names)}"
    done = subprocess.run(
        [sys.executable, __file__, "--part", part],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=False,
    )
    results = [line for line in done.stdout.splitlines() if line.startswith(RESULT)]
    for line in results:
        what, kept = line.removeprefix(RESULT).split("\t")
        counts[what] += 1
        if kept:
            print(kept, file=sys.stderr)
    if len(results) == last - first and done.returncode == 0:
        return last
    read = first + len(results)
    path = folder / names[read % len(names)]
    keep(path, f"input {read}", RuntimeError(f"the process ended, exit code {done.returncode}"), counts)
    return read + 1


def read_part(first: int, last: int, seed: int, folder: Path, names: list[str]) -> None:
    """Read some damaged videos and print a line for each."""
    targets = session_targets(folder)
    whole = {name: (folder / name).read_bytes() for name in names}
    for k in range(first, last):
        name, chance = names[k % len(names)], random.Random(f"{seed} {k}")
        spoil = altered if name == SUMMARY and chance.random() < 0.5 else damaged
        # the parent keeps the input where this process does not survive to report it
        (folder / name).write_bytes(spoil(whole[name], chance))
        kept = ""
        try:
            with refused_in_words(InputError) as outcome:
                targets[name]()
            what = f"{name} {outcome[-1]}"
        except Exception as error:  # noqa: BLE001 - counted, kept, and the run fails
            what, kept = FOREIGN, keep(folder / name, f"input {k}, {name}", error, collections.Counter())
        print(f"{RESULT}{what}\t{kept}", flush=True)
        (folder / name).write_bytes(whole[name])


def shares(inputs: int) -> dict[str, int]:
    """Return how many inputs of each kind there are; videos take a hundred times as long as a table."""
    logs, videos = inputs * 2 // 3, inputs // 100
    return {"logs": logs, "videos": videos, "sessions": inputs - logs - videos}


def main() -> None:
    """Run all and print how many were read and refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_050_000, metavar="N", help="how many in all")
    parser.add_argument("--seed", type=int, default=8, metavar="S")
    parser.add_argument("--only", choices=("logs", "sessions", "videos"), help="all inputs of this kind")
    parser.add_argument("--part", help=argparse.SUPPRESS)
    options = parser.parse_args()
    counts: collections.Counter[str] = collections.Counter()
    chance = random.Random(options.seed)
    signal.signal(signal.SIGALRM, no_end)
    # excessive memory for a small file is an error as well
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    # a non-finite number has to be refused before it is used
    warnings.simplefilter("error")
    if options.part:
        first, last, seed, folder, *names = options.part.split()
        read_part(int(first), int(last), int(seed), Path(folder), names)
        return
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(dir=shared) as name:
        n = {options.only: options.inputs} if options.only else shares(options.inputs)
        films, session = Path(name) / "videos", Path(name) / "session"
        for folder in (films, session):
            folder.mkdir()
        fuzz_videos(n.get("videos", 0), options.seed, films, counts, summary=options.only == "videos")
        fuzz_logs(n.get("logs", 0), chance, Path(name), counts)
        fuzz_sessions(n.get("sessions", 0), chance, session, counts)
    foreign = counts.pop(FOREIGN, 0)
    for kind in sorted({key.rsplit(" ", 1)[0] for key in counts}):
        print(f"{kind:<15} read {counts[f'{kind} read']:>8}  refused {counts[f'{kind} refused']:>8}")
    print(
        f"{sum(counts.values()) + foreign} inputs, {foreign or 'no'} errors that are not ours, "
        f"{time.perf_counter() - began:.0f} s"
    )
    sys.exit(foreign > 0)


if __name__ == "__main__":
    main()
