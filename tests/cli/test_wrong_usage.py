"""An argument whose text cannot be right ends with exit code 2 and one line, before anything is read or written."""

from pathlib import Path

import pytest

from groundstation.cli.main import main

BANK = 'format = "groundstation-bank/1"\nworld_set = "test"\nsessions = 1\n'
IMPORT = ("import", "left.mp4", "right.mp4", "--rig", "RIG", "--out", "OUT")
FLY = ("onboard", "fly", "v.avi", "--camera", "c", "--imu", "i", "--out", "OUT")
MOUNT = ("calibrate", "mount", "--landmarks", "l.csv", "--rig", "RIG")
WRONG: dict[str, tuple[tuple[str, ...], str]] = {
    "udp": (("replay", "SESSION", "--out", "OUT", "--realtime", "--udp", "here"), "--udp: got 'here'"),
    "udp port": (("live", "--simulate", "--for", "1", "--out", "OUT", "--udp", "h:99999"), "--udp: got 'h:99999'"),
    "autopilot": (
        ("live", "--simulate", "--out", "OUT", "--autopilot", "there", "--autopilot-mode", "vision"),
        "autopilot URL: got 'there'",
    ),
    "autopilot check": (("autopilot", "check", "there", "--mode", "vision"), "autopilot URL: got 'there'"),
    "reproduce": (("reproduce", "--only", "nonsense", "--out", "OUT"), "--only: got nonsense"),
    "board": (("calibrate", "intrinsics", "SESSION", "--board", "tiles", "--out", "OUT.toml"), "--board: got 'tiles'"),
    "suffix": (("calibrate", "convert-lens", "RIG", "OUT.png"), "got the suffix '.png'"),
    "mount": ((*MOUNT, "--out", "OUT.toml"), "SIGHTINGS, --pictures: got neither"),
    "mount board": (
        (*MOUNT[:2], "--rig", "RIG", "--pictures", "p.csv", "--board", "tiles", "--out", "OUT.toml"),
        "--board: got 'tiles'",
    ),
    "detections": (
        ("calibrate", "timing", "SESSION", "--detections", "d.csv", "--out", "OUT.toml"),
        "--detections: got no --from-flight",
    ),
    "start": ((*IMPORT, "--start", "left"), "--start: got 'left'"),
    "runway": (
        (*FLY, "--runways", "r", "--runway", "3"),
        "--runway: got 3",
    ),
    "runways": (
        (*FLY, "--runway", "LFRS_03"),
        "--runways: got nothing",
    ),
    "scheduler": (("bank", "BANK", "--out", "OUT", "--scheduler", "there"), "--scheduler: got 'there'"),
    "test log": (("bank", "BANK", "--out", "OUT"), "--test-log: got nothing"),
    "replay": (
        ("replay", "SESSION", "--out", "OUT", "--from", "5", "--to", "2"),
        "--from, --to: got --from 5 and --to 2",
    ),
    "night and world": (("simulate", "--out", "OUT", "--night", "3", "--world", "1"), "--world: got --night as well"),
    "night and flight": (
        ("simulate", "--out", "OUT", "--night", "3", "--flight", "weave"),
        "--flight: got --night as well; wanted one of them: only --seed holds for a night",
    ),
    "night and rate": (("simulate", "--out", "OUT", "--night", "3", "--rate", "5"), "--rate: got --night as well"),
    "world and wind": (("simulate", "--out", "OUT", "--world", "1", "--wind", "3"), "--wind: got --world as well"),
    "world and seed": (("simulate", "--out", "OUT", "--world", "1", "--seed", "3"), "--seed: got --world as well"),
    "world file and duration": (
        ("simulate", "--out", "OUT", "--world", "w.toml", "--duration", "3"),
        "--duration: got --world w.toml as well; wanted one of them: the file states it",
    ),
    "render": (
        ("onboard", "render", "--out", "OUT", "--world", "3", "--scene", "night"),
        "--scene: got --world as well; wanted one of them",
    ),
    "threshold": ((*FLY, "--threshold-m", "1,2,3"), "--threshold-m: got no --ground-track; wanted both, or neither"),
    "sky": (
        ("calibrate", "sky", "--receive", "h:3000", "--keep", "OUT", "--clock-sigma", "0.2"),
        "--receive: got no --keep, or more than it",
    ),
    "workers": (
        ("bank", "BANK", "--out", "OUT", "--scheduler", "tcp://h:80", "--workers", "2"),
        "--workers: got --scheduler as well",
    ),
    "convert": (("convert", "SESSION", "OUT", "--from", "5", "--to", "5"), "--from, --to: got --from 5 and --to 5"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_text_that_cannot_be_right(
    name: str, tmp_path: Path, landing_1: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words, said = WRONG[name]
    (tmp_path / "bank.toml").write_text(BANK, encoding="utf-8")
    places = {
        "SESSION": landing_1,
        "RIG": landing_1 / "rig.toml",
        "BANK": tmp_path / "bank.toml",
        "OUT": tmp_path / "out",
        "OUT.toml": tmp_path / "out.toml",
        "OUT.png": tmp_path / "out.png",
    }
    assert main([str(places.get(word, word)) for word in words]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("groundstation: ")
    assert said in lines[0]
    assert [path.name for path in tmp_path.iterdir()] == ["bank.toml"]


def test_a_port_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["ptu", "simulate", "--tcp", "70000"])
    assert ended.value.code == 2
    assert "--tcp: got '70000'; wanted a free port from 1 to 65535, or 0 for any" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "usage", "said"),
    [
        (("replay", "s", "--out", "o", "--fom", "3"), "usage: groundstation replay ", "did you mean --from?"),
        (
            ("onboard", "edges", "v", "--camera", "c", "--out", "o", "--no-rerum"),
            "usage: groundstation onboard edges ",
            "",
        ),
        (("config", "--everything"), "usage: groundstation config ", ""),
        (("--nonsense",), "usage: groundstation [-h]", ""),
    ],
)
def test_an_unknown_option_is_told_with_its_commands_usage(
    words: tuple[str, ...], usage: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith(usage)
    assert "unrecognized arguments: " in told.splitlines()[-1]
    assert said in told


def test_a_path_that_the_shell_left_with_a_tilde_is_in_the_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: as of ``--config=~/none.toml``, where a shell expands nothing."""
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["config", "--config=~/none.toml"]) == 1
    assert f"{tmp_path}/none.toml: got no such file" in capsys.readouterr().err


def test_a_tilde_of_a_user_without_a_home_is_wrong_usage(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: exit code 2 and a line, as for a user's number alone in a container."""

    def homeless(path: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "expanduser", homeless)
    with pytest.raises(SystemExit) as ended:
        main(["config", "--config=~/none.toml"])
    assert ended.value.code == 2
    assert "got '~/none.toml', and this user has no home; wanted a path" in capsys.readouterr().err
