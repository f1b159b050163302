"""The results say where they come from, and their hashes change with any of the inputs."""

import hashlib
import json
import subprocess
import time
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from groundstation import __version__
from groundstation.cli.main import main
from groundstation.replay import provenance
from tests.session.folder import Tiny

pytestmark = pytest.mark.usefixtures("unrendered_figures")


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return Tiny(rows=4).write(tmp_path / "session")


def replayed(session: Path, out: Path, *options: str) -> dict:
    assert main(["replay", str(session), "--out", str(out), "--no-rerun", *options]) == 0
    return json.loads((out / "summary.json").read_text())["provenance"]


def test_summary_and_report_say_where_they_come_from(session: Path, tmp_path: Path) -> None:
    found = replayed(session, tmp_path / "out")
    age = datetime.now(UTC) - datetime.fromisoformat(found["date"])
    assert timedelta(0) <= age < timedelta(minutes=10)
    assert found["version"] == __version__
    assert found["command"] == f"groundstation replay {session} --out {tmp_path / 'out'} --no-rerun"
    assert found["session"]["path"] == str(session)
    assert found["rig"]["path"] == str(session / "rig.toml")
    assert found["configuration"]["path"] is None
    assert found["machine"]["cores"] >= 1
    for part in ("session", "rig", "configuration"):
        assert len(found[part]["sha256"]) == 64
    page = (tmp_path / "out" / "report.html").read_text()
    assert found["session"]["sha256"] in page
    assert found["command"] in page


def test_hashes_follow_the_inputs(session: Path, tmp_path: Path) -> None:
    first = replayed(session, tmp_path / "one")
    again = replayed(session, tmp_path / "two")
    assert [again[k] for k in ("session", "rig", "configuration")] == [
        first[k] for k in ("session", "rig", "configuration")
    ]
    tuning = tmp_path / "tuning.toml"
    tuning.write_text("[estimation]\nlate_horizon_s = 0.4\n")
    tuned = replayed(session, tmp_path / "three", "--config", str(tuning))
    assert tuned["configuration"]["sha256"] != first["configuration"]["sha256"]
    assert tuned["configuration"]["path"] == str(tuning)
    assert tuned["session"] == first["session"]
    (session / "session.toml").write_text((session / "session.toml").read_text() + "\n# a note\n")
    changed = replayed(session, tmp_path / "four")
    assert changed["session"]["sha256"] != first["session"]["sha256"]
    assert changed["rig"] == first["rig"]


def test_the_hash_is_of_names_sizes_and_contents(tmp_path: Path) -> None:
    a, b = tmp_path / "a", tmp_path / "b"
    a.write_bytes(b"one")
    b.write_bytes(b"two")
    assert provenance.hash_of([a, b]) == hashlib.sha256(b"a\x003\x00oneb\x003\x00two").hexdigest()
    assert provenance.hash_of([a, tmp_path / "none"]) is None


def test_a_hash_is_remembered_until_a_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: read once while nothing changes; again after a change that keeps the size, and while it is fresh."""
    read: list[int] = []
    parts = provenance._parts

    def counted(size: int) -> Iterable[tuple[int, int]]:
        read.append(size)
        return parts(size)

    monkeypatch.setattr(provenance, "_parts", counted)
    file = tmp_path / "a"
    file.write_bytes(b"one")
    assert len({provenance.hash_of([file]) for _ in range(2)}) == 1
    # a file that was written this moment may be written again within the same tick of its time
    assert len(read) == 2
    monkeypatch.setattr(provenance, "_SETTLED_NS", 0)
    first = [provenance.hash_of([file]) for _ in range(3)]
    assert len(read) == 3
    time.sleep(0.02)
    file.write_bytes(b"two")
    assert provenance.hash_of([file]) not in first
    assert len(read) == 4


def test_a_file_that_could_not_be_read_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: as after an error of a disk or of a network, which leaves a file's state as it is."""
    monkeypatch.setattr(provenance, "_SETTLED_NS", 0)
    file = tmp_path / "a"
    file.write_bytes(b"one")
    time.sleep(0.02)
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "_parts", _unreadable)
        assert provenance.hash_of([file]) is None
    assert provenance.hash_of([file]) == hashlib.sha256(b"a\x003\x00one").hexdigest()


def _unreadable(_: int) -> Iterable[tuple[int, int]]:
    raise OSError("made up")


def test_a_large_file_is_hashed_in_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: its first and last bytes and its size count, and most of it is not read."""
    monkeypatch.setattr(provenance, "_WHOLE_BYTES", 1000)
    monkeypatch.setattr(provenance, "_BLOCKS", 4)
    monkeypatch.setattr(provenance, "_BLOCK_BYTES", 10)
    file = tmp_path / "video"
    content = bytearray(5000)
    hashes = []
    for place in (None, 0, 4999, 500):
        changed = bytearray(content)
        if place is not None:
            changed[place] = 1
        file.write_bytes(changed)
        hashes.append(provenance.hash_of([file]))
    assert hashes[3] == hashes[0]
    assert len({*hashes[:3]}) == 3
    file.write_bytes(content + b"\0")
    assert provenance.hash_of([file]) not in hashes


def test_the_commit_is_that_of_the_checkout(tmp_path: Path) -> None:
    assert provenance.commit_of(tmp_path) is None
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for command in (["init", "-q"], [*who, "commit", "-q", "--allow-empty", "-m", "first"]):
        subprocess.run(["git", "-C", str(tmp_path), *command], check=True)
    clean = provenance.commit_of(tmp_path)
    assert clean is not None
    assert len(clean) == 12
    (tmp_path / "file").write_text("a")
    subprocess.run(["git", "-C", str(tmp_path), "add", "file"], check=True)
    assert provenance.commit_of(tmp_path) == f"{clean}-dirty"
