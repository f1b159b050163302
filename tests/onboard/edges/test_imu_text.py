"""A table of inertial samples that is no text."""

from pathlib import Path

import pytest

from groundstation.onboard.edges.imu_file import ImuFileError, _read


def test_bytes_that_are_no_text_and_an_empty_file_are_named(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_bytes(b"t_s,x\n0,\xff\xfe\n")
    with pytest.raises(ImuFileError, match="got bytes that are no text in UTF-8; wanted a CSV table"):
        _read(path)
    path.write_bytes(b"")
    with pytest.raises(ImuFileError, match="got an empty file; wanted a CSV table"):
        _read(path)
    path.write_text("t_s, x\n0,1\n\n2,3\n")
    assert _read(path) == (["t_s", "x"], [(2, ["0", "1"]), (4, ["2", "3"])])
