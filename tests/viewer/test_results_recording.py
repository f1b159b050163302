"""A Rerun recording of a run's tables."""

from pathlib import Path

import pytest

from groundstation.errors import InputError
from groundstation.viewer.results_recording import write_results_recording


def test_unreadable_tables_leave_no_recording(tmp_path: Path) -> None:
    """Expected: the error of the table, and no part of a recording that a later reader would take for a whole one."""
    (tmp_path / "track.csv").write_text("t_s,status\n0.0,tracking\n")
    with pytest.raises(InputError, match=r"track\.csv"):
        write_results_recording(tmp_path, tmp_path / "run.rrd", "run")
    assert not (tmp_path / "run.rrd").exists()
