"""The bank on one and on two workers: the same rows, how many times as fast, and the same after a kill -9.

usage: python benchmarks/bank_workers.py [--worlds N] [--duration S] [--killed] [--unbound]

Worlds of the train set, short, without the baseline, on Linux. One worker with its encoder and decoders is bound to the
first CPU, two to the first two; where these are two threads of one core (`lscpu --extended`), the ratio is that of the
threads: name others with taskset. --unbound also times one worker that may use both: encoders and decoders then take
a part of the second. --killed also runs the bank in a separate process, kills one of its workers and then the process
itself midway, and continues it.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from groundstation.bank.bank_settings import BankSettings
from groundstation.bank.run_bank import BankRequest, run_bank
from groundstation.simulation.world.world_sets import WorldSet

_WAIT_S = 0.5
_LONGEST_S = 3600.0


def settings_of(worlds: int, duration_s: float) -> BankSettings:
    return BankSettings(world_set=WorldSet.TRAIN, sessions=worlds, first=500_000, duration_s=duration_s)


def require_cores(cores: int) -> None:
    count = len(os.sched_getaffinity(0))
    if count < cores:
        raise SystemExit(f"cores: got {count}, wanted {cores} or more")


def timed(settings: BankSettings, out: Path, workers: int, cores: int) -> tuple[str, float]:
    """Return the hash of the rows and the time in s of a bank whose processes share the first so many cores."""
    every = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(every)[:cores])
    began = time.perf_counter()
    try:
        outcome = run_bank(BankRequest(settings=settings, out=out, workers=workers), "")
    finally:
        os.sched_setaffinity(0, every)
    if outcome.result.failures:
        raise SystemExit(f"{outcome.result.failures[0].name}: {outcome.result.failures[0].reason}")
    return outcome.digest, time.perf_counter() - began


def killed_and_resumed(settings: BankSettings, out: Path) -> tuple[str, int]:
    """Return the hash of the rows after two kills, and how many sessions had been finished before the last start."""
    command = [sys.executable, __file__, "--part", str(out), str(settings.sessions), str(settings.duration_s)]
    process = subprocess.Popen(command, start_new_session=True)
    sessions = out / "sessions"
    try:
        _wait_for(sessions, settings.sessions // 4)
        worker = max(_children(process.pid), key=lambda pid: pid)
        os.kill(worker, signal.SIGKILL)
        _wait_for(sessions, settings.sessions // 2)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    outcome = run_bank(BankRequest(settings=settings, out=out, workers=2), "")
    return outcome.digest, outcome.reused


def _wait_for(sessions: Path, count: int) -> None:
    """Wait until so many sessions have been finished."""
    until = time.monotonic() + _LONGEST_S
    while len(list(sessions.glob("world-*.json"))) < count:
        if time.monotonic() > until:
            raise SystemExit(f"fewer than {count} sessions in {_LONGEST_S:.0f} s")
        time.sleep(_WAIT_S)


def _children(pid: int) -> list[int]:
    """Return the workers: the processes below one that have the most threads of Dask's nanny processes below them."""
    listed = subprocess.run(["ps", "-eo", "pid,ppid,args"], capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()[1:]]
    return [int(p) for p, parent, words in rows if int(parent) == pid and "spawn_main" in words]


def main() -> None:
    """Print times, their ratio, and whether the rows are the same."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--duration", type=float, default=4.0)
    parser.add_argument("--killed", action="store_true")
    parser.add_argument("--unbound", action="store_true")
    parser.add_argument("--part", nargs=3, metavar=("OUT", "WORLDS", "DURATION"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part is not None:
        out, worlds, duration = options.part
        timed(settings_of(int(worlds), float(duration)), Path(out), workers=2, cores=2)
        return
    settings = settings_of(options.worlds, options.duration)
    require_cores(2)
    with tempfile.TemporaryDirectory(prefix="bank-workers-") as name:
        folder = Path(name)
        one, one_s = timed(settings, folder / "one", workers=1, cores=1)
        two, two_s = timed(settings, folder / "two", workers=2, cores=2)
        same = "the same" if one == two else "differ"
        print(
            f"{options.worlds} worlds of {options.duration:g} s: 1 worker {one_s:.0f} s, 2 workers {two_s:.0f} s",
            end="",
        )
        print(f", {one_s / two_s:.2f} times as fast; rows {same} ({one[:12]}, {two[:12]})", flush=True)
        if options.unbound:
            _, unbound_s = timed(settings, folder / "unbound", workers=1, cores=2)
            print(f"1 worker that may use both cores: {unbound_s:.0f} s, {unbound_s / two_s:.2f} times", flush=True)
        if options.killed:
            digest, reused = killed_and_resumed(settings, folder / "killed")
            print(
                f"worker and program killed, {reused} sessions kept: rows {'the same' if digest == one else 'differ'}"
            )


if __name__ == "__main__":
    main()
