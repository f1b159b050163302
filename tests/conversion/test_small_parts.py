"""Parts of an import: progress over several videos, and a table of angles without a time."""

from pathlib import Path

import pytest

from groundstation.conversion.angle_table import read_angle_table
from groundstation.conversion.import_clock import ImportClock
from groundstation.conversion.import_session import _after
from groundstation.errors import SessionError
from groundstation.rig.rig import load_rig
from tests.conftest import ROOT


def test_frames_count_on_top_of_those_of_the_videos_before() -> None:
    reported: list[int] = []
    for count in (1, 7):
        _after(reported.append, 100, count)
    assert reported == [101, 107]


def test_a_table_without_a_time_shows_its_first_columns(tmp_path: Path) -> None:
    rig = load_rig(ROOT / "recordings" / "landing-1" / "rig.toml")
    angles = "left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg"
    (tmp_path / "angles.csv").write_text(f"{angles},a,b,c\n1,2,3,4,5,6,7\n")
    clock = ImportClock.__new__(ImportClock)
    with pytest.raises(SessionError, match=r"got left_pan_deg, .*, a, b; wanted a column t_s, utc or unix_s"):
        read_angle_table(tmp_path / "angles.csv", rig, clock)
