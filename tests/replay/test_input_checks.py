"""A replay of a session whose inputs contradict each other says which, and exits with 1; results are written."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.evaluation import evaluate
from groundstation.replay.replay import ReplayRequest, replay
from tests.session.folder import Tiny

pytestmark = pytest.mark.usefixtures("unrendered_figures")

FROM_S, TO_S = 24.0, 29.0
Edit = Callable[[dict[str, str]], dict[str, str]]


def exchanged(row: dict[str, str]) -> dict[str, str]:
    """A row of ptu.csv with the columns of left and right exchanged."""
    other = {"left": "right", "right": "left"}
    return {"_".join([other.get(k.split("_")[0], k.split("_")[0]), *k.split("_")[1:]]): v for k, v in row.items()}


def as_they_are(row: dict[str, str]) -> dict[str, str]:
    return row


@pytest.fixture
def session(landing_from_20_s: Path, tmp_path: Path) -> Callable[[Edit], Path]:
    """The bundled landing with other rows of ptu.csv."""

    def write(edit: Edit) -> Path:
        folder = tmp_path / "session"
        folder.mkdir()
        for file in landing_from_20_s.iterdir():
            if file.suffix == ".avi":
                (folder / file.name).symlink_to(file)
            elif file.is_file():
                shutil.copy(file, folder)
        with (landing_from_20_s / "ptu.csv").open() as stream:
            rows = list(csv.DictReader(stream))
        with (folder / "ptu.csv").open("w", newline="") as stream:
            table = csv.DictWriter(stream, list(rows[0]))
            table.writeheader()
            table.writerows(edit(row) for row in rows)
        return folder

    return write


def test_exchanged_stations_are_named_and_the_exit_is_1(
    session: Callable[[Edit], Path], classic_tuning: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["--no-rerun", "--config", str(classic_tuning), "--from", f"{FROM_S}", "--to", f"{TO_S}"]
    assert main(["replay", str(session(exchanged)), "--out", str(out), *words]) == 1
    shown = capsys.readouterr()
    assert "inputs that cannot be right: stations left and right: the pictures of each move" in shown.err
    assert "exchanged" in shown.out
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["contradictions"]) == 1
    assert "their angles or their videos are exchanged" in summary["contradictions"][0]
    assert "their angles or their videos are exchanged" in (out / "report.html").read_text()
    assert (out / "track.csv").is_file()


def test_a_session_as_it_should_be_is_not_doubted(
    session: Callable[[Edit], Path], classic_tuning: Path, tmp_path: Path
) -> None:
    request = ReplayRequest(
        session=session(as_they_are),
        out=tmp_path / "out",
        config=classic_tuning,
        rerun=False,
        report=False,
        from_s=FROM_S,
        to_s=TO_S,
    )
    summary = replay(request).evaluation.summary
    assert summary["contradictions"] == []
    assert summary["no_track"] is None
    assert summary["counts"]["track"]["tracking"] > 30


def test_a_session_without_a_track_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, out = Tiny(rows=12).write(tmp_path / "session"), tmp_path / "out"
    assert main(["replay", str(session), "--out", str(out), "--no-rerun"]) == 0
    assert "no track: in none of 12 pairs did two cameras show a moving target" in capsys.readouterr().out
    page = (out / "report.html").read_text()
    assert "No track: in none of 12 pairs" in page
    assert "no usable reference" not in page


def test_a_rig_in_millimetres_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = Tiny(rows=12).write(tmp_path / "session")
    rig, places = re.subn(
        r"ptu_position_m = \[(.*?), (.*?), (.*?)\]",
        lambda place: f"ptu_position_m = {[1000.0 * float(x) for x in place.groups()]}",
        (session / "rig.toml").read_text(),
    )
    assert places == 2
    (session / "rig.toml").write_text(rig)
    assert main(["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun"]) == 1
    assert "m apart: is the rig in metres?" in capsys.readouterr().err


def test_a_reference_of_another_time_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: dgps.csv in ms is named; the same in seconds is not."""
    for factor, told in ((1000.0, True), (1.0, False)):
        session = Tiny(rows=12).write(tmp_path / f"session-{factor:g}")
        rows = [f"{factor * (1.0 + 0.1 * k):.3f},0,{300 - k},20" for k in range(10)]
        (session / "dgps.csv").write_text("\n".join(["t_s,x_m,y_m,z_m", *rows]) + "\n")
        main(["replay", str(session), "--out", str(tmp_path / f"out-{factor:g}"), "--no-rerun"])
        assert ("have nothing in common with the pictures'" in capsys.readouterr().out) is told


@pytest.mark.parametrize(("factor", "every", "told"), [(1e3, 1, True), (1.0, 1, False), (1.0, 40, False)])
def test_readings_in_milliseconds_among_the_pictures_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], factor: float, every: int, told: bool
) -> None:
    """The table begins half a second before the pictures, which then have readings among them; sparse ones are none."""
    session = Tiny(rows=12, ptu_from_s=-0.5).write(tmp_path / "session")
    head, *rows = (session / "ptu.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows[::every]]
    stored = [",".join([f"{factor * float(t):.3f}", *others]) for t, *others in cells]
    (session / "ptu.csv").write_text("\n".join([head, *stored]) + "\n")
    code = main(["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun"])
    told_words = "s if its times are in milliseconds: wanted seconds" in capsys.readouterr().err
    assert (code == 1, told_words) == (told, told)


def test_the_truth_is_compared_on_the_sessions_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: no offset is looked for, as it is of a DGPS log: it would hide 50 m along the path."""
    session = Tiny(rows=12).write(tmp_path / "session")
    rows = [f"{1.0 + 0.1 * k:.3f},0,{300 - k},20,10,10,10,10" for k in range(10)]
    head = "t_s,x_m,y_m,z_m,left_u_px,left_v_px,right_u_px,right_v_px"
    (session / "truth.csv").write_text("\n".join([head, *rows]) + "\n")
    compared: dict[str, float] = {}

    def noted(_track: object, _reference: object, offset_s: float, name: str, *_: float) -> None:
        compared[name] = offset_s

    monkeypatch.setattr(evaluate, "reference_contradiction", noted)
    main(["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun"])
    assert compared == {"truth.csv": 0.0}


@pytest.mark.parametrize("table", ["dgps", "truth"])
@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1.0, ""), (0.0, "")])
def test_a_reference_in_another_unit_is_told_of_a_part_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, factor: float, unit: str
) -> None:
    """Expected: the unit is named; neither right times nor a part outside of its reference is doubted."""
    session = Tiny(rows=12).write(tmp_path / "session")
    # the last case: a reference that ends before the part begins
    times = [factor * (1.0 + 0.1 * k) if factor else 0.01 * k for k in range(10)]
    rows = [f"{t:.3f},0,{300 - k},20,10,10,10,10" for k, t in enumerate(times)]
    head = "t_s,x_m,y_m,z_m,left_u_px,left_v_px,right_u_px,right_v_px"
    (session / f"{table}.csv").write_text("\n".join([head, *rows]) + "\n")
    main(["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun", "--from", "1.2", "--to", "1.6"])
    name = {"dgps": "DGPS", "truth": "truth"}[table]
    # wrapped to the width of the table
    printed = " ".join(capsys.readouterr().out.split())
    assert printed.count("in common with the pictures'") == (1 if unit else 0)
    if unit:
        assert f"{name}: its times, {factor:.1f} to " in printed
        assert f", and would in {unit}: t_s is in seconds" in printed


def test_an_encoders_counts_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: named where they could be degrees; an error that names them where no head has such angles."""
    head = "t_s,left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg"
    for times, code, words in (
        (3, 1, "all angles of left and right are whole numbers, 6 to 192"),
        (1000, 1, "counts, or"),
    ):
        session = Tiny(rows=12).write(tmp_path / f"session-{times}")
        first_s = float((session / "frames.csv").read_text().splitlines()[1].split(",")[1])
        rows = [f"{first_s - 0.1 + 0.03 * k:.3f},{times * (k + 2)},6,{times * (k + 5)},7" for k in range(60)]
        (session / "ptu.csv").write_text("\n".join([head, *rows]) + "\n")
        assert main(["replay", str(session), "--out", str(tmp_path / f"out-{times}"), "--no-rerun"]) == code
        assert words in capsys.readouterr().err


def test_a_mount_that_turns_the_axis_away_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = Tiny(rows=12).write(tmp_path / "session")
    rig = (session / "rig.toml").read_text()
    ideal = "head_from_camera_wxyz = [0.70710678, -0.70710678, 0.0, 0.0]"
    assert ideal in rig
    (session / "rig.toml").write_text(rig.replace(ideal, "head_from_camera_wxyz = [1.0, 0.0, 0.0, 0.0]", 1))
    assert main(["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun"]) == 1
    assert "away from the head's forward axis, left's by 90°" in capsys.readouterr().err
