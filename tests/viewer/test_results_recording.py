"""A Rerun recording of a run's tables."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import InputError
from groundstation.sinks.track_files import TRACK_COLUMNS
from groundstation.viewer.entity_paths import time_column
from groundstation.viewer.results_recording import write_results_recording


def test_unreadable_tables_leave_no_recording(tmp_path: Path) -> None:
    """Expected: the error of the table, and no part of a recording that a later reader would take for a whole one."""
    (tmp_path / "track.csv").write_text("t_s,status\n0.0,tracking\n")
    with pytest.raises(InputError, match=r"track\.csv"):
        write_results_recording(tmp_path, tmp_path / "run.rrd", "run")
    assert not (tmp_path / "run.rrd").exists()


def test_a_time_beyond_the_recordings_range_is_an_error(tmp_path: Path) -> None:
    """Expected: an error of one line; Rerun counts ns in 64 bits, which 1e11 s overflow."""
    lost = "," * (len(TRACK_COLUMNS) - 1) + "lost\n"
    (tmp_path / "track.csv").write_text(",".join(TRACK_COLUMNS) + f"\n1.0{lost}1e11{lost}")
    with pytest.raises(InputError, match=r"track\.csv.*3.*got t_s = 1e\+11; wanted at most 9\.2e\+09 s"):
        write_results_recording(tmp_path, tmp_path / "run.rrd", "run")
    with pytest.raises(InputError, match="session time: got 1e"):
        time_column(np.array([0.0, -1e11]))
