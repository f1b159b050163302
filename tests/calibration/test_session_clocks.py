"""[clocks] of a session in the rig that a calibration writes: only what was estimated on top of them."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

from calibration.session_clocks import written_clocks
from groundstation.estimation.parameters import CLOCKS, rig_prior
from groundstation.rig.rig import ClockModel, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import Session, load_session
from tests.calibration.flight.flights import approach, flown, run
from tests.calibration.flight.test_flight import MOUNTS
from tests.session.folder import SESSION, Tiny

LATE_S = 0.2
OF_STATIONS = f"\n[clocks]\nleft = {{ offset_s = {LATE_S} }}\nright = {{ offset_s = {LATE_S} }}\n"
COPIED = {f"{name}.{clock}" for name in ("left", "right") for clock in ("camera_clock", "ptu_clock")}


def session_of(folder: Path, clocks: str, **rig_more: str) -> Session:
    return load_session(Tiny(rows=4, video="png", session=SESSION + clocks, rig_more=rig_more).write(folder))


def test_which_clocks_are_copies_of_which_entry(tmp_path: Path) -> None:
    """The rig's own come first; an entry of a station is its camera's and its PTU's unless there is one of ``ptu``."""
    assert set(session_of(tmp_path / "a", OF_STATIONS).clock_entries.items()) == {
        (clock, clock.partition(".")[0]) for clock in COPIED
    }
    tables = "\n[clocks]\nframes = { offset_s = 0.1 }\nptu = { offset_s = 0.3 }\nleft = { offset_s = 0.2 }\n"
    session = session_of(tmp_path / "b", tables, right="ptu_clock = { offset_s = 0.0 }")
    assert session.clock_entries == {
        "left.camera_clock": "left",
        "left.ptu_clock": "ptu",
        "right.camera_clock": "frames",
    }
    assert session.rig["right"].ptu_clock == ClockModel()
    assert session.rig["left"].ptu_clock == ClockModel(offset_s=0.3)
    assert not session_of(tmp_path / "c", "").clock_entries


def test_held_copies_are_left_out_and_the_rigs_own_stay(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s", OF_STATIONS, right="ptu_clock = { offset_s = 0.01 }")
    clocked = written_clocks(session, session.rig, {"right.ptu_clock"})
    assert clocked.rig["left"].camera_clock is None
    assert clocked.rig["right"].camera_clock is None
    assert not clocked.rig["left"].ptu_clock_given
    assert clocked.rig["right"].ptu_clock.offset_s == 0.01
    assert "left.camera_clock, left.ptu_clock, right.camera_clock" in clocked.note
    (tmp_path / "rig.toml").write_text(rig_to_toml(clocked.rig))
    (tmp_path / "own.toml").write_text(rig_to_toml(load_rig(tmp_path / "s" / "rig.toml")))
    assert (tmp_path / "rig.toml").read_text() == (tmp_path / "own.toml").read_text()


def test_the_error_of_an_entry_is_one_for_all_its_clocks(tmp_path: Path) -> None:
    """Of a station's entry camera and PTU are wrong together; of ``frames`` and ``ptu`` both cameras, and both PTUs."""
    sure = "left = { offset_s = 0.2, sigma_s = 0.05 }\nright = { offset_s = 0.2, sigma_s = 0.03 }\n"
    prior = rig_prior(session_of(tmp_path / "a", "\n[clocks]\n" + sure).rig)
    names = [f"{clock}.offset" for clock in sorted(COPIED)]
    order = [prior.names.index(name) for name in names]
    one = np.ones((2, 2))
    np.testing.assert_allclose(
        prior.covariance[np.ix_(order, order)], block_diag(0.05**2 * one, 0.03**2 * one), rtol=1e-12
    )
    tables = "frames = { offset_s = 0.1, sigma_s = 0.05 }\nptu = { offset_s = 0.3, sigma_s = 0.03 }\n"
    prior = rig_prior(session_of(tmp_path / "b", "\n[clocks]\n" + tables).rig)
    order = [prior.names.index(f"{name}.{clock}.offset") for clock in CLOCKS for name in ("left", "right")]
    np.testing.assert_allclose(
        prior.covariance[np.ix_(order, order)], block_diag(0.05**2 * one, 0.03**2 * one), rtol=1e-12
    )


def test_common_errors_of_copies_are_not_the_rigs(tmp_path: Path) -> None:
    sure = "\n[clocks]\nleft = { offset_s = 0.2, sigma_s = 0.05 }\n"
    session = session_of(tmp_path, sure, right="ptu_clock = { offset_s = 0.01, sigma_s = 0.004 }")
    assert session.rig.shared_covariance.names == ("left.camera_clock.offset", "left.ptu_clock.offset")
    assert not written_clocks(session, session.rig, {"right.ptu_clock"}).rig.shared_covariance.names
    # the rig's own clock is as it was: one error, by itself
    prior = rig_prior(session.rig)
    place = prior.names.index("right.ptu_clock.offset")
    assert np.flatnonzero(prior.covariance[place]).tolist() == [place]


def test_a_clock_estimated_on_top_of_a_copy_keeps_those_that_it_goes_with(tmp_path: Path) -> None:
    """A PTU's reading is late by its camera's clock: one of the two alone would be off by what both were moved by."""
    session = session_of(tmp_path, OF_STATIONS)
    left = replace(session.rig["left"], ptu_clock=ClockModel(offset_s=LATE_S + 0.012, sigma_s=0.001))
    rig = replace(session.rig, stations=(left, session.rig["right"]))
    clocked = written_clocks(session, rig, {"left.ptu_clock"})
    for station in clocked.rig.stations:
        assert station.camera_clock == ClockModel(offset_s=LATE_S)
        assert station.ptu_clock_given
    assert clocked.rig["left"].ptu_clock.offset_s == pytest.approx(LATE_S + 0.012)
    assert "left.ptu_clock: estimated on top of [clocks]" in clocked.note
    assert "right.camera_clock +0.2 s" in clocked.note


def test_a_session_without_clocks_has_no_note(tmp_path: Path) -> None:
    session = session_of(tmp_path, "")
    clocked = written_clocks(session, session.rig, {"left.ptu_clock"})
    assert clocked.rig is session.rig
    assert not clocked.note


def test_a_flight_leaves_the_held_clocks_of_its_session_out_of_the_rig(tmp_path: Path) -> None:
    """Stamps of cameras and PTUs are 0.2 s early in this recording, by [clocks]; the next recording's are not."""
    folder = flown(tmp_path, approach(3, MOUNTS))
    for name in ("detections.csv", "ptu.csv"):
        head, *rows = csv.reader((folder / name).read_text().splitlines())
        text = [",".join([f"{float(row[0]) - LATE_S:.7f}", *row[1:]]) for row in rows]
        (folder / name).write_text("\n".join([",".join(head), *text]) + "\n")
    about = folder / "session.toml"
    about.write_text(about.read_text() + OF_STATIONS)
    own = load_rig(folder / "rig.toml")
    assert all(s.camera_clock is None for s in own.stations)
    found = run(tmp_path, free="orientation")
    again = load_rig(tmp_path / "rig.toml")
    for name in ("left", "right"):
        assert again[name].camera_clock is None
        assert again[name].ptu_clock == own[name].ptu_clock
        assert again[name].ptu_clock_given == own[name].ptu_clock_given
    assert "note: [clocks] in session.toml are the session's and were held" in found.report
