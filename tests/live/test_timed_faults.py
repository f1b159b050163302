"""Faults of a simulated range happen when they are said to."""

import time
from pathlib import Path

from groundstation.live.timed_faults import CAMERA_LOST, PTU_SILENT, TimedFault, is_there, strike
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
