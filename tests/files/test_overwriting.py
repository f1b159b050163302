"""An output never replaces an input: by any name, of any command, and reported before anything is done."""

import argparse
import os
import shutil
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest

from groundstation.cli.main import build_parser, main
from groundstation.cli.path_arguments import PATH_TYPES, WrittenFile, WrittenFolder, check_paths
from groundstation.errors import InputError
from groundstation.files.overwriting import Output, refuse_overwriting
from groundstation.replay.compare import CompareRequest, compare
from groundstation.replay.result_files import REPLAY_FILES
from tests.session.folder import Tiny

# arguments of text that name no file on this machine's disk
TEXT = {
    "--format", "--free", "--board", "--station", "--name", "--runway", "--start", "--left-start", "--right-start",
    "--ptu-start", "--epoch", "--trigger", "--ptu-fault", "--fault", "--only", "--banner", "url",
    "--autopilot", "--udp", "--stations", "name", "--receive",
}  # fmt: skip


def every_argument(parser: argparse.ArgumentParser, command: str = "") -> Iterator[tuple[str, argparse.Action]]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from every_argument(below, f"{command} {name}".strip())
        else:
            yield command, action


ARGUMENTS = list(every_argument(build_parser()))


def test_every_path_argument_is_declared_as_read_or_written() -> None:
    """Expected: none is a bare path, and none is a bare text but those that name no file."""
    assert len(ARGUMENTS) > 150
    for command, action in ARGUMENTS:
        name = action.option_strings[0] if action.option_strings else action.dest
        if action.nargs == 0 or isinstance(action.type, PATH_TYPES):
            continue
        assert action.type is not Path, f"{command} {name}"
        assert action.type is not None or action.choices is not None or name in TEXT, f"{command} {name}"


def test_what_is_called_out_is_written() -> None:
    for command, action in ARGUMENTS:
        if action.option_strings and action.option_strings[0] in ("--out", "--save", "--csv", "--json", "--report"):
            assert isinstance(action.type, WrittenFile | WrittenFolder), command


def given(action: argparse.Action, value: str) -> list[str]:
    return [action.option_strings[0], value] if action.option_strings else [value]


def command_lines() -> Iterator[tuple[str, argparse.Action, argparse.Action]]:
    """Every pair of a path to read and one to write that a command takes."""
    by_command: dict[str, list[argparse.Action]] = {}
    for command, action in ARGUMENTS:
        if isinstance(action.type, PATH_TYPES):
            by_command.setdefault(command, []).append(action)
    for command, actions in by_command.items():
        written = [a for a in actions if isinstance(a.type, WrittenFile | WrittenFolder)]
        for read in (a for a in actions if a not in written):
            yield from ((command, read, output) for output in written)


@pytest.mark.parametrize(
    ("command", "read", "written"),
    [pytest.param(c, r, w, id=f"{c}: {r.dest} and {w.dest}") for c, r, w in command_lines()],
)
def test_no_command_takes_one_file_to_read_and_to_write(
    command: str, read: argparse.Action, written: argparse.Action, tmp_path: Path
) -> None:
    """Expected: refused, also through a symbolic link, a hard link, and where the file lies in the folder written."""
    options = argparse.Namespace()
    here = build_parser()
    spot: argparse.Namespace = options
    parser = here
    for word in command.split():
        below = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
        setattr(spot, below.dest, word)
        parser = below.choices[word]
    folder = isinstance(written.type, WrittenFolder)
    names = written.type.names if isinstance(written.type, WrittenFolder) else ()
    if folder and not names:
        # the folders that it makes are known later: see below
        return
    name = names[0].replace("*", "x") if names else "x"
    file = tmp_path / name
    file.write_bytes(b"kept")
    soft, hard = tmp_path / "soft", tmp_path / "hard"
    soft.symlink_to(file)
    os.link(file, hard)
    several = read.nargs == "+" or isinstance(read, argparse._AppendAction)
    for path in (file, tmp_path / "." / name, soft, hard):
        setattr(options, read.dest, [str(path)] if several else path)
        setattr(options, written.dest, tmp_path if folder else file)
        with pytest.raises(InputError, match="a file that is read"):
            check_paths(here, options)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main([str(a) for a in arguments]) == 1
    reported = [line for line in capsys.readouterr().err.splitlines() if line.startswith("groundstation: ")]
    assert len(reported) == 1
    return reported[0]


def test_a_session_is_not_replayed_onto_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: neither its folder nor its tables are written to, be it by replay, evaluate or view."""
    sessions = tmp_path / "sessions"
    session = Tiny(rows=3, video="png").write(sessions / "one")
    before = {p.name: p.read_bytes() for p in session.iterdir() if p.is_file()}
    assert "a folder that is read; wanted another --out" in refused(capsys, "replay", session, "--out", session)
    link = tmp_path / "link"
    link.symlink_to(session)
    assert "a folder that is read" in refused(capsys, "replay", session, "--out", link)
    # evaluate and view name folders after their runs
    assert "a folder that is read" in refused(capsys, "evaluate", session, "--out", sessions)
    assert "a folder that is read" in refused(capsys, "view", session, "--out", sessions, "--save", tmp_path / "x.rrd")
    for name in ("frames.csv", "rig.toml", "ptu.csv"):
        reported = refused(capsys, "replay", session, "--out", tmp_path / "out", "--record", session / name)
        assert "a file that is read; wanted another --record" in reported
    picture = session / "left" / "000000.png"
    assert "a file that is read" in refused(capsys, "calibrate", "flight", session, "--out", picture)
    assert {p.name: p.read_bytes() for p in session.iterdir() if p.is_file()} == before
    assert not (tmp_path / "out").exists()


def test_the_two_of_the_issue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: `evaluate --json` onto its input and `calibrate … --rig X --out X` leave X as it was."""
    results = tmp_path / "results"
    results.mkdir()
    summary = Path(__file__).parents[1] / "session" / "data" / "summary.json"
    shutil.copy(summary, results / "summary.json")
    (results / "track.csv").write_text("")
    assert "a file that is read; wanted another --json" in refused(
        capsys, "evaluate", results, "--json", results / "summary.json"
    )
    assert (results / "summary.json").read_bytes() == summary.read_bytes()
    session = Tiny(rows=3, video="").write(tmp_path / "session")
    rig = tmp_path / "rig.toml"
    shutil.copy(session / "rig.toml", rig)
    sightings, marks = tmp_path / "sightings.csv", tmp_path / "landmarks.csv"
    for path in (sightings, marks):
        path.write_text("")
    tables = (sightings, "--landmarks", marks)
    for kind in (
        ("flight", session),
        ("timing", session),
        ("mount", *tables),
        ("survey", *tables),
        ("check", *tables),
        ("intrinsics", session, "--board", "chessboard:7x5:0.04", "--station", "left"),
    ):
        before = rig.read_bytes()
        reported = refused(capsys, "calibrate", *kind, "--rig", rig, "--out", rig)
        assert "rig.toml: got a file that is read; wanted another --out" in reported
        assert rig.read_bytes() == before


def test_what_is_kept_beside_a_rig_replaces_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    marks = tmp_path / "new.sightings.csv"
    marks.write_text("kept")
    (tmp_path / "seen.csv").write_text("")
    (tmp_path / "rig.toml").write_text("")
    reported = refused(
        capsys,
        *("calibrate", "survey", tmp_path / "seen.csv", "--landmarks", marks),
        *("--rig", tmp_path / "rig.toml", "--out", tmp_path / "new.toml"),
    )
    assert "new.sightings.csv: got a file that is read" in reported
    assert marks.read_text() == "kept"


def test_what_is_new_or_elsewhere_is_written(tmp_path: Path) -> None:
    """Expected: a new rig in the session's folder, results below it, again, and next to what is read."""
    session = Tiny(rows=3, video="png").write(tmp_path / "session")
    read = [session, tmp_path / "station.toml"]
    (tmp_path / "station.toml").write_text("")
    refuse_overwriting(read, [Output(path=session / "better.toml")])
    out = session / "out"
    out.mkdir()
    (out / "track.csv").write_text("")
    refuse_overwriting(read, [Output(path=out, names=REPLAY_FILES)])
    refuse_overwriting(read, [Output(path=tmp_path, names=REPLAY_FILES)])
    refuse_overwriting([None], [Output(path=Path("/dev/null")), Output(path=Path("/dev/null"), option="--csv")])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("replay", "LOOP", "--out", "out"), "LOOP: got a link that leads to itself"),
        (("replay", "session", "--out", "LOOP"), "LOOP: got a link that leads to itself"),
        (("replay", "session", "--out", "LOOP/out"), "LOOP/out: got a link that leads to itself"),
        (("track", "LOOP", "--out", "track.csv"), "LOOP: got a link that leads to itself"),
        (("evaluate", "LOOP", "--out", "out"), "LOOP: got a link that leads to itself"),
        (("config", "--config", "LOOP"), "LOOP: got a link that leads to itself; wanted a file or a folder"),
    ],
)
def test_a_link_that_leads_to_itself_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Tiny(rows=3, video="png").write(tmp_path / "session")
    (tmp_path / "station.toml").write_text("")
    (tmp_path / "LOOP").symlink_to("LOOP")
    assert main(list(words)) == 1
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert error.startswith("groundstation: ")
    assert said in error


@pytest.mark.parametrize("words", [("replay", "session", "--out", ""), ("replay", "", "--out", "out"), ("plan", "")])
def test_a_path_of_no_text_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """Expected: as of a shell's variable that is not set; it would be the current folder."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    assert ended.value.code == 2
    assert "got ''; wanted a path" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_two_outputs_are_two_files(tmp_path: Path) -> None:
    one = Output(path=tmp_path / "a.csv", option="--csv")
    other = Output(path=tmp_path / "none" / ".." / "a.csv", option="--json")
    with pytest.raises(InputError, match="a file that --csv names, too; wanted another --json"):
        refuse_overwriting([], [one, other])


def test_a_replay_writes_its_declared_files(tmp_path: Path) -> None:
    """Expected: no other file, and evaluating it into a folder that holds the results of others is allowed."""
    session = Tiny(rows=3).write(tmp_path / "session")
    (session / "dgps.csv").write_text("t_s,x_m,y_m,z_m\n1.0,0,300,20\n1.1,0,299,20\n")
    assert main(["replay", str(session), "--out", str(tmp_path / "out" / "before"), "--smooth"]) == 0
    written = {p.name for p in (tmp_path / "out" / "before").iterdir()}
    assert written
    assert all(any(fnmatch(name, pattern) for pattern in REPLAY_FILES) for name in written), written
    before = tmp_path / "out" / "before"
    request = CompareRequest(sources=(before, session), work=tmp_path / "out")
    assert {run.name for run in compare(request).runs} == {"before", "session"}
