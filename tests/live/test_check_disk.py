"""The disk before the flight: room for the longest search, and a folder that can be written to."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

from groundstation.live.check_disk import check_disk, searching_bytes_per_s
from groundstation.rig.rig import load_rig
from groundstation.simulation.simulated_station_file import simulated_station_file


class Usage(NamedTuple):
    """What a disk has."""

    total: int
    used: int
    free: int


def test_free_space_is_compared_with_the_rate_of_a_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: two raw cameras of 1280 × 960 at 30 Hz are 73.7 MB/s, half an hour of that 133 GB; 20 GB are 4 min."""
    file = simulated_station_file(tmp_path, 30.0, None)
    rig = load_rig(file.rig)
    assert searching_bytes_per_s(file, rig, {}) == pytest.approx(73.7e6, rel=1e-3)
    assert searching_bytes_per_s(file, rig, {"left": False}) == pytest.approx(2 * 73.7e6, rel=1e-3)
    free = [20 * 10**9]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(0, 0, free[0]))
    line = check_disk(file, rig, {})
    assert not line.good
    assert "20 GB free" in line.text
    assert "4 min of searching at 74 MB/s; wanted 30 ([record] minutes)" in line.text
    assert check_disk(replace(file, record_s=200.0), rig, {}).good
    free[0] = 140 * 10**9
    assert check_disk(file, rig, {}).good
    # what is kept free is not there to be recorded to
    assert not check_disk(replace(file, record_s=140e9 / 73.7e6), rig, {}).good


def test_a_record_folder_that_is_a_file_is_wrong(tmp_path: Path) -> None:
    file = simulated_station_file(tmp_path, 30.0, None)
    rig = load_rig(file.rig)
    for folder in (tmp_path / "rig.toml", tmp_path / "rig.toml" / "flights"):
        line = check_disk(replace(file, record=folder), rig, {})
        assert not line.good
        assert "rig.toml, a file; wanted a folder" in line.text
    assert check_disk(replace(file, record=None), rig, {}).good
