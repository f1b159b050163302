"""Faults on a timetable: each edits what its device gives, and nothing else."""

import math
from dataclasses import replace

import numpy as np
import pytest

from groundstation.errors import ScenarioError
from groundstation.messages import PixelMeasurement, PtuSample
from groundstation.simulation import SimulatedFlight, simulate
from groundstation.simulation.event_faults import Fault, FaultKind, delivered_frames, with_faults
from groundstation.simulation.flights import FlightName, flight, rendered_scenario, site_rig
from tests.complaints import complaint

HEALTHY = simulate(rendered_scenario(flight(FlightName.LANDING, duration_s=6.0), site_rig(), seed=3))


def pixels(of: SimulatedFlight, station: str) -> dict[int, PixelMeasurement]:
    return {e.epoch: e for e in of.events if isinstance(e, PixelMeasurement) and e.station == station}


def readings(of: SimulatedFlight, station: str) -> list[PtuSample]:
    return [e for e in of.events if isinstance(e, PtuSample) and e.station == station]


def fault(kind: FaultKind, station: str = "left", by: float = 0.0) -> Fault:
    return Fault(kind=kind, station=station, from_s=2.0, to_s=4.0, by=by)


def test_no_fault_changes_nothing() -> None:
    assert with_faults(HEALTHY, ()).events == HEALTHY.events


def test_a_lost_camera_gives_nothing() -> None:
    lost = with_faults(HEALTHY, [fault(FaultKind.CAMERA_LOST)])
    gone = set(pixels(HEALTHY, "left")) - set(pixels(lost, "left"))
    assert gone == {k for k, e in pixels(HEALTHY, "left").items() if 2.0 <= e.t_s < 4.0}
    assert pixels(lost, "right") == pixels(HEALTHY, "right")
    assert readings(lost, "left") == readings(HEALTHY, "left")


def test_a_frozen_camera_repeats_its_last_picture_with_new_stamps() -> None:
    frozen = pixels(with_faults(HEALTHY, [fault(FaultKind.CAMERA_FROZEN)]), "left")
    own = delivered_frames(HEALTHY, "left", [fault(FaultKind.CAMERA_FROZEN)])
    assert np.all(own.shown[20:40] == 19)
    assert own.shown[40] == 40
    assert {(frozen[k].u_px, frozen[k].v_px) for k in range(19, 40)} == {(frozen[19].u_px, frozen[19].v_px)}
    assert frozen[30].t_s == pytest.approx(3.0)


def test_a_late_camera_stamps_and_arrives_late() -> None:
    late = with_faults(HEALTHY, [fault(FaultKind.CAMERA_LATE, by=0.06)])
    assert pixels(late, "left")[30].t_s == pytest.approx(3.06)
    arrived = {
        (e.station, e.epoch): t
        for e, t in zip(late.events, late.arrival_s, strict=True)
        if isinstance(e, PixelMeasurement)
    }
    assert arrived["left", 30] == pytest.approx(arrived["right", 30] + 0.06)
    assert np.all(np.diff(late.arrival_s) >= 0)


def test_a_ptu_falls_silent_sticks_or_spikes() -> None:
    silent = readings(with_faults(HEALTHY, [fault(FaultKind.PTU_SILENT)]), "left")
    assert not [e for e in silent if 2.0 <= e.t_s < 4.0]
    stuck = readings(with_faults(HEALTHY, [fault(FaultKind.PTU_STUCK)]), "left")
    held = [e for e in stuck if 2.0 <= e.t_s < 4.0]
    assert len(held) == 100
    before = [e for e in stuck if e.t_s < 2.0][-1]
    assert {(e.pan_rad, e.tilt_rad) for e in held} == {(before.pan_rad, before.tilt_rad)}
    assert [e for e in stuck if e.t_s >= 4.0] == [e for e in readings(HEALTHY, "left") if e.t_s >= 4.0]
    spiked = readings(with_faults(HEALTHY, [fault(FaultKind.PTU_SPIKE, by=0.02)]), "left")
    off = {
        round(s.pan_rad - h.pan_rad, 9)
        for s, h in zip(spiked, readings(HEALTHY, "left"), strict=True)
        if 2 <= h.t_s < 4
    }
    assert off == {0.02}


def test_dgps_has_a_gap_in_session_time() -> None:
    gap = with_faults(HEALTHY, [fault(FaultKind.DGPS_GAP, station="")])
    # the receiver's clock is 0.3 s ahead
    assert not [f for f in gap.dgps if 2.3 + 1e-6 < f.t_s < 4.3 - 1e-6]
    assert len(HEALTHY.dgps) - len(gap.dgps) == 20


def test_clocks_step() -> None:
    for kind, station in ((FaultKind.CAMERA_CLOCK_STEP, "left"), (FaultKind.PTU_CLOCK_STEP, "left")):
        stepped = with_faults(HEALTHY, [Fault(kind=kind, station=station, from_s=3.0, by=0.5)])
        chosen = (pixels(stepped, "left").values(), pixels(HEALTHY, "left").values())
        if kind is FaultKind.PTU_CLOCK_STEP:
            chosen = (readings(stepped, "left"), readings(HEALTHY, "left"))
        steps = {(h.t_s >= 3.0, round(s.t_s - h.t_s, 6)) for s, h in zip(*chosen, strict=True)}
        assert steps == {(False, 0.0), (True, 0.5)}
    dgps = with_faults(HEALTHY, [Fault(kind=FaultKind.DGPS_CLOCK_STEP, from_s=3.0, by=-0.5)]).dgps
    assert dgps[-1].t_s == pytest.approx(HEALTHY.dgps[-1].t_s - 0.5)


@pytest.mark.parametrize(
    ("wrong", "reported"),
    [
        ({"kind": FaultKind.CAMERA_LOST, "station": ""}, "station"),
        ({"kind": FaultKind.DGPS_GAP, "station": "left"}, "station"),
        ({"kind": FaultKind.CAMERA_LATE, "station": "left"}, "by"),
        ({"kind": FaultKind.CAMERA_LOST, "station": "left", "by": 1.0}, "by"),
        ({"kind": FaultKind.CAMERA_LOST, "station": "left", "from_s": 2.0, "to_s": 2.0}, "to"),
        ({"kind": FaultKind.CAMERA_LOST, "station": "left", "from_s": math.nan}, "from"),
        ({"kind": FaultKind.CAMERA_LOST, "station": "left", "from_s": -5.0, "to_s": -1.0}, "to"),
        ({"kind": FaultKind.CAMERA_LATE, "station": "left", "by": -1.0}, "by"),
    ],
)
def test_impossible_faults_are_refused(wrong: dict[str, object], reported: str) -> None:
    assert f": {reported}: got" in complaint(ScenarioError, lambda: Fault(**wrong))  # type: ignore[arg-type]


def test_faults_of_absent_devices_are_refused() -> None:
    unknown = Fault(kind=FaultKind.CAMERA_LOST, station="middle")
    assert "'middle'" in complaint(ScenarioError, lambda: with_faults(HEALTHY, [unknown]))
    stands = replace(
        HEALTHY, rig=replace(HEALTHY.rig, stations=tuple(replace(s, fixed=True) for s in HEALTHY.rig.stations))
    )
    silent = fault(FaultKind.PTU_SILENT)
    assert "pan-tilt unit" in complaint(ScenarioError, lambda: with_faults(stands, [silent]))
