"""Damaged logs and session files, a million and more: only errors of our own may come out, and only sane numbers.

python benchmarks/log_fuzz.py [--inputs N] [--seed S]
"""

import argparse
import collections
import contextlib
import os
import random
import resource
import signal
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
from groundstation.logs.fixes import LogOptions  # noqa: E402
from groundstation.logs.read import GnssLog, read_log  # noqa: E402
from tests.logs.damage import altered, damaged, forged, seeds  # noqa: E402
from tests.session.damage import SLOW, Parts, session_targets  # noqa: E402

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
    """Take an error of our own as an answer, "refused"; raises `AssertionError` if it is not one printable line."""
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
    """Say now and then how far it is."""
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


def keep(path: Path, what: str, error: Exception, counts: collections.Counter[str]) -> None:
    """Put an input that brought another error where it can be looked at, and go on: a long run finds more than one."""
    counts[FOREIGN] += 1
    if counts[FOREIGN] > MOST_KEPT:
        raise error
    kept = Path(tempfile.mkdtemp(prefix="fuzz_failure_")) / path.name
    kept.write_bytes(path.read_bytes())
    last = traceback.extract_tb(error.__traceback__)[-1]
    print(f"{what}: {type(error).__name__}: {error} ({last.filename}:{last.lineno}); kept as {kept}", file=sys.stderr)


def fuzz_sessions(inputs: int, chance: random.Random, folder: Path, counts: collections.Counter[str]) -> None:
    """Read a small session, one of whose files is damaged, and a small recording."""
    targets = session_targets(folder)
    whole = {name: (folder / name).read_bytes() for name in targets}
    parts = Parts(folder / "flight.mcap")
    quick = [name for name in targets if name not in SLOW]
    for k in range(inputs):
        tell(k, "session files")
        # pictures and recordings take a hundred times as long as a table
        name = chance.choice(SLOW) if k % 20 == 0 else quick[k % len(quick)]
        path = folder / name
        kind = name
        if name == "flight.mcap" and chance.random() < 0.5:
            kind = "its messages"
            parts.write(path, chance)
        else:
            spoil = altered if path.suffix in (".csv", ".toml") and chance.random() < 0.5 else damaged
            path.write_bytes(spoil(whole[name], chance))
        try:
            with refused_in_words(InputError) as outcome:
                targets[name]()
            counts[f"{kind} {outcome[-1]}"] += 1
        except Exception as error:  # noqa: BLE001 - counted, kept, and the run fails
            keep(path, f"input {k}, {kind}", error, counts)
        path.write_bytes(whole[name])


def main() -> None:
    """Run both and print how many were read and refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_050_000, metavar="N", help="how many in all")
    parser.add_argument("--seed", type=int, default=8, metavar="S")
    options = parser.parse_args()
    counts: collections.Counter[str] = collections.Counter()
    chance = random.Random(options.seed)
    signal.signal(signal.SIGALRM, no_end)
    # room that a small file asks for is an error as well
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    # a number that is none is to be refused before it is reckoned with
    warnings.simplefilter("error")
    shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(dir=shared) as name:
        fuzz_logs(options.inputs * 2 // 3, chance, Path(name), counts)
        session = Path(name) / "session"
        session.mkdir()
        fuzz_sessions(options.inputs - options.inputs * 2 // 3, chance, session, counts)
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
