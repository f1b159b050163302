"""Faults on the real lines: `live --simulate` on ptys, in real time, one approach for each fault and for some pairs.

    python benchmarks/live_serial_faults.py [--rate HZ] [--only WORD]

Pictures of a quarter of the size, so that two cores render and track in real time. For each case: what the status said
while the fault was there, how soon it tracked again after it, ANEES of all answers of the approach, and what the
recording lacks of what was consumed, in s at its end. "disk full" lets no file grow beyond 3 MB; "killed" is kill -9
of the station's process group, what is left then is recovered.
"""

import argparse
import contextlib
import json
import math
import multiprocessing as mp
import os
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from groundstation.errors import RecordingError
from groundstation.geometry.camera import Lens
from groundstation.live.command import LiveRequest, live
from groundstation.live.simulated_receiver import ReceiverModel
from groundstation.live.timed_faults import TimedFault
from groundstation.rig import Rig
from groundstation.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation.cases import standard_rig
from groundstation.sources.session_source import session_source

FROM_S, TO_S, END_S = 8.0, 10.0, 14.0
# a receiver is gone after two seconds
DGPS_LONGER_S = 1.0
DISK_BYTES = 3_000_000
# half of it may pass between two lines of the status
STATUS_S = 0.5


@dataclass(frozen=True)
class Case:
    """What goes wrong: faults by name and station; the receiver, the disk, the process."""

    name: str
    faults: tuple[tuple[str, str], ...] = ()
    dgps_gone: bool = False
    disk_full: bool = False
    killed: bool = False


CASES = (
    Case("nothing"),
    Case("PTU silent", (("PTU silent", "left"),)),
    Case("PTU garbage", (("garbage", "left"),)),
    Case("PTU unplugged", (("unplugged", "left"),)),
    Case("PTU power-cycled", (("power cycle", "left"),)),
    Case("PTU's answers late", (("late answer", "left"),)),
    Case("camera lost", (("camera lost", "right"),)),
    Case("camera frozen", (("camera frozen", "right"),)),
    Case("DGPS gone", dgps_gone=True),
    Case("disk full", disk_full=True),
    Case("killed", killed=True),
    Case("PTU silent, camera lost", (("PTU silent", "left"), ("camera lost", "left"))),
    Case("PTU garbage, DGPS gone", (("garbage", "right"),), dgps_gone=True),
    Case("camera frozen, disk full", (("camera frozen", "left"),), disk_full=True),
)


def small_rig() -> Rig:
    """Return the standard rig with pictures of a quarter of the size."""
    lens = Lens(
        image_size_px=(320, 240),
        focal_px=np.array([1667.0, 1667.0]),
        principal_point_px=np.array([159.5, 119.5]),
        distortion=np.zeros(5),
    )
    rig = standard_rig()
    return replace(rig, stations=tuple(replace(s, lens=lens) for s in rig.stations))


def fly(case: Case, folder: Path, rate_hz: float) -> None:
    """Fly one approach in this process, a line for each status; at the end how it went."""
    os.setsid()
    if case.disk_full:
        resource.setrlimit(resource.RLIMIT_FSIZE, (DISK_BYTES, DISK_BYTES))
    sys.stderr = sys.stdout = (folder / "said.txt").open("w", buffering=1, encoding="utf-8")
    told = (folder / "told.jsonl").open("w", buffering=1, encoding="utf-8")
    request = LiveRequest(
        station=None,
        out=folder / "live",
        seconds=END_S,
        simulate=True,
        rig=folder / "small.toml",
        rate_hz=rate_hz,
        receiver=ReceiverModel(gone_s=((FROM_S, TO_S + DGPS_LONGER_S),)) if case.dgps_gone else None,
        timetable=tuple(TimedFault(what=w, station=s, from_s=FROM_S, to_s=TO_S) for w, s in case.faults),
    )
    result = live(
        request,
        lambda: False,
        lambda s: print(json.dumps([s.t_s, time.monotonic(), s.track.value, list(s.lines)]), file=told),
        lambda text: None,
    )
    rows = [] if result.score is None else [[r.count, r.anees] for r in result.score.rows]
    (folder / "result.json").write_text(json.dumps({"begin_s": result.begin_s, "rows": rows}), encoding="utf-8")


def recorded_until(path: Path) -> float:
    """Return the stamp of the last event of a recording, session time; what was cut short counts so far."""
    newest_s = -math.inf
    with (
        contextlib.suppress(RecordingError),
        session_source(load_session(path), None, None, lambda line: None) as source,
    ):
        for event in source:
            newest_s = max(newest_s, event.t_s)
    return newest_s


def run(case: Case, rate_hz: float) -> str:
    """Fly a case and return its line of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "small.toml").write_text(rig_to_toml(small_rig()), encoding="utf-8")
        child = mp.get_context("spawn").Process(target=fly, args=(case, folder, rate_hz))
        child.start()
        if case.killed:
            kill_when_tracking(child, folder)
        child.join(150.0)
        if child.is_alive():
            os.killpg(child.pid or 0, signal.SIGKILL)
            return f"{case.name:26s} did not end"
        lines = (folder / "told.jsonl").read_text(encoding="utf-8").splitlines()
        told = [json.loads(line) for line in lines if line.endswith("]")]
        # a disk that is full takes nothing more, and it is said: what came before is to be there
        ended = [t_s for t_s, _, _, said in told if any("not recording" in w for w in said)]
        last_s = ended[0] if case.disk_full and ended else told[-1][0]
        lost_s = max(last_s - recorded_until(folder / "live" / "flight.mcap"), 0.0)
        if case.killed:
            return f"{case.name:26s} {'—':>24s} {'—':>7s} {'—':>6s} {lost_s:6.2f}"
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        return line_of(case, told, result, lost_s)


def kill_when_tracking(child: "mp.process.BaseProcess", folder: Path) -> None:
    """Kill a station and all of its processes once it has tracked for a while."""
    path = folder / "told.jsonl"
    end_s = time.monotonic() + 120.0
    while time.monotonic() < end_s:
        if path.is_file() and path.read_text(encoding="utf-8").count('"tracking"') > 6:
            break
        time.sleep(0.1)
    os.killpg(child.pid or 0, signal.SIGKILL)


def line_of(case: Case, told: list, result: dict, lost_s: float) -> str:
    """Return a line: statuses while the fault was there, time to tracking after it, ANEES, what is lost."""
    begin_s = result["begin_s"]
    during = Counter(track for t_s, _, track, _ in told if FROM_S + 0.2 <= t_s - begin_s < TO_S)
    words = ", ".join(f"{n} {track}" for track, n in during.most_common())
    again = [t_s - begin_s - TO_S for t_s, _, track, _ in told if t_s - begin_s >= TO_S and track == "tracking"]
    count = sum(n for n, _ in result["rows"])
    anees = sum(n * a for n, a in result["rows"]) / count if count else math.nan
    back = f"{again[0]:.1f}" if again else "never"
    also = [
        w for _, _, _, lines in told for w in lines if "gone since" in w or "not recording" in w or "ends here" in w
    ]
    note = f"  “{also[0][:60]}”" if also else ""
    return f"{case.name:26s} {words:>24s} {back:>7s} {anees:6.2f} {lost_s:6.2f}{note}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--only", default="", help="cases with this word")
    options = parser.parse_args()
    print(f"{'fault':26s} {'status meanwhile':>24s} {'back, s':>7s} {'ANEES':>6s} {'lost, s':>6s}", flush=True)
    for case in CASES:
        if options.only in case.name:
            print(run(case, options.rate), flush=True)


if __name__ == "__main__":
    main()
