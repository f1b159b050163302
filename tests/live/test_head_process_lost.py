"""The PTUs' process or the motion guard's killed, stopped or ended: the heads stop by their own log; it is reported."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from groundstation.live.head_device import HeadDevice
from groundstation.live.head_manager import HeadManager
from groundstation.live.input_queue import DeviceLogLine, InputQueue, Item
from groundstation.messages import PointingCommand, PtuSample, Purpose
from ptu_drivers.messages import Axis
from ptu_drivers.simulated.axis import SimulatedAxis
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from ptu_drivers.simulated.server import SimulatedServer

BAUD = 115200
RATE_RAD_S = 0.1
# what the machine that tests may take on top of everything
LONG_S = 30.0


@dataclass
class Station:
    """Heads in operation, one of which gets a rate command all the time; its unit is served here, in the test."""

    heads: HeadManager
    server: SimulatedServer
    axis: SimulatedAxis
    input_queue: InputQueue
    start_s: float
    items: list[tuple[float, Item]] = field(default_factory=list)
    states: list[tuple[float, str]] = field(default_factory=list)

    def speed(self, t_s: float) -> float:
        """How fast it truly turns, counts/s."""
        with self.server.lock:
            return self.axis.speed(t_s)

    def stood_at(self, after_s: float) -> float:
        """When it first stood after an instant, on the host's clock, by the unit's own log; its end is now."""
        now_s, t_s = time.monotonic(), after_s
        while t_s < now_s:
            if self.speed(t_s) == 0.0:
                return t_s
            t_s += 0.005
        return float("inf")

    def reported(self) -> list[str]:
        return [i.text for _, i in self.items if isinstance(i, DeviceLogLine)]

    def samples(self) -> int:
        return sum(isinstance(i, PtuSample) for _, i in self.items)


def flir(link: Path | int) -> tuple[SimulatedServer, HeadDevice, SimulatedAxis]:
    unit = SimulatedUnit(FlirModel(arcsec=22.5, min_rate=0), LineModel(baud=0 if isinstance(link, int) else BAUD))
    server = SimulatedServer(VirtualLine(unit, unit.baud, start_s=time.monotonic()), link)
    head = HeadDevice(url=server.url, baud=0 if isinstance(link, int) else BAUD)
    return server, head, unit.flir.axes["P"]


def pelco(link: Path | int) -> tuple[SimulatedServer, HeadDevice, SimulatedAxis]:
    """A unit without a lease of its own, whose rate stays until the next command."""
    unit = SimulatedPelco(PelcoModel(baud=9600))
    server = SimulatedServer(VirtualLine(unit, 9600, start_s=time.monotonic()), link)
    speeds = {1: 1.0, 8: 5.7, 63: 40.0}
    return server, HeadDevice(url=server.url, protocol="pelco-d", options={"speeds_deg_s": speeds}), unit.axes[Axis.PAN]


KINDS = {"flir on a pty": (flir, True), "flir by TCP": (flir, False), "pelco on a pty": (pelco, True)}


@contextlib.contextmanager
def operated(kind: str, folder: Path) -> Iterator[Station]:
    """Heads that turn at a rate which is commanded repeatedly."""
    make, is_pty = KINDS[kind]
    server, head, axis = make(folder / "ptu" if is_pty else 0)
    start_s = time.monotonic()
    heads = HeadManager({"left": head}, start_s)
    ended = threading.Event()
    with server, heads:
        station = Station(heads, server, axis, InputQueue(), start_s)
        heads.start(station.input_queue)

        def operate() -> None:
            commanded_s = 0.0
            while not ended.is_set():
                item = station.input_queue.get(0.01)
                if item is not None:
                    station.items.append((time.monotonic(), item))
                words = heads.states["left"].state
                if not station.states or station.states[-1][1] != words:
                    station.states.append((time.monotonic(), words))
                now_s = time.monotonic()
                if now_s > commanded_s + 0.03:
                    commanded_s = now_s
                    # there and back, so that no limit is reached
                    way = 1.0 if int((now_s - start_s) / 6.0) % 2 == 0 else -1.0
                    heads.send_command(turning(way * RATE_RAD_S, now_s - start_s))

        thread = threading.Thread(target=operate, daemon=True)
        thread.start()
        try:
            assert until(lambda: abs(station.speed(time.monotonic())) > 0.0)
            yield station
        finally:
            ended.set()
            thread.join()


def turning(rate_rad_s: float, t_s: float) -> PointingCommand:
    return PointingCommand(
        t_s=t_s,
        station="left",
        pan_rad=0.0,
        tilt_rad=0.0,
        pan_rate_rad_s=rate_rad_s,
        tilt_rate_rad_s=0.0,
        purpose=Purpose.TRACK,
    )


def until(condition: Callable[[], bool], seconds: float = LONG_S) -> bool:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(0.02)
    return False


@pytest.mark.parametrize(
    ("kind", "number"),
    [
        ("flir on a pty", signal.SIGKILL),
        ("flir on a pty", signal.SIGTERM),
        # the stopped process holds the only connection that the server takes
        ("flir by TCP", signal.SIGSTOP),
        ("pelco on a pty", signal.SIGKILL),
        ("pelco on a pty", signal.SIGSTOP),
    ],
)
def test_a_lost_process_leaves_no_head_turning(tmp_path: Path, kind: str, number: signal.Signals) -> None:
    """Expected: the unit stands, nothing is called ready meanwhile, the process runs again, readings come, it turns."""
    with operated(kind, tmp_path) as station:
        pid = station.heads.pids["ptus"]
        lost_s = time.monotonic()
        os.kill(pid, number)
        assert until(lambda: any("restart " in text for text in station.reported()))
        assert until(lambda: station.stood_at(lost_s) < float("inf"))
        shown = [words for t_s, _, words in station.heads.log.shown if t_s >= lost_s]
        lost, halted = "process lost, being halted", "process lost, halted, restarting"
        # what else may be shown before: that it is silent, or ends in order
        assert shown.index(lost) < shown.index(halted)
        assert "process restarted" not in shown[: shown.index(halted)]
        assert "ready" not in shown[shown.index(lost) : shown.index(halted) + 1]
        assert not any("nothing turns" in text for text in station.reported())
        assert any("left: halt acknowledged" in text for text in station.reported())
        how = "was killed" if number is signal.SIGSTOP else f"was ended by {number.name}"
        assert any(how in text for text in station.reported())
        # a busy machine may lose more than what was killed here
        assert any(how in loss for loss in station.heads.log.losses)
        count = station.samples()
        assert until(lambda: station.samples() > count + 20)
        assert until(lambda: abs(station.speed(time.monotonic())) > 0.0)
        assert until(lambda: station.states[-1][1] == "ready")
    # it may still be braking when its halt is acknowledged
    assert until(lambda: station.speed(time.monotonic()) == 0.0)


def test_a_head_that_does_not_acknowledge_is_not_called_halted(tmp_path: Path) -> None:
    """Expected: of a unit whose line is dead when its process is lost, it is reported that it may still turn."""
    with operated("flir on a pty", tmp_path) as station:
        lost_s = time.monotonic()
        with station.server.lock:
            station.server.line.dead = True
        os.kill(station.heads.pids["ptus"], signal.SIGKILL)
        assert until(
            lambda: any("may still turn" in words for t_s, _, words in station.heads.log.shown if t_s >= lost_s)
        )
        assert not any("halted, restarting" in words for t_s, _, words in station.heads.log.shown if t_s >= lost_s)
        # it is shown a moment before it is logged
        assert until(
            lambda: any(
                "left: no halt was acknowledged" in text and "may still turn" in text for text in station.reported()
            )
        )
        with station.server.lock:
            station.server.line.dead = False
        assert until(lambda: any("restart " in text for text in station.reported()), 90.0)
        assert until(lambda: station.states[-1][1] == "ready")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_without_a_guard_no_head_turns(tmp_path: Path, number: signal.Signals) -> None:
    """Expected: the PTUs' process halts its unit by itself, and turns it again once there is another guard."""
    with operated("pelco on a pty", tmp_path) as station:
        lost_s = time.monotonic()
        os.kill(station.heads.pids["guard"], number)
        assert until(lambda: station.stood_at(lost_s) < float("inf"))
        assert until(lambda: any("held still" in words for _, _, words in station.heads.log.shown))
        assert any("the motion guard's process" in text for text in station.reported())
        assert until(lambda: abs(station.speed(time.monotonic())) > 0.0)
        assert any("the motion guard's process" in loss for loss in station.heads.log.losses)
