"""Survey: poses from landmarks without initial values, with consistent sigmas; wrong landmarks found, poor refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from landmark_study.simulated import PLACES_M, SurveyScene, look, morning, turned_rad, write_landmarks, write_sightings
from scipy.stats import chi2

from calibration.joint_covariance import with_covariance
from calibration.landmarks.angles import gather_observations, lasting_variance, stops_of
from calibration.landmarks.check import solve_check
from calibration.landmarks.problem import pose_problem, root_of
from calibration.landmarks.survey import Survey, solve_survey
from calibration.landmarks.survey_advice import advise_survey
from calibration.landmarks.survey_report import rejected
from calibration.sightings import Landmark
from groundstation.cli.main import main
from groundstation.errors import GroundstationError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import Station, load_rig
from groundstation.rig.rig_toml import rig_to_toml

pytestmark = pytest.mark.usefixtures("unrendered_pictures")


def surveyed(
    day: SurveyScene, generator: np.random.Generator, readings: int = 10, words: tuple[str, ...] = ()
) -> Survey:
    return solve_survey(day.stated, look(day.true, day.stands, generator, readings), day.table, words)


def pose_error(survey: Survey, day: SurveyScene, groups: tuple[str, ...]) -> tuple[list[str], np.ndarray]:
    names: list[str] = []
    off: list[float] = []
    for true in day.true.stations:
        own = survey.rig[true.name]
        errors = {"runway_from_base": turned_rad(own, true), "ptu_position": true.ptu_position_m - own.ptu_position_m}
        for group in groups:
            names += [f"{true.name}.{group}.{a}" for a in "xyz"]
            off += list(errors[group])
    return names, np.array(off)


@pytest.mark.parametrize("total_station", [True, False])
def test_errors_are_consistent_with_their_sigmas(total_station: bool) -> None:
    groups = ("runway_from_base", "ptu_position")
    nees, squares, n = 0.0, np.zeros(6 * len(groups)), 8
    for seed in range(n):
        generator = np.random.default_rng([seed, 3])
        day = morning(generator, total_station=total_station)
        survey = surveyed(day, generator, 6)
        names, off = pose_error(survey, day, groups)
        block = survey.fit.block(names)
        nees += off @ np.linalg.solve(block, off)
        squares += off**2 / np.diag(block)
    low, high = chi2.ppf([0.001, 0.999], n * len(squares))
    assert low < nees < high
    low, high = chi2.ppf([0.0001, 0.9999], n)
    assert ((low < squares) & (squares < high)).all()


def test_a_jacobian_is_the_slope_of_its_pixels(rng: np.random.Generator) -> None:
    day = morning(rng)
    marks = [
        *day.table.values(),
        Landmark(name="far", kind="direction", place=np.array([0.1, 0.99, 0.1]), sigma=np.full(3, 1e-3)),
    ]
    places = {m.name: k for k, m in enumerate(marks)}
    seen = look(day.true, {m.name: m for m in marks}, rng, 1)
    stations = {s.name: s for s in day.true.stations}
    observed = [gather_observations(seen, s, places, today=t) for s in stations.values() for t in (True, False)]
    free = [f"{n}.{g}.{a}" for n in stations for g in ("runway_from_base", "ptu_position") for a in "xyz"]
    problem = pose_problem(stations, observed, marks, free, day.stated.calibration_covariance(), moved=list(stations))
    at = rng.normal(0.0, 1.0, len(problem.known))
    jacobian = problem.evaluate(at).jacobian
    step = 1e-4
    for k in range(len(at)):
        ahead, behind = at.copy(), at.copy()
        ahead[k] += step
        behind[k] -= step
        slope = (problem.evaluate(ahead).pixel_px - problem.evaluate(behind).pixel_px) / (2 * step)
        assert jacobian[:, :, k] == pytest.approx(slope, rel=2e-4, abs=2e-4), problem.names


@pytest.mark.parametrize("total_station", [True, False])
def test_no_initial_value_is_needed(rng: np.random.Generator, total_station: bool) -> None:
    """Bases lean by some 15 degrees and face anywhere; of a position nothing is known but by landmarks."""
    day = morning(rng, total_station=total_station, tipped_rad=0.25 if total_station else 0.12)
    survey = surveyed(day, rng)
    for true in day.true.stations:
        found = survey.rig[true.name]
        assert np.degrees(np.linalg.norm(turned_rad(found, true))) < 0.05
        assert found.ptu_position_m == pytest.approx(true.ptu_position_m, abs=0.1)
        assert set(found.known) == {"position", "orientation", "lens"}


def test_far_directions_give_an_orientation_and_one_more_point_a_position(rng: np.random.Generator) -> None:
    day = morning(rng, total_station=False, uncertain=False)
    stars = {
        n: Landmark(name=n, kind="direction", place=np.array(d) / np.linalg.norm(d), sigma=np.zeros(3))
        for n, d in (("vega", (0.3, 0.8, 0.5)), ("altair", (-0.5, 0.7, 0.3)), ("deneb", (0.9, 0.3, 0.4)))
    }
    chosen = {n: day.table[n] for n in ("m0", "m4", "m5")}
    seen = look(day.true, {**{n: day.stands[n] for n in chosen}, **stars}, rng, 10)
    survey = solve_survey(day.stated, seen, {**chosen, **stars})
    names, off = pose_error(survey, day, ("runway_from_base", "ptu_position"))
    low, high = chi2.ppf([0.0001, 0.9999], len(off))
    assert low < off @ np.linalg.solve(survey.fit.block(names), off) < high
    only = [s for s in seen if s.landmark in stars]
    day_known = replace(day.stated, stations=tuple(replace(s, known=("position", "lens")) for s in day.true.stations))
    fixed = solve_survey(day_known, only, stars)
    for true in day.true.stations:
        assert np.degrees(np.linalg.norm(turned_rad(fixed.rig[true.name], true))) < 0.05


def test_the_rigs_axis_errors_are_used(rng: np.random.Generator) -> None:
    day = morning(rng, uncertain=False)
    axes = PtuAxes(pan_zero_rad=0.5, tilt_scale=2e-3, pan_backlash_rad=2e-3, lean_rad=3e-3)
    leaning = replace(day.true, stations=tuple(replace(s, ptu_axes=axes) for s in day.true.stations))
    seen = []
    for s in look(leaning, day.stands, rng, 8):
        pan, tilt = axes.readings(s.pan_rad, s.tilt_rad, s.pan_from, s.tilt_from)
        seen.append(replace(s, pan_rad=pan, tilt_rad=tilt))
    stated = replace(day.stated, stations=tuple(replace(s, ptu_axes=axes) for s in day.stated.stations))
    survey = solve_survey(stated, seen, day.table)
    names, off = pose_error(survey, replace(day, true=leaning), ("runway_from_base",))
    low, high = chi2.ppf([0.0001, 0.9999], len(off))
    assert low < off @ np.linalg.solve(survey.fit.block(names), off) < high
    assert survey.rig["left"].ptu_axes == axes


def test_fixed_cameras_need_no_angles(rng: np.random.Generator) -> None:
    """Landmarks in one picture: the angles of the table mean nothing."""
    places = ((-8, 200, 3), (6, 180, 9), (3, 320, 2), (-4, 150, 6), (10, 260, 14))
    day = morning(rng, uncertain=False, places_m=places, tipped_rad=0.001)
    ahead = tuple(replace(s, fixed=True, runway_from_base_wxyz=np.array([1.0, 0, 0, 0])) for s in day.true.stations)
    true = replace(day.true, stations=ahead)
    seen = []
    for own in ahead:
        for mark in day.stands.values():
            projected = own.geometry().project(mark.place, 0.0, 0.0)
            assert projected is not None
            template = look(replace(true, stations=(own,)), {mark.name: mark}, rng, 6)
            pixels = [projected.pixel + rng.normal(0.0, 0.3, 2) for _ in template]
            seen += [replace(s, pan_rad=1.0, pixel_px=p) for s, p in zip(template, pixels, strict=True)]
    stated = replace(day.stated, stations=tuple(replace(s, fixed=True) for s in day.stated.stations))
    survey = solve_survey(stated, seen, day.table)
    names, off = pose_error(survey, replace(day, true=true), ("runway_from_base",))
    low, high = chi2.ppf([0.0001, 0.9999], len(off))
    assert low < off @ np.linalg.solve(survey.fit.block(names), off) < high


def test_a_boresight_is_estimated_on_request(rng: np.random.Generator) -> None:
    """The camera is 0.4 degrees off on its head, with a sigma of 0.003 in the rig or, freed, of 1 at best."""
    day = morning(rng, uncertain=False)
    slip = np.zeros(21)
    slip[6:9] = np.radians([0.4, 0.0, 0.0])
    true = replace(day.true, stations=tuple(s.changed(slip) for s in day.true.stations))
    seen = look(true, day.stands, rng, 10)
    with pytest.raises(GroundstationError, match="landmarks that contradict each other"):
        solve_survey(day.stated, seen, day.table)
    survey = solve_survey(day.stated, seen, day.table, ("boresight",))
    for name in true.names:
        k = survey.fit.problem.names.index(f"{name}.head_from_camera.x")
        off = survey.fit.change[k] - slip[6]
        assert abs(off) < 4.5 * np.sqrt(survey.fit.covariance[k, k])
        assert np.sqrt(survey.fit.covariance[k, k]) < np.radians(0.05)


def test_landmarks_seen_by_two_stations_correlate_them_in_the_file(rng: np.random.Generator, tmp_path: Path) -> None:
    day = morning(rng, uncertain=False)
    survey = surveyed(day, rng, 40)
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(survey.rig))
    back = load_rig(path).calibration_covariance()
    names = [n for n in survey.fit.problem.names if "runway_from_base" in n]
    places = [back.names.index(n) for n in names]
    written = back.matrix[np.ix_(places, places)]
    joint = survey.fit.block(names)
    off_diagonal = ~np.eye(len(names), dtype=bool)
    assert written[off_diagonal] == pytest.approx(joint[off_diagonal], rel=1e-6)
    # never below what was found
    assert (np.diag(written) >= np.diag(joint)).all()
    pans = [names.index(f"{n}.runway_from_base.z") for n in ("left", "right")]
    correlation = joint[pans[0], pans[1]] / np.sqrt(joint[pans[0], pans[0]] * joint[pans[1], pans[1]])
    assert correlation > 0.3


def test_stations_without_common_landmarks_keep_their_own_blocks(rng: np.random.Generator) -> None:
    day = morning(rng)
    matrix = np.diag([1e-8, 4e-8])
    found = ParameterCovariance(names=("left.runway_from_base.z", "right.runway_from_base.z"), matrix=matrix)
    rig = with_covariance(day.stated, found)
    assert not rig.shared_covariance.names
    assert rig["left"].covariance_parameters[0] == "runway_from_base.z"
    assert rig["left"].covariance[0, 0] == 1e-8
    # the rig's other values stay
    assert set(day.stated["left"].covariance_parameters) < set(rig["left"].covariance_parameters)


def test_a_rig_with_clocks_from_a_flight_can_be_surveyed_and_checked(rng: np.random.Generator, tmp_path: Path) -> None:
    """Clocks, shutters and the DGPS stand in its covariance: landmarks do not show them, and they stay as they were."""
    day = morning(rng)
    times = ("left.camera_clock.offset", "left.ptu_clock.offset", "left.readout", "dgps_clock.offset")
    matrix = np.diag([4e-6, 9e-6, 1e-6, 1e-4])
    matrix[0, 3] = matrix[3, 0] = 1e-5
    flown = with_covariance(day.stated, ParameterCovariance(names=times, matrix=matrix))
    seen = look(day.true, day.stands, rng, 10)
    survey = solve_survey(flown, seen, day.table)
    plain = solve_survey(day.stated, seen, day.table)
    assert set(survey.fit.problem.names) == set(plain.fit.problem.names)
    for own, other in zip(survey.rig.stations, plain.rig.stations, strict=True):
        np.testing.assert_allclose(own.ptu_position_m, other.ptu_position_m, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(turned_rad(own, other), 0.0, atol=1e-9)
    assert advise_survey(survey) == advise_survey(plain)
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(survey.rig))
    again = load_rig(path)
    places = [again.shared_covariance.names.index(name) for name in times]
    np.testing.assert_allclose(again.shared_covariance.matrix[np.ix_(places, places)], matrix, rtol=1e-12)
    assert set(again.calibration_covariance().names) > set(plain.rig.calibration_covariance().names)
    knocked = replace(again, stations=tuple(_panned(s) if s.name == "left" else s for s in again.stations))
    check = solve_check(knocked, look(day.true, day.stands, rng, 10), day.table)
    assert [m.station for m in check.moved] == ["left"]
    assert set(times) < set(check.corrected.shared_covariance.names)


def _panned(station: Station) -> Station:
    change = np.zeros(len(CALIBRATION_PARAMETERS))
    change[CALIBRATION_PARAMETERS.index("runway_from_base.z")] = np.radians(0.5)
    return station.changed(change)


@pytest.mark.parametrize(("total_station", "wrong"), [(True, "m5"), (False, "m2")])
def test_a_wrong_coordinate_is_found_and_named(rng: np.random.Generator, total_station: bool, wrong: str) -> None:
    day = morning(rng, total_station=total_station)
    mark = day.table[wrong]
    table = {**day.table, wrong: replace(mark, place=mark.place + np.array([1.0, 0.0, 0.0]))}
    survey = solve_survey(day.stated, look(day.true, day.stands, rng, 10), table)
    assert list(survey.fit.rejected_landmarks) == [wrong]
    assert wrong in rejected(survey.fit)[0]
    names, off = pose_error(survey, day, ("runway_from_base",))
    low, high = chi2.ppf([0.0001, 0.9999], len(off))
    assert low < off @ np.linalg.solve(survey.fit.block(names), off) < high


def test_single_slips_and_one_stations_mistake_are_left_out(rng: np.random.Generator) -> None:
    day = morning(rng)
    seen = look(day.true, day.stands, rng, 10)
    slip = [k for k, s in enumerate(seen) if s.landmark == "m1"][3]
    seen[slip] = replace(seen[slip], pixel_px=seen[slip].pixel_px + np.array([0.0, 25.0]))
    # the right station took another mast for m0
    seen = [
        replace(s, pixel_px=s.pixel_px + np.array([80.0, 3.0])) if (s.station, s.landmark) == ("right", "m0") else s
        for s in seen
    ]
    survey = solve_survey(day.stated, seen, day.table)
    out = [seen_in_fit for observed in survey.fit.problem.observations for seen_in_fit in observed.sightings]
    gone = {(s.station, s.landmark) for s, kept in zip(out, survey.fit.kept, strict=True) if not kept}
    assert gone == {("left", "m1"), ("right", "m0")}
    assert survey.fit.rejected_landmarks == {}
    assert int((~survey.fit.kept).sum()) == 11


def test_a_step_that_noise_does_not_blur_is_not_averaged_out() -> None:
    generator = np.random.default_rng(1)
    step = 1.0
    for sigma in (0.15, 0.3):
        stands = generator.uniform(0.0, 1.0, 4000)
        read = np.round(stands[:, None] + generator.normal(0.0, sigma, (4000, 400)))
        off = read.mean(axis=1) - stands
        total = ((read - stands[:, None]) ** 2).mean()
        lasting = lasting_variance(step, sigma)
        # the mean of 400 readings still has the lasting part, and a 400th of the rest
        assert (off**2).mean() == pytest.approx(lasting + (total - lasting) / 400, rel=0.06)
    assert lasting_variance(step, 1e-9) == pytest.approx(step**2 / 12, rel=0.02)


def test_the_same_picture_counts_once(rng: np.random.Generator) -> None:
    day = morning(rng)
    once = look(day.true, day.stands, rng, 1)
    station = replace(day.true["left"], ptu_sigma_rad=0.0)
    places = {n: k for k, n in enumerate(day.table)}
    single = gather_observations(once, station, places)
    many = gather_observations([s for s in once for _ in range(7)], station, places)
    assert many.pixel_variance == pytest.approx(7 * np.repeat(single.pixel_variance, 7))
    assert many.angle_variance == pytest.approx(7 * np.repeat(single.angle_variance, 7))
    assert stops_of(many.sightings, station).max() == len(single) - 1


def test_root_of_a_singular_covariance() -> None:
    matrix = np.outer([1e-3, 2.0, 0.0], [1e-3, 2.0, 0.0])
    root = root_of(matrix)
    assert root.shape == (3, 1)
    assert root @ root.T == pytest.approx(matrix)


def test_the_verdict_names_ranges_and_missing_landmarks(rng: np.random.Generator) -> None:
    day = morning(rng)
    two = {n: day.stands[n] for n in ("m0", "m1")}
    survey = solve_survey(day.stated, look(day.true, two, rng, 10), day.table)
    advice = advise_survey(survey)
    assert [row[0] for row in advice.table] == ["100 m", "200 m", "400 m"]
    assert any("a third landmark off the line" in step for step in advice.next_steps)
    assert "good enough" in advice.verdict[1]
    full = advise_survey(solve_survey(day.stated, look(day.true, day.stands, rng, 10), day.table))
    assert not any("a third landmark" in step for step in full.next_steps)
    along = [float(row[4].split()[0]) for row in (*advice.table, *full.table)]
    assert along[3:] < along[:3]
    # what a remedy is weighed against is what the table states
    weighed = [step for a in (advice, full) for step in a.next_steps if " instead of " in step]
    assert weighed
    for a in (advice, full):
        for step in a.next_steps:
            if " instead of " in step:
                assert step.endswith(f"instead of {a.table[1][4]}")


LINE = tuple((10.0 * k, 50.0 + 30.0 * k, 2.0) for k in range(5))
BEARING = tuple((-5.385, 60.0 + 50.0 * k, 1.6) for k in range(4))


@pytest.mark.parametrize(
    ("total_station", "places", "names", "message"),
    [
        (True, PLACES_M, ("m0",), "got one landmark; wanted two or more"),
        (False, PLACES_M, ("m0", "m1"), "got 2 landmarks; wanted three or more"),
        (False, LINE, tuple(f"m{k}" for k in range(5)), "all in one line"),
        (True, BEARING, tuple(f"m{k}" for k in range(4)), "along one bearing"),
    ],
)
def test_too_little_is_refused(
    rng: np.random.Generator,
    total_station: bool,
    places: tuple[tuple[float, ...], ...],
    names: tuple[str, ...],
    message: str,
) -> None:
    day = morning(rng, total_station=total_station, places_m=places)
    seen = look(day.true, {n: day.stands[n] for n in names}, rng, 6)
    seen = [s for s in seen if s.station == "left"]
    with pytest.raises(GroundstationError, match=message):
        solve_survey(day.stated, seen, day.table)


def test_a_contradiction_that_cannot_be_settled_is_refused(rng: np.random.Generator) -> None:
    """Of two landmarks one is wrong, of four with a free position, too: the wrong one is not identifiable."""
    for total_station, names in ((True, ("m0", "m1")), (False, ("m0", "m1", "m3", "m5"))):
        day = morning(rng, total_station=total_station)
        table = {n: day.table[n] for n in names}
        table["m1"] = replace(table["m1"], place=table["m1"].place + np.array([3.0, 0.0, 0.0]))
        seen = look(day.true, {n: day.stands[n] for n in names}, rng, 10)
        with pytest.raises(GroundstationError, match="contradict each other"):
            solve_survey(day.stated, seen, table)


def test_the_command_end_to_end(rng: np.random.Generator, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    day = morning(rng)
    write_sightings(tmp_path / "s.csv", look(day.true, day.stands, rng, 6))
    write_landmarks(tmp_path / "l.csv", day.table)
    (tmp_path / "in.toml").write_text(rig_to_toml(day.stated))
    command = ["calibrate", "survey", str(tmp_path / "s.csv"), "--landmarks", str(tmp_path / "l.csv")]
    command += ["--rig", str(tmp_path / "in.toml")]
    out = tmp_path / "rig.toml"
    assert main([*command, "--out", str(out), "--report", str(tmp_path / "report")]) == 0
    text = capsys.readouterr().out
    assert "verdict:" in text
    assert "along the runway" in text
    load_rig(out).require_known()
    page = (tmp_path / "report" / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert "http" not in page.replace("http-equiv", "")
    assert main([*command, "--out", str(tmp_path / "no.txt")]) == 2
    assert main([*command, "--out", str(tmp_path / "b.toml"), "--free", "magic"]) == 2
    (tmp_path / "l.csv").write_text("landmark,x_m,y_m,z_m\nm0,1,2,3\n")
    assert main([*command, "--out", str(tmp_path / "b.toml")]) == 1
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 3
    assert "got landmark 'm1'" in errors[-1]
    assert not (tmp_path / "b.toml").exists()


def test_landmarks_on_one_line_are_reported(rng: np.random.Generator) -> None:
    """Six along the runway's middle: the turn about it is hardly determined; the advice states what is missing."""
    day = morning(rng)
    line = {n: replace(m, place=np.array([0.0, 40.0 + 40.0 * k, 1.0])) for k, (n, m) in enumerate(day.table.items())}
    steps = advise_survey(solve_survey(day.stated, look(day.true, line, rng, 12), line)).next_steps
    assert sum("well off the line of the others: the turn about that line is known to 0." in s for s in steps) == 2
    around = advise_survey(solve_survey(day.stated, look(day.true, day.stands, rng, 12), day.table)).next_steps
    assert not any("off the line" in s for s in around)
