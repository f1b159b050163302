"""Cost of the pipeline itself: processor time a pair of frames, without decoding, files and report.

    python benchmarks/pipeline_cost.py [SESSION] [--runs N]

All pictures are decoded first and kept (a gigabyte for each 130 pairs of 1280 × 960), then the session's events go
through a pipeline N times. Of each event the least of its N times counts: other load of the machine varies.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from groundstation.messages import Epoch, Event
from groundstation.replay.recording_replay import load_replay_config
from groundstation.session import Session, load_session
from groundstation.sources.session_source import session_source
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.warm_up import warm_up

ROOT = Path(__file__).resolve().parent.parent


def one_run(session: Session, events: list[Event]) -> np.ndarray:
    """Return this thread's processor time of each event, s."""
    pipeline = Pipeline(session.rig, load_replay_config(session, None), span_m=session.target.span_m)
    spent = np.empty(len(events))
    for k, event in enumerate(events):
        began = time.thread_time()
        pipeline.step(event)
        spent[k] = time.thread_time() - began
    pipeline.finish()
    return spent


def main() -> None:
    """Print the time a pair."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path, nargs="?", default=ROOT / "recordings" / "landing-1")
    parser.add_argument("--runs", type=int, default=5)
    options = parser.parse_args()
    session = load_session(options.session, None)
    with session_source(session, None, None, lambda line: None) as source:
        events = list(source)
    warm_up()
    one_run(session, events)
    least = np.min([one_run(session, events) for _ in range(options.runs)], axis=0)
    pairs = sum(isinstance(event, Epoch) for event in events)
    print(f"{pairs} pairs, {options.runs} runs: {least.sum() / pairs * 1e3:.2f} ms a pair")


if __name__ == "__main__":
    main()
