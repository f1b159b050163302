"""A rig with its clocks that cannot be written."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.clocks.calibrate import _write, timed_rig
from groundstation.errors import InputError
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import ClockModel, load_rig
from groundstation.simulation import standard_rig
from tests.conftest import ROOT


def test_a_folder_in_the_way_is_named(tmp_path: Path) -> None:
    rig = load_rig(ROOT / "recordings" / "landing-1" / "rig.toml")
    _write(tmp_path / "new" / "rig.toml", "landing-1", rig)
    assert load_rig(tmp_path / "new" / "rig.toml").names == rig.names
    with pytest.raises(InputError, match="wanted a file that can be written"):
        _write(tmp_path, "landing-1", rig)


def test_a_clock_found_again_has_nothing_left_in_common_with_others(tmp_path: Path) -> None:
    """A flight's table over stations has the clock's former variance: next to the new one the file was refused."""
    before = standard_rig()
    clock = ClockModel(offset_s=0.01, sigma_s=0.004)
    stations = tuple(replace(s, ptu_clock=clock, ptu_clock_given=True) for s in before.stations)
    names = ("left.ptu_clock.offset", "right.ptu_clock.offset", "left.runway_from_base.x")
    matrix = np.diag([0.004**2, 0.004**2, 1e-8])
    matrix[0, 1] = matrix[1, 0] = 0.9 * 0.004**2
    shared = ParameterCovariance(names=names, matrix=matrix)
    found = SimpleNamespace(offset_s=0.002, drift=0.0, middle_s=0.0, sigma_s=0.0005)
    timed = timed_rig(replace(before, stations=stations, shared_covariance=shared), {"left": found})
    _write(tmp_path / "rig.toml", "swing", timed)
    again = load_rig(tmp_path / "rig.toml")
    assert again.shared_covariance.names == names[1:]
    assert again["left"].ptu_clock.sigma_s == 0.0005
    assert again["right"].ptu_clock == clock
