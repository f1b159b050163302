"""Clocks found by image motion are differences to a camera's clock: the rig says how well both are known, and those."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.clocks.calibrate import timed_rig
from calibration.session_clocks import written_clocks
from groundstation.estimation.parameters import rig_prior
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import ClockModel, Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import Session
from groundstation.simulation import standard_rig
from tests.calibration.test_session_clocks import session_of

CAMERA_S, FIT_S, OTHER_FIT_S = 0.02, 0.001, 0.002
LEFT_CAMERA, LEFT_PTU = "left.camera_clock.offset", "left.ptu_clock.offset"
RIGHT_CAMERA, RIGHT_PTU = "right.camera_clock.offset", "right.ptu_clock.offset"
FITS = {
    "left": SimpleNamespace(offset_s=0.012, drift=0.0, middle_s=0.0, sigma_s=FIT_S),
    "right": SimpleNamespace(offset_s=0.015, drift=0.0, middle_s=0.0, sigma_s=OTHER_FIT_S),
}
OF_BOTH = "\n[clocks]\nleft = { offset_s = 0.2, sigma_s = 0.02 }\nright = { offset_s = 0.2, sigma_s = 0.02 }\n"
OF_TABLES = "\n[clocks]\nframes = { offset_s = 0.2, sigma_s = 0.02 }\nptu = { offset_s = 0.1, sigma_s = 0.03 }\n"


def sigma_s(rig: Rig, **weights: float) -> float:
    """Return 1 sigma of a sum of clocks by the covariance that the filter carries for the rig."""
    prior = rig_prior(rig)
    names = {"lc": LEFT_CAMERA, "lp": LEFT_PTU, "rc": RIGHT_CAMERA, "rp": RIGHT_PTU}
    row = np.zeros(len(prior.names))
    for short, weight in weights.items():
        row[prior.names.index(names[short])] = weight
    return float(np.sqrt(row @ prior.covariance @ row))


def read_again(rig: Rig, folder: Path) -> Rig:
    path = folder / "timed.toml"
    path.write_text(rig_to_toml(rig))
    return load_rig(path)


def timed(session: Session, folder: Path) -> Rig:
    """Return the rig that the left station's fit gives, as a later run reads it."""
    rig = timed_rig(session.rig, {"left": FITS["left"]})
    return read_again(written_clocks(session, rig, {"left.ptu_clock"}).rig, folder)


@pytest.mark.parametrize("clocks", [OF_BOTH, OF_TABLES])
def test_only_the_difference_to_the_camera_is_measured(tmp_path: Path, clocks: str) -> None:
    """Of one entry, the difference was exact before and is the fit's after; its error was the entry's until now."""
    rig = timed(session_of(tmp_path / "s", clocks), tmp_path)
    assert sigma_s(rig, lp=1.0, lc=-1.0) == pytest.approx(FIT_S, rel=1e-6)
    assert sigma_s(rig, lc=1.0) == pytest.approx(CAMERA_S, rel=1e-9)
    assert rig["left"].ptu_clock.sigma_s == pytest.approx(np.hypot(CAMERA_S, FIT_S), rel=1e-9)
    assert sigma_s(rig, lp=1.0) == pytest.approx(np.hypot(CAMERA_S, FIT_S), rel=1e-9)
    if clocks is OF_BOTH:
        # the other station's copies are as they were
        assert sigma_s(rig, rp=1.0, rc=-1.0) == pytest.approx(0.0, abs=1e-9)


def test_the_ptu_has_what_the_camera_has_in_common_with_others() -> None:
    """A flight's table correlates the camera's clock with the orientation; the PTU's by its own fit is no other."""
    before = standard_rig()
    clock = ClockModel(sigma_s=0.004)
    left = replace(before["left"], camera_clock=clock, ptu_clock=clock, ptu_clock_given=True)
    turn = "left.runway_from_base.z"
    covariance = 0.8 * 0.004 * 1e-4
    matrix = np.array([[0.004**2, 0.0, covariance], [0.0, 0.004**2, 0.0], [covariance, 0.0, 1e-8]])
    shared = ParameterCovariance(names=(LEFT_CAMERA, LEFT_PTU, turn), matrix=matrix)
    rig = replace(before, stations=(left, before["right"]), shared_covariance=shared)
    table = timed_rig(rig, {"left": FITS["left"]}).shared_covariance
    of = {name: k for k, name in enumerate(table.names)}
    assert set(of) == {LEFT_CAMERA, LEFT_PTU, turn}
    assert table.matrix[of[LEFT_PTU], of[turn]] == pytest.approx(covariance)
    assert table.matrix[of[LEFT_CAMERA], of[turn]] == pytest.approx(covariance)
    assert table.matrix[of[LEFT_PTU], of[LEFT_PTU]] == pytest.approx(0.004**2 + FIT_S**2)
    assert table.matrix[of[LEFT_PTU], of[LEFT_CAMERA]] == pytest.approx(0.004**2)


def test_one_ptu_clock_is_known_by_the_first_camera_and_the_others_by_it(tmp_path: Path) -> None:
    """All PTUs have one error; each camera is as far from it as its own fit says."""
    session = session_of(tmp_path / "s", OF_BOTH)
    rig = read_again(timed_rig(session.rig, FITS, one_ptu_clock=True), tmp_path)
    assert sigma_s(rig, lp=1.0, rp=-1.0) == pytest.approx(0.0, abs=1e-9)
    assert sigma_s(rig, lp=1.0, lc=-1.0) == pytest.approx(FIT_S, rel=1e-6)
    assert sigma_s(rig, rp=1.0, rc=-1.0) == pytest.approx(OTHER_FIT_S, rel=1e-6)
    assert sigma_s(rig, rc=1.0, lc=-1.0) == pytest.approx(np.hypot(FIT_S, OTHER_FIT_S), rel=1e-6)
    assert rig["right"].camera_clock is not None
    assert rig["right"].camera_clock.sigma_s == pytest.approx(np.sqrt(CAMERA_S**2 + FIT_S**2 + OTHER_FIT_S**2))


def test_a_clock_by_a_camera_without_an_error_stands_alone() -> None:
    rig = timed_rig(standard_rig(), FITS)
    assert not rig.shared_covariance.names
    assert rig["left"].ptu_clock.sigma_s == pytest.approx(FIT_S)
    assert rig["right"].ptu_clock.sigma_s == pytest.approx(OTHER_FIT_S)
