"""Check: knocks found, rigs that stand left alone, a corrected rig better than the spoilt one, always a record."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from landmark_study.simulated import knocked, look, morning, turned_rad, write_landmarks, write_sightings
from scipy.stats import chi2

from calibration.landmarks.check import solve_check
from calibration.landmarks.check_pictures import expected_px
from calibration.landmarks.check_reference import require_new_sightings
from calibration.landmarks.check_report import station_line
from calibration.landmarks.survey import solve_survey
from calibration.rig_reach import approach_point
from calibration.sightings import LandmarkSighting, read_sightings
from groundstation.cli.main import main
from groundstation.errors import GroundstationError, InputError
from groundstation.geometry.aim import aim_at
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from tests.complaints import complaint

KNOCK_RAD = float(np.radians(0.01))
READINGS = 24


def test_a_knock_is_detected_and_an_unmoved_rig_is_unchanged() -> None:
    """0.01 degrees of pan and of tilt, six landmarks of 24 readings with the survey's sightings as reference."""
    alarms, statistics, knocks = 0, [], []
    for seed in range(6):
        generator = np.random.default_rng([seed, 11])
        day = morning(generator)
        first = look(day.true, day.stands, generator, READINGS)
        rig = solve_survey(day.stated, first, day.table).rig
        still = solve_check(rig, look(day.true, day.stands, generator, READINGS), day.table, first)
        alarms += bool(still.moved)
        statistics += [m.statistic for m in still.movements]
        true = knocked(knocked(day.true, "left", 2, KNOCK_RAD), "right", 0, KNOCK_RAD)
        hit = solve_check(rig, look(true, day.stands, generator, READINGS), day.table, first)
        assert [m.station for m in hit.moved] == ["left", "right"]
        knocks += [
            (hit.movements[0].turned_rad[2] - KNOCK_RAD) / hit.movements[0].sigma_rad[2],
            (hit.movements[1].turned_rad[0] - KNOCK_RAD) / hit.movements[1].sigma_rad[0],
        ]
    # of 12 stations one alarm in 200 is expected; two rigs of six would be one in 1700
    assert alarms <= 1
    low, high = chi2.ppf([0.001, 0.999], 3 * len(statistics))
    assert low < sum(statistics) < high
    low, high = chi2.ppf([0.001, 0.999], len(knocks))
    assert low < np.square(knocks).sum() < high


def test_without_a_reference_the_rigs_own_covariance_counts(rng: np.random.Generator) -> None:
    """The same knock against a rig that is known to 0.0005 degrees and one to 0.02; landmarks without error."""
    day = morning(rng, uncertain=False)
    exact = {n: replace(m, sigma=np.zeros(3)) for n, m in day.stands.items()}
    names = tuple(f"runway_from_base.{a}" for a in "xyz")
    seen = look(knocked(day.true, "left", 2, KNOCK_RAD), exact, rng, READINGS)
    found = {}
    for sigma_deg in (0.0005, 0.02):
        known = np.diag(np.full(3, np.radians(sigma_deg) ** 2))
        rig = Rig(stations=tuple(replace(s, covariance_parameters=names, covariance=known) for s in day.true.stations))
        found[sigma_deg] = solve_check(rig, seen, exact)
    assert [m.station for m in found[0.0005].moved] == ["left"]
    assert not found[0.02].moved
    pan = [np.degrees(found[s].movements[0].sigma_rad[2]) for s in (0.0005, 0.02)]
    assert pan[1] == pytest.approx(np.hypot(0.02, np.sqrt(pan[0] ** 2 - 0.0005**2)), rel=0.02)
    assert found[0.02].movements[0].detectable_rad[2] > np.radians(0.05)


def localisation_error(rig: Rig, true: Rig) -> float:
    """Return how far (3-D, m) a point at 300 m is put wrong: rays of exact pixels and angles of the true rig."""
    point = approach_point(true, 300.0)
    origins, directions = [], []
    for own in true.stations:
        aim = aim_at(own.geometry(), point)
        assert aim is not None
        seen = own.geometry().project(point, aim.pan_rad, aim.tilt_rad)
        assert seen is not None
        ray = rig[own.name].geometry().ray(*seen.pixel, aim.pan_rad, aim.tilt_rad)
        origins.append(ray.origin_runway_m)
        directions.append(ray.direction_runway)
    across = [np.eye(3) - np.outer(d, d) for d in directions]
    nearest = np.linalg.solve(sum(across), sum(a @ o for a, o in zip(across, origins, strict=True)))
    return float(np.linalg.norm(nearest - point))


@pytest.mark.parametrize("with_reference", [True, False])
def test_a_corrected_rig_localises_better_than_the_spoilt_one(rng: np.random.Generator, with_reference: bool) -> None:
    day = morning(rng)
    first = look(day.true, day.stands, rng, READINGS)
    rig = solve_survey(day.stated, first, day.table).rig
    true = knocked(knocked(day.true, "left", 2, np.radians(0.08)), "left", 0, np.radians(-0.05))
    readings = look(true, day.stands, rng, READINGS)
    check = solve_check(rig, readings, day.table, first if with_reference else ())
    assert [m.station for m in check.moved] == ["left"]
    spoilt, corrected = localisation_error(rig, true), localisation_error(check.corrected, true)
    assert corrected < 0.25 * spoilt
    # what did not move stays as it was, what did is less well known than before
    assert check.corrected["right"].runway_from_base_wxyz.tolist() == rig["right"].runway_from_base_wxyz.tolist()
    before, after = rig.calibration_covariance(), check.corrected.calibration_covariance()
    assert set(before.names) == set(after.names)
    for axis in "xyz":
        name = f"left.runway_from_base.{axis}"
        k, j = before.names.index(name), after.names.index(name)
        assert after.matrix[j, j] > before.matrix[k, k]
    names = [f"left.runway_from_base.{a}" for a in "xyz"]
    places = [after.names.index(n) for n in names]
    off = turned_rad(check.corrected["left"], true["left"])
    low, high = chi2.ppf([0.0001, 0.9999], 3)
    assert low < off @ np.linalg.solve(after.matrix[np.ix_(places, places)], off) < high


def test_the_picture_has_landmarks_where_the_rig_expects_them(rng: np.random.Generator) -> None:
    """Turned by 0.03° of pan, the base sees all landmarks 0.03° aside of where the rig as it was expects them."""
    day = morning(rng)
    first = look(day.true, day.stands, rng, READINGS)
    rig = solve_survey(day.stated, first, day.table).rig
    found = solve_check(
        rig, look(knocked(day.true, "left", 2, 3 * KNOCK_RAD), day.stands, rng, READINGS), day.table, first
    )
    expected, start = expected_px(found), 0
    for observed in found.fit.problem.observations:
        off = (observed.pixel_px - expected[start : start + len(observed)]) / rig[observed.station].lens.focal_px
        start += len(observed)
        aside = abs(float(np.degrees(off[:, 0].mean())))
        assert aside == pytest.approx(0.03 if observed.today and observed.station == "left" else 0.0, abs=0.004)
        assert abs(float(np.degrees(off[:, 1].mean()))) < 0.004


@pytest.mark.parametrize("with_reference", [True, False])
def test_a_camera_that_slipped_on_its_head_is_distinguished_from_a_base_that_turned(
    rng: np.random.Generator, with_reference: bool
) -> None:
    """Seen over 120 degrees of pan, a tilt of the camera is no turn of the base."""
    day = morning(rng)
    first = look(day.true, day.stands, rng, READINGS)
    rig = solve_survey(day.stated, first, day.table).rig
    slip = np.zeros(21)
    slip[6:9] = np.radians([0.1, 0.0, 0.02])
    true = replace(day.true, stations=(day.true["left"], day.true["right"].changed(slip)))
    check = solve_check(rig, look(true, day.stands, rng, READINGS), day.table, first if with_reference else ())
    assert [(m.station, m.group) for m in check.moved] == [("right", "head_from_camera")]
    assert re.search(
        r"camera has turned on its head by 0\.(09|10)\d deg in tilt", station_line(check, check.movements[1])
    )
    (off, sigma) = check.movements[1].turned_rad - slip[6:9], check.movements[1].sigma_rad
    assert (np.abs(off) < 4 * sigma).all()
    # measured: roll is hardly seen; tilt and pan were stated to 0.0012 deg with the reference and 0.0042 without, and
    # were off by 0.6 of it at most
    usual = np.radians([0.0012, 0.53, 0.0012] if with_reference else [0.0041, 0.74, 0.0042])
    assert (np.abs(off) < 4 * usual).all()
    assert (sigma < 1.5 * usual).all()
    assert (sigma > usual / 1.5).all()
    assert localisation_error(check.corrected, true) < 0.25 * localisation_error(rig, true)


def test_an_axis_that_the_landmarks_do_not_show_stays(rng: np.random.Generator) -> None:
    """Two landmarks a degree apart do not determine roll: noise does not change it."""
    near = ((-3.0, 300.0, 3.0), (3.0, 300.0, 3.0))
    day = morning(rng, uncertain=False, places_m=near)
    true = knocked(day.true, "left", 2, np.radians(0.1))
    check = solve_check(day.true, look(true, day.stands, rng, READINGS), day.table)
    (left, _) = check.movements
    assert left.moved
    assert left.turned_rad[2] == pytest.approx(np.radians(0.1), abs=5 * left.sigma_rad[2])
    # measured: 1.7e-6 deg off, 0.0032 deg stated
    assert left.turned_rad[2] == pytest.approx(np.radians(0.1), abs=np.radians(4 * 0.0032))
    assert np.radians(0.0032) / 1.5 < left.sigma_rad[2] < 1.5 * np.radians(0.0032)
    assert left.sigma_rad[1] > 20 * left.sigma_rad[2]
    assert "deg in pan" in station_line(check, left)


def test_too_little_is_refused(rng: np.random.Generator) -> None:
    day = morning(rng)
    with pytest.raises(GroundstationError, match="got one landmark; wanted two or more"):
        solve_check(day.true, look(day.true, {"m0": day.stands["m0"]}, rng, 4), day.table)
    with pytest.raises(GroundstationError, match=r"known = .*wanted a calibrated orientation"):
        solve_check(day.stated, look(day.true, day.stands, rng, 4), day.table)
    far = knocked(day.true, "left", 2, np.radians(8.0))
    with pytest.raises(GroundstationError, match="wanted a new survey"):
        solve_check(day.true, look(far, day.stands, rng, 4), day.table)
    two = {n: day.stands[n] for n in ("m0", "m1")}
    table = {**day.table, "m0": replace(day.table["m0"], place=day.table["m0"].place + np.array([5.0, 0.0, 0.0]))}
    with pytest.raises(GroundstationError, match="contradict each other"):
        solve_check(day.true, look(day.true, two, rng, 4), table)


def test_the_command_accepts_refuses_corrects_and_records(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    day = morning(rng)
    first = look(day.true, day.stands, rng, READINGS)
    rig = solve_survey(day.stated, first, day.table).rig
    (tmp_path / "rig.toml").write_text(rig_to_toml(rig))
    write_landmarks(tmp_path / "l.csv", day.table)
    write_sightings(tmp_path / "first.csv", first)
    write_sightings(tmp_path / "still.csv", look(day.true, day.stands, rng, READINGS))
    turned = knocked(day.true, "left", 2, 3 * KNOCK_RAD)
    write_sightings(tmp_path / "moved.csv", look(turned, day.stands, rng, READINGS))

    def check(table: str, *more: str) -> int:
        names = [str(tmp_path / table), "--landmarks", str(tmp_path / "l.csv"), "--rig", str(tmp_path / "rig.toml")]
        return main(["calibrate", "check", *names, "--reference", str(tmp_path / "first.csv"), *more])

    assert check("still.csv") == 0
    assert "left: as calibrated (pan" in capsys.readouterr().out
    assert check("moved.csv") == 1
    text = capsys.readouterr().out
    assert "left: mount has turned 0.0" in text
    assert "deg in pan" in text
    assert "m along the runway at 400 m" in text
    assert "right: as calibrated" in text
    assert "refused: left moved" in text
    assert check("moved.csv", "--out", str(tmp_path / "new.toml"), "--report", str(tmp_path / "report")) == 0
    moved = turned_rad(load_rig(tmp_path / "new.toml")["left"], rig["left"])
    assert np.degrees(np.linalg.norm(moved)) == pytest.approx(0.03, abs=0.01)
    page = (tmp_path / "report" / "report.html").read_text()
    assert "corrected: left moved" in page
    assert page.count("<img") == 2
    assert (tmp_path / "report" / "left-landmarks.png").stat().st_size > 10_000
    assert check("nothing.csv") == 1
    assert check("still.csv", "--alarm-deg", "0") == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 2
    records = [json.loads(line) for line in (tmp_path / "rig.checks.jsonl").read_text().splitlines()]
    assert [r["decision"] for r in records] == ["accepted", "refused", "corrected", "refused", "refused"]
    assert records[1]["stations"]["left"]["turned_deg"]["pan"] == pytest.approx(0.03, abs=0.01)
    assert records[0]["to_s"] == pytest.approx(0.1 * (len(first) - 1))
    assert records[0]["files"]["rig"]["sha256"] == records[1]["files"]["rig"]["sha256"]
    assert "no such file" in records[3]["reason"]


def test_a_station_without_sightings_does_not_pass(
    rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    day = morning(rng)
    seen = [s for s in look(day.true, day.stands, rng, 6) if s.station == "left"]
    write_sightings(tmp_path / "s.csv", seen)
    write_landmarks(tmp_path / "l.csv", day.table)
    (tmp_path / "rig.toml").write_text(rig_to_toml(day.true))
    names = [str(tmp_path / "s.csv"), "--landmarks", str(tmp_path / "l.csv"), "--rig", str(tmp_path / "rig.toml")]
    more = ["--out", str(tmp_path / "new.toml"), "--record", str(tmp_path / "log.jsonl")]
    assert main(["calibrate", "check", *names, *more]) == 1
    assert "right: not looked at" in capsys.readouterr().out
    assert not (tmp_path / "new.toml").exists()
    assert json.loads((tmp_path / "log.jsonl").read_text())["not_checked"] == ["right"]


def test_the_survey_s_own_sightings_are_found_beside_the_rig(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """A knock of 0.01 degrees: seen without a word about the table, not without the table."""
    day = morning(rng)
    write_landmarks(tmp_path / "marks.csv", day.table)
    (tmp_path / "lenses.toml").write_text(rig_to_toml(day.stated))
    write_sightings(tmp_path / "first.csv", look(day.true, day.stands, rng, 40))
    write_sightings(tmp_path / "today.csv", look(knocked(day.true, "left", 2, KNOCK_RAD), day.stands, rng, 40))
    marks, rig = f"--landmarks {tmp_path / 'marks.csv'}", tmp_path / "rig.toml"
    assert (
        main(f"calibrate survey {tmp_path / 'first.csv'} {marks} --rig {tmp_path / 'lenses.toml'} --out {rig}".split())
        == 0
    )
    assert (tmp_path / "rig.sightings.csv").read_bytes() == (tmp_path / "first.csv").read_bytes()
    check = f"calibrate check {tmp_path / 'today.csv'} {marks} --rig {rig}"
    capsys.readouterr()
    assert main(check.split()) == 1
    assert "compared with rig.sightings.csv" in capsys.readouterr().out
    assert main([*check.split(), "--reference", "none"]) == 0
    # what is corrected goes by today's sightings from now on, and they agree with it
    assert main([*check.split(), "--out", str(tmp_path / "today.toml")]) == 0
    assert (tmp_path / "today.sightings.csv").read_bytes() == (tmp_path / "today.csv").read_bytes()
    write_sightings(tmp_path / "later.csv", look(knocked(day.true, "left", 2, KNOCK_RAD), day.stands, rng, 40))
    assert main(f"calibrate check {tmp_path / 'later.csv'} {marks} --rig {tmp_path / 'today.toml'}".split()) == 0


def test_the_survey_s_own_table_is_not_todays(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """A copy of the reference agrees with it whatever has moved: refused, on record; half of it new is taken."""
    day = morning(rng)
    write_landmarks(tmp_path / "marks.csv", day.table)
    first = look(day.true, day.stands, rng, 6)
    (tmp_path / "rig.toml").write_text(rig_to_toml(solve_survey(day.stated, first, day.table).rig))
    write_sightings(tmp_path / "rig.sightings.csv", first)
    write_sightings(tmp_path / "today.csv", first)
    check = ["calibrate", "check", str(tmp_path / "today.csv"), "--landmarks", str(tmp_path / "marks.csv")]
    check += ["--rig", str(tmp_path / "rig.toml")]
    assert main(check) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith(
        "groundstation: today.csv: got 72 of 72 rows that stand in rig.sightings.csv, too; wanted"
    )
    assert printed.err.count("\n") == 1
    assert "accepted" not in printed.out
    assert main([*check, "--reference", "none"]) == 1
    records = [json.loads(line) for line in (tmp_path / "rig.checks.jsonl").read_text().splitlines()]
    assert [record["decision"] for record in records] == ["refused", "refused"]
    write_sightings(tmp_path / "today.csv", look(day.true, day.stands, rng, 6))
    assert main(check) == 0


@pytest.mark.parametrize(
    "how", ["u_px to 3 decimals", "pixels to 2 decimals", "angles to 3 decimals", "no t_s", "sorted"]
)
def test_a_table_is_the_same_however_it_is_written(tmp_path: Path, rng: np.random.Generator, how: str) -> None:
    """What rounding leaves of the survey's table shows no knock either; new sightings are another table."""
    day = morning(rng)
    path, survey = tmp_path / "today.csv", tmp_path / "rig.sightings.csv"
    write_sightings(survey, look(day.true, day.stands, rng, 6))

    def rewritten(table: Path) -> tuple[LandmarkSighting, ...]:
        head, *rows = [line.split(",") for line in table.read_text().splitlines()]
        for row in rows:
            if how == "u_px to 3 decimals":
                row[4] = f"{float(row[4]):.3f}"
            elif how == "pixels to 2 decimals":
                row[4:6] = [f"{float(v):.2f}" for v in row[4:6]]
            elif how == "angles to 3 decimals":
                row[2:4] = [f"{float(v):.3f}" for v in row[2:4]]
            elif how == "no t_s":
                del row[6]
        if how == "no t_s":
            del head[6]
        if how == "sorted":
            rows.sort()
        path.write_text("\n".join(",".join(line) for line in [head, *rows]) + "\n")
        return read_sightings(path)

    then = read_sightings(survey)
    message = complaint(InputError, lambda: require_new_sightings(rewritten(survey), then, path, survey))
    assert "today.csv: got 72 of 72 rows that stand in rig.sightings.csv, too" in message
    write_sightings(tmp_path / "new.csv", look(day.true, day.stands, rng, 6))
    require_new_sightings(rewritten(tmp_path / "new.csv"), then, path, survey)


def test_sightings_of_another_set_up_are_no_reference(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stations put up again, calibrated without a survey, and the old table still next to the rig."""
    day = morning(rng)
    moved = knocked(day.true, "left", 2, np.radians(0.4))
    write_landmarks(tmp_path / "marks.csv", day.table)
    write_sightings(tmp_path / "rig.sightings.csv", look(day.true, day.stands, rng, 24))
    today = look(moved, day.stands, rng, 24)
    write_sightings(tmp_path / "today.csv", today)
    rig = solve_survey(day.stated, today, day.table).rig
    (tmp_path / "rig.toml").write_text(rig_to_toml(rig))
    check = (
        f"calibrate check {tmp_path / 'today.csv'} --landmarks {tmp_path / 'marks.csv'} --rig {tmp_path / 'rig.toml'}"
    )
    assert main(check.split()) == 0
    assert "is of another set-up, left stood 0.4" in capsys.readouterr().out
