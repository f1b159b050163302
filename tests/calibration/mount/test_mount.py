"""`calibrate mount`: errors within their sigmas, what cannot be known held, outliers named, bad input refused."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from calibration.lens.boards import parse_board
from calibration.mount.calibrate import StationMount, calibrate_mounts, calibrate_station, write_rig
from calibration.mount.fit import MountFitError
from calibration.mount.parameters import USUAL_WORDS, choose_mount, mount_words
from calibration.mount.pointing import pointing_sigma
from calibration.mount.problem import Mark, MarkKind, MountProblem, MountSightings
from calibration.mount.sightings_from_pictures import find_lamp
from calibration.mount.standstills import standstills, with_shared_error
from calibration.mount.text_report import format_mount, verdict
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.geometry.rotation import rotation_from_vector, rotation_x, rotation_y, wxyz_from_matrix
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from tests.calibration.mount.mounts import (
    GRID_ROWS,
    NOISE_DEG,
    NOISE_PX,
    STEP_DEG,
    Noise,
    head_on_the_grid,
    look,
    marks_around,
    off_by,
    plain_station,
    spoiled,
)

pytestmark = pytest.mark.usefixtures("unrendered_pictures")

NOTHING_STATED = ParameterCovariance.nothing()
UNKNOWN_BOARD = Mark(
    name="board",
    kind=MarkKind.BOARD,
    place_m=np.array([0.0, 50.0, 0.0]),
    sigma=np.zeros(3),
    runway_from_board=np.eye(3),
)


def standing_board(station, away_m=6.0):
    turn = rotation_x(-np.pi / 2) @ rotation_from_vector(np.array([0.3, 0.4, 0.1]))
    place = station.ptu_position_m + np.array([0.05 * away_m, away_m, 0.2 * away_m])
    return replace(UNKNOWN_BOARD, place_m=place, runway_from_board=turn)


def board_body():
    return parse_board("charuco:9x7:0.04:0.03").corners_m - np.array([0.18, 0.14, 0.0])


@pytest.fixture
def made(rng):
    station = plain_station()
    true = spoiled(station, rng)
    return station, true, marks_around(true, rng)


def test_every_derivative_has_its_numeric_twin(made, rng) -> None:
    station, true, marks = made
    unknown = marks_around(true, rng, known=False)
    board = standing_board(true)
    both = [*marks[:6], *unknown[6:], board]
    seen = look(true, tuple(both), rng, 39, bodies={"board": board_body()})
    names = {
        **choose_mount(station, NOTHING_STATED, both, ("zero", *USUAL_WORDS)),
        **choose_mount(station, NOTHING_STATED, both, USUAL_WORDS),
    }
    names = tuple({**names, "ptu_position.x": 1.0, "ptu_position.z": 1.0})
    problem = MountProblem(
        station=station, sightings=seen, marks=tuple(both), names=names, prior_sigma=np.ones(len(names))
    )
    at = 3e-3 * rng.normal(size=len(names))
    jacobian, step = problem.predict(at).jacobian, 1e-6
    for k, name in enumerate(names):
        # the projection centre does not move what is infinitely far away
        d = np.zeros(len(names))
        d[k] = step
        numeric = (problem.predict(at + d).pixel_px - problem.predict(at - d).pixel_px) / (2 * step)
        size = max(1.0, float(np.abs(numeric).max()))
        np.testing.assert_allclose(jacobian[:, :, k] / size, numeric / size, atol=1e-4, err_msg=name)


def test_errors_are_consistent_with_their_sigmas() -> None:
    squares: dict[str, list[float]] = {}
    for seed in range(8):
        rng = np.random.default_rng([41, seed])
        station = plain_station()
        true = spoiled(station, rng)
        marks = marks_around(true, rng)
        one = calibrate_station(station, NOTHING_STATED, look(true, marks, rng, 120), marks, USUAL_WORDS)
        for name, off in off_by(one.after, true).items():
            if name in one.fit.problem.names:
                squares.setdefault(name, []).append((off / one.fit.sigma(name)) ** 2)
    assert {"lean", "pan_scale", "tilt_scale", "pan_backlash", "tilt_backlash", "head_from_camera.z"} <= set(squares)
    for name, values in squares.items():
        low, high = chi2.ppf([5e-5, 1 - 5e-5], len(values))
        assert low < sum(values) < high, name


def errors_and_covariance(one: StationMount, true: Station) -> tuple[np.ndarray, np.ndarray]:
    """Return true less found of everything free but marks, and its covariance."""
    off = {name: v for name, v in off_by(one.after, true).items() if name in one.fit.problem.names}
    places = [one.fit.problem.names.index(name) for name in off]
    return np.array(list(off.values())), one.fit.covariance[np.ix_(places, places)]


def held_to(off: float, sigma: float, usual: float, what: str) -> None:
    """Hold an error and its sigma against a sigma that is not the fit's own, so that an inflated one does not pass."""
    assert abs(off) < 4.0 * usual, what
    assert usual / 1.5 < sigma < 1.5 * usual, what


def backlash_bound(standstills: int, px: float) -> float:
    """Return the Cramér-Rao bound of a backlash, rad: the difference of two means over half of the standstills each.

    One standstill's angle is uncertain by the encoder's noise, its step and the mark's pixel. The bound is reached as
    far as everything else is known from other sightings and both senses are as frequent.
    """
    focal_px = float(plain_station().lens.focal_px[0])
    one = np.hypot(np.radians(np.hypot(NOISE_DEG, STEP_DEG / np.sqrt(12.0))), px / focal_px)
    return float(2.0 * one / np.sqrt(standstills))


def squares_are_chi_square(one: StationMount, true: Station) -> None:
    """Hold eᵀC⁻¹e of all that is free between two bounds of chi-square, 99.8 %: C is neither too small nor too wide."""
    off, covariance = errors_and_covariance(one, true)
    low, high = chi2.ppf([0.001, 0.999], len(off))
    assert low < float(off @ np.linalg.solve(covariance, off)) < high


def test_what_a_step_hides_lasts_as_long_as_the_head_stands() -> None:
    """Encoders whose step is all their noise, 8 rows at each of 48 standstills, each row with a time of its own.

    With as many standstills as rows eᵀC⁻¹e came to 3 times its degrees of freedom.
    """
    squares, count = 0.0, 0
    for seed in range(5):
        head = head_on_the_grid(np.random.default_rng([43, seed]), 8, noise_deg=0.0)
        one = calibrate_station(head.station, NOTHING_STATED, head.seen, head.marks, USUAL_WORDS)
        off, covariance = errors_and_covariance(one, head.true)
        squares += float(off @ np.linalg.solve(covariance, off))
        count += len(off)
    low, high = chi2.ppf([0.001, 0.999], count)
    assert low < squares < high


def test_a_standstill_is_one_whatever_its_stamps() -> None:
    """Rows of tables at other times, of one place: no more standstills; a step, or another sense of motion, is one."""
    station = plain_station(ptu_sigma_rad=0.0)
    step = station.ptu_resolution_rad
    readings = np.array([[0.2, 0.1]] * 3 + [[0.2 + step, 0.1]] * 2 + [[0.2, 0.1]])
    still = np.ones((6, 2))
    assert standstills(readings, still, station).tolist() == [0, 0, 0, 1, 1, 2]
    other = np.where(np.arange(6)[:, None] < 2, 1.0, [1.0, -1.0])
    assert standstills(readings, other, station).tolist() == [0, 0, 1, 2, 2, 3]
    noisy = replace(station, ptu_sigma_rad=step)
    assert standstills(readings, still, noisy).tolist() == [0] * 6


def test_shared_errors_are_whitened(rng: np.random.Generator) -> None:
    """Against the Cholesky root of each standstill's whole covariance: the same squares of everything."""
    white, by_angle = rng.normal(size=(14, 4)), rng.normal(size=(14, 2))
    by_angle[5:9] = by_angle[5]
    stand = np.repeat([4, 1, 7], [5, 4, 5])
    found = with_shared_error(white, by_angle, stand, 0.6)
    covariance = np.eye(14) + 0.6 * (by_angle @ by_angle.T) * (stand[:, None] == stand)
    np.testing.assert_allclose(found.T @ found, white.T @ np.linalg.solve(covariance, white), atol=1e-12)


def test_the_boresight_alone_on_the_grid_of_the_manual() -> None:
    """48 standstills of 40 rows: 0.003° about each axis of the head, claimed and come true (two heads)."""
    errors, squares = [], 0.0
    for seed in range(2):
        head = head_on_the_grid(np.random.default_rng([44, seed]), GRID_ROWS)
        one = calibrate_station(head.station, NOTHING_STATED, head.seen, head.marks, USUAL_WORDS)
        names = [f"head_from_camera.{axis}" for axis in "xyz"]
        sigma = np.array([one.fit.sigma(name) for name in names])
        assert np.degrees(sigma).max() < 0.003
        off = off_by(one.after, head.true)
        errors += [off[name] for name in names]
        assert float(np.sum((np.array(errors[-3:]) / sigma) ** 2)) < 3 * chi2.ppf(0.999, 1)
        squares += float(np.sum((np.array(errors[-3:]) / sigma) ** 2))
        for name, claimed, usual_deg in zip(names, sigma, (0.0008, 0.0021, 0.0029), strict=True):
            # measured on these two heads, which agree to 5 %
            held_to(off[name], claimed, np.radians(usual_deg), name)
    low, high = chi2.ppf([0.001, 0.999], len(errors))
    assert low < squares < high
    assert float(np.degrees(np.sqrt(np.mean(np.square(errors))))) < 0.003


def test_the_cameras_direction_is_that_of_the_rig(made, rng) -> None:
    station, true, marks = made
    one = calibrate_station(station, NOTHING_STATED, look(true, marks, rng, 300), marks, USUAL_WORDS)
    at = pointing_sigma(one.fit)
    assert at.worst_deg < 0.003
    assert verdict(one)[0].startswith("good")
    assert not [line for line in verdict(one) if line.startswith("doubtful")]
    off = []
    for pan in np.radians((-30.0, 0.0, 30.0)):
        for tilt in np.radians((0.0, 15.0)):
            rays = []
            for found in (one.after, true):
                u, v = found.lens.principal_point_px
                angles = found.ptu_axes.angles(pan, tilt, 1.0, 1.0)
                rays.append(found.geometry().ray(u, v, *angles).direction_runway)
            off.append(np.degrees(np.linalg.norm(rays[0] - rays[1])))
    assert max(off) < 4.0 * np.hypot(at.pan_deg, at.tilt_deg)
    # four drawn heads claimed 0.0015° to 0.0017° in pan and 0.0013° to 0.0014° in tilt, and were off by 0.0038° at most
    assert max(off) < 4.0 * np.hypot(0.0016, 0.0013)
    assert 0.0016 / 1.5 < at.pan_deg < 1.5 * 0.0016
    assert 0.0013 / 1.5 < at.tilt_deg < 1.5 * 0.0013


def test_held_out_residuals_are_noise(made, rng) -> None:
    station, true, marks = made
    one = calibrate_station(station, NOTHING_STATED, look(true, marks, rng, 300), marks, USUAL_WORDS)
    held_out = one.fit.held_out
    assert held_out is not None
    assert len(held_out.residual_px) == 60
    assert held_out.rms_px == pytest.approx(held_out.expected_px, rel=0.25)
    assert held_out.expected_px > held_out.noise_px


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_no_initial_value_is_needed(rng, quarter: int) -> None:
    ideal = plain_station()
    camera = rotation_y(0.5 * np.pi * quarter + 0.05) @ rotation_x(-0.5 * np.pi + 0.04)
    base = rotation_from_vector(np.array([0.02, -0.01, 1.9]))
    turned = replace(
        ideal, head_from_camera_wxyz=wxyz_from_matrix(camera), runway_from_base_wxyz=wxyz_from_matrix(base)
    )
    marks = marks_around(ideal, rng)
    # the base has another orientation: marks are moved with it, so that the head can reach them
    marks = tuple(
        replace(m, place_m=base @ (m.place_m - far) + far)
        for m in marks
        for far in [ideal.ptu_position_m if m.kind is MarkKind.POINT else np.zeros(3)]
    )
    seen = look(turned, marks, rng, 60)
    nothing_known = replace(ideal, known=("position", "lens"))
    one = calibrate_station(nothing_known, NOTHING_STATED, seen, marks, USUAL_WORDS)
    off = off_by(one.after, turned)
    for name in ("head_from_camera.x", "head_from_camera.y", "runway_from_base.x"):
        assert abs(off[name]) < 5.0 * one.fit.sigma(name)
    # over sixteen draws, four of each quarter, the sigmas were 0.0043°–0.0053°, 0.025°–0.034° and 0.0026°–0.0032°
    for name, usual_deg in (
        ("head_from_camera.x", 0.0048),
        ("head_from_camera.y", 0.029),
        ("runway_from_base.x", 0.0028),
    ):
        held_to(off[name], one.fit.sigma(name), np.radians(usual_deg), name)
    squares_are_chi_square(one, turned)
    assert "orientation" in one.after.known


def test_marks_of_unknown_place_leave_the_base_alone(made, rng) -> None:
    station, true, _ = made
    marks = marks_around(true, rng, known=False)
    one = calibrate_station(station, NOTHING_STATED, look(true, marks, rng, 200), marks, USUAL_WORDS)
    np.testing.assert_array_equal(one.after.runway_from_base_wxyz, station.runway_from_base_wxyz)
    assert not [name for name in one.after.covariance_parameters if name.startswith("runway_from_base")]
    off = off_by(one.after, true)
    for name in ("pan_backlash", "tilt_backlash", "head_from_camera.y"):
        assert abs(off[name]) < 4.5 * one.fit.sigma(name), name
    for name in ("pan_backlash", "tilt_backlash"):
        held_to(off[name], one.fit.sigma(name), backlash_bound(200, NOISE_PX), name)
    # four drawn heads: 0.018° to 0.021°
    held_to(off["head_from_camera.y"], one.fit.sigma("head_from_camera.y"), np.radians(0.02), "head_from_camera.y")
    squares_are_chi_square(one, true)
    text = format_mount(one)
    assert "no mark of known place" in text


def lone_mark(station: Station, tilt_deg: float) -> Mark:
    up = np.radians(tilt_deg)
    place = station.ptu_position_m + 60.0 * np.array([-0.1 * np.cos(up), np.cos(up), np.sin(up)])
    return Mark(name="lamp", kind=MarkKind.UNKNOWN_POINT, place_m=place, sigma=np.zeros(3), runway_from_board=np.eye(3))


def unknown_place(mark: Mark) -> Mark:
    return replace(mark, place_m=np.array([0.0, 50.0, 0.0]))


def test_marks_of_unknown_place_near_the_horizon_write_no_rig(made, rng, tmp_path, capsys) -> None:
    """A lone lamp, then two, leave the boresight's pan and tilt open; refused with what is missing."""
    station, true, _ = made
    marks = (lone_mark(true, 6.0), replace(lone_mark(true, 12.0), name="lantern"))
    for some, expected in ((marks[:1], "60 sightings of one mark"), (marks, "60 sightings of 2 marks")):
        command = tables(tmp_path, station, look(true, some, rng, 60), some)
        at = command.index("--landmarks")
        assert main([*command[:at], *command[at + 2 :]]) == 1
        error = capsys.readouterr().err.strip()
        assert f"got {expected} of unknown place: the camera's orientation is undetermined by 0." in error
        assert "(--landmarks)" in error
        assert "or a board" in error
        assert len(error.splitlines()) == 1
        assert not (tmp_path / "out.toml").exists()


def test_a_lone_high_landmark_determines_the_cameras_direction(made, rng) -> None:
    """50 degrees up the boresight comes out within its sigma, and better than the rig's 0.3 deg."""
    station, true, _ = made
    lamp = lone_mark(true, 50.0)
    one = calibrate_station(station, NOTHING_STATED, look(true, (lamp,), rng, 60), (unknown_place(lamp),), USUAL_WORDS)
    off = off_by(one.after, true)
    for axis, usual_deg in (("x", 0.079), ("z", 0.14)):
        name = f"head_from_camera.{axis}"
        place = one.after.covariance_parameters.index(name)
        assert abs(off[name]) < 4.0 * np.sqrt(one.after.covariance[place, place]) < np.radians(0.8), name
        # four drawn heads: 0.076° to 0.084° and 0.139° to 0.143°
        held_to(off[name], float(np.sqrt(one.after.covariance[place, place])), np.radians(usual_deg), name)


def test_a_boresight_before_a_board_is_consistent_with_its_sigma() -> None:
    """Six boards of unknown place: they stay as they are, for their sigmas cover the errors (chi-square)."""
    squares: dict[str, float] = {}
    for seed in range(6):
        rng = np.random.default_rng([45, seed])
        station = plain_station()
        true = spoiled(station, rng)
        seen = look(true, (standing_board(true),), rng, 30, Noise(px=0.1), {"board": board_body()[[0, 7, 40, 47]]})
        one = calibrate_station(station, NOTHING_STATED, seen, (UNKNOWN_BOARD,), USUAL_WORDS)
        off = off_by(one.after, true)
        for axis in "xyz":
            name = f"head_from_camera.{axis}"
            place = one.after.covariance_parameters.index(name)
            squares[name] = squares.get(name, 0.0) + off[name] ** 2 / one.after.covariance[place, place]
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 6)
    assert all(low < total < high for total in squares.values()), squares


def test_a_board_gives_backlash_and_lever_arm(made, rng) -> None:
    station, true, _ = made
    seen = look(true, (standing_board(true),), rng, 40, Noise(px=0.1), {"board": board_body()})
    one = calibrate_station(station, NOTHING_STATED, seen, (UNKNOWN_BOARD,), USUAL_WORDS)
    off = off_by(one.after, true)
    for name in ("pan_backlash", "tilt_backlash", "camera_in_head.x", "camera_in_head.y", "camera_in_head.z"):
        assert abs(off[name]) < 4.5 * one.fit.sigma(name), name
    assert one.fit.sigma("camera_in_head.x") < 0.005
    for name in ("pan_backlash", "tilt_backlash"):
        held_to(off[name], one.fit.sigma(name), backlash_bound(40, 0.1), name)
    # four drawn heads: 3.0 to 3.8, 5.3 to 5.7 and 3.7 to 4.2 mm, of the 10 mm that the rig leaves open
    for axis, usual_m in (("x", 0.0034), ("y", 0.0055), ("z", 0.0040)):
        held_to(off[f"camera_in_head.{axis}"], one.fit.sigma(f"camera_in_head.{axis}"), usual_m, axis)
    squares_are_chi_square(one, true)
    # one board does not determine the scale over the whole range: fixed, and reported
    assert {"pan_scale", "lean"} <= set(one.fit.held)
    assert "pan_scale is not determined" in format_mount(one)


def test_what_was_approached_from_one_side_only_has_no_backlash(made, rng) -> None:
    station, true, marks = made
    seen = look(true, marks, rng, 200)
    keep = (seen.sense > 0).all(axis=1)
    one = calibrate_station(station, NOTHING_STATED, seen.keep(keep), marks, USUAL_WORDS)
    assert {"pan_backlash", "tilt_backlash"} <= set(one.fit.held)
    assert one.after.ptu_axes.pan_backlash_rad == 0.0
    # and the boresight carries its uncertainty
    free = calibrate_station(station, NOTHING_STATED, seen, marks, USUAL_WORDS)
    assert one.fit.sigma("head_from_camera.x") > 3.0 * free.fit.sigma("head_from_camera.x")


def test_inverted_senses_are_detected(made, rng) -> None:
    station, true, marks = made
    true = replace(true, ptu_axes=replace(true.ptu_axes, pan_backlash_rad=np.radians(0.05)))
    seen = look(true, marks, rng, 200)
    with pytest.raises(MountFitError, match="pan_from"):
        calibrate_station(station, NOTHING_STATED, replace(seen, sense=-seen.sense), marks, USUAL_WORDS)


def test_sightings_that_do_not_fit_are_left_out_and_named(made, rng) -> None:
    station, true, marks = made
    seen = look(true, marks, rng, 150)
    pixel = seen.pixel_px.copy()
    pixel[[3, 40, 77, 120]] += [[40, 0], [0, -25], [60, 60], [-30, 10]]
    one = calibrate_station(station, NOTHING_STATED, replace(seen, pixel_px=pixel), marks, USUAL_WORDS)
    assert {r.label for r in one.fit.rejected} >= {f"sighting {k}" for k in (3, 40, 77, 120)}
    assert len(one.fit.rejected) <= 6
    assert all("px off" in r.reason for r in one.fit.rejected)
    off = off_by(one.after, true)
    assert abs(off["head_from_camera.x"]) < 4.5 * one.fit.sigma("head_from_camera.x")
    # four drawn heads: 0.0029° to 0.0032°, as without the four wrong ones
    held_to(off["head_from_camera.x"], one.fit.sigma("head_from_camera.x"), np.radians(0.003), "head_from_camera.x")
    squares_are_chi_square(one, true)


def test_zeros_replace_equivalent_rotations(made, rng) -> None:
    station, true, marks = made
    seen = look(true, marks, rng, 150)
    usual = calibrate_station(station, NOTHING_STATED, seen, marks, USUAL_WORDS)
    zeros = calibrate_station(
        station, NOTHING_STATED, seen, marks, mount_words("zero,boresight,lever,lean,scale,backlash,base")
    )
    assert not {"head_from_camera.x", "runway_from_base.z"} & set(zeros.fit.problem.names)
    assert zeros.after.ptu_axes.pan_zero_rad != 0.0
    rays = []
    for one in (usual, zeros):
        s = one.after
        rays.append(s.geometry().ray(600.0, 500.0, *s.ptu_axes.angles(0.3, 0.2, 1.0, 1.0)).direction_runway)
    assert np.degrees(np.linalg.norm(rays[0] - rays[1])) < 2e-4


@pytest.mark.parametrize(
    ("cut", "reported"),
    [
        (lambda s: s.pointing < 1, "at least 4"),
        (lambda s: s.pointing < 3, "at least 4"),
    ],
)
def test_too_few_angles_are_refused(made, rng, cut, reported: str) -> None:
    station, true, marks = made
    seen = look(true, marks, rng, 40)
    with pytest.raises(MountFitError, match=reported):
        calibrate_station(station, NOTHING_STATED, seen.keep(cut(seen)), marks, USUAL_WORDS)


def test_all_angles_alike_are_refused(made, rng) -> None:
    station, true, marks = made
    seen = look(true, marks, rng, 40)
    alike = replace(seen, reading_rad=np.tile(seen.reading_rad[0], (40, 1)))
    with pytest.raises(MountFitError, match="same pan"):
        calibrate_station(station, NOTHING_STATED, alike, marks, USUAL_WORDS)


def test_angles_of_the_wrong_sign_are_refused(made, rng) -> None:
    station, true, marks = made
    seen = look(true, marks, rng, 60)
    with pytest.raises(MountFitError, match="signs"):
        calibrate_station(
            station, NOTHING_STATED, replace(seen, reading_rad=seen.reading_rad * (-1, 1)), marks, USUAL_WORDS
        )


def test_one_unknown_mark_seen_once_is_refused(made, rng) -> None:
    station, true, _ = made
    marks = marks_around(true, rng, count=6, known=False)
    with pytest.raises(MountFitError, match="seen twice"):
        calibrate_station(station, NOTHING_STATED, look(true, marks, rng, 6), marks, USUAL_WORDS)


def test_free_refuses_unknown_words() -> None:
    with pytest.raises(InputError, match="--free"):
        mount_words("boresight,colour")


# ------------------------------------------------------------------------------------------------ pictures
def blob(at, size=(120, 160), width=1.6, bright=180.0):
    v, u = np.mgrid[0 : size[0], 0 : size[1]]
    return bright * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * width**2))


def test_a_lamp_is_found_to_a_fraction_of_a_pixel(rng) -> None:
    errors = []
    for _ in range(40):
        at = rng.uniform((20, 20), (140, 100))
        ramp = np.linspace(10, 50, 160)[None] * np.ones((120, 1))
        picture = np.clip(np.round(ramp + blob(at) + 2.0 * rng.normal(size=(120, 160))), 0, 255).astype(np.uint8)
        errors.append(find_lamp(picture) - at)
    assert np.sqrt(np.mean(np.square(errors))) < 0.15


def test_a_picture_without_a_lamp_is_reported(rng) -> None:
    dark = (20 + 2.0 * rng.normal(size=(120, 160))).clip(0, 255).astype(np.uint8)
    assert "no bright spot" in find_lamp(dark)
    two = (dark + blob((40, 40)) + blob((120, 90))).clip(0, 255).astype(np.uint8)
    assert "two" in find_lamp(two)
    cut = (dark + blob((1, 60))).clip(0, 255).astype(np.uint8)
    assert "border" in find_lamp(cut)


def drawn_board(station, angles, board, mark):
    """Return a picture of a flat ChArUco board as a station's camera sees it."""
    px = 40
    flat = board.opencv().generateImage((board.columns * px, board.rows * px), marginSize=0)
    corners = np.array([[0, 0], [board.columns, 0], [board.columns, board.rows], [0, board.rows]], dtype=np.float64)
    body = np.column_stack([corners * board.square_m, np.zeros(4)])
    points = mark.place_m + body @ mark.runway_from_board.T
    seen = np.array([station.geometry().project(p, *angles).pixel for p in points], dtype=np.float32)
    warp = cv2.getPerspectiveTransform((corners * px - 0.5).astype(np.float32), seen)
    w, h = station.lens.image_size_px
    return cv2.warpPerspective(flat, warp, (w, h), flags=cv2.INTER_AREA, borderValue=150)


@pytest.fixture
def pictures(rng, tmp_path):
    """A folder of pictures of a board and its rig, the lens without distortion so that a picture is a homography."""
    plain = plain_station()
    lens = replace(plain.lens, distortion=np.zeros(5), focal_px=np.array([3000.0, 3000.0]))
    station = replace(plain, lens=replace(lens, image_size_px=(640, 480), principal_point_px=np.array([319.5, 239.5])))
    true = spoiled(station, rng)
    board = parse_board("charuco:7x5:0.04:0.03")
    mark = standing_board(true, 4.0)
    shots = tmp_path / "shots"
    shots.mkdir()
    aim = np.array([np.arctan2(-0.2 - 0.13, 4.0), np.arctan2(0.8, 4.0)])
    rows = ["file,station,pan_deg,tilt_deg,pan_from,tilt_from"]
    for k in range(20):
        sense = rng.choice([-1.0, 1.0], 2)
        angles = aim + np.radians(rng.uniform(-1.5, 1.5, 2))
        reading = np.degrees(true.ptu_axes.readings(*angles, *sense)) + 0.002 * rng.normal(size=2)
        cv2.imwrite(str(shots / f"{k:02d}.png"), drawn_board(true, angles, board, mark))
        rows.append(f"{k:02d}.png,left,{reading[0]:.6f},{reading[1]:.6f},{sense[0]:.0f},{sense[1]:.0f}")
    (shots / "pictures.csv").write_text("\n".join(rows) + "\n")
    quiet = replace(station, ptu_sigma_rad=np.radians(0.002), ptu_resolution_rad=0.0)
    (tmp_path / "rig.toml").write_text(rig_to_toml(Rig(stations=(quiet,))))
    return tmp_path, true


def test_pictures_of_a_board_calibrate_by_the_command(pictures, capsys) -> None:
    folder, true = pictures
    out, report = folder / "out.toml", folder / "report"
    options = ["--pictures", str(folder / "shots"), "--board", "charuco:7x5:0.04:0.03"]
    code = main(
        ["calibrate", "mount", *options, "--rig", str(folder / "rig.toml"), "--out", str(out), "--report", str(report)]
    )
    text = capsys.readouterr().out
    assert code == 0, text
    found = load_rig(out)["left"]
    for name in ("pan_backlash_rad", "tilt_backlash_rad"):
        assert getattr(found.ptu_axes, name) == pytest.approx(getattr(true.ptu_axes, name), abs=np.radians(0.006))
    assert "held-out angles" in text
    page = (report / "report.html").read_text()
    assert "verdict" in page
    assert page.count("data:image/png") == 3


@pytest.mark.parametrize(
    ("row", "reported"),
    [
        ("99.png,left,0,0", "decoded"),
        ("../00.png,left,0,0", "inside the folder"),
        ("00.png,middle,0,0", "station 'middle'"),
        ("00.png,left,nan,0", "pan_deg"),
    ],
)
def test_a_faulty_table_of_pictures_is_reported(pictures, capsys, row: str, reported: str) -> None:
    folder, _ = pictures
    (folder / "shots" / "pictures.csv").write_text(f"file,station,pan_deg,tilt_deg\n{row}\n")
    options = ["--pictures", str(folder / "shots"), "--lamp", "--rig", str(folder / "rig.toml")]
    assert main(["calibrate", "mount", *options, "--out", str(folder / "out.toml")]) == 1
    assert reported in capsys.readouterr().err
    assert not (folder / "out.toml").exists()


def tables(folder: Path, station: Station, seen: MountSightings, marks: tuple[Mark, ...]) -> list[str]:
    """Write sightings, marks and rig; return the command that reads them and writes out.toml."""
    rows = ["station,landmark,pan_deg,tilt_deg,u_px,v_px,pan_from,tilt_from"]
    for k in range(len(seen)):
        pan, tilt = np.degrees(seen.reading_rad[k])
        u, v = seen.pixel_px[k]
        rows.append(
            f"left,{marks[seen.mark[k]].name},{pan:.6f},{tilt:.6f},{u:.4f},{v:.4f},"
            f"{seen.sense[k, 0]:.0f},{seen.sense[k, 1]:.0f}"
        )
    (folder / "sightings.csv").write_text("\n".join(rows) + "\n")
    places = ["landmark,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,kind"]
    for mark in marks:
        kind = "point" if mark.kind is MarkKind.POINT else "direction"
        sigma = 0.003 if kind == "point" else 0.0
        places.append(f"{mark.name},{','.join(f'{v:.9f}' for v in mark.place_m)},{sigma},{sigma},{sigma},{kind}")
    (folder / "landmarks.csv").write_text("\n".join(places) + "\n")
    (folder / "rig.toml").write_text(rig_to_toml(Rig(stations=(station,))))
    given = [str(folder / "sightings.csv"), "--landmarks", str(folder / "landmarks.csv")]
    return ["calibrate", "mount", *given, "--rig", str(folder / "rig.toml"), "--out", str(folder / "out.toml")]


def test_one_sighting_is_refused_in_one_line(made, rng, tmp_path, capsys) -> None:
    station, true, marks = made
    assert main(tables(tmp_path, station, look(true, marks, rng, 1), marks)) == 1
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert "got 1 sighting" in error
    assert "got 1 sighting at 1 pair of angles" in error


@pytest.mark.parametrize("count", [4, 7, 10])
def test_a_handful_of_sightings_writes_no_rig(made, rng, tmp_path, capsys, count: int) -> None:
    """They can be fitted, but hardly anything is left over: one line with how many would do, exit code 1."""
    station, true, marks = made
    assert main(tables(tmp_path, station, look(true, marks, rng, count), marks)) == 1
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert f"got {count} sightings at {count} pairs of angles for" in error
    needed = int(error.partition("0.01 deg: some ")[2].partition(" ")[0])
    assert needed > 2 * count
    assert not (tmp_path / "out.toml").exists()
    # so many more do
    station, true, marks = made
    assert main(tables(tmp_path, station, look(true, marks, rng, max(needed, 40)), marks)) == 0


def test_what_is_held_keeps_value_and_covariance(made, rng, tmp_path, capsys) -> None:
    """The rig's lever arm has sigmas of 2 mm in y and z; sightings 40 m and farther away do not improve it."""
    station, true, marks = made
    reported = {"camera_in_head.x": 0.01, "camera_in_head.y": 0.002, "camera_in_head.z": 0.002}
    given = np.diag(np.square(list(reported.values())))
    given[1, 2] = given[2, 1] = 1e-6
    station = replace(station, covariance_parameters=tuple(reported), covariance=given)
    seen = look(true, marks, rng, 60)
    assert main(tables(tmp_path, station, seen, marks)) == 0
    text = capsys.readouterr().out
    found = load_rig(tmp_path / "out.toml")["left"]
    for axis in "yz":
        name = f"camera_in_head.{axis}"
        assert f"{name} is not determined by these sightings and stays as it was" in text
        assert found.camera_in_head_m["xyz".index(axis)] == station.camera_in_head_m["xyz".index(axis)]
    places = [found.covariance_parameters.index(f"camera_in_head.{axis}") for axis in "yz"]
    np.testing.assert_allclose(found.covariance[np.ix_(places, places)], given[1:, 1:], rtol=1e-9)


def test_what_two_stations_knew_together_goes_where_one_is_found_anew(made, rng, tmp_path) -> None:
    """The rig that is written can be read: its shared covariance no longer states what the station now does."""
    station, true, marks = made
    left = replace(station, covariance_parameters=("head_from_camera.x",), covariance=np.array([[1e-4]]))
    names = ("left.head_from_camera.x", "right.head_from_camera.x", "right.head_from_camera.z")
    matrix = 5e-5 * (np.eye(3) + np.ones((3, 3)))
    rig = Rig(
        stations=(left, replace(left, name="right")), shared_covariance=ParameterCovariance(names=names, matrix=matrix)
    )
    found = calibrate_mounts(rig, {"left": look(true, marks, rng, 60)}, marks)
    write_rig(tmp_path / "out.toml", found)
    back = load_rig(tmp_path / "out.toml")
    assert back.shared_covariance.names == names[1:]
    np.testing.assert_array_equal(back.shared_covariance.matrix, matrix[1:, 1:])


def test_tables_calibrate_by_the_command(made, rng, tmp_path, capsys) -> None:
    station, true, marks = made
    command = tables(tmp_path, station, look(true, marks, rng, 80), marks)
    code = main(command)
    text = capsys.readouterr().out
    assert code == 0, text
    found = load_rig(tmp_path / "out.toml")["left"]
    place = found.covariance_parameters.index("head_from_camera.x")
    off = off_by(found, true)["head_from_camera.x"]
    assert abs(off) < 4.5 * np.sqrt(found.covariance[place, place])
    assert "verdict" in text


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ([], 2),
        (["s.csv", "--pictures", "d"], 2),
        (["--pictures", "d"], 2),
        (["s.csv", "--lamp"], 2),
        (["s.csv", "--rig", "r.toml"], 1),
    ],
)
def test_wrong_input_ends_in_one_line(tmp_path, capsys, monkeypatch, options: list[str], code: int) -> None:
    monkeypatch.chdir(tmp_path)
    rig = [] if "--rig" in options else ["--rig", "rig.toml"]
    assert main(["calibrate", "mount", *options, *rig, "--out", "out.toml"]) == code
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    assert "wanted" in error


def test_collinear_marks_get_the_advice_for_other_marks(rng: np.random.Generator) -> None:
    """Points along one bearing do not determine roll: the advice is other marks, not thousands of sightings."""
    station = plain_station()
    marks = tuple(
        Mark(
            name=f"m{k}",
            kind=MarkKind.POINT,
            place_m=np.array([0.0, 100.0 + 100.0 * k, 1.0]),
            sigma=np.full(3, 0.003),
            runway_from_board=np.eye(3),
        )
        for k in range(6)
    )
    seen = look(station, marks, rng, 24)
    with pytest.raises(MountFitError, match=r"wanted 0\.01 deg: other marks of known place, far apart in pan"):
        calibrate_station(station, NOTHING_STATED, seen, marks, USUAL_WORDS)
