"""Faults of a simulated range occur at their stated times."""

import multiprocessing as mp
import time
from pathlib import Path

from benchmarks.live_serial_faults import CASES
from groundstation.live.simulated_latency import DelayLine
from groundstation.simulation.device_faults import (
    CAMERA_CLOCK_STEPPED,
    CAMERA_FROZEN,
    CAMERA_LATE,
    CAMERA_LOST,
    PTU_SILENT,
    TimedFault,
    is_there,
    strike,
)
from tests.live.test_heads import simulated_unit, until


def test_a_fault_is_there_from_its_beginning_to_its_end() -> None:
    faults = [TimedFault(what=CAMERA_LOST, station="left", from_s=2.0, to_s=3.0)]
    assert [is_there(faults, CAMERA_LOST, "left", t) for t in (1.9, 2.0, 2.9, 3.0)] == [False, True, True, False]
    assert not is_there(faults, CAMERA_LOST, "right", 2.5)
    assert not is_there(faults, PTU_SILENT, "left", 2.5)


def test_a_line_is_silent_for_so_long_and_struck_over_and_over(tmp_path: Path) -> None:
    with simulated_unit(tmp_path / "ptu") as server:
        begin_s = time.monotonic()
        faults = [
            TimedFault(what=PTU_SILENT, station="left", from_s=0.2, to_s=0.6),
            TimedFault(what=PTU_SILENT, station="right", from_s=0.0, to_s=9.0),
            TimedFault(what="echo off", station="left", from_s=0.1, to_s=0.3),
        ]
        strike(server, faults, "left", begin_s, 1)
        assert until(lambda: not server.line.unit.flir.echo)
        assert until(lambda: server.line.dead)
        assert time.monotonic() - begin_s >= 0.2
        assert until(lambda: not server.line.dead)
        assert time.monotonic() - begin_s >= 0.6


def test_what_is_late_holds_up_nobody_and_overtakes_nothing() -> None:
    """Expected: items are delivered in order when due; the sender does not block; a closed reader is detected."""
    here, there = mp.Pipe(duplex=False)
    line = DelayLine(there, time.monotonic)
    began_s = time.monotonic()
    for number, late_s in enumerate((0.2, 0.0, 0.3)):
        line.send(began_s + late_s, number)
    handed_s = time.monotonic() - began_s
    got = []
    for _ in range(3):
        assert here.poll(10.0)
        got.append((here.recv(), time.monotonic() - began_s))
    assert [number for number, _ in got] == [0, 1, 2]
    assert handed_s < got[0][1]
    assert got[0][1] >= 0.2
    assert got[2][1] >= 0.3
    here.close()
    line.send(began_s, 3)
    assert until(lambda: line.broken)
    line.close()


def test_the_benchmark_knows_every_fault() -> None:
    """Expected: each fault of cameras and PTUs that a range has is struck on real lines, and six with a full disk."""
    struck = {what for case in CASES for what, _ in case.faults}
    assert {CAMERA_LOST, CAMERA_FROZEN, CAMERA_LATE, CAMERA_CLOCK_STEPPED, PTU_SILENT} <= struck
    assert sum(case.disk_full and bool(case.faults or case.dgps_gone) for case in CASES) >= 6
    assert len({case.name for case in CASES}) == len(CASES)
