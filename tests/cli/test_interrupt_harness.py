"""`benchmarks/interrupts.py` counts as wrong what an interrupted command must not print."""

from pathlib import Path

import pytest

from benchmarks.interrupts import Command, Ended, faults_of

LIVE = Command(name="live", words=lambda out: [], ends=frozenset({0, 1}))
LAST = "groundstation: interrupted; nothing was written to out\n"


@pytest.mark.parametrize(
    ("code", "err", "faults"),
    [
        (130, LAST, []),
        (
            130,
            f"/usr/lib/x.py:224: UserWarning: resource_tracker: 2 leaked shared_memory objects\n{LAST}",
            ["a warning"],
        ),
        (1, "groundstation: did not end within 3 s and is ended by force\n", ["ended by force"]),
        (1, "groundstation: no track: 0.5 pairs per s are too few\n", []),
        (2, "", ["exit code 2"]),
    ],
)
def test_what_is_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, err: str, faults: list[str]) -> None:
    # where the folder that the line names is not there
    monkeypatch.chdir(tmp_path)
    ended = Ended(code=code, out="", err=err, late_s=0.1)
    assert list(faults_of(LIVE, ended, tmp_path)) == faults
