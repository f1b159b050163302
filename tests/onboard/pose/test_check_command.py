"""`groundstation calibrate check --runway`: the runway's corners seen by a station."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.rig.rig import Rig, Station
from groundstation.rig.rig_toml import rig_to_toml
from tests.onboard.pose.test_station_check import CORNERS, PAN, TILT, pixels, station, turned

NAMES = ("near left", "far left", "far right", "near right")


def write(
    folder: Path, reported: Station, true: Station, rng: np.random.Generator, rig: Rig | None = None
) -> list[str]:
    (folder / "rig.toml").write_text(rig_to_toml(rig or Rig(stations=(reported,))))
    rows = ["landmark,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m"]
    rows += [f"{name},{x},{y},{z},0.005,0.005,0.005" for name, (x, y, z) in zip(NAMES, CORNERS, strict=True)]
    (folder / "landmarks.csv").write_text("\n".join(rows) + "\n")
    rows = ["station,landmark,pan_deg,tilt_deg,u_px,v_px,sigma_px"]
    exact = pixels(true, PAN, TILT)
    for k, name in enumerate(NAMES):
        for _ in range(20):
            pan, tilt = np.degrees(np.array([PAN, TILT]) + reported.ptu_sigma_rad * rng.standard_normal(2))
            u, v = exact[k] + 0.2 * rng.standard_normal(2)
            rows.append(f"left,{name},{pan:.6f},{tilt:.6f},{u:.4f},{v:.4f},0.2")
    (folder / "today.csv").write_text("\n".join(rows) + "\n")
    words = ["calibrate", "check", str(folder / "today.csv"), "--landmarks", str(folder / "landmarks.csv")]
    return [*words, "--rig", str(folder / "rig.toml"), "--runway", ",".join(NAMES)]


def test_a_station_as_calibrated_agrees(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(write(tmp_path, station(), station(), rng))
    printed = capsys.readouterr()
    assert "left: agrees" in printed.out, printed
    assert code == 0


def test_what_the_rig_s_own_table_states_is_known(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """A base turned by two of its sigmas, which the rig's table states and the station's does not: no alarm."""
    reported = station()
    rig = Rig(stations=(reported,))
    nothing = replace(reported, covariance_parameters=(), covariance=np.zeros((0, 0)))
    rig = Rig(stations=(nothing,), shared_covariance=rig.calibration_covariance())
    code = main(write(tmp_path, reported, turned(reported, np.array([0.0, 0.0, 2e-4])), rng, rig))
    printed = capsys.readouterr()
    assert "left: agrees" in printed.out, printed
    assert code == 0


def test_a_turned_station_does_not(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    reported = station()
    code = main(write(tmp_path, reported, turned(reported, np.radians([0.0, 0.0, 0.3])), rng))
    printed = capsys.readouterr()
    assert "left: does not agree" in printed.out, printed
    assert code == 1


@pytest.mark.parametrize(
    ("names", "code", "wanted"), [("near left,far left", 2, "four or more"), ("a,b,c,d", 1, "no surveyed point 'a'")]
)
def test_names_that_will_not_do_are_refused(
    names: str, code: int, wanted: str, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    words = write(tmp_path, station(), station(), rng)
    assert main([*words[:-1], names]) == code
    printed = capsys.readouterr()
    assert wanted in printed.err
    assert printed.err.count("\n") == 1
    # no verdict before an error, and the record agrees
    assert printed.out == ""
    assert json.loads((tmp_path / "rig.checks.jsonl").read_text())["decision"] == "refused"


def test_verdict_record_and_exit_code_are_one(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """Turned by 0.08° since the rig, but not since the reference: only the corners see it, and refuse for all."""
    true = turned(station(), np.radians([0.0, 0.0, 0.08]))
    words = write(tmp_path, station(), true, rng)
    (tmp_path / "today.csv").rename(tmp_path / "rig.sightings.csv")
    words = write(tmp_path, station(), true, rng)
    assert main(words[:-2]) == 0
    assert "accepted" in capsys.readouterr().out
    assert main([*words, "--out", str(tmp_path / "new.toml")]) == 1
    reported = capsys.readouterr().out
    assert "left: as calibrated" in reported
    assert "accepted" not in reported
    assert "refused: nothing has moved by the landmarks, but the runway's corners disagree (left)" in reported
    assert not (tmp_path / "new.toml").exists()
    records = [json.loads(line) for line in (tmp_path / "rig.checks.jsonl").read_text().splitlines()]
    assert [r["decision"] for r in records] == ["accepted", "refused"]
