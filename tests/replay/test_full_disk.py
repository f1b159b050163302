"""A full disk, and Ctrl-C: results come first and whole, the Rerun recording is given up with its reason.

A limit on the size of files stands for the disk: session.rrd, which holds the videos, is the first to meet it.
"""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.replay.replay import ReplayRequest, replay
from tests.files.limits import files_of_at_most

LANDING = Path(__file__).resolve().parents[2] / "recordings" / "landing-1"
TABLES = ("track.csv", "triangulation.csv", "detections.csv", "track.tum")


def _request(out: Path, tuning: Path) -> ReplayRequest:
    return ReplayRequest(session=LANDING, out=out, config=tuning, to_s=0.75, report=False)


def _names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def _whole_lines(path: Path) -> bool:
    text = path.read_bytes()
    return not text or text.endswith(b"\n")


@pytest.mark.usefixtures("unrendered_figures")
def test_results_are_whole_where_the_recording_has_no_room(
    classic_tuning: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["replay", str(LANDING), "--out", str(out), "--config", str(classic_tuning), "--to", "0.75"]
    with files_of_at_most(1_000_000):
        code = main(words)
    printed = capsys.readouterr()
    assert code == 1
    assert f"groundstation: {out / 'session.rrd'} was given up: File too large; the results are whole" in printed.err
    said = {Path(line.removeprefix("wrote ")) for line in printed.out.splitlines() if line.startswith("wrote ")}
    assert said == set(out.iterdir())
    assert out / "session.rrd" not in said
    assert json.loads((out / "summary.json").read_text())["session"]["name"]
    assert (out / "report.html").read_text().endswith("</html>\n")


def test_a_table_that_has_no_room_ends_with_a_whole_line(classic_tuning: Path, tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"csv|tum") as fault, files_of_at_most(120):
        replay(_request(tmp_path, classic_tuning))
    assert str(tmp_path) in str(fault.value)
    assert sorted(_names(tmp_path)) == sorted(TABLES)
    assert all(_whole_lines(tmp_path / name) for name in TABLES)


def test_a_result_takes_the_room_of_the_recording(
    classic_tuning: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The summary finds the disk full until the recording's draft is gone."""
    import groundstation.replay.replay_outputs as outputs

    write, drafts = outputs.write_summary, []

    def full(path: Path, evaluation: object) -> None:
        drafts.append([name for name in _names(tmp_path) if name.endswith("session.rrd")])
        if drafts[-1]:
            raise InputError(str(path), got="a full disk", wanted="room") from OSError(28, "No space left on device")
        write(path, evaluation)  # type: ignore[arg-type]

    monkeypatch.setattr(outputs, "write_summary", full)
    result = replay(_request(tmp_path, classic_tuning))
    assert [len(found) for found in drafts] == [1, 0]
    assert result.given_up == {tmp_path / "session.rrd": "no room left after the results"}
    assert not any(name.endswith("session.rrd") for name in _names(tmp_path))
    assert tmp_path / "summary.json" in result.files


@pytest.mark.usefixtures("unrendered_figures")
@pytest.mark.parametrize("measurements_with_room", [0, 3])
def test_a_recording_without_room_ends_and_the_replay_does_not(
    landing_from_20_s: Path,
    classic_tuning: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    measurements_with_room: int,
) -> None:
    """Expected: the disk of --record is full from the start or from some moment on; all pairs are tracked."""
    free = itertools.chain(itertools.repeat(10**12, measurements_with_room), itertools.repeat(0))
    monkeypatch.setattr("groundstation.recording.recorder._free_bytes", lambda _: next(free))
    # at each write, however fast the machine is
    monkeypatch.setattr("groundstation.recording.writer_thread._MEASURE_S", 0.0)
    out, recorded = tmp_path / "out", tmp_path / "flight.mcap"
    words = ["replay", str(landing_from_20_s), "--out", str(out), "--from", "20", "--to", "21.5", "--no-rerun"]
    assert main([*words, "--config", str(classic_tuning), "--record", str(recorded)]) == 1
    printed = capsys.readouterr()
    assert f"groundstation: {recorded} was given up: disk full, 0 MB free; the results are whole" in printed.err
    assert not recorded.exists()
    assert f"wrote {recorded}" not in printed.out
    assert len((out / "track.csv").read_text().splitlines()) == 1 + 15


def test_a_replay_without_a_recording_removes_that_of_an_earlier_run(classic_tuning: Path, tmp_path: Path) -> None:
    """Expected: `view` of the folder shows this run's tables, not the earlier run; other files stay."""
    (tmp_path / "session.rrd").write_bytes(b"of an earlier run")
    (tmp_path / "notes.txt").write_text("mine")
    result = replay(replace(_request(tmp_path, classic_tuning), rerun=False))
    assert result.fault is None
    assert "session.rrd" not in _names(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_recording_that_cannot_be_removed_is_named(classic_tuning: Path, tmp_path: Path) -> None:
    (tmp_path / "session.rrd" / "mine").mkdir(parents=True)
    with pytest.raises(InputError, match=r"session\.rrd: got Is a directory; wanted a folder that can be written"):
        replay(replace(_request(tmp_path, classic_tuning), rerun=False))


def test_an_interrupt_leaves_whole_lines_and_no_draft(classic_tuning: Path, tmp_path: Path) -> None:
    (tmp_path / "session.rrd").write_bytes(b"of an earlier run")

    def interrupted(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay(_request(tmp_path, classic_tuning), interrupted)
    assert sorted(_names(tmp_path)) == sorted(TABLES)
    assert all(_whole_lines(tmp_path / name) and (tmp_path / name).stat().st_size for name in TABLES[:3])


def test_an_interrupt_right_after_the_recordings_draft_leaves_none(
    classic_tuning: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: before anything has been told of the draft that was just made."""
    import groundstation.viewer.session_view as opening

    made, found = opening.session_view, []

    def interrupted(*arguments: object) -> None:
        made(*arguments)  # type: ignore[arg-type]
        found.extend(_names(tmp_path))
        raise KeyboardInterrupt

    monkeypatch.setattr(opening, "session_view", interrupted)
    with pytest.raises(KeyboardInterrupt):
        replay(_request(tmp_path, classic_tuning))
    assert any(".part.session.rrd" in name for name in found)
    assert not any("session.rrd" in name for name in _names(tmp_path))
