"""Sessions of one hour with DGPS: constant memory of a replay, and results that open.

    python benchmarks/long_session.py [--hours H] [--keep DIR] [--only pixels|pictures]

`pixels`: detections only, 10 Hz; an aircraft holds in front of two stations (case B), its receiver 0.3 s late.
`pictures`: the bundled landing repeatedly, an approach each 45 s, filmed at 10 Hz while it lasts: its own videos,
joined without re-encoding (needs `ffmpeg`), its angles, DGPS and truth at the times of each approach. So it
is acquired, tracked and lost once in 45 s.

Memory is the process's own resident set, sampled by a thread each 50 ms: from the most in the second half of the first
minute, when everything is loaded and compiled, to the most of all, wherever that is: replay, evaluation, closing the
Rerun recording, report. Each session runs in a separate process. Exit code 1 where that is more than `GROWTH_MB`, the
report is above `REPORT_MB`, or Rerun finds a fault in the recording. Run it twice where the kernels have changed: the
first time they are compiled in this process, which takes some 100 MB from the beginning.
"""

import argparse
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.replay.replay import ReplayRequest, replay
from groundstation.simulation import case_b, simulate
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.session_folder import write_session_folder
from groundstation.simulation.trajectory import SampledTrajectory

GROWTH_MB, REPORT_MB = 50.0, 5.0
RATE_HZ, LAP_S, STEP_S = 10.0, 90.0, 0.25
DGPS_LATE_S = 0.3
# after the last pair
AFTERWARDS = 1_000_000
LANDING, EVERY_S = Path(__file__).resolve().parent.parent / "recordings" / "landing-1", 45.0


def holding(span_s: float) -> SampledTrajectory:
    """Return an aircraft that flies to and fro between y = 150 and 450 m, weaving, for ``span_s``."""
    t = np.arange(0.0, span_s + STEP_S, STEP_S)
    turn = 2 * np.pi / LAP_S
    middle, swing = np.array([0.0, 300.0, 40.0]), np.array([30.0, 150.0, 8.0])
    phase = np.array([0.5 * np.pi, 0.0, 0.25 * np.pi])
    angle = turn * t[:, None] * np.array([2.0, 1.0, 3.0]) + phase
    rate = turn * np.array([2.0, 1.0, 3.0])
    return SampledTrajectory(
        t_s=t, position_m=middle + swing * np.sin(angle), velocity_m_s=swing * rate * np.cos(angle)
    )


def held(folder: Path, span_s: float) -> int:
    """Write the session without pictures."""
    scenario = case_b(seed=1, rate_hz=RATE_HZ, trajectory=holding(span_s))
    scenario = replace(scenario, dgps=DgpsModel(clock_offset_s=DGPS_LATE_S))
    write_session_folder(folder, simulate(scenario), name="one hour")
    return 0


def filmed(folder: Path, span_s: float) -> int:
    """Write the session with pictures: the bundled landing, again each `EVERY_S`."""
    approaches = round(span_s / EVERY_S)
    folder.mkdir(parents=True)
    shutil.copy(LANDING / "rig.toml", folder)
    text = (LANDING / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text(text[: text.index("[[phase]]")], encoding="utf-8")
    for name in ("ptu", "dgps", "truth", "frames"):
        head, *rows = (LANDING / f"{name}.csv").read_text(encoding="utf-8").splitlines()
        frames = len(rows) if name == "frames" else 0
        again = [_later(row, k, frames) for k in range(approaches) for row in rows]
        (folder / f"{name}.csv").write_text("\n".join([head, *again]) + "\n", encoding="utf-8")
    for name in ("left", "right"):
        source = ["ffmpeg", "-v", "error", "-stream_loop", str(approaches - 1), "-i", str(LANDING / f"{name}.mp4")]
        subprocess.run([*source, "-c", "copy", str(folder / f"{name}.mp4")], check=True)
    return 0


def _later(row: str, approach: int, frames: int) -> str:
    """Return a row at its time of an approach; in the table of frames (``frames`` of them) with its number there."""
    cells, by_s = row.split(","), approach * EVERY_S
    if not frames:
        return ",".join([f"{float(cells[0]) + by_s:.6f}", *cells[1:]])
    return ",".join([str(int(cells[0]) + approach * frames), *(f"{float(c) + by_s:.6f}" for c in cells[1:])])


SESSIONS: dict[str, Callable[[Path, float], int]] = {"pixels": held, "pictures": filmed}


def resident_mb() -> float:
    """Return this process's resident memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class MemoryMonitor:
    """The largest resident memory of each stretch of work, and the main thread's work then; by a thread."""

    def __init__(self) -> None:
        self.stretch = -1
        self.most: dict[int, tuple[float, str]] = {}
        self._main = threading.get_ident()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._stop.wait(0.05):
            now_mb, stretch = resident_mb(), self.stretch
            if now_mb > self.most.get(stretch, (0.0, ""))[0]:
                self.most[stretch] = now_mb, self._ours()

    def _ours(self) -> str:
        """Return the innermost function of this project that the main thread is in."""
        frame = sys._current_frames().get(self._main)
        while frame is not None and f"{os.sep}groundstation{os.sep}" not in frame.f_code.co_filename:
            frame = frame.f_back
        return "" if frame is None else f"{Path(frame.f_code.co_filename).stem}.{frame.f_code.co_name}"

    def stop(self) -> None:
        """End it."""
        self._stop.set()
        self._thread.join()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--keep", type=Path, help="write sessions and results there")
    parser.add_argument("--only", choices=SESSIONS, help="one of the two")
    options = parser.parse_args()
    worst = 0
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in SESSIONS.items():
            if options.only not in (None, kind):
                continue
            root, span_s = (options.keep or Path(folder)) / kind, 3600.0 * options.hours
            session = root / "session"
            if not session.is_dir():
                worst = max(worst, apart(write, session, span_s))
            print(f"== {kind}", flush=True)
            worst = max(worst, apart(measure, root))
    return worst


def apart(work: Callable[..., int], *given: Any) -> int:
    """Run ``work`` in a separate process, where nothing of another is counted, and return its exit code."""
    process = multiprocessing.get_context("fork").Process(target=lambda: sys.exit(work(*given)))
    process.start()
    process.join()
    return process.exitcode or 0


def measure(root: Path) -> int:
    session, out = root / "session", root / "out"
    total, half = 0, int(30 * RATE_HZ)
    watch = MemoryMonitor()

    def progress(done: int, of: int) -> None:
        nonlocal total
        total = of
        watch.stretch = AFTERWARDS if done >= of else done // half

    began = time.process_time()
    result = replay(ReplayRequest(session=session, out=out), progress)
    elapsed = time.process_time() - began
    watch.stop()
    most = [mb for stretch, (mb, _) in sorted(watch.most.items()) if 0 <= stretch < AFTERWARDS]
    early_mb, replay_mb = most[1], max(most[1:])
    most_mb, at = max(reading for stretch, reading in watch.most.items() if stretch > 0)
    summary = result.evaluation.summary
    rrd, report = out / "session.rrd", out / "report.html"
    verify = [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(rrd)]
    sound = subprocess.run(verify, env={**os.environ, "RERUN_ANALYTICS": "0"}, check=False).returncode == 0
    report_mb = report.stat().st_size / 1e6
    print(f"pairs, tracked        {total}, {summary['counts']['track']['tracking']}")
    for reference, table in summary["accuracy"].items():
        rmse = "/".join(f"{value:.3f}" for value in table["total"]["ekf"]["rmse_m"])
        print(f"RMSE against {reference:<8} {rmse} m, {table['total']['ekf']['epochs']} pairs")
    print(f"fixes, left out       {summary['reference']['fixes']}, {len(summary['reference']['excluded'])} stretches")
    print(f"replay                {elapsed:.0f} s of processor time, everything included")
    every = [f"{most[k]:.0f}" for k in range(1, len(most), max(1, len(most) // 6))]
    print(f"resident memory       most in the first minute {early_mb:.0f} MB; then, evenly, {', '.join(every)}")
    print(f"  most of all         {most_mb:.0f} MB, in {at}")
    print(f"session.rrd           {rrd.stat().st_size / 1e6:.1f} MB, {'sound' if sound else 'NOT SOUND'}")
    print(f"report.html           {report_mb:.2f} MB")
    grown_mb = most_mb - early_mb
    print(f"grown in the replay   {replay_mb - early_mb:.0f} MB")
    print(f"grown in all          {grown_mb:.0f} MB (at most {GROWTH_MB:.0f})")
    return 0 if grown_mb <= GROWTH_MB and report_mb <= REPORT_MB and sound else 1


if __name__ == "__main__":
    sys.exit(main())
