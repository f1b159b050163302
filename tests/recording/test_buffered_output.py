"""The recorder's file: which data are synced to the disk, and when."""

import os
from pathlib import Path

import pytest

from groundstation.recording.buffered_output import BufferedOutput


def test_the_disk_gets_one_request_for_the_written_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fdatasync", lambda number: synced.append(os.fstat(number).st_size))
    with (tmp_path / "part").open("wb", buffering=0) as raw:
        output = BufferedOutput(raw)
        output.sync()
        assert synced == []
        output.write(b"abc")
        output.sync()
        assert synced == []
        output.commit()
        output.sync()
        output.sync()
        assert synced == [3]
        output.write(b"de")
        output.commit()
        output.sync()
        assert synced == [3, 5]
