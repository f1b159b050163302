"""`groundstation calibrate stars` and `simulate --night`: a night out, a rig in; heads that are turned; wrong input."""

import csv
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.stars.simulated.night_score import direction_errors_deg
from calibration.stars.site_file import read_site, site_to_toml
from calibration.stars.sky import ObservingSite
from groundstation.cli.main import main
from groundstation.rig.rig import Rig, load_rig
from tests.calibration.landmarks.sighting_set_up import brisk_unit, true_rig, write_station
from tests.live.test_heads import pan_of, pan_rate_of, until

pytestmark = pytest.mark.usefixtures("unrendered_pictures")

PICTURES = 6


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stars") / "night"
    assert main(["simulate", "--out", str(folder), "--night", str(PICTURES), "--seed", "4"]) == 0
    return folder


@pytest.fixture
def left_night(night: Path, tmp_path: Path) -> Path:
    """Four pictures of the left station."""
    folder = tmp_path / "left"
    folder.mkdir()
    heading, *rows = (night / "pictures.csv").read_text().splitlines()
    own = [row for row in rows if "left-" in row][:4]
    (folder / "pictures.csv").write_text("\n".join([heading, *own]) + "\n")
    for name in ("rig.toml", "site.toml", *(path.name for path in night.glob("left-*.png"))):
        (folder / name).symlink_to(night / name)
    return folder


@pytest.fixture
def copied(night: Path, tmp_path: Path) -> Path:
    """The night without its pictures' content: for input that is refused before they are looked at."""
    for name in ("pictures.csv", "rig.toml", "site.toml"):
        shutil.copy(night / name, tmp_path / name)
    return tmp_path


def run(folder: Path, out: Path, *more: str) -> int:
    given = ["--rig", str(folder / "rig.toml"), "--site", str(folder / "site.toml"), "--from", str(folder)]
    return main(["calibrate", "stars", *given, "--out", str(out), *more])


def test_a_rendered_night_becomes_a_rig(night: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "stars.toml"
    assert run(night, out, "--report", str(tmp_path / "report")) == 0
    said = capsys.readouterr().out
    assert "left against right is known to" in said
    assert f"wrote {out}" in said
    page = (tmp_path / "report" / "report.html").read_text()
    assert "Over the picture" in page
    assert {p.name for p in (tmp_path / "report").glob("*.png")} == {
        f"{name}-{kind}.png" for name in ("left", "right") for kind in ("lens", "head", "over-angle")
    }
    found, true = load_rig(out), load_rig(night / "truth.toml")
    errors = [direction_errors_deg(found[name], true[name]) for name in ("left", "right")]
    # six pictures each, an encoder's step of 0.00625°; before it was a degree
    assert np.abs(errors[0] - errors[1]).max() < 0.03
    assert np.abs(errors).max() < 0.05
    # a check leaves the night's own folder as it is
    before = sorted(night.iterdir())
    check = ["calibrate", "check", "--stars", str(night), "--site", str(night / "site.toml"), "--rig", str(out)]
    assert main([*check, "--clock-sigma", "0.2"]) == 0
    assert sorted(night.iterdir()) == before


def test_the_same_night_gives_the_same_rig(left_night: Path, tmp_path: Path) -> None:
    texts = []
    for name in ("one.toml", "two.toml"):
        assert run(left_night, tmp_path / name, "--stations", "left") == 0
        texts.append((tmp_path / name).read_bytes())
    assert texts[0] == texts[1]


def test_simulated_nights_are_the_same_by_their_seed(night: Path, tmp_path: Path) -> None:
    assert main(["simulate", "--out", str(tmp_path / "n"), "--night", "1", "--seed", "4"]) == 0
    assert main(["simulate", "--out", str(tmp_path / "m"), "--night", "1", "--seed", "4"]) == 0
    for path in sorted((tmp_path / "n").iterdir()):
        assert path.read_bytes() == (tmp_path / "m" / path.name).read_bytes(), path.name


@pytest.mark.parametrize(
    ("column", "value", "complaint"),
    [
        ("t_utc_s", "179580000000", "wanted Unix time in s"),
        ("t_utc_s", "12.5", "pictures over"),
        ("t_utc_s", "", "t_utc_s"),
        ("station", "third", "wanted one of left, right"),
        ("pan_deg", "1e9", "pan_deg = 1e+09"),
        ("file", "../x.png", "wanted a picture inside the folder"),
        ("pan_from", "2", "wanted 1 or -1"),
    ],
)
def test_rows_that_cannot_be_are_told_with_their_line(copied, capsys, column: str, value: str, complaint: str) -> None:
    with (copied / "pictures.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    rows[2][column] = value
    with (copied / "pictures.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    assert run(copied, copied / "out.toml") == 1
    said = capsys.readouterr().err
    assert complaint in said
    assert "pictures.csv" in said
    assert not (copied / "out.toml").exists()


def test_missing_pictures_and_tables_are_told(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(copied, copied / "out.toml") == 1
    assert "left-000.png: got no such file" in capsys.readouterr().err
    (copied / "left-000.png").write_bytes(b"no picture")
    assert run(copied, copied / "out.toml") == 1
    assert "left-000.png: got nothing that can be decoded" in capsys.readouterr().err
    text = (copied / "pictures.csv").read_text()
    (copied / "pictures.csv").write_text(text.replace("t_utc_s", "t_s"))
    assert run(copied, copied / "out.toml") == 1
    assert "wanted a column t_utc_s" in capsys.readouterr().err
    (copied / "site.toml").write_text("[air]\nair_c = 3\n")
    assert run(copied, copied / "out.toml") == 1
    assert "got no [origin]; wanted a table [origin] with lat_deg" in capsys.readouterr().err


def test_pictures_of_another_camera_are_refused(night: Path, copied: Path, capsys) -> None:
    text = (copied / "rig.toml").read_text()
    (copied / "rig.toml").write_text(text.replace("[1280, 960]", "[640, 480]"))
    shutil.copy(night / "left-000.png", copied)
    assert run(copied, copied / "out.toml") == 1
    assert "got 1280x960 px; wanted 640x480 px" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "STATION.toml: got none"),
        (["--rig", "rig.toml", "--site", "site.toml"], "wanted --from DIR"),
        (["--rig", "rig.toml", "--site", "s.toml", "--from", ".", "--pictures", "p"], "--pictures: got --from as well"),
        (["--rig", "rig.toml", "--site", "s.toml", "--from", ".", "--each-clock"], "got no --clock-sigma"),
        (["f.toml", "--range", "5,2,1,9"], "wanted PAN_LOW,PAN_HIGH,TILT_LOW,TILT_HIGH"),
        (["f.toml", "--range", "1,2,3"], "wanted PAN_LOW,PAN_HIGH,TILT_LOW,TILT_HIGH"),
        (["f.toml", "--pointings", "0"], "--pointings"),
    ],
)
def test_arguments_that_cannot_be_are_usage_errors(tmp_path, monkeypatch, capsys, arguments, complaint) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("rig.toml", "site.toml", "s.toml", "f.toml"):
        (tmp_path / name).write_text("")
    try:
        code = main(["calibrate", "stars", *arguments, "--out", "out.toml"])
    except SystemExit as left:
        code = left.code
    assert code == 2
    assert complaint in capsys.readouterr().err


def wide_rig() -> Rig:
    """Return the rig of the simulated units with a field of view whose patterns of stars are few."""
    rig = true_rig()
    wide = [replace(s, lens=replace(s.lens, focal_px=np.array([300.0, 300.0]))) for s in rig.stations]
    return replace(rig, stations=tuple(wide))


@pytest.fixture
def field(tmp_path: Path) -> Iterator[Path]:
    """A station of simulated units and videos, at a place where it is night now."""
    with ExitStack() as stack:
        for name in ("left", "right"):
            stack.enter_context(brisk_unit(tmp_path / name))
        write_station(tmp_path, wide_rig())
        midnight_lon = (180.0 - 15.0 * (time.time() % 86400.0) / 3600.0) % 360.0 - 180.0
        site = ObservingSite(lat_deg=0.0, lon_deg=midnight_lon, height_m=0.0, y_axis_azimuth_deg=0.0)
        (tmp_path / "site.toml").write_text(site_to_toml(site))
        yield tmp_path


def test_heads_are_turned_and_pictures_kept_with_their_angles(field: Path, capsys) -> None:
    """Expected: cameras that show no stars end it with the reason, and the pictures stay."""
    command = ["calibrate", "stars", str(field / "field.toml"), "--site", str(field / "site.toml")]
    options = ["--out", str(field / "out.toml"), "--pointings", "3", "--range=-20,20,12,29", "--rate", "50"]
    assert main([*command, *options]) == 1
    said = capsys.readouterr()
    assert "got 0 pictures whose stars were recognised" in said.err
    assert "left: 3 of 3, pan" in said.out
    with (field / "out.pictures" / "pictures.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["station"] for row in rows] == ["left"] * 3 + ["right"] * 3
    for row in rows:
        assert (field / "out.pictures" / row["file"]).is_file()
        assert -20.0 <= float(row["pan_deg"]) <= 20.0
        assert 12.0 <= float(row["tilt_deg"]) <= 29.0
        assert abs(float(row["t_utc_s"]) - time.time()) < 120.0
        assert row["pan_from"] in ("1", "-1")
    # a second night does not mix with the first
    assert main([*command, *options]) == 1
    assert "got pictures of another night" in capsys.readouterr().err
    assert main([*command, "--out", str(field / "out.toml"), "--from", str(field / "out.pictures")]) == 1
    assert "got 0 pictures whose stars were recognised" in capsys.readouterr().err


def test_a_field_too_small_for_the_catalogue_is_refused(left_night: Path, tmp_path: Path, capsys) -> None:
    text = (left_night / "rig.toml").read_text()
    focal = next(line for line in text.splitlines() if line.startswith("focal_px"))
    (left_night / "rig.toml").unlink()
    (left_night / "rig.toml").write_text(text.replace(focal, "focal_px = [60000.0, 60000.0]"))
    assert run(left_night, tmp_path / "out.toml") == 1
    assert "got a field of view of 1.22 deg; wanted 3 to 60 deg" in capsys.readouterr().err


def test_a_site_file_is_read_as_it_is_written(tmp_path: Path) -> None:
    for air in ({}, {"pressure_hpa": 955.5, "air_c": -2.25}):
        site = ObservingSite(lat_deg=-33.123456789, lon_deg=151.5, height_m=12.5, y_axis_azimuth_deg=70.0, **air)
        (tmp_path / "site.toml").write_text(site_to_toml(site))
        assert read_site(tmp_path / "site.toml") == site


def test_a_picture_listed_twice_is_refused(copied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (copied / "pictures.csv").read_text().splitlines()
    (copied / "pictures.csv").write_text("\n".join([*lines, lines[1]]) + "\n")
    assert run(copied, copied / "out.toml") == 1
    assert "left-000.png a second time; wanted each picture once" in capsys.readouterr().err


def test_a_station_that_is_not_there_is_told_before_pictures_are_read(copied: Path, capsys) -> None:
    assert run(copied, copied / "out.toml", "--stations", "lef") == 2
    assert "--stations: got 'lef'; wanted some of left, right" in capsys.readouterr().err


def test_a_night_is_not_drawn_over_another(night: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--out", str(night), "--night", "2"]) == 1
    assert "empty" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--range=-20,20,12,29"], "--range: got --from as well; wanted one of them"),
        (["--pointings", "3"], "--pointings: got --from as well"),
        (["--exposure", "1"], "--exposure: got --from as well"),
        (["--clock-sigma", "1", "--each-clock", "--station-clocks"], "--station-clocks: got --each-clock as well"),
    ],
)
def test_what_concerns_new_pictures_is_refused_with_old_ones(copied: Path, capsys, arguments, complaint) -> None:
    assert run(copied, copied / "out.toml", *arguments) == 2
    assert complaint in capsys.readouterr().err


def test_places_that_cannot_be_written_are_told_before_any_picture_is_read(copied: Path, capsys) -> None:
    """Expected: the pictures are not even there."""
    assert run(copied, copied / "rig.toml" / "out.toml") == 1
    assert "rig.toml, a file; wanted a file in a folder that can be written" in capsys.readouterr().err
    assert run(copied, copied / "out.toml", "--report", str(copied / "site.toml" / "report")) == 1
    assert "site.toml, a file; wanted a folder that can be written" in capsys.readouterr().err


def test_heads_stand_where_the_program_is_killed(tmp_path: Path) -> None:
    """Expected: the motion guard halts the head on its way to the first pointing, long before it is there."""
    write_station(tmp_path, wide_rig())
    midnight_lon = (180.0 - 15.0 * (time.time() % 86400.0) / 3600.0) % 360.0 - 180.0
    site = ObservingSite(lat_deg=0.0, lon_deg=midnight_lon, height_m=0.0, y_axis_azimuth_deg=0.0)
    (tmp_path / "site.toml").write_text(site_to_toml(site))
    words = ["calibrate", "stars", str(tmp_path / "field.toml"), "--site", str(tmp_path / "site.toml")]
    words += ["--out", str(tmp_path / "out.toml"), "--range=40,60,12,29", "--pointings", "3", "--rate", "4"]
    with brisk_unit(tmp_path / "left") as left, brisk_unit(tmp_path / "right"):
        command = [sys.executable, "-m", "groundstation", *words]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, text=True) as process:
            assert until(lambda: abs(pan_rate_of(left)) > np.radians(2.0), 60.0)
            process.kill()
        assert until(lambda: pan_rate_of(left) == 0.0, 6.0)
        # 40 deg and more at 4 deg/s are 10 s
        assert np.degrees(pan_of(left, 1e9)) < 36.0
