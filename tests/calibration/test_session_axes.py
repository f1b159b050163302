"""[ptu_axes_applied] of a session in the rig that a calibration writes: angles corrected by them calibrated it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.clocks.calibrate import TimingRequest, calibrate_timing
from calibration.clocks.text_report import format_timing
from calibration.session_axes import written_axes
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from tests.calibration.flight.flights import CLOCKS, approach, flown, run
from tests.calibration.flight.test_flight import MOUNTS
from tests.session.folder import SESSION, Tiny

# more digits than a rig file has
APPLIED = "\n[ptu_axes_applied.left]\npan_zero_deg = 1.23456789012345\npan_backlash_deg = 0.03\n"
AXES = PtuAxes(pan_zero_rad=float(np.radians(1.23456789012345)), pan_backlash_rad=float(np.radians(0.03)))
LINE = "note: ptu_axes taken from [ptu_axes_applied] in session.toml"


def compare_file(path: Path, lean_rad: float = 0.0) -> None:
    """Compare a rig file's axes with those that were applied."""
    again = load_rig(path)
    for name, value in (("pan_zero_rad", AXES.pan_zero_rad), ("pan_backlash_rad", AXES.pan_backlash_rad)):
        assert getattr(again["left"].ptu_axes, name) == pytest.approx(value, rel=1e-11)
    assert again["left"].ptu_axes.lean_rad == pytest.approx(lean_rad, rel=1e-11)
    assert again["right"].ptu_axes == PtuAxes()


def test_a_flight_of_corrected_angles_calibrates_a_rig_with_their_axes(tmp_path: Path) -> None:
    folder = flown(tmp_path, approach(3, MOUNTS))
    about = folder / "session.toml"
    about.write_text(about.read_text() + APPLIED)
    rig = load_rig(folder / "rig.toml")
    leaning = replace(rig["left"], ptu_axes=PtuAxes(lean_rad=1e-4))
    (folder / "rig.toml").write_text(rig_to_toml(replace(rig, stations=(leaning, rig["right"]))))
    found = run(tmp_path, free="orientation")
    assert LINE in found.report
    compare_file(tmp_path / "rig.toml", lean_rad=1e-4)
    again = load_session(folder, tmp_path / "rig.toml")
    # the rig has them for the next recording, this one's angles have them already
    assert again.reading_axes(again.rig["left"]).is_ideal_apart_from_lean
    # nothing is left to take from the session
    assert not written_axes(again, again.rig).note


def test_clocks_of_corrected_angles_come_in_a_rig_with_their_axes(tmp_path: Path) -> None:
    folder = flown(tmp_path, approach(3, {}))
    about = folder / "session.toml"
    about.write_text(about.read_text() + CLOCKS.format(sigma=0.02) + APPLIED)
    request = TimingRequest(session=folder, out=tmp_path / "rig.toml", pictures=False, flight=True)
    assert LINE in format_timing(calibrate_timing(request))
    compare_file(tmp_path / "rig.toml")
    load_session(folder, tmp_path / "rig.toml")


def test_axes_of_no_error_and_of_fixed_cameras_are_not_taken(tmp_path: Path) -> None:
    """A camera that does not turn has no readings; a table without an error has nothing to add."""
    text = SESSION + "\n[ptu_axes_applied.right]\n" + APPLIED
    session = load_session(Tiny(rows=4, video="png", fixed=("left",), session=text).write(tmp_path))
    written = written_axes(session, session.rig)
    assert written.rig is session.rig
    assert not written.note
