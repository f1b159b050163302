"""The errors of a head's axes: read, written, applied to readings, and exact in the geometry."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import RigError
from groundstation.geometry.calibration import project_with_calibration
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.rig.ptu_axes import (
    AXES_KEYS,
    AxisCorrection,
    Backlash,
    PtuAxes,
    axes_from_file_units,
    axes_in_file_units,
)
from groundstation.rig.rig import load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.sources.ptu_readings import PtuReadings

small = st.floats(-0.01, 0.01)
play = st.floats(0.0, 0.01)
axes_of_any_head = st.builds(
    PtuAxes,
    pan_zero_rad=small,
    tilt_zero_rad=small,
    pan_scale=small,
    tilt_scale=small,
    lean_rad=small,
    pan_backlash_rad=play,
    tilt_backlash_rad=play,
)
angle = st.floats(-3.0, 3.0)
sense = st.sampled_from([-1.0, 0.0, 1.0])


@given(axes_of_any_head, angle, angle, sense, sense)
def test_readings_are_the_inverse_of_angles(
    axes: PtuAxes, pan: float, tilt: float, pan_from: float, tilt_from: float
) -> None:
    back = axes.readings(*axes.angles(pan, tilt, pan_from, tilt_from), pan_from, tilt_from)
    np.testing.assert_allclose(back, (pan, tilt), atol=1e-12)


@given(axes_of_any_head)
def test_file_units_round_trip(axes: PtuAxes) -> None:
    back = axes_from_file_units(axes_in_file_units(axes))
    for name in PtuAxes.__dataclass_fields__:
        assert getattr(back, name) == pytest.approx(getattr(axes, name), rel=1e-12, abs=1e-18)


@given(st.lists(angle, min_size=1, max_size=60), st.floats(1e-4, 0.5))
def test_play_stays_within_its_width(readings: list[float], backlash: float) -> None:
    gears, head = Backlash(backlash), readings[0]
    for reading in readings:
        turned = gears.sense(reading)
        assert -1.0 - 1e-9 <= turned <= 1.0 + 1e-9
        # the head moves only as far as the motor pushes it, and then towards the reading
        before, head = head, reading - 0.5 * backlash * turned
        assert min(before, reading) - 1e-9 <= head <= max(before, reading) + 1e-9


def test_the_head_stands_still_while_the_backlash_is_crossed() -> None:
    correction = AxisCorrection(PtuAxes(pan_backlash_rad=0.02))
    readings = [0.0, 0.1, 0.2, 0.195, 0.19, 0.18, 0.15]
    angles = [correction.angles(reading, 0.0)[0] for reading in readings]
    np.testing.assert_allclose(angles, [0.0, 0.09, 0.19, 0.19, 0.19, 0.19, 0.16], atol=1e-12)


def test_readings_of_an_ideal_head_stay_to_the_last_bit() -> None:
    correction = AxisCorrection(PtuAxes(lean_rad=0.01))
    assert correction.angles(0.123456789, -0.987654321) == (0.123456789, -0.987654321)


@pytest.fixture
def leaning(landing_1):
    rig = load_rig(landing_1 / "rig.toml")
    axes = PtuAxes(
        pan_zero_rad=0.01, tilt_zero_rad=-0.02, pan_scale=2e-4, tilt_scale=-1e-4, lean_rad=3e-3, pan_backlash_rad=1e-4
    )
    return replace(rig, stations=(replace(rig.stations[0], ptu_axes=axes), rig.stations[1]))


def test_rig_file_keeps_the_axes(leaning, tmp_path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(leaning))
    back = load_rig(path)
    for key, value in axes_in_file_units(leaning["left"].ptu_axes).items():
        assert axes_in_file_units(back["left"].ptu_axes)[key] == pytest.approx(value, rel=1e-11, abs=1e-15), key
    assert "ptu_axes" not in path.read_text().split('name = "right"')[1]


@pytest.mark.parametrize("text", ["{ lean_rad = 0.1 }", "{ lean_deg = 11 }", "{ pan_backlash_deg = -0.1 }", "3"])
def test_rig_file_refuses_axes_that_cannot_be(landing_1, tmp_path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text((landing_1 / "rig.toml").read_text() + f"ptu_axes = {text}\n")
    with pytest.raises(RigError, match="ptu_axes"):
        load_rig(path)


def test_a_lean_is_exact_in_projection_ray_and_derivatives(leaning, rng) -> None:
    geometry = leaning["left"].geometry()
    assert geometry.lean_rad == pytest.approx(3e-3)
    for _ in range(20):
        pan, tilt = rng.uniform(-1.0, 1.0), rng.uniform(-0.5, 0.5)
        ray = geometry.ray(*rng.uniform(100, 900, 2), pan, tilt)
        point = ray.origin_runway_m + 50.0 * ray.direction_runway
        seen = project_with_calibration(geometry, point, pan, tilt)
        pose = geometry.camera_pose(pan, tilt)
        by_hand = pose.runway_from_camera.T @ (point - pose.position_runway_m)
        assert by_hand[2] == pytest.approx(seen.depth_m, rel=1e-12)
        base_from_head = rotation_z(pan) @ rotation_y(3e-3) @ rotation_x(tilt)
        runway_from_head = geometry.packed[0:9].reshape(3, 3) @ base_from_head
        np.testing.assert_allclose(
            pose.runway_from_camera, runway_from_head @ geometry.packed[12:21].reshape(3, 3), atol=1e-15
        )
        step = 1e-6
        for k, (dp, dt) in enumerate([(step, 0.0), (0.0, step)]):
            up, down = geometry.project(point, pan + dp, tilt + dt), geometry.project(point, pan - dp, tilt - dt)
            numeric = (up.pixel - down.pixel) / (2 * step)
            np.testing.assert_allclose(seen.jacobian[:, 3 + k], numeric, rtol=1e-5, atol=1e-3)
        numeric = np.empty((2, 3))
        for axis in range(3):
            d = np.zeros(3)
            d[axis] = 1e-4
            up, down = geometry.project(point + d, pan, tilt), geometry.project(point - d, pan, tilt)
            numeric[:, axis] = (up.pixel - down.pixel) / 2e-4
        np.testing.assert_allclose(seen.jacobian[:, :3], numeric, rtol=1e-5, atol=1e-3)


def test_recorded_readings_are_corrected_where_they_enter(landing_1, tmp_path) -> None:
    text = (landing_1 / "rig.toml").read_text()
    line = 'name = "left"\nptu_axes = { pan_zero_deg = 0.5, tilt_scale_ppm = 1000.0 }'
    (tmp_path / "rig.toml").write_text(text.replace('name = "left"', line))

    def read(rig):
        source = PtuReadings(load_session(landing_1, rig))
        source.start(0.0, 2.0)
        return list(source.until(2.0))

    for raw, corrected in zip(read(None), read(tmp_path / "rig.toml"), strict=True):
        left = raw.station == "left"
        assert corrected.pan_rad == pytest.approx(raw.pan_rad + (np.radians(0.5) if left else 0.0), abs=1e-15)
        assert corrected.tilt_rad == pytest.approx(raw.tilt_rad * (1.001 if left else 1.0), abs=1e-15)


def test_every_key_is_written() -> None:
    assert set(axes_in_file_units(PtuAxes())) == set(AXES_KEYS)


def test_one_pair_of_readings_converts_like_many_and_is_invertible() -> None:
    axes = PtuAxes(pan_scale=0.004, tilt_scale=-0.003, pan_zero_rad=0.01, tilt_zero_rad=-0.02, pan_backlash_rad=0.002)
    readings, senses = np.array([[1.3, -0.4]]), np.array([[1.0, -1.0]])
    one = axes.angles(1.3, -0.4, 1.0, -1.0)
    np.testing.assert_allclose(one, axes.angles_many(readings, senses)[0], rtol=1e-14)
    np.testing.assert_allclose(one, [1.3 * 1.004 + 0.01 - 0.001, -0.4 * 0.997 - 0.02], rtol=1e-14)
    np.testing.assert_allclose(axes.readings(*one, 1.0, -1.0), (1.3, -0.4), rtol=1e-14)


@given(
    pan=st.floats(-3.0, 3.0),
    tilt=st.floats(-1.5, 1.5),
    sine=st.floats(-0.03, 0.03),
    cosine=st.floats(-0.03, 0.03),
    sag=st.floats(-0.03, 0.03),
)
def test_periodic_errors_and_sag_are_invertible_and_vanish_at_zero(pan, tilt, sine, cosine, sag) -> None:
    axes = PtuAxes(pan_scale=0.004, pan_sine_rad=sine, pan_cosine_rad=cosine, tilt_sag_rad=sag)
    one = axes.angles(pan, tilt, 0.0, 0.0)
    np.testing.assert_allclose(axes.readings(*one, 0.0, 0.0), (pan, tilt), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(one, axes.angles_many(np.array([[pan, tilt]]), np.zeros((1, 2)))[0], atol=1e-14)
    assert one[0] == pytest.approx(1.004 * pan + sine * np.sin(pan) + cosine * (np.cos(pan) - 1.0), abs=1e-14)
    assert one[1] == pytest.approx(tilt + sag * (1.0 - np.cos(tilt)), abs=1e-14)
    assert axes.angles(0.0, 0.0, 0.0, 0.0) == (0.0, 0.0)


def test_rig_file_keeps_periodic_errors_and_refuses_large_ones(leaning, landing_1, tmp_path) -> None:
    axes = PtuAxes(pan_sine_rad=1e-4, pan_cosine_rad=-2e-4, tilt_sag_rad=3e-4)
    assert not axes.is_ideal_apart_from_lean
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(replace(leaning, stations=(replace(leaning["left"], ptu_axes=axes), leaning["right"]))))
    back = load_rig(path)["left"].ptu_axes
    for name in ("pan_sine_rad", "pan_cosine_rad", "tilt_sag_rad"):
        assert getattr(back, name) == pytest.approx(getattr(axes, name), rel=1e-11)
    path.write_text((landing_1 / "rig.toml").read_text() + "ptu_axes = { tilt_sag_deg = 3 }\n")
    with pytest.raises(RigError, match="tilt_sag_deg"):
        load_rig(path)
