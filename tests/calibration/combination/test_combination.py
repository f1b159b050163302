"""Rigs of several sources made one: errors as large as is said, axes and what is held, frames, contradictions."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.combination.directions import difference, direction_jacobian, directions, readings_of
from calibration.combination.fusion import Combination, combine
from calibration.combination.shared_prior import CombinationError, RigSource
from calibration.combination.text_report import common_direction, relative_direction
from calibration.joint_covariance import with_covariance
from calibration.stars.simulated.night_draw import drawn_station
from calibration.stars.simulated.night_score import direction_errors_deg
from groundstation.arrays import FloatArray
from groundstation.cli.main import main
from groundstation.errors import RigError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station, load_rig
from groundstation.rig.rig_toml import rig_to_toml

pytestmark = pytest.mark.usefixtures("unrendered_pictures")

BASE = tuple(f"runway_from_base.{axis}" for axis in "xyz")
BORESIGHT = tuple(f"head_from_camera.{axis}" for axis in "xyz")
LENS = ("focal.x", "focal.y", "principal_point.x", "principal_point.y")
PLACE = tuple(f"ptu_position.{axis}" for axis in "xyz")
TRUE = Rig(
    stations=tuple(
        replace(drawn_station(name, x, 10.96, 0.00625), known=("position", "orientation", "lens"))
        for name, x in (("left", -5.0), ("right", 5.0))
    )
)
HEADING_RAD = float(np.radians(1.0))


def sigma_of(name: str, scale: float) -> float:
    if name in LENS:
        return 1.0 * scale
    return (0.01 if name in PLACE else float(np.radians(0.01))) * scale


def source(
    name: str,
    stated: Sequence[str],
    random: np.random.Generator,
    scale: float = 1.0,
    heading_rad: float | None = None,
) -> RigSource:
    """Return a rig with errors drawn by a random covariance over both stations, which it states."""
    names = tuple(f"{station}.{n}" for station in TRUE.names for n in stated)
    sigma = np.array([sigma_of(n.partition(".")[2], scale) for n in names])
    mixed = random.normal(size=(len(names), 3 * len(names)))
    correlation = mixed @ mixed.T
    correlation /= np.sqrt(np.outer(np.diag(correlation), np.diag(correlation)))
    matrix = correlation * np.outer(sigma, sigma)
    error = random.multivariate_normal(np.zeros(len(names)), matrix)
    rig = changed(TRUE, dict(zip(names, error.tolist(), strict=True)))
    if heading_rad is not None:
        rig = changed(rig, {f"{station}.{BASE[2]}": heading_rad for station in TRUE.names})
    return RigSource(
        name=name,
        rig=with_covariance(rig, ParameterCovariance(names=names, matrix=matrix)),
        from_north=heading_rad is not None,
    )


def nearly(stated: ParameterCovariance) -> ParameterCovariance:
    """Return a covariance that is as good as the same, and no copy."""
    return ParameterCovariance(names=stated.names, matrix=1.0001 * stated.matrix)


def changed(rig: Rig, change: dict[str, float]) -> Rig:
    stations = []
    for station in rig.stations:
        whole = np.zeros(len(CALIBRATION_PARAMETERS))
        for k, name in enumerate(CALIBRATION_PARAMETERS):
            whole[k] = change.get(f"{station.name}.{name}", 0.0)
        stations.append(station.changed(whole))
    return replace(rig, stations=tuple(stations))


def errors_of(found: Combination, true: Rig = TRUE) -> FloatArray:
    """Return how far (p,) the truth is from a combination's parameters."""
    rows = []
    for name in found.names:
        station, _, short = name.partition(".")
        rows.append(difference(true[station], found.rig[station], short))
    return np.array(rows)


def test_errors_are_as_large_as_is_said_and_less_than_of_each_source() -> None:
    """Expected: eᵀC⁻¹e within the 99.8 % of chi-square over drawn sources: marks, stars of the north, a flight."""
    nees, size, misfit, degrees = 0.0, 0, 0.0, 0
    for seed in range(12):
        random = np.random.default_rng([seed, 77])
        heading = random.normal(0.0, HEADING_RAD)
        sources = (
            source("marks", (*BASE, *PLACE), random, 1.5),
            source("flight", BASE, random, 1.0),
            source("stars", (*BASE, *BORESIGHT, *LENS), random, 0.5, heading),
            source("sky", (*BASE, *BORESIGHT, *LENS), random, 1.0, heading),
        )
        # what marks and flight hold is the truth's: those of the lens and boresight that the stars find are drawn
        found = combine(sources, HEADING_RAD)
        error = errors_of(found)
        nees += float(error @ np.linalg.solve(found.covariance, error))
        size += len(error)
        misfit, degrees = misfit + found.chi_square, degrees + found.degrees
        for one in sources:
            own, together = (relative_direction(rig, "left", "right") for rig in (one.rig, found.rig))
            assert own is not None
            assert together is not None
            assert together.pan_deg < own.pan_deg
        assert found.heading_rad is not None
        assert found.heading_sigma_rad is not None
        assert abs(found.heading_rad - heading) < 4.0 * found.heading_sigma_rad
    low, high = chi2.ppf([0.001, 0.999], size)
    assert low < nees < high
    low, high = chi2.ppf([0.001, 0.999], degrees)
    assert low < misfit < high


def test_one_frame_needs_no_heading_and_two_like_sources_halve_the_variance() -> None:
    """Expected: two independent sources whose covariances are as good as equal, each with errors of its own."""
    random = np.random.default_rng(3)
    one = source("stars", (*BASE, *BORESIGHT), random)
    stated = one.rig.calibration_covariance()
    error = random.multivariate_normal(np.zeros(len(stated.names)), stated.matrix)
    moved = changed(TRUE, dict(zip(stated.names, error.tolist(), strict=True)))
    again = RigSource(name="again", rig=with_covariance(moved, nearly(stated)))
    found = combine((one, again), HEADING_RAD)
    assert found.heading_rad is None
    own, together = (common_direction(rig) for rig in (one.rig, found.rig))
    assert own is not None
    assert together is not None
    assert together.pan_deg == pytest.approx(own.pan_deg / np.sqrt(2.0), rel=1e-3)
    assert together.tilt_deg == pytest.approx(own.tilt_deg / np.sqrt(2.0), rel=1e-3)


def test_rigs_with_other_axes_agree_where_they_look_alike() -> None:
    """Expected: a second rig with another zero of pan, scale and boresight that looks the same way, to 0.001 deg."""
    random = np.random.default_rng(8)
    first = source("first", (*BASE, *BORESIGHT), random)
    # the same directions by other axes: base and boresight take up a zero and what a scale does in the mean
    axes = replace(TRUE.stations[0].ptu_axes, pan_zero_rad=0.01, tilt_scale=0.0005)
    stations = []
    for station in first.rig.stations:
        other = replace(station, ptu_axes=axes)
        readings = readings_of(station)
        for _ in range(4):
            off = directions(station, readings) - directions(other, readings)
            by = direction_jacobian(other, readings, (*BASE, *BORESIGHT))
            step = np.zeros(len(CALIBRATION_PARAMETERS))
            for name, value in zip((*BASE, *BORESIGHT), np.linalg.pinv(by, rcond=1e-6) @ off.ravel(), strict=True):
                step[CALIBRATION_PARAMETERS.index(name)] = value
            other = other.changed(step)
        stations.append(other)
    stated = nearly(first.rig.calibration_covariance())
    second = RigSource(name="second", rig=with_covariance(replace(first.rig, stations=tuple(stations)), stated))
    found = combine((first, second), HEADING_RAD)
    assert found.chi_square < 0.5
    for name in TRUE.names:
        assert np.abs(direction_errors_deg(found.rig[name], first.rig[name])).max() < 0.003


def test_what_a_flight_holds_goes_with_what_it_found() -> None:
    """Expected: a flight with a boresight 0.3 deg off, its base turned back, adds its directions, not its boresight."""
    random = np.random.default_rng(5)
    stars = source("stars", (*BASE, *BORESIGHT), random, 1.0)
    flight = source("flight", BASE, random, 0.2)
    off = float(np.radians(0.3))
    turned = []
    for station in flight.rig.stations:
        wrong = changed(Rig(stations=(station,)), {f"{station.name}.{BORESIGHT[1]}": off}).stations[0]
        readings = readings_of(station)
        for _ in range(3):
            away = directions(station, readings) - directions(wrong, readings)
            by = np.linalg.pinv(direction_jacobian(wrong, readings, BASE))
            step = np.zeros(len(CALIBRATION_PARAMETERS))
            step[:3] = by @ away.ravel()
            wrong = wrong.changed(step)
        turned.append(wrong)
    held = replace(flight, rig=replace(flight.rig, stations=tuple(turned)))
    found, wanted = (combine((stars, one), HEADING_RAD) for one in (held, flight))
    assert found.chi_square == pytest.approx(wanted.chi_square, abs=2.0)
    for name in TRUE.names:
        assert np.abs(direction_errors_deg(found.rig[name], wanted.rig[name])).max() < 0.004
        assert abs(difference(found.rig[name], stars.rig[name], BORESIGHT[1])) < np.radians(0.05)


def workshop(random: np.random.Generator) -> RigSource:
    """Return a rig whose boresight and lens a workshop has measured, with errors of it."""
    names = tuple(f"{station}.{n}" for station in TRUE.names for n in (*BORESIGHT, *LENS))
    sigma = np.array([2.0 * sigma_of(n.partition(".")[2], 1.0) for n in names])
    matrix = np.diag(sigma**2)
    error = dict(zip(names, random.normal(0.0, sigma).tolist(), strict=True))
    return RigSource(
        name="workshop", rig=with_covariance(changed(TRUE, error), ParameterCovariance(names=names, matrix=matrix))
    )


def calibrated_from(
    prior: RigSource, name: str, told: Sequence[str], random: np.random.Generator, scale: float = 1.0
) -> RigSource:
    """Return the prior's rig after a calibration whose data tell some parameters, with errors of their own."""
    before = prior.rig.calibration_covariance()
    data = source(name, told, random, scale)
    stated = data.rig.calibration_covariance()
    names = tuple(dict.fromkeys((*stated.names, *before.names)))
    information, right = np.zeros((len(names),) * 2), np.zeros(len(names))
    for rig, known in ((prior.rig, before), (data.rig, stated)):
        rows = [names.index(n) for n in known.names]
        inverse = np.linalg.inv(known.matrix)
        value = [
            difference(rig[n.partition(".")[0]], TRUE[n.partition(".")[0]], n.partition(".")[2]) for n in known.names
        ]
        information[np.ix_(rows, rows)] += inverse
        right[rows] += inverse @ np.array(value)
    covariance = np.linalg.inv(information)
    covariance = 0.5 * (covariance + covariance.T)
    found = changed(TRUE, dict(zip(names, (covariance @ right).tolist(), strict=True)))
    return RigSource(name=name, rig=with_covariance(found, ParameterCovariance(names=names, matrix=covariance)))


def test_what_was_known_before_counts_once() -> None:
    """Expected: two surveys of one workshop's rig know its focal length as the workshop, to 2 px, and not to 1.4."""
    random = np.random.default_rng(11)
    before = workshop(random)
    both = tuple(calibrated_from(before, name, BASE, random) for name in ("first", "second"))
    focal = f"left.{LENS[0]}"
    with pytest.raises(
        CombinationError, match=r"first, second: got one and the same covariance of left\.\w+ in both.*--prior"
    ):
        combine(both, HEADING_RAD)
    found = combine(both, HEADING_RAD, before)
    assert found.began == ("first", "second")
    k = found.names.index(focal)
    assert np.sqrt(found.covariance[k, k]) == pytest.approx(2.0, rel=1e-3)
    assert difference(found.rig["left"], before.rig["left"], LENS[0]) == pytest.approx(0.0, abs=0.01)
    own, together = (relative_direction(rig, "left", "right") for rig in (both[0].rig, found.rig))
    assert own is not None
    assert together is not None
    assert together.pan_deg < own.pan_deg


def test_errors_are_as_large_as_is_said_of_sources_that_began_with_one_prior() -> None:
    """Expected: eᵀC⁻¹e and the agreement within the 99.8 % of chi-square; counted as independent they are above it."""
    nees, size, misfit, degrees, counted_twice = 0.0, 0, 0.0, 0, 0.0
    for seed in range(6):
        random = np.random.default_rng([seed, 78])
        before = workshop(random)
        told = (*BASE, *BORESIGHT, *LENS)
        sources = (
            calibrated_from(before, "stars", told, random, 4.0),
            calibrated_from(before, "sky", told, random, 4.0),
            source("marks", (*BASE, *PLACE), random, 1.5),
        )
        found = combine(sources, HEADING_RAD, before)
        assert found.began == ("stars", "sky")
        error = errors_of(found)
        nees += float(error @ np.linalg.solve(found.covariance, error))
        size += len(error)
        misfit, degrees = misfit + found.chi_square, degrees + found.degrees
        twice = combine(sources, HEADING_RAD)
        error = errors_of(twice)
        counted_twice += float(error @ np.linalg.solve(twice.covariance, error))
    low, high = chi2.ppf([0.001, 0.999], size)
    assert low < nees < high
    assert counted_twice > high
    low, high = chi2.ppf([0.001, 0.999], degrees)
    assert low < misfit < high


def test_a_rig_that_is_given_twice_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(6)
    one = source("stars", (*BASE, *BORESIGHT), random)
    with pytest.raises(CombinationError, match="again: got the calibration of stars once more; wanted each once"):
        combine((one, replace(one, name="again")), HEADING_RAD)
    (tmp_path / "sub").mkdir()
    for name in ("a.toml", "sub/a.toml"):
        (tmp_path / name).write_text(rig_to_toml(one.rig))
    words = ["calibrate", "combine", "--out", str(tmp_path / "rig.toml"), str(tmp_path / "a.toml")]
    assert main([*words, str(tmp_path / "sub" / ".." / "a.toml")]) == 2
    assert "got the same file as" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "sub" / "a.toml")]) == 1
    assert f"{tmp_path}/sub/a.toml: got the calibration of {tmp_path}/a.toml once more" in capsys.readouterr().err
    assert main([*words, str(tmp_path / "sub" / "a.toml"), "--heading", "45"]) == 2
    assert "--heading: got 45 deg; wanted at most 20" in capsys.readouterr().err
    assert not (tmp_path / "rig.toml").exists()


@pytest.mark.parametrize("turned_deg", [1.0, 5.0, 20.0])
def test_a_frame_that_is_far_turned_is_found_as_far(turned_deg: float) -> None:
    random = np.random.default_rng(9)
    one = source("marks", BASE, random)
    other = source("stars", BASE, random, 1.0, float(np.radians(turned_deg)))
    found = combine((one, other), float(np.radians(20.0)))
    assert found.heading_rad is not None
    assert np.degrees(found.heading_rad) == pytest.approx(turned_deg, abs=0.05)


def test_rigs_that_contradict_each_other_are_refused() -> None:
    random = np.random.default_rng(2)
    stars, flight = source("stars", (*BASE, *BORESIGHT), random), source("flight", BASE, random)
    knocked = replace(flight, rig=changed(flight.rig, {f"left.{BASE[0]}": float(np.radians(0.15))}))
    combine((stars, flight), HEADING_RAD)
    with pytest.raises(CombinationError, match=r"contradict each other: chi-square \d+ of 6 \(stars \d+, flight \d+\)"):
        combine((stars, knocked), HEADING_RAD)


def test_what_cannot_be_combined_is_refused() -> None:
    random = np.random.default_rng(2)
    stars = source("stars", BASE, random)
    with pytest.raises(CombinationError, match="got 1 rig; wanted two or more"):
        combine((stars,), HEADING_RAD)
    with pytest.raises(CombinationError, match="state no covariance"):
        combine((RigSource(name="a", rig=TRUE), RigSource(name="b", rig=TRUE)), HEADING_RAD)
    with pytest.raises(RigError, match="b: got no covariance; wanted a rig that a calibration has written"):
        combine((stars, RigSource(name="b", rig=TRUE)), HEADING_RAD)
    one = RigSource(name="one", rig=replace(TRUE, stations=TRUE.stations[:1]))
    with pytest.raises(RigError, match="got stations left; wanted left, right, as in stars"):
        combine((stars, one), HEADING_RAD)
    smaller = [replace(s, lens=replace(s.lens, image_size_px=(640, 480))) for s in TRUE.stations]
    with pytest.raises(RigError, match="another head or camera of station left"):
        combine((stars, RigSource(name="x", rig=replace(TRUE, stations=tuple(smaller)))), HEADING_RAD)


def test_a_direction_s_derivatives_are_those_of_its_parameters() -> None:
    station: Station = TRUE.stations[0]
    readings = readings_of(station)
    by = direction_jacobian(station, readings, CALIBRATION_PARAMETERS)
    step = np.random.default_rng(4).normal(0.0, 1e-4, len(CALIBRATION_PARAMETERS))
    moved = directions(station.changed(step), readings) - directions(station, readings)
    assert np.abs(by @ step - moved.ravel()).max() < 1e-7
    # neither a position nor a lever arm turns a direction
    assert np.abs(by[:, [CALIBRATION_PARAMETERS.index(name) for name in PLACE]]).max() < 1e-9


def test_the_command_writes_one_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(6)
    for one in (
        source("marks", (*BASE, *PLACE), random),
        source("stars", (*BASE, *BORESIGHT), random, 0.5, HEADING_RAD),
    ):
        (tmp_path / f"{one.name}.toml").write_text(rig_to_toml(one.rig))
    words = [str(tmp_path / "marks.toml"), "--north", str(tmp_path / "stars.toml"), "--heading", "2"]
    out = tmp_path / "rig.toml"
    assert main(["calibrate", "combine", *words, "--out", str(out), "--report", str(tmp_path / "report")]) == 0
    said = capsys.readouterr().out
    assert "the frame is turned by" in said
    assert "together" in said
    assert said.count("left against right:") == 3
    assert "marks.toml, stars.toml agree" in (tmp_path / "report" / "report.html").read_text()
    drawn = {path.name for path in (tmp_path / "report").glob("*.png")}
    assert drawn == {"left-right-sigma.png", "left-directions.png", "right-directions.png"}
    rig = load_rig(out)
    assert f"left.{BORESIGHT[0]}" in rig.calibration_covariance().names
    assert f"left.{PLACE[0]}" in rig.calibration_covariance().names
    assert main(["calibrate", "combine", words[0], "--out", str(out)]) == 1
    assert "got 1 rig; wanted two or more of the same heads" in capsys.readouterr().err
