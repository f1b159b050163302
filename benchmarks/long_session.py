"""A session of one hour at 10 Hz, detections only: does a replay's memory stay flat, and do its results open?

    python benchmarks/long_session.py [--hours H] [--keep DIR]

An aircraft holds in front of two stations (case B, exact truth, no DGPS). Memory is the process's own resident set,
sampled by a thread: from the end of the session's first minute, when everything is loaded and compiled, to the most of
all, wherever that is: replay, evaluation, closing the Rerun recording, report. Exit code 1 where that is more than
`GROWTH_MB`, the report is above `REPORT_MB`, or Rerun finds a fault in the recording. Run it twice where the kernels
have changed: the first time they are compiled in this process, which takes some 100 MB from the beginning.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from groundstation.replay import ReplayRequest, replay
from groundstation.simulation import case_b, simulate
from groundstation.simulation.trajectory import Sampled
from groundstation.sinks.session_folder import write_session_folder

GROWTH_MB, REPORT_MB = 50.0, 5.0
RATE_HZ, LAP_S, STEP_S = 10.0, 90.0, 0.25


def holding(span_s: float) -> Sampled:
    """Return an aircraft that flies to and fro between y = 150 and 450 m, weaving, for ``span_s``."""
    t = np.arange(0.0, span_s + STEP_S, STEP_S)
    turn = 2 * np.pi / LAP_S
    middle, swing = np.array([0.0, 300.0, 40.0]), np.array([30.0, 150.0, 8.0])
    phase = np.array([0.5 * np.pi, 0.0, 0.25 * np.pi])
    angle = turn * t[:, None] * np.array([2.0, 1.0, 3.0]) + phase
    rate = turn * np.array([2.0, 1.0, 3.0])
    return Sampled(t_s=t, position_m=middle + swing * np.sin(angle), velocity_m_s=swing * rate * np.cos(angle))


def resident_mb() -> float:
    """Return this process's resident memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Watch:
    """The largest resident memory, sampled by a thread."""

    def __init__(self) -> None:
        self.most_mb = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._stop.wait(0.05):
            self.most_mb = max(self.most_mb, resident_mb())

    def stop(self) -> float:
        """End it and return the most that was seen, MB."""
        self._stop.set()
        self._thread.join()
        return self.most_mb


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--keep", type=Path, help="write session and results there")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        return measure(options.keep or Path(folder), 3600.0 * options.hours)


def measure(root: Path, span_s: float) -> int:
    session, out = root / "session", root / "out"
    if not session.is_dir():
        # in a process of its own, so that nothing of the simulation is counted
        child = os.fork()
        if child == 0:
            flight = simulate(case_b(seed=1, rate_hz=RATE_HZ, trajectory=holding(span_s)))
            write_session_folder(session, flight, name="one hour")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
    readings: list[tuple[int, float]] = []
    total = 0

    def progress(done: int, of: int) -> None:
        nonlocal total
        total = of
        if done % 200 == 0:
            readings.append((done, resident_mb()))

    watch = Watch()
    began = time.perf_counter()
    result = replay(ReplayRequest(session=session, out=out), progress)
    elapsed = time.perf_counter() - began
    most_mb = watch.stop()
    early_mb = next(mb for done, mb in readings if done >= 60 * RATE_HZ)
    late_mb = readings[-1][1]
    tracked = result.evaluation.summary["counts"]["track"]["tracking"]
    rrd, report = out / "session.rrd", out / "report.html"
    verify = [sys.executable, "-m", "rerun", "rrd", "verify", str(rrd)]
    sound = subprocess.run(verify, env={**os.environ, "RERUN_ANALYTICS": "0"}, check=False).returncode == 0
    report_mb = report.stat().st_size / 1e6
    print(f"pairs, tracked        {total}, {tracked}")
    print(f"replay                {elapsed:.0f} s, {total / elapsed:.0f} pairs/s, everything included")
    print(f"resident memory       {early_mb:.0f} MB after a minute, {late_mb:.0f} MB at the last pair")
    print(f"  most, with report   {most_mb:.0f} MB")
    print(f"session.rrd           {rrd.stat().st_size / 1e6:.1f} MB, {'sound' if sound else 'NOT SOUND'}")
    print(f"report.html           {report_mb:.2f} MB")
    grown_mb = most_mb - early_mb
    print(f"grown in the replay   {late_mb - early_mb:.0f} MB")
    print(f"grown in all          {grown_mb:.0f} MB (at most {GROWTH_MB:.0f})")
    return 0 if grown_mb <= GROWTH_MB and report_mb <= REPORT_MB and sound else 1


if __name__ == "__main__":
    sys.exit(main())
