"""Rows of frame_angles.csv that are no frame's are counted, and the first of them is named."""

from pathlib import Path

import pytest

from groundstation.session import load_session
from groundstation.sources.folder_source import FolderSource
from tests.session.folder import Tiny


@pytest.mark.parametrize("off_s", [0.0, 0.0005])
def test_rows_without_a_frame_are_noted(tmp_path: Path, off_s: float) -> None:
    folder = Tiny(rows=3, video="png").write(tmp_path)
    stamps = [row.split(",")[1] for row in (folder / "frames.csv").read_text().split()[1:]]
    rows = [f"{float(t_s) + off_s * (k > 0)!r},left,0.01,0.02,0.0001" for k, t_s in enumerate(stamps)]
    (folder / "frame_angles.csv").write_text("\n".join(["t_s,station,pan_rad,tilt_rad,sigma_rad", *rows]) + "\n")
    with FolderSource(load_session(folder)) as source:
        assert len(list(source)) > 3
        notes = [note for note in source.notes(0.25) if note.startswith("frame_angles.csv")]
    expected = (
        f"frame_angles.csv: 2 of 3 rows are of no frame and are not used, the first of left at "
        f"{float(stamps[1]) + off_s:.13g} s: frames.csv has no such time"
    )
    assert notes == ([] if off_s == 0.0 else [expected])
