"""masks.npz: equal masks are equal files, read by numpy."""

import time
from pathlib import Path

import numpy as np
import pytest

from groundstation.simulation.silhouette_archive import write_silhouettes


def test_equal_masks_are_equal_files_at_any_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    masks = {"left_0000": np.eye(40, dtype=np.uint8), "left_0000_xy": np.array([3, 4]), "empty": np.zeros((0, 0))}
    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    write_silhouettes(first, masks)
    later = time.struct_time((2031, 5, 6, 7, 8, 9, 1, 126, 0))
    monkeypatch.setattr(time, "localtime", lambda *_: later)
    write_silhouettes(second, masks)
    assert first.read_bytes() == second.read_bytes()
    with np.load(first) as found:
        assert list(found) == list(masks)
        for name, values in masks.items():
            np.testing.assert_array_equal(found[name], values)
            assert found[name].dtype == values.dtype
    assert first.stat().st_size < 1200
