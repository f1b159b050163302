"""How fast a session replays: against its own length, and against decoding its videos alone in the same run.

    python benchmarks/replay_speed.py [SESSION] [--repeats N]

Decoding alone is one thread per video, nothing done with the frames. Replays alternate with it, so that a busy
machine slows both; medians are printed. Imports and compilation are done before the first measurement and are
not counted; neither are evaluation and report, which come after the last frame.
"""

import argparse
import statistics
import tempfile
import threading
import time
from pathlib import Path

import cv2

from groundstation.replay import ReplayRequest, replay

ROOT = Path(__file__).resolve().parent.parent


def decode_alone(session: Path) -> float:
    """Return the seconds that two threads take to decode both videos."""

    def work(path: Path) -> None:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        while capture.read()[0]:
            pass
        capture.release()

    threads = [threading.Thread(target=work, args=(p,)) for p in sorted(session.glob("*.mp4"))]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return time.perf_counter() - started


def replayed(session: Path, *, rerun: bool) -> dict[str, float]:
    """Return the speed figures of one replay into a folder that is thrown away."""
    with tempfile.TemporaryDirectory() as folder:
        result = replay(ReplayRequest(session=session, out=Path(folder), rerun=rerun))
    speed: dict[str, float] = result.evaluation.summary["speed"]
    return {**speed, **{f"latency {k}": v for k, v in result.evaluation.summary["latency_ms"].items()}}


def main() -> None:
    """Print the medians and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path, nargs="?", default=ROOT / "recordings" / "landing-1")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    replayed(options.session, rerun=True)
    alone, plain, full = [], [], []
    for _ in range(options.repeats):
        alone.append(decode_alone(options.session))
        plain.append(replayed(options.session, rerun=False))
        full.append(replayed(options.session, rerun=True))
    base = statistics.median(alone)
    print(f"decoding alone            {base:7.2f} s")
    for name, runs in (("replay without Rerun", plain), ("replay, all outputs", full)):
        seconds = statistics.median(r["replay_s"] for r in runs)
        pairs = statistics.median(r["epochs_per_s"] for r in runs)
        real = statistics.median(r["times_real_time"] for r in runs)
        latency = statistics.median(r["latency p50"] for r in runs), statistics.median(r["latency p99"] for r in runs)
        print(
            f"{name:25s} {seconds:7.2f} s, {pairs:6.1f} pairs/s, {real:5.1f} × real time, "
            f"{seconds / base:4.2f} × decoding, latency {latency[0]:.1f} ms median, {latency[1]:.1f} ms at 99 %"
        )


if __name__ == "__main__":
    main()
