"""Size of a recording of the bundled landing: bytes per second at 30 pairs/s, searching and tracking, and its cost.

Twice: with the pictures as the videos have them, and as a raw camera would give them (Bayer, noise of 2 grey levels).
Then each recording is replayed: the same track, bit for bit?
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.conversion.recording_header import build_header
from groundstation.messages import Event, Frame
from groundstation.picture import BayerPattern, RawPicture
from groundstation.recording.mcap_reader import McapReader
from groundstation.recording.recorder import PATIENT, Recorder
from groundstation.replay.run_pipeline import run_pipeline
from groundstation.session import Session, load_session
from groundstation.sinks.output_comparison import OutputComparisonSink
from groundstation.sources.session_source import session_source
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.warm_up import warm_up

SESSION = Path(__file__).resolve().parents[1] / "recordings" / "landing-1"
RATE_HZ = 30.0
NOISE = 2.0
LIMIT_MB_S = 15.0


def raw(events: Iterable[Event]) -> Iterator[Event]:
    """Convert pictures to those of a sensor behind a Bayer filter, with noise."""
    rng = np.random.default_rng(3)
    for event in events:
        if isinstance(event, Frame):
            image = event.image.whole()
            mosaic = np.empty(image.shape[:2], np.float32)
            mosaic[0::2, 0::2], mosaic[0::2, 1::2] = image[0::2, 0::2, 2], image[0::2, 1::2, 1]
            mosaic[1::2, 0::2], mosaic[1::2, 1::2] = image[1::2, 0::2, 1], image[1::2, 1::2, 0]
            noisy = mosaic + NOISE * rng.standard_normal(mosaic.shape, np.float32)
            sensed = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
            yield replace(event, image=RawPicture(sensed, BayerPattern.RG))
        else:
            yield event


class Timed(Recorder):
    """A recorder that measures its cost in the calling thread."""

    spent_s = 0.0

    def take(self, event: Event) -> None:
        """Record an event."""
        began = time.thread_time()
        super().take(event)
        self.spent_s += time.thread_time() - began

    def write(self, report: object) -> None:
        """Record a report."""
        began = time.thread_time()
        super().write(report)  # type: ignore[arg-type]
        self.spent_s += time.thread_time() - began


def record(session: Session, path: Path, as_raw: bool, to_s: float | None) -> float:
    """Record a replay; returns its cost in the pipeline's thread, s per pair."""
    config = Config()
    header = build_header(session, None, config, initial=None, learns_from_reference=False)
    pipeline = Pipeline(session.rig, config, span_m=session.target.span_m)
    with session_source(session, None, to_s) as source, Timed(path, session.rig, header, PATIENT) as recorder:
        events: Iterable[Event] = raw(source) if as_raw else source
        outcome = run_pipeline(recorder.taken(events), pipeline, [recorder], lambda done: None)
    return recorder.spent_s / outcome.epochs


def rates(path: Path) -> dict[str, tuple[int, float]]:
    """Return frames and bytes per frame, of whole ones and of windows, and bytes per pair of all other data."""
    frames: dict[str, set[tuple[str, int]]] = {"whole": set(), "windows": set()}
    size = dict.fromkeys(("whole", "windows", "rest"), 0)
    pairs = 0
    with McapReader(path) as reader:
        for message in reader.messages():
            name = message.topic.split("/")
            kind = "rest"
            if len(name) > 3 and name[3] in ("image", "window"):
                kind = "whole" if name[3] == "image" else "windows"
                frames[kind].add((name[2], message.sequence))
            pairs += message.topic == "/groundstation/track"
            size[kind] += len(message.data)
    result = {kind: (len(frames[kind]), size[kind] / max(1, len(frames[kind]))) for kind in frames}
    result["rest"] = (pairs, size["rest"] / pairs)
    return result


def same_track(path: Path) -> str:
    session = load_session(path)
    check = OutputComparisonSink()
    pipeline = Pipeline(session.rig, Config(), span_m=session.target.span_m)
    with session_source(session, on_output=check.recorded) as source:
        run_pipeline(source, pipeline, [check], lambda done: None)
    if check.result().differing or check.result().alone:
        sys.exit(check.result().line())
    return check.result().line()


def live_search(session: Session, path: Path, seconds: float) -> str:
    """Record whole raw frames in real time, as while a live station searches; returns the result."""
    rng = np.random.default_rng(5)
    w, h = session.rig.stations[0].lens.image_size_px
    pool = [rng.normal(120.0, 4.0, (h, w)).astype(np.uint8) for _ in range(8)]
    header = build_header(session, None, Config(), initial=None, learns_from_reference=False)
    began, epoch, fullest = time.monotonic(), 0, 0.0
    with Recorder(path, session.rig, header, whole_frames=True) as recorder:
        while epoch < seconds * RATE_HZ:
            t_s = epoch / RATE_HZ
            for k, name in enumerate(session.rig.names):
                picture = RawPicture(pool[(epoch + k) % len(pool)], BayerPattern.RG)
                recorder.take(Frame(t_s=t_s, station=name, epoch=epoch, image=picture))
            epoch += 1
            fullest = max(fullest, recorder.status.fill)
            time.sleep(max(0.0, began + epoch / RATE_HZ - time.monotonic()))
    status = recorder.status
    rate = status.written_bytes / seconds / 1e6
    dropped = f"{status.pictures_dropped} of {2 * epoch} pictures dropped"
    return (
        f"live search, whole raw frames for {seconds:g} s: {rate:.1f} MB/s, {dropped}, queue at most {fullest:.0%} full"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--to", type=float, default=None, help="stop at this session time, s")
    options = parser.parse_args()
    warm_up()
    session = load_session(SESSION)
    with tempfile.TemporaryDirectory() as folder:
        print(live_search(session, Path(folder) / "search.mcap", 20.0), flush=True)
        for label, as_raw in (("as in the videos", False), (f"raw Bayer, noise {NOISE:g}", True)):
            path = Path(folder) / f"{as_raw}.mcap"
            spent_s = record(session, path, as_raw, options.to)
            found = rates(path)
            rest = found["rest"][1]
            print(f"{label}: {path.stat().st_size / 1e6:.1f} MB, {found['rest'][0]} pairs")
            for kind, words in (("whole", "searching"), ("windows", "tracking")):
                count, size = found[kind]
                rate = RATE_HZ * (2.0 * size + rest) / 1e6
                print(f"  {words}: {count} frames of {size / 1e3:.1f} kB, {rate:.2f} MB/s at {RATE_HZ:g} pairs/s")
                if kind == "windows" and rate > LIMIT_MB_S:
                    sys.exit(f"more than {LIMIT_MB_S:g} MB/s while tracking")
            print(
                f"  all else: {rest / 1e3:.1f} kB a pair; cost to the pipeline's thread: {1e3 * spent_s:.2f} ms a pair"
            )
            print(f"  replayed: {same_track(path)}", flush=True)


if __name__ == "__main__":
    main()
