"""A rig with its clocks that cannot be written."""

from pathlib import Path

import pytest

from calibration.clocks.calibrate import _write
from groundstation.errors import InputError
from groundstation.rig.rig import load_rig
from tests.conftest import ROOT


def test_a_folder_in_the_way_is_named(tmp_path: Path) -> None:
    rig = load_rig(ROOT / "recordings" / "landing-1" / "rig.toml")
    _write(tmp_path / "new" / "rig.toml", "landing-1", rig)
    assert load_rig(tmp_path / "new" / "rig.toml").names == rig.names
    with pytest.raises(InputError, match="wanted a file that can be written"):
        _write(tmp_path, "landing-1", rig)
