"""Every file of a session, damaged: read, or refused in one line; benchmarks/log_fuzz.py does a million."""

import random
from pathlib import Path

import pytest

from groundstation.errors import InputError
from tests.session.damage import SLOW, Parts, session_targets
from tests.session.logs.damage import altered, damaged


def test_only_project_errors_are_raised(tmp_path: Path) -> None:
    targets, chance = session_targets(tmp_path), random.Random(8)
    parts = Parts(tmp_path / "flight.mcap")
    refused: list[str] = []
    for name, read in targets.items():
        path = tmp_path / name
        whole = path.read_bytes()
        read()
        for k in range(5 if name in SLOW else 40):
            if name == "flight.mcap":
                parts.write(path, chance)
            else:
                spoil = altered if k % 2 and path.suffix in (".csv", ".toml", ".json") else damaged
                path.write_bytes(spoil(whole, chance))
            try:
                read()
            except InputError as fault:
                refused.append(str(fault))
        path.write_bytes(whole)
    assert len(refused) > 200
    assert all(line.isprintable() for line in refused)


def test_what_cannot_be_printed_is_shown_as_an_escape(tmp_path: Path) -> None:
    targets = session_targets(tmp_path)
    path = tmp_path / "angles.csv"
    lines = path.read_bytes().split(b"\n", 1)
    path.write_bytes(lines[0].replace(b"utc", b"u\xcac") + b"\n" + lines[1])
    with pytest.raises(InputError, match=r"angles\.csv: line 1: got u\\udccac, left_pan_deg") as fault:
        targets["angles.csv"]()
    assert str(fault.value).isprintable()
    assert str(InputError("a\nfile.csv", got="\x00", wanted="text")) == r"a\nfile.csv: got \x00; wanted text"


def test_an_archive_of_silhouettes_that_is_none_is_named(tmp_path: Path) -> None:
    targets = session_targets(tmp_path)
    targets["masks.npz"]()
    (tmp_path / "masks.npz").write_bytes(b"PK no archive")
    with pytest.raises(InputError, match=r"masks\.npz: got .*; wanted silhouettes"):
        targets["masks.npz"]()
