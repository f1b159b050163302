"""The command line as a user meets it: output, exit codes, and what lies in the folder afterwards."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from groundstation import __version__
from groundstation.cli.main import main
from tests.session.folder import Tiny, edit_line, replace_in, write_video

TABLES = ("track.csv", "triangulation.csv", "detections.csv", "track.tum", "summary.json", "report.html")
DGPS = "t_s,x_m,y_m,z_m\n1.0,0,300,20\n1.1,0,299,20\n1.2,0,nan,20\n1.3,0,297,20\n"


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return Tiny(rows=12).write(tmp_path / "session")


def run(session: Path, *options: str, code: int = 0) -> Path:
    out = session.parent / "out"
    assert main(["replay", str(session), "--out", str(out), "--no-rerun", *options]) == code
    return out


def rows(out: Path, name: str = "track.csv") -> int:
    return len((out / name).read_text().splitlines()) - 1


# -------------------------------------------------------------------------------------------------- usage
def test_help_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, words in (
        (["--help"], ("replay", "config", "recorded stereo session in")),
        (["replay", "--help"], ("SESSION", "--out DIR", "--from S", "--no-rerun", "exit code", "example")),
        (["config", "--help"], ("--config FILE", "TOML")),
        (["plan", "--help"], ("SITE", "--out DIR", "exit code", "example")),
        (["calibrate", "intrinsics", "--help"], ("IMAGES", "--board SPEC", "--report DIR", "exit code", "example")),
        (["--version"], (__version__,)),
    ):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 0
        reported = capsys.readouterr().out
        assert all(word in reported for word in words), reported
        assert all(len(line) <= 80 for line in reported.splitlines())


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["fly"], "invalid choice: 'fly'"),
        (["replay"], "the following arguments are required: SESSION, --out"),
        (["replay", "a"], "the following arguments are required: --out"),
        (["replay", "a", "--out", "b", "--from", "soon"], "argument --from: got 'soon'; wanted a session time"),
        (["replay", "a", "--out", "b", "--fast"], "unrecognized arguments: --fast"),
        (["replay", "a", "--out", "b", "--view", "--no-rerun"], "not allowed with argument"),
    ],
)
def test_wrong_usage(arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    shown = capsys.readouterr()
    assert complaint in shown.err
    assert "usage: groundstation" in shown.err
    assert not shown.out


def test_no_command_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "COMMAND" in capsys.readouterr().err


def test_it_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "groundstation", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (done.stdout.strip(), done.stderr) == (f"groundstation {__version__}", "")


def test_config_prints_a_file_to_start_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tuning.toml").write_text("[detection]\nroi_sigmas = 4.5\n")
    assert main(["config", "--config", str(tmp_path / "tuning.toml")]) == 0
    table = tomllib.loads(capsys.readouterr().out)
    assert table["detection"]["roi_sigmas"] == 4.5
    assert table["start"] == "auto"


# ------------------------------------------------------------------------------------------------- replay
def test_a_replay_writes_everything_and_prints_where(session: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = session.parent / "new" / "out"
    assert main(["replay", str(session), "--out", str(out)]) == 0
    assert {p.name for p in out.iterdir()} == {*TABLES, "session.rrd", "figures"}
    pictures = list((out / "figures").iterdir())
    assert pictures
    assert all(picture.stat().st_size > 1000 for picture in pictures)
    assert rows(out) == rows(out, "triangulation.csv") == 12
    shown = capfd.readouterr()
    assert shown.out.splitlines()[0] == "tiny: 12 epochs, 1.1 s, stations left, right"
    assert [line for line in shown.out.splitlines() if line.startswith("wrote")] == [
        f"wrote {out / name}" for name in (*TABLES[:4], "session.rrd", *TABLES[4:], "figures")
    ]
    assert shown.err.startswith("replay: 12 of 12 pairs in ")
    assert len(shown.err.splitlines()) == 1


@pytest.mark.usefixtures("unrendered_figures")
def test_a_part_of_it(session: Path) -> None:
    assert rows(run(session, "--from", "1.25", "--to", "1.55")) == 3


def stopped(session: Path, capfd: pytest.CaptureFixture[str], message: str, at_row: int) -> None:
    out = run(session, code=1)
    lines = capfd.readouterr().err.splitlines()
    ours = [line for line in lines if line and not line.startswith("replay: ")]
    assert len(ours) == 1, ours
    assert ours[0].startswith(f"groundstation: fault in the recording: {message}")
    assert {p.name for p in out.iterdir()} == {*TABLES, "figures"}
    assert rows(out) == at_row
    assert message in (out / "report.html").read_text()


@pytest.mark.usefixtures("unrendered_figures")
@pytest.mark.parametrize(
    ("name", "line", "text", "at_row"),
    [("frames.csv", 8, "6,nan,1.6", 6), ("ptu.csv", 18, "1.45,0,0,0,0", 5), ("ptu.csv", 18, "soon,0,0,0,0", 5)],
)
def test_what_was_usable_is_written(
    session: Path, capfd: pytest.CaptureFixture[str], name: str, line: int, text: str, at_row: int
) -> None:
    edit_line(session / name, line, text)
    stopped(session, capfd, f"{name}: line {line}: got ", at_row)


@pytest.mark.usefixtures("unrendered_figures")
def test_a_video_cut_short_is_used_up_to_its_end(session: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_video(session / "right.avi", range(7))
    stopped(session, capfd, "right.avi: frame 7: got the end of the video after 7 frames", 7)


def test_a_video_that_is_none_and_decoders_that_keep_quiet(session: Path) -> None:
    """Expected: in a program of its own, FFmpeg and OpenCV add nothing to our one line."""
    (session / "left.avi").write_bytes(b"RIFF nothing")
    out = session.parent / "out"
    command = [sys.executable, "-m", "groundstation", "replay", str(session), "--out", str(out), "--no-rerun"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    line = "groundstation: left.avi: got no video that OpenCV can open; wanted a complete video file\n"
    assert (done.returncode, done.stderr, done.stdout) == (1, line, "")
    assert not out.exists()


@pytest.mark.usefixtures("unrendered_figures")
@pytest.mark.parametrize("name", ["dgps.csv", "truth.csv"])
def test_a_broken_reference_does_not_stop_the_track(
    session: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    (session / name).write_text(DGPS)
    out = run(session)
    assert rows(out) == 12
    reported = " ".join(capfd.readouterr().out.split())
    assert f"note: {name}: line 4: got y_m = 'nan'; wanted a finite number; rows of" in reported
    assert "before that: 2" in reported


def refused(capsys: pytest.CaptureFixture[str], arguments: list[str], message: str, code: int = 1) -> None:
    """Nothing could be done: one line, exit code 1 (2 for wrong usage), no folder made."""
    assert main(["replay", *arguments]) == code
    shown = capsys.readouterr()
    assert not shown.out
    assert shown.err.count("\n") == 1
    assert shown.err.startswith("groundstation: ")
    assert message in shown.err


def test_what_cannot_be_replayed_at_all(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = session.parent / "out"
    start = [str(session), "--out", str(out)]
    refused(capsys, [str(session / "nowhere"), "--out", str(out)], "nowhere: got no such folder")
    refused(capsys, [*start, "--from", "3", "--to", "2"], "got --from 3 and --to 2; wanted an end after the", 2)
    refused(capsys, [*start, "--from", "99"], "got times from 1 to 2.1 s; wanted some from 99 s on")
    refused(capsys, [*start, "--rig", str(session / "other.toml")], "other.toml: got no such file")
    refused(capsys, [*start, "--config", str(session / "c.toml")], "c.toml: got no such file; wanted a TOML file")
    (session / "c.toml").write_text("[detection]\nroi = 1\n")
    refused(capsys, [*start, "--config", str(session / "c.toml")], "c.toml: detection: roi: got an unknown key")
    (session / "c.toml").write_text('start = "initial"\n')
    refused(capsys, [*start, "--config", str(session / "c.toml")], "session.toml: got no [initial]; wanted one")
    (session / "c.toml").write_text('start = "dgps"\n')
    refused(capsys, [*start, "--config", str(session / "c.toml")], "dgps.csv: got 0 fixes in the first second")
    assert not out.exists()


def test_a_rig_that_is_not_calibrated(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    replace_in(session / "rig.toml", "fixed = false", 'fixed = false\nknown = ["position", "lens"]')
    message = "station left: got known = ['position', 'lens']; wanted a calibrated orientation"
    refused(capsys, [str(session), "--out", str(session.parent / "out")], message)


def test_one_station_is_not_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = Tiny(rows=2, names=("left",)).write(tmp_path / "session")
    refused(capsys, [str(folder), "--out", str(tmp_path / "out")], "rig.toml: got one station; wanted two or more")


def test_the_recording_itself_is_never_written_over(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(session.iterdir())
    (session.parent / "link").symlink_to(session)
    for out in (session, session / ".." / session.name, session.parent / "link"):
        refused(capsys, [str(session), "--out", str(out)], "got a folder that is read; wanted another --out")
    assert sorted(session.iterdir()) == before


def test_an_output_folder_that_cannot_be_made(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (session.parent / "file").write_text("")
    for out in (session.parent / "file", session.parent / "file" / "deeper"):
        refused(capsys, [str(session), "--out", str(out)], "wanted a folder that can be written")


def test_a_disk_that_fails_is_one_line(
    session: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "track.csv")

    monkeypatch.setattr("groundstation.replay.replay.run_pipeline", full)
    refused(capsys, [str(session), "--out", str(session.parent / "out")], "track.csv: No space left on device")


def test_an_interrupt_is_no_crash(
    session: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("groundstation.replay.replay.run_pipeline", interrupted)
    assert main(["replay", str(session), "--out", str(session.parent / "out"), "--no-rerun"]) == 130
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "words"), [(False, "interrupted; nothing was written to"), (True, "out holds what was done until then")]
)
def test_an_interrupt_says_truly_what_is_there(
    session: Path, written: bool, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = session.parent / "out"
    out.mkdir()
    old = out / "track.csv"
    old.write_text("of an earlier run")
    os.utime(old, (1.0, 1.0))

    def interrupted(*_: object) -> None:
        if written:
            (out / "triangulation.csv").write_text("t_s")
        raise KeyboardInterrupt

    monkeypatch.setattr("groundstation.replay.replay.replay", interrupted)
    assert main(["replay", str(session), "--out", str(out), "--no-rerun"]) == 130
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["replya", "x"], "replay"),
        (["replay", "x", "--out", "y", "--no-rerum"], "--no-rerun"),
        (["calibrate", "filght", "x"], "flight"),
        (["view", "x", "--align", "strat"], "start"),
        (["live", "--simulat", "--oout", "x"], "--out"),
    ],
)
def test_a_misspelt_word_gets_a_suggestion(
    arguments: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    assert f"did you mean {meant}?" in capsys.readouterr().err


def test_a_word_unlike_any_gets_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["replay", "x", "--out", "y", "--qqqq"])
    assert "did you mean" not in capsys.readouterr().err
