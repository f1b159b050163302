"""A simulated flight as a session folder: the replay gets the same events, and finds the aircraft."""

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import InputError
from groundstation.messages import Epoch, Event, InitialState, PixelMeasurement, PtuSample
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_dgps, load_session, load_truth
from groundstation.simulation import Scenario, StationErrors, case_b, case_c, perturbed, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.detection_camera import CameraModel
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.ptu import PtuModel
from groundstation.simulation.session_folder import write_session_folder
from groundstation.sources.folder_source import FolderSource
from tests.complaints import complaint

pytestmark = pytest.mark.usefixtures("unrendered_figures")

SHORT = GlideApproach(start_y_m=300.0, end_y_m=150.0)


def plain(events: Iterable[Event]) -> tuple[list[tuple[str, str]], np.ndarray]:
    """Kind and station of each event, and its numbers (n, 3), by kind, station and time."""
    rows: list[tuple[str, str, float, float, float]] = []
    for event in events:
        if isinstance(event, PtuSample):
            rows.append(("ptu", event.station, event.t_s, event.pan_rad, event.tilt_rad))
        elif isinstance(event, PixelMeasurement):
            rows.append(("pixel", event.station, event.t_s, event.u_px, event.v_px))
        elif isinstance(event, Epoch):
            rows.append(("epoch", "", event.t_s, 0.0, 0.0))
    rows.sort()
    return [row[:2] for row in rows], np.array([row[2:] for row in rows])


def off_clocks() -> Scenario:
    """Every clock off, some known, some not; units at rates and phases of their own."""
    scenario = case_b(trajectory=SHORT)
    known = {
        "left": StationErrors(ptu_offset_s=0.25, ptu_drift_ppm=40.0, camera_offset_s=-0.1),
        "right": StationErrors(ptu_offset_s=-0.5, camera_offset_s=-0.1),
    }
    rig = perturbed(scenario.rig, known)
    true = perturbed(rig, {"left": StationErrors(ptu_offset_s=0.004)})
    ptus = {"left": PtuModel(rate_hz=50.0, phase_s=0.003), "right": PtuModel(rate_hz=30.0, delay_s=0.02)}
    dgps = DgpsModel(clock_offset_s=0.3, antenna_in_body_m=np.array([-0.5, 0.0, -0.1]))
    return replace(scenario, rig=rig, true_rig=true, ptus=ptus, dgps=dgps)


@pytest.mark.parametrize("scenario", [case_b(trajectory=SHORT), off_clocks()], ids=["plain", "clocks"])
def test_a_replay_gets_the_same_events(scenario: Scenario, tmp_path: Path) -> None:
    """Up to the rounding of the tables, whatever the clocks; only the order of arrival is lost."""
    flight = simulate(scenario)
    write_session_folder(tmp_path / "s", flight, name="simulated")
    with FolderSource(load_session(tmp_path / "s")) as source:
        kinds, numbers = plain(source)
    sent_kinds, sent_numbers = plain(flight.events)
    assert kinds == sent_kinds
    assert numbers == pytest.approx(sent_numbers, abs=1e-6)


def test_truth_and_fixes_are_read_again(tmp_path: Path) -> None:
    flight = simulate(off_clocks())
    write_session_folder(tmp_path / "s", flight, name="simulated")
    session = load_session(tmp_path / "s")
    truth, fixes = load_truth(session), load_dgps(session)
    assert truth is not None
    assert truth.t_s == pytest.approx(flight.truth.t_s)
    assert truth.position_runway_m == pytest.approx(flight.truth.position_runway_m, abs=1e-6)
    assert truth.pixels_px["right"] == pytest.approx(flight.truth.stations["right"].pixel_px, abs=1e-6)
    assert [f.t_s for f in fixes] == pytest.approx([f.t_s for f in flight.dgps])
    assert fixes[7].position_runway_m == pytest.approx(flight.dgps[7].position_runway_m, abs=1e-6)
    assert session.target.antenna_in_body_m == pytest.approx([-0.5, 0.0, -0.1])


def test_replayed_from_end_to_end(tmp_path: Path) -> None:
    """Case C's weaving approach with misses and outliers: acquired, tracked, near the truth; DGPS clock found."""
    camera = CameraModel(pixel_covariance_px2=np.eye(2), miss_probability=0.03, outlier_probability=0.01)
    scenario = case_c(ptu_hz=50.0, seed=5)
    dgps = DgpsModel(clock_offset_s=0.2)
    flight = simulate(replace(scenario, cameras=dict.fromkeys(scenario.rig.names, camera), dgps=dgps))
    write_session_folder(tmp_path / "s", flight, name="case C")
    result = replay(ReplayRequest(session=tmp_path / "s", out=tmp_path / "out", rerun=False))
    assert result.fault is None
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    ekf = summary["accuracy"]["truth"]["total"]["ekf"]
    assert ekf["epochs"] > 140
    assert ekf["rmse_m"][0] < 0.05
    assert ekf["rmse_m"][1] < 2.0
    assert ekf["rmse_m"][2] < 0.10
    assert summary["reference"]["time_offset"]["offset_s"] == pytest.approx(0.2, abs=0.02)
    assert np.abs(ekf["mean_m"]).max() < 0.5


def test_a_start_can_be_given(tmp_path: Path) -> None:
    start = InitialState(
        t_s=0.0,
        position_runway_m=np.array([0.0, 300.0, 15.0]),
        velocity_runway_m_s=np.array([0.0, -25.0, -1.5]),
        sigma_position_m=np.ones(3),
        sigma_velocity_m_s=np.ones(3),
    )
    write_session_folder(tmp_path / "s", simulate(case_b(trajectory=SHORT)), name="s", initial=start)
    initial = load_session(tmp_path / "s").initial
    assert initial is not None
    assert initial.velocity_runway_m_s == pytest.approx([0.0, -25.0, -1.5])


def test_fixed_stations_need_no_ptu_table(tmp_path: Path) -> None:
    scenario = case_b(trajectory=SHORT)
    rig = replace(scenario.rig, stations=tuple(replace(s, fixed=True) for s in scenario.rig.stations))
    flight = simulate(replace(scenario, rig=rig, true_rig=rig, ptus={}))
    write_session_folder(tmp_path / "s", flight, name="fixed")
    assert not (tmp_path / "s" / "ptu.csv").exists()
    load_session(tmp_path / "s")


def test_nothing_is_written_over(tmp_path: Path) -> None:
    flight = simulate(case_b(trajectory=SHORT))
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "left.mp4").write_text("precious")
    reported = complaint(InputError, lambda: write_session_folder(tmp_path / "s", flight, name="s"))
    assert "got a folder that is not empty; wanted a new or an empty one" in reported
    (tmp_path / "file").write_text("")
    assert "wanted a folder that can be written" in complaint(
        InputError, lambda: write_session_folder(tmp_path / "file" / "s", flight, name="s")
    )
