"""PTUs in operation: read on real serial lines, commanded, halted at any end."""

import contextlib
import math
import multiprocessing as mp
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundstation.live.head_device import DeviceError, HeadDevice
from groundstation.live.head_manager import HeadManager
from groundstation.live.head_worker import PanTiltAligner
from groundstation.live.input_queue import InputQueue
from groundstation.messages import PointingCommand, PtuSample, Purpose
from ptu_drivers.messages import AngleSample, AngleSource, Axis, Reading
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer

MODEL = FlirModel(arcsec=22.5, min_rate=0)
COUNT_RAD = math.radians(22.5 / 3600.0)
BAUD = 115200


@contextlib.contextmanager
def simulated_unit(link: Path) -> Iterator[SimulatedServer]:
    unit = SimulatedUnit(MODEL, LineModel(baud=BAUD))
    line = VirtualLine(unit, BAUD, start_s=time.monotonic())
    with SimulatedServer(line, link) as server:
        yield server


def pan_of(server: SimulatedServer, t_s: float) -> float:
    with server.lock:
        return server.line.unit.flir.axes["P"].head(t_s) * COUNT_RAD


def pan_rate_of(server: SimulatedServer) -> float:
    with server.lock:
        return server.line.unit.flir.axes["P"].speed(time.monotonic()) * COUNT_RAD


def until(condition: object, seconds: float = 20.0) -> bool:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():  # type: ignore[operator]
            return True
        time.sleep(0.02)
    return False


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


def test_a_head_is_read_turned_and_halted(tmp_path: Path) -> None:
    link, start_s = tmp_path / "ptu", time.monotonic()
    with simulated_unit(link) as server:
        input_queue = InputQueue()
        with HeadManager({"left": HeadDevice(url=str(link), baud=BAUD)}, start_s) as heads:
            assert heads.states["left"].limits.pan.fastest_rad_s == pytest.approx(8000 * COUNT_RAD, rel=0.01)
            heads.start(input_queue)
            samples: list[PtuSample] = []
            for k in range(40):
                heads.send_command(turning(0.1, time.monotonic() - start_s + 0.001 * k))
                end_s = time.monotonic() + 0.05
                while time.monotonic() < end_s:
                    item = input_queue.get(0.01)
                    if isinstance(item, PtuSample):
                        samples.append(item)
            assert len(samples) > 20
            # each angle is the one that was there at its stamp: at 0.1 rad/s, 10 ms are a milliradian
            late = [s for s in samples if s.t_s > samples[len(samples) // 2].t_s]
            off = sorted(abs(s.pan_rad - pan_of(server, s.t_s + start_s)) for s in late)
            assert off[len(off) // 2] < 1e-3
            assert late[-1].pan_rad > late[0].pan_rad
        assert until(lambda: pan_rate_of(server) == 0.0)


def test_a_line_that_nobody_is_on_is_one_line(tmp_path: Path) -> None:
    with (
        pytest.raises(DeviceError, match=r"left: PTU: .*nowhere.*wanted"),
        HeadManager({"left": HeadDevice(url=str(tmp_path / "nowhere"))}, 0.0),
    ):
        pass


def _operate(link: str) -> None:
    start_s = time.monotonic()
    with HeadManager({"left": HeadDevice(url=link, baud=BAUD)}, start_s) as heads:
        heads.start(InputQueue())
        while True:
            heads.send_command(turning(0.05, time.monotonic() - start_s))
            time.sleep(0.05)


def test_a_killed_station_leaves_no_head_turning(tmp_path: Path) -> None:
    link = tmp_path / "ptu"
    with simulated_unit(link) as server:
        process = mp.get_context("spawn").Process(target=_operate, args=(str(link),))
        process.start()
        try:
            assert until(lambda: pan_rate_of(server) > 0.0, 60.0)
            assert process.pid is not None
            os.kill(process.pid, signal.SIGKILL)
            assert until(lambda: pan_rate_of(server) == 0.0)
            place = pan_of(server, time.monotonic())
            time.sleep(0.3)
            assert pan_of(server, time.monotonic()) == place
        finally:
            process.kill()
            process.join()


def reading(pan_s: float, tilt_s: float) -> Reading:
    def sample(axis: Axis, t_s: float) -> AngleSample:
        return AngleSample(
            axis=axis,
            t_s=t_s,
            sigma_t_s=1e-3,
            angle_rad=2.0 * t_s if axis is Axis.PAN else 1.0 - t_s,
            sigma_rad=1e-4,
            source=AngleSource.FIRST_REPLY_BYTE,
        )

    return Reading(pan=sample(Axis.PAN, pan_s), tilt=sample(Axis.TILT, tilt_s), sent_s=pan_s, answered_s=tilt_s)


def test_two_replies_become_one_instant() -> None:
    at_once = PanTiltAligner("left", session_from_unit_s=-1.0)
    assert at_once.sample(reading(2.00, 2.01)) is None
    sample = at_once.sample(reading(2.03, 2.04))
    assert sample is not None
    assert sample.t_s == pytest.approx(1.03)
    assert sample.pan_rad == pytest.approx(4.06)
    assert sample.tilt_rad == pytest.approx(1.0 - 2.03)


def test_one_reply_keeps_its_instant() -> None:
    sample = PanTiltAligner("left", session_from_unit_s=0.0).sample(reading(2.0, 2.0))
    assert sample == PtuSample(t_s=2.0, station="left", pan_rad=4.0, tilt_rad=-1.0)
