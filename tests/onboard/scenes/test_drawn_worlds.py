"""Drawn approaches: the sets, what varies, and that camera file and log say of a drawn flight what is true of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.errors import ScenarioError
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.onboard.edges.camera_file import load_nose_camera
from groundstation.onboard.edges.imu_file import load_imu
from groundstation.onboard.edges.pose import Attitude, nose_pose
from groundstation.onboard.pose.inertial_filter import InertialConfig
from groundstation.onboard.render import NavigationAccount, world_camera_file
from groundstation.onboard.scenes.bright_grounds import BRIGHT
from groundstation.onboard.scenes.draw_nose_world import BRIGHT_FROM, draw_nose_world
from groundstation.onboard.scenes.drawn_airfield import draw_airfield
from groundstation.onboard.scenes.drawn_light import draw_light
from groundstation.onboard.scenes.ground import Airfield, Shadow, Strip, patches
from groundstation.onboard.scenes.nose_flight import attitude_of
from groundstation.onboard.visual_inertial.inertial_unit_file import load_unit


def test_snow_and_dusk_are_of_the_test_set_alone() -> None:
    grounds: dict[bool, set[str]] = {False: set(), True: set()}
    lights: dict[bool, set[str]] = {False: set(), True: set()}
    for seed in range(80):
        for everything in (False, True):
            drawn = draw_airfield(np.random.default_rng([seed, 1]), snow=everything)
            light = draw_light(np.random.default_rng(seed), drawn.airfield.surfaces, dusk=everything, lamps=drawn.lamps)
            grounds[everything].add(drawn.factors["ground"])
            lights[everything].add(light.factors["light"])
    assert grounds[True] - grounds[False] == {"snow"}
    assert lights[True] - lights[False] == {"dusk"}


def test_bright_ground_is_of_later_numbers_alone_and_never_snow() -> None:
    drawn = [draw_airfield(np.random.default_rng([seed, 3]), snow=True, bright=True) for seed in range(60)]
    assert {one.factors["ground"] for one in drawn} == set(BRIGHT)
    assert {one.factors["border"] for one in drawn} == {"none", "ploughed", "track", "trees"}
    # as bright as pavement, or brighter, is what makes them worth drawing: where nothing is wet or blown over too
    dry = [one.airfield.surfaces for one in drawn if one.factors["wet"] == "dry"]
    assert min(np.mean(one.ground) for one in dry) > 0.38
    assert np.mean([np.mean(one.ground) > np.mean(one.runway) for one in dry]) > 0.8
    factors = [draw_nose_world(first + BRIGHT_FROM + k, 2).factors for first in (0, 2_000_000) for k in range(2)]
    assert all(one["ground"] in BRIGHT for one in factors)


@pytest.mark.parametrize(
    ("seed", "width_m", "grain", "ground"),
    [
        (4, 31.748797080150702, 0.491549063839613, (0.20504770403733982, 0.2863226564759796, 0.1185589353811051)),
        (1_000_003, 48.563157057168546, 0.3638205501208743, (0.22461065656141, 0.31171029715642, 0.14054678950978)),
    ],
)
def test_worlds_that_figures_are_of_stay_what_they_were(
    seed: int, width_m: float, grain: float, ground: tuple[float, float, float]
) -> None:
    field = draw_nose_world(seed, 2).flight.sequence.airfield
    assert field.width_m == pytest.approx(width_m, rel=1e-12)
    assert field.grain == pytest.approx(grain, rel=1e-12)
    assert field.surfaces.ground == pytest.approx(ground, rel=1e-12)
    assert field.strips == ()


def test_a_strip_lies_under_the_runway_where_it_is_drawn() -> None:
    strip = Strip(
        x_m=12.0, y_m=-50.0, turn_rad=0.0, width_m=10.0, length_m=300.0, colour=(0.1, 0.1, 0.1), mottle=0.0,
        dashes=(12.0, 0.5),
    )  # fmt: skip
    plain = Airfield(taxiway_side=0)
    rows = patches(replace(plain, strips=(strip,)), np.random.default_rng(1))
    np.testing.assert_array_equal(rows[1:], patches(plain, np.random.default_rng(1)))
    np.testing.assert_allclose(rows[0, [0, 1, 4, 5, 6, 11, 12]], [12.0, -50.0, 5.0, 150.0, 0.1, 12.0, 0.5])


def test_widths_are_announced_right_or_wrong_by_a_quarter_at_most() -> None:
    drawn = [draw_airfield(np.random.default_rng([seed, 2]), snow=True) for seed in range(200)]
    off = np.array([one.announced_m / one.airfield.width_m - 1.0 for one in drawn])
    widths = np.array([one.airfield.width_m for one in drawn])
    assert widths.min() >= 15.0
    assert widths.max() <= 60.0
    assert np.abs(off).max() <= 0.25
    # six of ten: 120 of 200, to three sigmas of a binomial draw
    assert abs((off == 0.0).sum() - 120) <= 21


def test_the_same_seed_is_the_same_approach_and_the_camera_sits_as_is_stated() -> None:
    one, same = (draw_nose_world(1_000_003, 3) for _ in range(2))
    assert one.factors == same.factors
    np.testing.assert_array_equal(one.flight.motion.position_m, same.flight.motion.position_m)
    assert one.flight.sequence == same.flight.sequence
    sample = one.flight.frames[1]
    exact = one.flight.pose(sample)
    attitude = one.flight.motion.runway_from_body[sample]
    body = one.flight.setup.mount
    np.testing.assert_allclose(exact.threshold_from_camera, attitude @ body.body_from_camera)
    with pytest.raises(ScenarioError):
        draw_nose_world(3_000_000)


def test_a_world_as_files_is_what_was_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["onboard", "render", "--world", "4", "--frames", "2", "--out", str(tmp_path / "w")]) == 0
    world = draw_nose_world(4, 2)
    camera = load_nose_camera(tmp_path / "w" / "nose.toml")
    assert camera.guess.width_m == pytest.approx(world.announced_m, abs=1e-3)
    assert camera.mount.pitch_rad == pytest.approx(world.mount.pitch_rad, abs=1e-7)
    np.testing.assert_allclose(camera.lens.distortion, world.flight.setup.lens.distortion)
    assert camera.noise.attitude_rad == pytest.approx(world.noise.attitude_rad, rel=1e-5)
    unit, usual = load_unit(tmp_path / "w" / "nose.toml", camera), InertialConfig()
    assert unit.config.force_noise == pytest.approx(world.flight.setup.config.force_noise, rel=1e-5)
    assert unit.config.force_bias_walk == usual.force_bias_walk
    # the logged poses, by the mount that is stated, are those of the camera but for the unit's errors
    log = load_imu(tmp_path / "w" / "imu.csv", camera)
    sample = world.flight.frames[1]
    reported, exact = log.pose(float(world.flight.motion.t_s[sample])), world.flight.pose(sample)
    assert reported is not None
    turned = reported.threshold_from_camera.T @ exact.threshold_from_camera
    assert np.degrees(np.arccos(0.5 * (np.trace(turned) - 1.0))) < 4.0
    assert np.linalg.norm(reported.camera_threshold_m - exact.camera_threshold_m) < 6.0
    capsys.readouterr()
    for seed in ("3000000", "-1", "a"):
        with pytest.raises(SystemExit) as ended:
            main(["onboard", "render", "--world", seed, "--out", str(tmp_path / "n")])
        assert ended.value.code == 2
        assert "wanted a whole number from 0 to 2999999" in capsys.readouterr().err


def test_without_errors_the_stated_pose_is_exact() -> None:
    world = draw_nose_world(2, 2)
    sample = world.flight.frames[1]
    exact = world.flight.pose(sample)
    M = world.flight.motion.runway_from_body[sample]
    roll, pitch, yaw = attitude_of(wxyz_from_matrix(M))
    stated = nose_pose(exact.camera_threshold_m, Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw), world.mount)
    np.testing.assert_allclose(stated.threshold_from_camera, exact.threshold_from_camera, atol=1e-9)
    attitudes, places = np.zeros((1, 3)), np.array([[1.0, 200.0, 20.0]])
    text = world_camera_file(world, NavigationAccount(attitude_rad=attitudes, place_m=places))
    assert ("[pose_noise]" in text) == (world.noise.attitude_rad is not None)


def test_worn_paint_and_shadows_are_patches() -> None:
    rng = np.random.default_rng(0)
    plain = patches(Airfield(), np.random.default_rng(0))
    worn = patches(Airfield(paint_opacity=0.2), np.random.default_rng(0))
    assert worn.shape == plain.shape
    assert (worn != plain).any(axis=1).sum() == 19
    none = patches(Airfield(paint_opacity=0.0), np.random.default_rng(0))
    assert len(none) == len(plain) - 19
    shadow = Shadow(x_m=9.0, y_m=-50.0, turn_rad=1.0, width_m=8.0, length_m=20.0, darkness=0.4)
    last = patches(Airfield(shadows=(shadow,)), rng)[-1]
    np.testing.assert_allclose(last[[0, 1, 4, 5, 6, 7, 8, 9]], [9.0, -50.0, 4.0, 10.0, 0.0, 0.0, 0.0, 0.4])
