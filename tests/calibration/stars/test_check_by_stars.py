"""`calibrate check` by the stars: a rig that stands is accepted, a knock is found, checks of many nights are drawn."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.landmarks.check_history import history_picture, read_history
from calibration.landmarks.check_record import RECORD_FORMAT
from calibration.landmarks.jobs import CheckDone, CheckRequest, run_check
from calibration.stars.calibrate import sky_uncertainty
from calibration.stars.night_landmarks import write_night_tables
from calibration.stars.star_images import NO_STARS
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from tests.calibration.stars.nights import calibrated, night, pictures

SEED = 2


def knocked(rig: Rig, station: str, parameter: str, by_deg: float) -> Rig:
    """Return the rig as if it had been calibrated before a knock."""
    change = np.zeros(len(CALIBRATION_PARAMETERS))
    change[CALIBRATION_PARAMETERS.index(parameter)] = np.radians(by_deg)
    turned = rig[station].changed(change)
    return replace(rig, stations=tuple(turned if s.name == station else s for s in rig.stations))


def check(folder: Path, rig: Rig, **options: object) -> CheckDone:
    path = folder / "rig.toml"
    path.write_text(rig_to_toml(rig))
    uncertain = sky_uncertainty(night(SEED).site, 0.1, each_clock=False)
    tables = write_night_tables(folder, load_rig(path), pictures(SEED), night(SEED).site, uncertain)
    request = CheckRequest(
        sightings=tables.sightings,
        landmarks=tables.landmarks,
        rig=path,
        reference=Path("none"),
        keep=False,
        **options,
    )
    return run_check(request)


def test_a_rig_that_stands_is_accepted(tmp_path: Path) -> None:
    done = check(tmp_path, calibrated(SEED).rig, report=tmp_path / "report")
    assert done.good
    assert "accepted: the rig stands as it was calibrated" in done.text
    for movement in done.check.movements:
        # one sighting a picture, its stars share the angles' error
        assert len(movement.landmarks) <= 10
        assert 0.0005 < np.degrees(movement.sigma_rad[2]) < 0.004
    assert not (tmp_path / "report" / "drift.png").exists()


@pytest.mark.parametrize("parameter", ["runway_from_base.z", "runway_from_base.x"])
def test_a_knock_of_a_fortieth_of_a_degree_is_found_and_put_right(tmp_path: Path, parameter: str) -> None:
    rig = knocked(calibrated(SEED).rig, "left", parameter, -0.025)
    done = check(tmp_path, rig)
    assert not done.good
    assert [m.station for m in done.check.moved] == ["left"]
    axis = "xyz".index(parameter[-1])
    assert np.degrees(done.check.moved[0].change_rad[axis]) == pytest.approx(0.025, abs=0.008)
    put_right = check(tmp_path, rig, out=tmp_path / "today.toml", report=tmp_path / "report")
    assert put_right.good
    assert "corrected: left moved" in put_right.text
    # the night is no survey's table that another day could be compared with
    assert not (tmp_path / "today.sightings.csv").exists()
    assert (tmp_path / "report" / "drift.png").is_file()
    assert len(read_history(tmp_path / "rig.checks.jsonl")) == 2


def test_a_night_without_stars_is_refused(tmp_path: Path) -> None:
    dark = {"left": tuple(replace(p, seen=NO_STARS) for p in pictures(SEED)["left"])}
    uncertain = sky_uncertainty(night(SEED).site, 0.1, each_clock=False)
    with pytest.raises(InputError, match="got no picture whose stars are recognised"):
        write_night_tables(tmp_path, calibrated(SEED).rig, dark, night(SEED).site, uncertain)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "wanted SIGHTINGS and --landmarks, or --stars and --site"),
        (["rig.toml"], "wanted SIGHTINGS and --landmarks, or --stars and --site"),
        (["--stars", "."], "--stars: got no --site"),
        (["rig.toml", "--landmarks", "rig.toml", "--clock-sigma", "1"], "--clock-sigma: got no --stars"),
        (["rig.toml", "--stars", ".", "--site", "rig.toml"], "--stars: got tables as well"),
        (["rig.toml", "--landmarks", "rig.toml", "--site", "rig.toml"], "wanted SIGHTINGS and --landmarks"),
    ],
)
def test_tables_or_stars_are_wanted(tmp_path, monkeypatch, capsys, arguments, complaint) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.toml").write_text("")
    try:
        code = main(["calibrate", "check", *arguments, "--rig", "rig.toml"])
    except SystemExit as left:
        code = left.code
    assert code == 2
    assert complaint in capsys.readouterr().err


def entry(utc_s: float, pan_deg: float) -> dict[str, object]:
    turned = {"pan": pan_deg, "tilt": 0.001, "roll": 0.0}
    return {
        "format": RECORD_FORMAT,
        "from_s": utc_s,
        "to_s": utc_s + 60.0,
        "stations": {"left": {"turned_deg": turned, "sigma_deg": {"pan": 0.001, "tilt": 0.001, "roll": 0.002}}},
    }


def test_checks_of_many_nights_are_drawn_in_order_of_time(tmp_path: Path) -> None:
    record = tmp_path / "rig.checks.jsonl"
    days = [1.8e9 + 86400.0 * day for day in (3, 1, 2)]
    lines = [json.dumps(entry(day, 0.002 * k)) for k, day in enumerate(days)]
    # a check in a table's own clock, one that failed, and a line that is none
    lines += [json.dumps(entry(12.0, 0.0)), json.dumps({**entry(days[0], 0.0), "stations": {}}), "{", "3", ""]
    record.write_text("\n".join(lines))
    history = read_history(record)
    assert [check.utc_s for check in history] == [day + 30.0 for day in sorted(days)]
    assert [check.turned_deg["left"][0] for check in history] == [0.002, 0.004, 0.0]
    picture = history_picture(history)
    assert picture is not None
    assert picture.png.startswith(b"\x89PNG")
    assert history_picture(history[:1]) is None
    assert read_history(tmp_path / "none.jsonl") == ()


@given(st.lists(st.one_of(st.text(), st.dictionaries(st.text(), st.floats()).map(json.dumps)), max_size=5))
def test_any_text_is_a_record(tmp_path_factory: pytest.TempPathFactory, lines: list[str]) -> None:
    record = tmp_path_factory.getbasetemp() / "any.checks.jsonl"
    record.write_text("\n".join([*lines, json.dumps(entry(1.8e9, 0.001))]), encoding="utf-8", errors="replace")
    assert len(read_history(record)) == 1
