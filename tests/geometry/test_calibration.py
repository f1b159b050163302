"""The calibration's Jacobian against its numeric twin, and the change that it differentiates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from groundstation.geometry.calibration import (
    CALIBRATION_PARAMETERS,
    CalibrationError,
    parameter_indices,
    perturbed_packed,
    perturbed_station,
    project_with_calibration,
)
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_from_vector, rotation_x, rotation_z
from groundstation.geometry.station import StationGeometry
from tests.geometry.test_station import LENS, station

BARREL = Lens(
    image_size_px=(1280, 960),
    focal_px=np.array([1000.0, 1010.0]),
    principal_point_px=np.array([640.0, 480.0]),
    distortion=np.array([-0.3, 0.05, 0.001, -0.001, 0.01]),
)
# steps small enough for the curvature and large enough for the last digits, by the unit of the parameter
_STEPS = {"runway_from_base": 1e-6, "head_from_camera": 1e-6, "focal": 1e-2, "principal_point": 1e-2}


def numeric_calibration_jacobian(
    geometry: StationGeometry, point: NDArray[np.float64], pan: float, tilt: float
) -> NDArray[np.float64]:
    """Central differences of the projection of a changed station, the twin of ``calibration_jacobian``."""
    J = np.zeros((2, CALIBRATION_SIZE))
    for k, name in enumerate(CALIBRATION_PARAMETERS):
        group = name.split(".")[0]
        h = _STEPS.get(group, 1e-5)
        if group in ("ptu_position", "camera_in_head"):
            h = 1e-5 * max(1.0, 0.1 * float(np.linalg.norm(point)))
        change = np.zeros(CALIBRATION_SIZE)
        change[k] = h
        ahead = perturbed_station(geometry, change).project(point, pan, tilt)
        back = perturbed_station(geometry, -change).project(point, pan, tilt)
        assert ahead is not None
        assert back is not None
        J[:, k] = (ahead.pixel - back.pixel) / (2 * h)
    return J


def assert_twins(geometry: StationGeometry, point: NDArray[np.float64], pan: float, tilt: float) -> None:
    projected = project_with_calibration(geometry, point, pan, tilt)
    plain = geometry.project(point, pan, tilt)
    assert projected is not None
    assert plain is not None
    np.testing.assert_array_equal(projected.pixel, plain.pixel)
    np.testing.assert_array_equal(projected.jacobian, plain.jacobian)
    assert projected.depth_m == plain.depth_m
    twin = numeric_calibration_jacobian(geometry, point, pan, tilt)
    # a column is compared with its size; the smallest are the last distortion terms, far below a pixel
    scale = np.abs(twin).max(axis=0) + 1e-3
    np.testing.assert_allclose(projected.calibration_jacobian / scale, twin / scale, atol=2e-5)


def test_the_names_are_the_kernels_columns() -> None:
    assert len(CALIBRATION_PARAMETERS) == CALIBRATION_SIZE == len(set(CALIBRATION_PARAMETERS))
    assert parameter_indices(["ptu_position.x", "distortion.p1"]) == [3, 18]
    with pytest.raises(CalibrationError, match=r"no calibration parameter 'focal\.z'; one of runway_from_base\.x"):
        parameter_indices(["focal.z"])


@pytest.mark.parametrize("range_m", [10.0, 60.0, 400.0, 5000.0])
@pytest.mark.parametrize("tilt_deg", [-20.0, 0.0, 45.0, 89.99, 95.0])
def test_near_limits_and_far_away(rng: np.random.Generator, range_m: float, tilt_deg: float) -> None:
    geometry = station(rng)
    for pan in (-3.1, rng.uniform(-3, 3), 3.1):
        tilt = float(np.radians(tilt_deg))
        ray = geometry.ray(*rng.uniform([0, 0], [1279, 959]), pan, tilt)
        assert_twins(geometry, ray.origin_runway_m + range_m * ray.direction_runway, pan, tilt)


@settings(max_examples=60)
@given(
    pan=st.floats(-3.1, 3.1),
    tilt=st.floats(-1.5, 1.6),
    u=st.floats(-0.5, 1279.5),
    v=st.floats(-0.5, 959.5),
    range_m=st.floats(5.0, 10000.0),
    seed=st.integers(0, 2**31),
    wide=st.booleans(),
)
def test_anywhere(pan: float, tilt: float, u: float, v: float, range_m: float, seed: int, wide: bool) -> None:
    geometry = station(np.random.default_rng(seed), BARREL if wide else LENS)
    ray = geometry.ray(u, v, pan, tilt)
    assert_twins(geometry, ray.origin_runway_m + range_m * ray.direction_runway, pan, tilt)


@pytest.mark.parametrize("degrees", [65, 70, 80, 85])
def test_beyond_the_radius_limit(rng: np.random.Generator, degrees: int) -> None:
    """Where the radial factor is held, the pixel still moves with the coefficients that made it."""
    geometry = station(rng, BARREL)
    assert np.tan(np.radians(degrees)) ** 2 > geometry.packed[33]
    axis = geometry.ray(640.0, 480.0, 0.3, 0.1)
    side = np.cross(axis.direction_runway, [0.0, 0.0, 1.0])
    point = axis.origin_runway_m + 100.0 * (axis.direction_runway + np.tan(np.radians(degrees)) * side)
    assert_twins(geometry, point, 0.3, 0.1)


def test_behind_the_camera_there_is_none(rng: np.random.Generator) -> None:
    assert project_with_calibration(station(rng), np.array([0.0, -50.0, 0.0]), 0.0, 0.0) is None


def test_a_pan_error_is_a_turned_base_and_a_tilt_error_a_turned_camera(rng: np.random.Generator) -> None:
    """Encoder zeros are no parameters of their own: they are these rotations, but for the lever arm."""
    geometry = station(rng)
    lever_free = perturbed_station(geometry, -np.r_[np.zeros(9), geometry.packed[21:24], np.zeros(9)])
    point = np.array([3.0, 200.0, 9.0])
    projected = project_with_calibration(lever_free, point, 0.03, 0.02)
    assert projected is not None
    up = geometry.packed[0:9].reshape(3, 3)[:, 2]
    np.testing.assert_allclose(projected.calibration_jacobian[:, 0:3] @ up, projected.jacobian[:, 3], rtol=1e-9)
    np.testing.assert_allclose(projected.calibration_jacobian[:, 6], projected.jacobian[:, 4], rtol=1e-9)


def test_a_change_affects_the_named_parameters(rng: np.random.Generator) -> None:
    """runway_from_base_true = exp([θ]×) · runway_from_base, and so on, to the last digit and for large angles."""
    geometry = station(rng)
    change = np.zeros(CALIBRATION_SIZE)
    change[0:3], change[6:9] = (0.0, 0.0, 0.3), (-0.2, 0.0, 0.0)
    change[3:6], change[9:12] = (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)
    change[12:21] = 10.0, -10.0, 5.0, -5.0, 0.01, 0.02, 0.03, 0.04, 0.05
    before, after = geometry.packed, perturbed_packed(geometry.packed, change)
    np.testing.assert_allclose(after[0:9].reshape(3, 3), rotation_z(0.3) @ before[0:9].reshape(3, 3))
    np.testing.assert_allclose(after[12:21].reshape(3, 3), rotation_x(-0.2) @ before[12:21].reshape(3, 3))
    np.testing.assert_allclose(after[9:12] - before[9:12], change[3:6])
    np.testing.assert_allclose(after[21:24] - before[21:24], change[9:12])
    np.testing.assert_allclose(after[24:33] - before[24:33], change[12:21])
    np.testing.assert_array_equal(perturbed_packed(before, np.zeros(CALIBRATION_SIZE)), before)
    changed = perturbed_station(geometry, change)
    np.testing.assert_array_equal(changed.lens.focal_px, after[24:26])
    np.testing.assert_array_equal(changed.packed, after)
    assert geometry.packed[33] == changed.packed[33]


def test_a_focal_length_below_zero_is_refused(rng: np.random.Generator) -> None:
    change = np.zeros(CALIBRATION_SIZE)
    change[12] = -1e4
    with pytest.raises(CalibrationError, match=r"station left: a focal length of -3315\.7 px"):
        perturbed_station(station(rng), change)


def test_rotation_vectors() -> None:
    np.testing.assert_allclose(rotation_from_vector(np.array([0.0, 0.0, 1.2])), rotation_z(1.2), atol=1e-15)
    np.testing.assert_array_equal(rotation_from_vector(np.zeros(3)), np.eye(3))
    small = np.array([1e-9, -2e-9, 3e-9])
    cross = np.array([[0, -3e-9, -2e-9], [3e-9, 0, -1e-9], [2e-9, 1e-9, 0]])
    np.testing.assert_allclose(rotation_from_vector(small) - np.eye(3), cross, atol=1e-16)
