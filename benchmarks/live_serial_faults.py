"""Faults on the real lines: `live --simulate` on ptys, in real time, one approach for each fault and for some pairs.

    python benchmarks/live_serial_faults.py [--rate HZ] [--only WORD]

Pictures of a quarter of the size, so that two cores render and track in real time. For each case: until when the fault
lasts (a unit that lost power homes, late replies delay each other), the statuses meanwhile, the time from then until
it tracked, ANEES of all estimates of the approach, and the missing part of the recording, in s at
its end. "disk full" lets no file grow beyond 3 MB. "killed" is kill -9 of the station's process group in mid-flight, on
a range that continues; the rest of the recording is recovered, and the station is restarted at once.
"""

import argparse
import contextlib
import json
import math
import multiprocessing as mp
import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.errors import RecordingError
from groundstation.geometry.camera import Lens
from groundstation.live.command import LiveRequest, live
from groundstation.live.status_board import LiveStatus
from groundstation.messages import TrackStatus
from groundstation.recording.recovery import recover
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation.attached_simulator import AttachedSimulator
from groundstation.simulation.device_faults import TimedFault, struck_at
from groundstation.simulation.device_simulator import DeviceSimulator, DeviceSimulatorConfig
from groundstation.simulation.repeated_landings import RepeatedLandings
from groundstation.simulation.simulated_receiver import ReceiverModel
from groundstation.simulation.simulated_station import SimulatedStation, SimulatedStationConfig
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.simulation.standard_cases import standard_rig
from groundstation.sources.session_source import session_source
from ptu_drivers.simulated.faults import FAULTS
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

FROM_S, TO_S = 8.0, 10.0
# flown after a fault's end
AFTER_S = 4.0
# time that a station needs to start; a restarted one has this approach or the next, and ends after so many lines
BEGINS_S, TWO_LAPS_S, ENOUGH_LINES = 25.0, 76.0, 12
SIMULATED_BAUD = 115200
RANGE_UNIT = FlirModel(homing_s=8.0)
# a receiver is gone after two seconds
DGPS_LONGER_S = 1.0
DISK_BYTES = 3_000_000
# half of it may pass between two lines of the status
STATUS_S = 0.5


@dataclass(frozen=True)
class Case:
    """A fault case: faults by name and station; the receiver (lost, its clock off by so much), disk, process."""

    name: str
    faults: tuple[tuple[str, str], ...] = ()
    dgps_gone: bool = False
    dgps_stepped: tuple[float, float, float] | None = None
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
    Case("camera late by 0.2 s", (("camera late", "right"),)),
    Case("camera's clock steps by 0.2 s", (("camera clock stepped", "right"),)),
    Case("DGPS gone", dgps_gone=True),
    Case("DGPS clock steps by 0.1 s", dgps_stepped=(FROM_S, TO_S, 0.1)),
    Case("DGPS clock steps back for good", dgps_stepped=(FROM_S, math.inf, -0.1)),
    Case("disk full", disk_full=True),
    Case("killed", killed=True),
    Case("PTU silent, camera lost", (("PTU silent", "left"), ("camera lost", "left"))),
    Case("PTU garbage, DGPS gone", (("garbage", "right"),), dgps_gone=True),
    Case("camera frozen, disk full", (("camera frozen", "left"),), disk_full=True),
    Case("camera lost, disk full", (("camera lost", "left"),), disk_full=True),
    Case("camera late, disk full", (("camera late", "left"),), disk_full=True),
    Case("PTU silent, disk full", (("PTU silent", "left"),), disk_full=True),
    Case("PTU garbage, disk full", (("garbage", "right"),), disk_full=True),
    Case("PTU power-cycled, disk full", (("power cycle", "left"),), disk_full=True),
    Case("DGPS gone, disk full", dgps_gone=True, disk_full=True),
    Case("camera late, PTU silent", (("camera late", "right"), ("PTU silent", "left"))),
    Case("camera's clock steps, PTU silent", (("camera clock stepped", "right"), ("PTU silent", "right"))),
)


def lasts_until(case: Case) -> float:
    """Return when the last of a case's faults is over, s of the flight, as the range draws them."""
    ends_s = [TO_S]
    for number, name in enumerate(small_rig().names):
        random_ = random.Random(number)
        for fault in (f for f in timetable(case) if f.station == name and f.what in FAULTS):
            line = VirtualLine(SimulatedUnit(RANGE_UNIT, LineModel(baud=SIMULATED_BAUD)), SIMULATED_BAUD)
            lengths = [FAULTS[fault.what](line, random_) for _ in struck_at(fault)]
            # one late reply delays the next
            ends_s.append(FROM_S + (sum(lengths) if fault.what == "late answer" else lengths[0]))
    return max(ends_s)


def timetable(case: Case) -> tuple[TimedFault, ...]:
    """Return a case's faults in the range's format."""
    return tuple(TimedFault(what=w, station=s, from_s=FROM_S, to_s=TO_S) for w, s in case.faults)


def receiver(case: Case) -> ReceiverModel | None:
    """Return a case's receiver, None where it needs none."""
    if case.dgps_stepped is not None:
        return ReceiverModel(stepped_s=(case.dgps_stepped,))
    return ReceiverModel(gone_s=((FROM_S, TO_S + DGPS_LONGER_S),)) if case.dgps_gone else None


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


def fly(case: Case, folder: Path, rate_hz: float, lent: AttachedSimulator | None = None) -> None:
    """Fly one approach in this process, a line for each status; at the end the result."""
    os.setsid()
    if case.disk_full:
        resource.setrlimit(resource.RLIMIT_FSIZE, (DISK_BYTES, DISK_BYTES))
    sys.stderr = sys.stdout = (folder / "said.txt").open("w", buffering=1, encoding="utf-8")
    status_file = (folder / "status.jsonl").open("w", buffering=1, encoding="utf-8")
    seconds = TWO_LAPS_S if case.killed else lasts_until(case) + AFTER_S
    request = LiveRequest(station=None, out=folder / "live", seconds=seconds)
    own = SimulatedStation(
        SimulatedStationConfig(
            seconds=seconds,
            rig=folder / "small.toml",
            rate_hz=rate_hz,
            receiver=receiver(case),
            timetable=timetable(case),
        )
    )
    tracks: list[TrackStatus] = []

    def tell(s: LiveStatus) -> None:
        tracks.append(s.track)
        print(json.dumps([s.t_s, time.monotonic(), s.track.value, list(s.lines)]), file=status_file)

    result = live(
        request,
        lambda: case.killed and tracks.count(TrackStatus.TRACKING) >= ENOUGH_LINES,
        tell,
        lambda text: None,
        lent or own,
    )
    score = None if lent else own.score(result.begin_s)
    rows = [] if score is None else [[r.count, r.anees] for r in score.rows]
    (folder / "result.json").write_text(json.dumps({"begin_s": result.begin_s, "rows": rows}), encoding="utf-8")


def recorded_until(path: Path) -> float:
    """Return the stamp of the last event of a recording, session time; a truncated file counts so far."""
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
        if case.killed:
            return killed(case, folder, rate_hz)
        child = begun(case, folder, rate_hz)
        child.join(150.0)
        if child.is_alive():
            os.killpg(child.pid or 0, signal.SIGKILL)
            return f"{case.name:32s} did not end"
        statuses = statuses_of(folder)
        # a full disk accepts no more data, which is reported: data from before must be in the file
        ended = [t_s for t_s, _, _, reported in statuses if any("not recording" in w for w in reported)]
        last_s = ended[0] if case.disk_full and ended else statuses[-1][0]
        lost_s = max(last_s - recorded_until(folder / "live" / "flight.mcap"), 0.0)
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        return line_of(case, statuses, result, lost_s)


def begun(case: Case, folder: Path, rate_hz: float, lent: AttachedSimulator | None = None) -> "mp.process.BaseProcess":
    """Start a station in a separate process."""
    folder.mkdir(exist_ok=True)
    child = mp.get_context("spawn").Process(target=fly, args=(case, folder, rate_hz, lent))
    child.start()
    return child


def statuses_of(folder: Path) -> list[Any]:
    """Return the lines of the status: session time, host's time, track, words."""
    path = folder / "status.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines if line.endswith("]")]


def killed(case: Case, folder: Path, rate_hz: float) -> str:
    """Kill a station in mid-flight, begin another on the same range; return what became of both."""
    file = simulated_station_file(folder / "range", rate_hz, small_rig())
    range_ = DeviceSimulatorConfig(
        rig=file.rig, folder=folder / "range", flight=RepeatedLandings(1e9), frame_rate_hz=rate_hz
    )
    with DeviceSimulator(range_) as lender:
        begin_s = lender.begin(time.monotonic() + BEGINS_S)
        lent = AttachedSimulator(lender, file, begin_s)
        child = begun(case, folder / "first", rate_hz, lent)
        wait_until(lambda: sum(track == "tracking" for _, _, track, _ in statuses_of(folder / "first")) > 3)
        os.killpg(child.pid or 0, signal.SIGKILL)
        killed_s = time.monotonic()
        child.join()
        path = folder / "first" / "live" / "flight.mcap"
        left = path.read_bytes()
        again = begun(case, folder / "second", rate_hz, lent)
        again.join(150.0)
    statuses = statuses_of(folder / "second")
    tracking = [host_s - killed_s for _, host_s, track, _ in statuses if track == "tracking"]
    done = recover(path)
    result = json.loads((folder / "second" / "result.json").read_text(encoding="utf-8"))
    count, anees = summed(result["rows"])
    lost_s = statuses_of(folder / "first")[-1][0] - recorded_until(done.out or path)
    return "\n".join(
        (
            f"{case.name} at {killed_s - begin_s:.1f} s of the flight: {max(lost_s, 0.0):.2f} s lost; recovered "
            f"{done.chunks} chunks, {done.skipped} skipped; the file is as it was left: {path.read_bytes() == left}",
            f"begun again: opened {statuses[0][1] - killed_s:.1f} s after the kill, tracking after "
            + (f"{tracking[0]:.1f} s; " if tracking else "never; ")
            + f"{count} answers, ANEES {anees:.2f}; its recording holds "
            f"{recorded_until(folder / 'second' / 'live' / 'flight.mcap') - statuses[0][0]:.1f} s",
        )
    )


def wait_until(done: Callable[[], bool]) -> None:
    """Wait, two minutes at the most."""
    end_s = time.monotonic() + 120.0
    while time.monotonic() < end_s and not done():
        time.sleep(0.1)


def summed(rows: list[Any]) -> tuple[int, float]:
    """Return the number of estimates, and the ANEES of all."""
    count = sum(n for n, _ in rows)
    return count, sum(n * a for n, a in rows) / count if count else math.nan


def line_of(case: Case, statuses: list[Any], result: dict[str, Any], lost_s: float) -> str:
    """Return a line: statuses during the fault, time to tracking after it, ANEES, losses."""
    begin_s, until_s = result["begin_s"], lasts_until(case)
    during = Counter(track for t_s, _, track, _ in statuses if FROM_S + 0.2 <= t_s - begin_s < until_s)
    words = ", ".join(f"{n} {track}" for track, n in during.most_common())
    again = [
        t_s - begin_s - until_s for t_s, _, track, _ in statuses if t_s - begin_s >= until_s and track == "tracking"
    ]
    _, anees = summed(result["rows"])
    back = f"{again[0]:.1f}" if again else "never"
    also = [
        w for _, _, _, lines in statuses for w in lines if "gone since" in w or "not recording" in w or "ends here" in w
    ]
    note = f"  “{also[0][:60]}”" if also else ""
    return f"{case.name:32s} {until_s:8.1f} {words:>24s} {back:>7s} {anees:6.2f} {lost_s:6.2f}{note}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--only", default="", help="cases with this word")
    options = parser.parse_args()
    print(
        f"{'fault':32s} {'until, s':>8s} {'status meanwhile':>24s} {'back, s':>7s} {'ANEES':>6s} {'lost, s':>6s}",
        flush=True,
    )
    for case in CASES:
        if options.only in case.name:
            print(run(case, options.rate), flush=True)


if __name__ == "__main__":
    main()
