"""A recording whose run learnt from DGPS, replayed with a rig that knows antenna and clock of the receiver."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.messages import DgpsFix
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.dgps import RigReference
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation import case_b, simulate
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.session_folder import write_session_folder
from groundstation.sources.recorded_fixes import recorded_fixes, recorrected_fixes
from groundstation.sources.reference_fixes import reference_fixes

pytestmark = pytest.mark.usefixtures("unrendered_figures")

ANTENNA_M = np.array([-3.0, 0.0, -0.3])
LATE_S = 0.10
TO_S = 8.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session without [target], replayed and recorded by a rig that does not know the receiver."""
    folder = tmp_path_factory.mktemp("recorded")
    scenario = replace(case_b(seed=5), dgps=DgpsModel(antenna_in_body_m=ANTENNA_M, clock_offset_s=LATE_S))
    write_session_folder(folder / "session", simulate(scenario), name="flight")
    about = folder / "session" / "session.toml"
    text = about.read_text()
    about.write_text(text[: text.index("[target]")])
    known = RigReference(
        session="flight",
        offset_s=LATE_S,
        offset_sigma_s=0.001,
        antenna_in_body_m=ANTENNA_M,
        antenna_sigma_m=np.full(3, 0.02),
    )
    (folder / "known.toml").write_text(rig_to_toml(replace(scenario.rig, reference=known)))
    run(folder, "first", folder / "session", learn_until_s=1e6, record=folder / "flight.mcap")
    return folder


def run(folder: Path, name: str, session: Path, **how: object) -> Path:
    request = ReplayRequest(session=session, out=folder / name, to_s=TO_S, rerun=False, report=False, **how)
    assert replay(request).fault is None
    return folder / name


def track(out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, 3) where the target is tracked, and one sigma of each along the runway (n,)."""
    with (out / "track.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "tracking"]
    positions = np.array([[float(row[k]) for k in ("x_m", "y_m", "z_m")] for row in rows])
    return positions, np.sqrt([float(row["cov_yy_m2"]) for row in rows])


def test_recorded_positions_are_corrected_by_the_rig_in_use(flight: Path) -> None:
    """Expected: the track of the folder with that rig; with positions as recorded it was up to 5.5 m off."""
    wanted, sigma_m = track(run(flight, "folder", flight / "session", rig=flight / "known.toml", learn_until_s=1e6))
    found, _ = track(run(flight, "recording", flight / "flight.mcap", rig=flight / "known.toml"))
    assert len(found) == len(wanted) > 50
    # recorded are the positions up to the last picture; the direction of flight is that of nose or antenna
    assert np.max(np.abs(found - wanted)[:, 1] / sigma_m) < 0.2
    recorded, _ = track(flight / "first")
    assert np.max(np.abs(recorded - wanted)[:, 1] / sigma_m) > 3.0


def test_by_the_recorded_rig_they_stay(flight: Path) -> None:
    found, _ = track(run(flight, "again", flight / "flight.mcap", rig=flight / "session" / "rig.toml"))
    np.testing.assert_array_equal(found, track(flight / "first")[0])


def test_recorrected_positions_are_those_that_the_log_gives(flight: Path) -> None:
    session = load_session(flight / "flight.mcap")
    assert session.recorded is not None
    fixes = recorded_fixes(session.recorded)
    assert len(fixes) > 50
    log = [DgpsFix(t_s=fix.t_s, position_runway_m=fix.position_runway_m, sigma_m=fix.sigma_m) for fix in fixes]
    wanted = reference_fixes(log, ANTENNA_M, np.inf, LATE_S)
    # from another antenna and clock that are not true either
    first = reference_fixes(log, np.array([0.5, -0.4, 0.2]), np.inf, -0.07)
    found = recorrected_fixes(first, ANTENNA_M - np.array([0.5, -0.4, 0.2]), LATE_S + 0.07)
    np.testing.assert_allclose([fix.t_s for fix in found], [fix.t_s for fix in wanted], atol=1e-9)
    off = np.array([a.position_runway_m - b.position_runway_m for a, b in zip(found, wanted, strict=True)])
    # two directions of flight from fixes of 2 cm: less than one of them is off
    assert np.max(np.abs(off)) < 0.02
    np.testing.assert_array_equal([fix.sigma_m for fix in found], [fix.sigma_m for fix in wanted])


def test_one_position_alone_has_no_direction(flight: Path) -> None:
    session = load_session(flight / "flight.mcap")
    assert session.recorded is not None
    first = recorded_fixes(session.recorded)[:1]
    (found,) = recorrected_fixes(first, ANTENNA_M, LATE_S)
    np.testing.assert_array_equal(found.position_runway_m, first[0].position_runway_m)
    assert recorrected_fixes([], ANTENNA_M, LATE_S) == []
