"""How fast a session replays: against its own length, and against decoding its videos alone in the same run.

    python benchmarks/replay_speed.py [SESSION] [--pairs N] [--repeats N]

Decoding alone is one thread per video, nothing done with the frames. The session is played over and over until so
many pairs have gone by, replays in turn with decoding, so that a busy machine slows both; the medians of some such
runs are printed. Imports and compilation are done before the first measurement and are not counted; neither are
evaluation and report, which come after the last frame. Every replay acquires its target anew.
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
WAYS = {"replay without Rerun": False, "replay, all outputs": True}


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


def one_run(session: Path, pairs: int) -> dict[str, list[float]]:
    """Return the seconds of each way of playing, over as many rounds as give ``pairs``, and the latencies."""
    got: dict[str, list[float]] = {"pairs": [], "decoding alone": [], "latency p50": [], "latency p99": []}
    got |= {name: [] for name in WAYS}
    while sum(got["pairs"]) < pairs:
        got["decoding alone"].append(decode_alone(session))
        for name, rerun in WAYS.items():
            speed = replayed(session, rerun=rerun)
            got[name].append(speed["replay_s"])
        got["pairs"].append(speed["replay_s"] * speed["epochs_per_s"])
        got["latency p50"].append(speed["latency p50"])
        got["latency p99"].append(speed["latency p99"])
    return got


def main() -> None:
    """Print the medians and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path, nargs="?", default=ROOT / "recordings" / "landing-1")
    parser.add_argument("--pairs", type=int, default=3000, help="play the session until so many pairs have gone by")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    replayed(options.session, rerun=True)
    runs = [one_run(options.session, options.pairs) for _ in range(options.repeats)]
    pairs = sum(runs[0]["pairs"])
    print(f"{pairs:.0f} pairs a run, {options.repeats} runs, medians")
    alone = statistics.median(sum(r["decoding alone"]) for r in runs)
    print(f"decoding alone            {alone:7.2f} s, {pairs / alone:6.1f} pairs/s")
    for name in WAYS:
        seconds = statistics.median(sum(r[name]) for r in runs)
        ratio = statistics.median(sum(r[name]) / sum(r["decoding alone"]) for r in runs)
        print(f"{name:25s} {seconds:7.2f} s, {pairs / seconds:6.1f} pairs/s, {ratio:4.2f} × decoding")
    middle, tail = (statistics.median(v for r in runs for v in r[key]) for key in ("latency p50", "latency p99"))
    print(f"latency with all outputs  {middle:.1f} ms median, {tail:.1f} ms at 99 %")


if __name__ == "__main__":
    main()
