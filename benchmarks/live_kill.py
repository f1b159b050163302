"""Each process of a station in operation killed, stopped, ended and starved of memory, at random moments.

    python benchmarks/live_kill.py [--moments N] [--seed N] [--log FILE.jsonl]

A station operates on pan-tilt units that a process of its own serves on ptys: a FLIR, and a Pelco-D, which has no lease
of its own. Its cameras give noise, so that it searches the sky and both heads turn all the time. At random moments
happens to one of its processes: the pipeline, the PTUs' process, the motion guard, the library's resource
tracker. Printed for each kind of moment, the worst of all: when the heads stood after it, by the units' own log; when
the status stopped calling them ready; what the recording lacks of the time until a process was killed; how long the end
took after Ctrl-C. With --log each moment is a line of a file, and a run that was interrupted goes on from there.
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
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from groundstation.cli.interpreter_exit import leave
from groundstation.cli.stop_request import StopRequest
from groundstation.errors import RecordingError
from groundstation.geometry.camera import Lens
from groundstation.live.command import LiveRequest, live
from groundstation.live.head_device import HeadDevice
from groundstation.live.status_board import LiveStatus
from groundstation.pointing.search_pattern import SearchConfig
from groundstation.recording.recovery import recover
from groundstation.rig.rig import Rig
from groundstation.session import load_session
from groundstation.simulation.attached_simulator import AttachedSimulator
from groundstation.simulation.nose_truth import NoseTruth
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.simulation.standard_cases import standard_rig
from groundstation.sources.cameras.camera import CameraDevice, GrabbedFrame, SettingsReadBack
from groundstation.sources.session_source import session_source
from ptu_drivers.deferred_termination import GRACE_S
from ptu_drivers.messages import Axis
from ptu_drivers.simulated.axis import SimulatedAxis
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from ptu_drivers.simulated.server import SimulatedServer

ROOT = Path(__file__).resolve().parent.parent
SIZE_PX = (160, 120)
FRAMES_HZ = 2.0
SPEEDS_DEG_S = {1: 0.6, 4: 2.5, 8: 5.1, 16: 10.2, 32: 20.3, 63: 40.0}
# actions on a process; "memory" leaves it no more address space than it has
DEEDS = ("KILL", "STOP", "TERM", "memory")
RECOVERED = ("ptus", "ptu-guard", "resource_tracker")
# these must stand after a loss; the tracker moves nothing
MOVERS = ("ptus", "ptu-guard", "pipeline")
# moments of one run of the station, the last of which ends it
A_RUN = 8
LOOKED_S = 2.5
BACK_S = 60.0
# statuses are written twice a second
STATUS_S = 0.75


# ------------------------------------------------------------------------------------ the units, apart from it all
def serve_units(folder: str, pipe: Connection) -> None:
    """Serve both units until requested to stop, and evaluate their own logs."""
    flir = SimulatedUnit(FlirModel(arcsec=22.5, min_rate=0), LineModel(baud=115200))
    pelco = SimulatedPelco(PelcoModel(baud=9600))
    axes: dict[str, tuple[SimulatedAxis, ...]] = {
        "left": tuple(flir.flir.axes.values()),
        "right": (pelco.axes[Axis.PAN], pelco.axes[Axis.TILT]),
    }
    now_s = time.monotonic()
    servers = {
        "left": SimulatedServer(VirtualLine(flir, 115200, start_s=now_s), Path(folder) / "ptu-left"),
        "right": SimulatedServer(VirtualLine(pelco, 9600, start_s=now_s), Path(folder) / "ptu-right"),
    }
    with contextlib.ExitStack() as stack:
        for server in servers.values():
            stack.enter_context(server)
        pipe.send("ready")
        with contextlib.suppress(EOFError):
            while (asked := pipe.recv()) != "stop":
                what, from_s, to_s = asked
                found = {}
                for name, server in servers.items():
                    with server.lock:
                        found[name] = what_of(what, axes[name], from_s, to_s)
                pipe.send(found)


def what_of(what: str, axes: tuple[SimulatedAxis, ...], from_s: float, to_s: float) -> float:
    """Return when a head first stood within a span, infinite if never; or how long it turned there, s."""
    step_s, turned_s = 0.005, 0.0
    for k in range(math.ceil((to_s - from_s) / step_s)):
        t_s = from_s + k * step_s
        if any(axis.speed(t_s) != 0.0 for axis in axes):
            turned_s += step_s
        elif what == "stood":
            return t_s
    return math.inf if what == "stood" else turned_s


# ------------------------------------------------------------------------------------ the station, as a program
def small_rig() -> Rig:
    """Return the standard rig with pictures that cost nothing."""
    middle = np.array([0.5 * (s - 1) for s in SIZE_PX])
    lens = Lens(
        image_size_px=SIZE_PX, focal_px=np.array([800.0, 800.0]), principal_point_px=middle, distortion=np.zeros(5)
    )
    rig = standard_rig(sigma_rad=float(np.radians(0.02)))
    return replace(rig, stations=tuple(replace(s, lens=lens) for s in rig.stations))


class NoiseCamera(CameraDevice):
    """A camera that sees noise."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._number = 0
        self._due_s = time.monotonic()
        self.read_back = SettingsReadBack(model="noise", size_px=SIZE_PX)

    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame when it is due."""
        wait_s = self._due_s - time.monotonic()
        time.sleep(min(max(wait_s, 0.0), timeout_s))
        if wait_s > timeout_s:
            return None
        self._due_s = max(self._due_s + 1.0 / FRAMES_HZ, time.monotonic() - 1.0 / FRAMES_HZ)
        self._number += 1
        pixels = self._random.integers(110, 118, (SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
        return GrabbedFrame(
            frame_id=self._number, device_ns=None, pixels=pixels, pattern=None, payload_bytes=int(pixels.nbytes)
        )

    def close(self) -> None:
        """Nothing is held."""


class NoiseRange(AttachedSimulator):
    """A range whose cameras see noise, and whose heads are the units of `serve_units`."""

    def __init__(self, folder: Path, out: Path) -> None:
        out.mkdir(parents=True)
        file = simulated_station_file(out, FRAMES_HZ, small_rig())
        pelco = HeadDevice(
            url=str(folder / "ptu-right"), protocol="pelco-d", options={"speeds_deg_s": SPEEDS_DEG_S}, poll_s=0.05
        )
        # as for the simulated range: on a machine at its limit the simulated unit may have to wait for its turn
        flir = HeadDevice(url=str(folder / "ptu-left"), baud=115200, poll_s=0.05, options={"patience_s": 30.0})
        heads = {"left": flir, "right": pelco}
        # so wide and so hasty that the slower unit turns nearly all the time, too
        search = SearchConfig(azimuth_deg=(-30.0, 30.0), dwell_s=0.2)
        stations = tuple(replace(s, head=heads[s.name]) for s in file.stations)
        self.file = replace(file, stations=stations, search=search)
        self.delivery_s = 0.01
        self.truth: dict[str, NoseTruth] = {}

    def begin(self, start_s: float) -> float:
        """Nothing flies."""
        return start_s

    def connect(self, name: str) -> CameraDevice:
        """Return a camera."""
        return NoiseCamera(len(name))


def operate(folder: Path, run: Path) -> NoReturn:
    """Operate until asked to stop, as `groundstation live` does; each status is a line of a file."""
    status_file = (run / "status.jsonl").open("w", buffering=1, encoding="utf-8")

    def tell(status: LiveStatus) -> None:
        print(
            json.dumps([time.monotonic(), status.t_s, [d.note for d in status.devices], list(status.lines)]),
            file=status_file,
        )

    def force_exit(line: str, _: bool) -> None:
        print(line, file=sys.stderr, flush=True)
        os._exit(1)

    request = LiveRequest(station=None, out=run / "live")
    with StopRequest() as stop:
        result = live(request, stop, tell, lambda _: None, NoiseRange(folder, run / "set-up"), force_exit)
    print("\n".join(result.losses), file=sys.stderr)
    # as `groundstation live` ends
    leave(1 if result.losses else 0)


# ------------------------------------------------------------------------------------ actions on processes
@dataclass(frozen=True)
class Moment:
    """The action on a process, and its effects: times in s from the action on; ``turning`` heads turned before it."""

    who: str
    deed: str
    stood_s: float = math.nan
    status_s: float = math.nan
    turned_again_s: float = math.nan
    back_s: float = math.nan
    ended_s: float = math.nan
    lost_s: float = math.nan
    code: int | None = None
    note: str = ""
    turning: int = 0


class Units:
    """The units' process."""

    def __init__(self, folder: Path) -> None:
        self._pipe, other = mp.get_context("spawn").Pipe()
        self._process = mp.get_context("spawn").Process(target=serve_units, args=(str(folder), other), daemon=True)
        self._process.start()
        other.close()
        if self._pipe.recv() != "ready":
            raise RuntimeError("the units did not start")

    def stood(self, from_s: float, to_s: float) -> dict[str, float]:
        """Return when each head first stood."""
        self._pipe.send(("stood", from_s, to_s))
        return dict(self._pipe.recv())

    def turning(self, at_s: float) -> int:
        """Return how many heads turned in the last moment before a time."""
        return sum(turned > 0.0 for turned in self.turned(at_s - 0.05, at_s).values())

    def turned(self, from_s: float, to_s: float) -> dict[str, float]:
        """Return how long each head turned."""
        self._pipe.send(("turned", from_s, to_s))
        return dict(self._pipe.recv())

    def stop(self) -> None:
        """End it."""
        self._pipe.send("stop")
        self._process.join(5.0)


class Run:
    """One run of the station."""

    def __init__(self, folder: Path, run: Path) -> None:
        run.mkdir()
        self.run = run
        # no file is the program: processes that are spawned would read it all again, as they do not of the command line
        program = (
            "import pathlib, sys; from benchmarks.live_kill import operate; operate(*map(pathlib.Path, sys.argv[1:]))"
        )
        command = [sys.executable, "-c", program, str(folder), str(run)]
        with (run / "said.txt").open("w", encoding="utf-8") as reported:
            self.process = subprocess.Popen(
                command, cwd=ROOT, stdout=reported, stderr=reported, start_new_session=True, env=environment()
            )

    def statuses(self) -> list[Any]:
        """Return the lines of the status so far: host's time, session time, notes of the devices, lines."""
        path = self.run / "status.jsonl"
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        return [json.loads(line) for line in lines if line.endswith("]]")]

    def reported(self) -> str:
        """Return the station's terminal output."""
        return (self.run / "said.txt").read_text(encoding="utf-8")

    def ready(self, after_s: float) -> float:
        """Return when both heads were first reported ready, all well, after an instant; infinite if not yet."""
        heads = [(t, [n for n in notes if n.startswith("ready")]) for t, _, notes, _ in self.statuses() if t > after_s]
        return next((t for t, ready in heads if len(ready) == 2), math.inf)

    def unready(self, after_s: float) -> float:
        """Return when a status first did not call both heads ready after an instant; infinite if not yet."""
        for t, _, notes, _ in self.statuses():
            if t > after_s and sum(n.startswith("ready") for n in notes) < 2:
                return float(t)
        return math.inf

    def has_status_since(self, from_s: float) -> bool:
        """Return whether a status was written from an instant on."""
        statuses = self.statuses()
        return bool(statuses) and statuses[-1][0] >= from_s

    def pids(self) -> dict[str, int]:
        """Return the station's processes by name."""
        found = {"pipeline": self.process.pid}
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            with contextlib.suppress(OSError, IndexError):
                if int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == self.process.pid:
                    tracker = b"resource_tracker" in (entry / "cmdline").read_bytes()
                    name = "resource_tracker" if tracker else (entry / "comm").read_text().strip()
                    found[name] = int(entry.name)
        return found

    def end(self) -> tuple[float, int | None]:
        """Press Ctrl-C; return how long the end took, s, and the exit code."""
        began_s = time.monotonic()
        self.process.send_signal(signal.SIGINT)
        return self.wait(began_s)

    def wait(self, began_s: float) -> tuple[float, int | None]:
        """Wait for the end; return how long it took since an instant, s, and the exit code."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(60.0)
        return time.monotonic() - began_s, self.process.returncode

    def kill(self) -> None:
        """Leave nothing of it behind."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


def environment() -> Mapping[str, str]:
    """Return this environment, in which the station finds its packages."""
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def wait_until(done: Callable[[], bool], seconds: float) -> bool:
    """Wait, so long at the most."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if done():
            return True
        time.sleep(0.05)
    return False


def do(deed: str, pid: int) -> None:
    """Do something to a process."""
    if deed == "memory":
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[0])
        size = pages * resource.getpagesize()
        resource.prlimit(pid, resource.RLIMIT_AS, (size, size))
    else:
        os.kill(pid, getattr(signal, f"SIG{deed}"))


def recovered(run: Run, units: Units, who: str, deed: str) -> Moment:
    """Act on a process that is restarted, and record the effects."""
    pid = run.pids().get(who)
    if pid is None:
        return Moment(who, deed, note="there is none")
    if run.process.poll() is not None:
        return Moment(who, deed, note="the station has ended before")
    do(deed, pid)
    if deed == "TERM" and who in MOVERS:
        # until it knows that the station is not ending as well, it works on
        time.sleep(GRACE_S)
    began_s = time.monotonic()
    time.sleep(LOOKED_S)
    now_s = time.monotonic()
    stood = max(units.stood(began_s, now_s).values()) - began_s
    status = run.unready(began_s) - began_s
    if who not in MOVERS:
        # the station does not need it: it must continue unchanged
        well = run.process.poll() is None
        return Moment(who, deed, note="goes on" if well else "the station has ended", stood_s=0.0, status_s=0.0)
    if run.process.poll() is not None:
        return Moment(who, deed, stood_s=stood, note="the station has ended: " + run.reported()[-400:])
    if deed == "memory" and status == math.inf:
        return Moment(who, deed, note="needed no more memory")
    back = run.ready(began_s + status) - began_s
    wait_until(lambda: run.ready(began_s + status) < math.inf, BACK_S)
    back = run.ready(began_s + status) - began_s
    if deed == "memory" and back < stood and run.pids().get(who) == pid:
        # the same process works again, and its heads turn as they are commanded
        return Moment(who, deed, status_s=status, back_s=back, note="late for a moment")
    if stood == math.inf:
        return Moment(who, deed, stood_s=stood, status_s=status, back_s=back, note="a head never stood")
    # from standing to the report that all is well again nothing may turn, but for the last moment: commands come then
    again = max(units.turned(began_s + stood, began_s + max(stood, min(back, LOOKED_S) - 1.0)).values())
    return Moment(
        who,
        deed,
        stood_s=stood,
        status_s=status,
        turned_again_s=again,
        back_s=back,
        turning=units.turning(began_s),
    )


def ending(run: Run, units: Units, who: str, deed: str) -> Moment:
    """Act in a way that ends the station: on its pipeline, or Ctrl-C right after another action."""
    pid = run.pids().get("pipeline" if who == "pipeline" else who, run.process.pid)
    newest = run.statuses()[-1]
    began_s = time.monotonic()
    do(deed, pid)
    status = math.nan
    if who != "pipeline":
        time.sleep(random.uniform(0.0, 0.6))
        ended_s, code = run.end()
    elif deed == "STOP":
        time.sleep(LOOKED_S)
        do("CONT", pid)
        ended_s, code = run.end()
    elif deed == "memory":
        time.sleep(LOOKED_S)
        ended_s, code = run.end() if run.process.poll() is None else (0.0, run.process.returncode)
    else:
        ended_s, code = run.wait(began_s)
        # a killed station received no stop request
        ended_s = math.nan if deed == "KILL" else ended_s
    asked_s = time.monotonic() - (0.0 if math.isnan(ended_s) else ended_s)
    time.sleep(1.5)
    now_s = time.monotonic()
    # SIGTERM asks the pipeline to end as Ctrl-C does: heads are parked, and stand when they are; so it is after Ctrl-C
    # where a process had allocated all its memory before, or hears of the end before it has left by SIGTERM
    well = run.has_status_since(asked_s - STATUS_S) and run.unready(began_s) > asked_s
    parks = deed == "TERM" or (deed == "memory" and well)
    stood = math.nan if parks else max(units.stood(began_s, now_s).values()) - began_s
    still = max(units.turned(now_s - 0.4, now_s).values())
    # the session's clock at the moment, from the last status before it
    moment_s = newest[1] + began_s - newest[0]
    lost = max(moment_s - recorded_until(run.run / "live" / "flight.mcap"), 0.0)
    return Moment(
        who,
        deed,
        stood_s=stood,
        status_s=status,
        turned_again_s=still,
        ended_s=ended_s,
        lost_s=lost,
        turning=units.turning(began_s),
        code=code,
        note=" ".join(run.reported().split())[-300:] if deed == "memory" else "",
    )


def recorded_until(path: Path) -> float:
    """Return the stamp of the last event of a recording, session time, after it was recovered."""
    newest_s = -math.inf
    try:
        whole = recover(path).out or path
    except RecordingError:
        return newest_s
    with session_source(load_session(whole), None, None, lambda line: None) as source:
        for event in source:
            newest_s = max(newest_s, event.t_s)
    return newest_s


def moments(count: int, seed: int) -> Iterator[list[tuple[str, str]]]:
    """Return what happens in each run: moments that the station survives, then one that it does not."""
    draw = random.Random(seed)
    done = 0
    while done < count:
        happens = [
            (draw.choice(RECOVERED) if draw.random() < 0.2 else draw.choice(RECOVERED[:2]), draw.choice(DEEDS))
            for _ in range(min(A_RUN - 1, count - done - 1))
        ]
        last = (draw.choice(("pipeline", "pipeline", "ptus", "ptu-guard")), draw.choice(DEEDS))
        yield [*happens, last]
        done += len(happens) + 1


def fly(folder: Path, number: int, happens: list[tuple[str, str]], seed: int) -> list[Moment]:
    """Run the station once, and let all that happen to it."""
    draw = random.Random(1000 * seed + number)
    units = Units(folder)
    run = Run(folder, folder / f"run-{number}")
    out: list[Moment] = []
    try:
        if not wait_until(lambda: run.ready(0.0) < math.inf, 240.0):
            return [Moment(*happens[0], note="did not start: " + run.reported()[-300:])]
        for who, deed in happens[:-1]:
            time.sleep(draw.uniform(0.5, 2.5))
            out.append(recovered(run, units, who, deed))
        time.sleep(draw.uniform(0.5, 2.5))
        out.append(ending(run, units, *happens[-1]))
    finally:
        run.kill()
        units.stop()
    return out


def table(found: list[Moment]) -> str:
    """Return the worst of each kind of moment."""
    lines = [
        f"{'process':17s} {'what':7s} {'times':>5s} {'stood, s':>9s} {'status, s':>9s} {'end, s':>7s} {'lost, s':>8s}"
        "  exit codes, notes"
    ]
    for who in sorted({m.who for m in found}):
        for deed in DEEDS:
            these = [m for m in found if (m.who, m.deed) == (who, deed)]
            if not these:
                continue
            worst = [
                max((v for m in these if not math.isnan(v := getattr(m, name))), default=math.nan)
                for name in ("stood_s", "status_s", "ended_s", "lost_s")
            ]
            codes = sorted({str(m.code) for m in these if m.code is not None})
            notes = sorted({m.note for m in these if m.note})
            lines.append(
                f"{who:17s} {deed:7s} {len(these):5d} {worst[0]:9.2f} {worst[1]:9.2f} {worst[2]:7.2f} {worst[3]:8.2f}"
                f"  {', '.join([*codes, *notes])}"
            )
    stopped = [m.stood_s for m in found if m.who in MOVERS and not math.isnan(m.stood_s)]
    statuses = [m.status_s for m in found if m.who in MOVERS and not math.isnan(m.status_s)]
    ended = [m.ended_s for m in found if not math.isnan(m.ended_s)]
    lost = [m.lost_s for m in found if not math.isnan(m.lost_s)]
    losses = [m for m in found if m.who in MOVERS and not math.isnan(m.stood_s)]
    lines.append("heads that turned: " + ", ".join(f"{k} in {sum(m.turning == k for m in losses)}" for k in range(3)))
    for what, values, within in (
        ("heads stood within 1 s", stopped, 1.0),
        ("status true within 0.5 s", statuses, 0.5),
        ("ended within 3 s", ended, 3.0),
        ("recording lacks less than 1 s", lost, 1.0),
    ):
        lines.append(
            f"{what}: {sum(v <= within for v in values)} of {len(values)}, worst {max(values, default=0):.2f} s"
        )
    return "\n".join(lines)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moments", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, help="a line for each moment; goes on where it ended")
    options = parser.parse_args()
    found: list[Moment] = []
    runs = list(moments(options.moments, options.seed))
    done = 0
    if options.log and options.log.is_file():
        for line in options.log.read_text(encoding="utf-8").splitlines():
            record = json.loads(line)
            done = max(done, record.pop("run") + 1)
            found.append(Moment(**record))
    for number, happens in enumerate(runs):
        if number < done:
            continue
        with tempfile.TemporaryDirectory() as name:
            new = fly(Path(name), number, happens, options.seed)
        found += new
        for moment in new:
            print(moment, file=sys.stderr, flush=True)
        if options.log:
            with options.log.open("a", encoding="utf-8") as log:
                for moment in new:
                    print(json.dumps({"run": number, **vars(moment)}), file=log)
    print(f"load of this machine: {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores")
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
