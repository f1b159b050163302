"""A recording whose run learnt from DGPS, replayed with a rig that knows antenna and clock of the receiver."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.messages import DgpsFix, Event, PtuSample, ReferenceFix
from groundstation.recording.recorder import PATIENT, Recorder
from groundstation.replay.replay import ReplayRequest, ReplayResult, replay
from groundstation.rig.dgps import RigReference
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation import case_b, simulate
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.session_folder import write_session_folder
from groundstation.sources.recorded_fixes import recorded_fixes, recorrected_fixes, recorrected_in_place
from groundstation.sources.reference_fixes import reference_fixes
from groundstation.sources.session_source import session_source

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
    # a recording of operation has an identity of its own
    (folder / "any.toml").write_text(rig_to_toml(replace(scenario.rig, reference=replace(known, session=""))))
    run(folder, "first", folder / "session", learn_until_s=1e6, record=folder / "flight.mcap")
    return folder


def run(folder: Path, name: str, session: Path, **how: object) -> Path:
    assert result_of(folder, name, session, **how).fault is None
    return folder / name


def result_of(folder: Path, name: str, session: Path, **how: object) -> ReplayResult:
    how = {"to_s": TO_S, **how}
    return replay(ReplayRequest(session=session, out=folder / name, rerun=False, report=False, **how))


def events_of(path: Path, rig: Path | None = None) -> list[Event]:
    with session_source(load_session(path, rig)) as source:
        return list(source)


def in_operation(flight: Path, path: Path, events: list[Event]) -> Path:
    """Record events, in their order of arrival, as `groundstation live` does."""
    session = load_session(flight / "flight.mcap")
    assert session.recorded is not None
    header = session.recorded.header
    about = header.files["session.toml"].replace(b'notes = ""', b'notes = "recorded in operation"')
    assert about != header.files["session.toml"]
    with Recorder(path, session.rig, replace(header, files={**header.files, "session.toml": about}), PATIENT) as file:
        for event in events:
            file.take(event)
    return path


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


def test_one_stamp_of_the_future_moves_no_position(flight: Path, tmp_path: Path) -> None:
    """Expected: corrected where they arrived. Merged by time, all of them came at a reading stamped 1000 s ahead."""
    events = events_of(flight / "flight.mcap")
    third = len(events) // 3
    ahead = PtuSample(t_s=events[third].t_s + 1000.0, station="left", pan_rad=0.0, tilt_rad=0.0)
    as_sent = in_operation(flight, tmp_path / "sent.mcap", events)
    with_bad = in_operation(flight, tmp_path / "bad.mcap", [*events[:third], ahead, *events[third:]])
    # the whole recording: a part has no stamps outside of it
    by_rig = {"rig": flight / "any.toml", "to_s": None}
    wanted, sigma_m = track(run(tmp_path, "wanted", as_sent, **by_rig))
    found, _ = track(run(tmp_path, "found", with_bad, **by_rig))
    assert len(found) == len(wanted) > 50
    assert np.max(np.abs(found - wanted)[:, 1] / sigma_m) < 0.2


def test_positions_of_operation_are_corrected_where_they_arrived(flight: Path, tmp_path: Path) -> None:
    """Expected: by clock and antenna, each at its place; also one that arrives late, and two of the same stamp."""
    events = events_of(flight / "flight.mcap")
    places = [k for k, event in enumerate(events) if isinstance(event, ReferenceFix)]
    second, ninth = events[places[1]], events[places[8]]
    assert isinstance(second, ReferenceFix)
    again = replace(second, sigma_m=np.full(3, 0.5))
    events[places[8] : places[8] + 1] = [again]
    events.append(ninth)
    given = [event for event in events if isinstance(event, ReferenceFix)]
    path = in_operation(flight, tmp_path / "flight.mcap", events)
    session = load_session(path)
    assert session.recorded is not None
    corrected = recorrected_in_place(recorded_fixes(session.recorded), ANTENNA_M, LATE_S)
    with session_source(session, reference=corrected) as source:
        found = list(source)
    assert [type(event) for event in found] == [type(event) for event in events]
    moved = [event for event in found if isinstance(event, ReferenceFix)]
    np.testing.assert_allclose([fix.t_s for fix in moved], [fix.t_s - LATE_S for fix in given], atol=1e-12)
    np.testing.assert_array_equal([fix.sigma_m for fix in moved], [fix.sigma_m for fix in given])
    by_m = [np.linalg.norm(a.position_runway_m - b.position_runway_m) for a, b in zip(moved, given, strict=True)]
    np.testing.assert_allclose(by_m, np.linalg.norm(ANTENNA_M), rtol=1e-6)


def test_positions_that_have_moved_out_of_the_part_are_not_used(flight: Path, tmp_path: Path) -> None:
    """Expected: a clock by which none is of the part leaves none, instead of all as they were recorded."""
    session = load_session(flight / "flight.mcap")
    away = RigReference(offset_s=1000.0, offset_sigma_s=0.001)
    (tmp_path / "away.toml").write_text(rig_to_toml(replace(session.rig, reference=away)))
    result = result_of(tmp_path, "out", flight / "flight.mcap", rig=tmp_path / "away.toml", from_s=0.0, to_s=6.0)
    assert result.fault is None
    assert result.evaluation.summary["calibration"]["learnt_until_s"] is None
    assert any("no DGPS fix updated the filter" in note for note in result.evaluation.summary["faults"])
