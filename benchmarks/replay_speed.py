"""How fast a session replays: against its own length, and against decoding its videos alone in the same run.

    python benchmarks/replay_speed.py [SESSION] [--pairs N] [--repeats N]

Decoding alone is one thread per video, without use of the frames. The session is played repeatedly until so
many pairs have gone by, replays in turn with decoding, so that a busy machine slows both; the medians of some such
runs are printed. Imports and compilation are done before the first measurement and are not counted; neither are
evaluation and report, which come after the last frame. Every replay acquires its target again, which a flight does
once; so the part after the first tracked pair is reported separately, as "steady". There decoding alone is charged
only for what the replay's decoders had not yet decoded when the track began, the frames of a full queue less.
"""

import argparse
import csv
import statistics
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from groundstation.messages import TrackStatus
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.sources.picture_reader import QUEUE_FRAMES

ROOT = Path(__file__).resolve().parent.parent
WAYS = {"replay without Rerun": False, "replay, all outputs": True}
ALONE = "decoding alone"


def decode_alone(session: Path) -> tuple[float, list[float]]:
    """Return the seconds that two threads take to decode both videos, and when both had each of the frames."""
    moments: dict[Path, list[float]] = {}

    def work(path: Path) -> None:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        own = moments[path] = []
        while capture.read()[0]:
            own.append(time.perf_counter() - started)
        capture.release()

    threads = [threading.Thread(target=work, args=(p,)) for p in sorted(session.glob("*.mp4"))]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return time.perf_counter() - started, [max(pair) for pair in zip(*moments.values(), strict=False)]


def replayed(session: Path, *, rerun: bool) -> tuple[dict[str, float], list[float], int]:
    """Return the speed figures of one replay into a temporary folder.

    Also the time at which each pair was processed, s, and the first one that was tracked.
    """
    moments: list[float] = []

    def answered(pairs: int, _total: int | None) -> None:
        # several pairs may be processed at once
        moments.extend([time.perf_counter()] * (pairs - len(moments)))

    with tempfile.TemporaryDirectory() as folder:
        request = ReplayRequest(session=session, out=Path(folder), rerun=rerun)
        result = replay(request, answered)
        with (Path(folder) / "track.csv").open(newline="") as file:
            status = [row["status"] for row in csv.DictReader(file)]
    speed: dict[str, float] = result.evaluation.summary["speed"]
    latency = {f"latency {k}": v for k, v in result.evaluation.summary["latency_ms"].items()}
    if TrackStatus.TRACKING not in status:
        raise SystemExit(f"{session}: nothing is tracked, wanted a session with a target in it")
    return {**speed, **latency}, moments, status.index(TrackStatus.TRACKING)


def one_run(session: Path, pairs: int) -> dict[str, list[float]]:
    """Return the seconds of each way of playing, over as many rounds as give ``pairs``, and the latencies."""
    got: dict[str, list[float]] = {"pairs": [], ALONE: [], "latency p50": [], "latency p99": []}
    got |= {f"{name}{part}": [] for name in (*WAYS, ALONE) for part in ("", " steady")}
    while sum(got["pairs"]) < pairs:
        seconds, decoded = decode_alone(session)
        got[ALONE].append(seconds)
        for name, rerun in WAYS.items():
            speed, answered, first = replayed(session, rerun=rerun)
            got[name].append(speed["replay_s"])
            got[f"{name} steady"].append(answered[-1] - answered[first])
        got[f"{ALONE} steady"].append(decoded[-1] - decoded[min(first + QUEUE_FRAMES, len(decoded) - 1)])
        got["pairs"].append(speed["replay_s"] * speed["epochs_per_s"])
        got["latency p50"].append(speed["latency p50"])
        got["latency p99"].append(speed["latency p99"])
    return got


def ratios(runs: Sequence[Mapping[str, Sequence[float]]], name: str, part: str = "") -> tuple[float, float, float]:
    """Return how many times decoding alone a way of playing takes: median of the runs, and the rounds' quartiles."""
    of_runs = [sum(r[name + part]) / sum(r[ALONE + part]) for r in runs]
    rounds = [a / b for r in runs for a, b in zip(r[name + part], r[ALONE + part], strict=True)]
    low, high = np.quantile(rounds, [0.25, 0.75])
    return statistics.median(of_runs), float(low), float(high)


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
    alone = statistics.median(sum(r[ALONE]) for r in runs)
    print(f"decoding alone            {alone:7.2f} s, {pairs / alone:6.1f} pairs/s")
    for name in WAYS:
        seconds = statistics.median(sum(r[name]) for r in runs)
        whole, steady = ratios(runs, name), ratios(runs, name, " steady")
        print(
            f"{name:25s} {seconds:7.2f} s, {pairs / seconds:6.1f} pairs/s, {whole[0]:4.2f} × decoding"
            f" (half of the rounds {whole[1]:.2f} to {whole[2]:.2f});"
            f" steady {steady[0]:4.2f} ({steady[1]:.2f} to {steady[2]:.2f})"
        )
    middle, tail = (statistics.median(v for r in runs for v in r[key]) for key in ("latency p50", "latency p99"))
    print(f"latency with all outputs  {middle:.1f} ms median, {tail:.1f} ms at 99 %")


if __name__ == "__main__":
    main()
