"""The station's projection: frames and signs, rays, and every Jacobian against its numeric twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_z, wxyz_from_matrix
from groundstation.geometry.station import LensError, StationGeometry

IDEAL_CAMERA = np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0])
LENS = Lens(
    image_size_px=(1280, 960),
    focal_px=np.array([6684.3, 6680.9]),
    principal_point_px=np.array([646.82, 471.36]),
    distortion=np.array([-0.212, 0.63, 0.00041, -0.00027, 0.0]),
)


def small_rotation(generator: np.random.Generator, sigma_rad: float) -> NDArray[np.float64]:
    v = generator.normal(0.0, sigma_rad, 3)
    q = np.array([1.0, *(v / 2)])
    return q / np.linalg.norm(q)


def station(generator: np.random.Generator, lens: Lens = LENS) -> StationGeometry:
    head_from_camera = matrix_from_wxyz(IDEAL_CAMERA) @ matrix_from_wxyz(small_rotation(generator, 0.01))
    return StationGeometry(
        name="left",
        ptu_position_m=np.array([-5.385, 0.0, 1.648]) + generator.normal(0, 0.1, 3),
        runway_from_base_wxyz=small_rotation(generator, 0.01),
        head_from_camera_wxyz=wxyz_from_matrix(head_from_camera),
        camera_in_head_m=generator.normal(0, 0.05, 3),
        lens=lens,
    )


def numeric_jacobian(
    geometry: StationGeometry, point: NDArray[np.float64], pan: float, tilt: float
) -> NDArray[np.float64]:
    """Central differences of the projection, the twin of `Projection.jacobian`."""
    J = np.zeros((2, 5))
    for k in range(5):
        h = 1e-5 * max(1.0, float(np.linalg.norm(point))) if k < 3 else 1e-6
        d = np.zeros(5)
        d[k] = h
        ahead = geometry.project(point + d[:3], pan + d[3], tilt + d[4])
        back = geometry.project(point - d[:3], pan - d[3], tilt - d[4])
        assert ahead is not None
        assert back is not None
        J[:, k] = (ahead.pixel - back.pixel) / (2 * h)
    return J


@pytest.mark.parametrize("range_m", [10.0, 60.0, 400.0, 5000.0])
@pytest.mark.parametrize("tilt_deg", [-20.0, 0.0, 45.0, 89.0, 89.99, 95.0])
def test_jacobian_matches_its_numeric_twin(rng: np.random.Generator, range_m: float, tilt_deg: float) -> None:
    geometry = station(rng)
    for _ in range(10):
        pan, tilt = rng.uniform(-3, 3), np.radians(tilt_deg)
        pixel = rng.uniform([0, 0], [1279, 959])
        ray = geometry.ray(*pixel, pan, tilt)
        point = ray.origin_runway_m + range_m * ray.direction_runway
        projection = geometry.project(point, pan, tilt)
        assert projection is not None
        np.testing.assert_allclose(projection.pixel, pixel, atol=1e-6)
        twin = numeric_jacobian(geometry, point, pan, tilt)
        scale = np.abs(twin).max(axis=0) + 1e-9
        np.testing.assert_allclose(projection.jacobian / scale, twin / scale, atol=2e-6)


@settings(max_examples=60)
@given(
    pan=st.floats(-3.1, 3.1),
    tilt=st.floats(-1.5, 1.6),
    u=st.floats(-0.5, 1279.5),
    v=st.floats(-0.5, 959.5),
    range_m=st.floats(2.0, 20000.0),
    seed=st.integers(0, 2**31),
)
def test_pixel_to_ray_and_back(pan: float, tilt: float, u: float, v: float, range_m: float, seed: int) -> None:
    geometry = station(np.random.default_rng(seed))
    ray = geometry.ray(u, v, pan, tilt)
    assert np.linalg.norm(ray.direction_runway) == pytest.approx(1.0, abs=1e-12)
    projection = geometry.project(ray.origin_runway_m + range_m * ray.direction_runway, pan, tilt)
    assert projection is not None
    np.testing.assert_allclose(projection.pixel, [u, v], atol=1e-6)


def test_signs_of_pan_and_tilt() -> None:
    """Pan is positive counter-clockwise from above, tilt positive upwards; both zero along +y."""
    plain = StationGeometry(
        name="s",
        ptu_position_m=np.zeros(3),
        runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
        head_from_camera_wxyz=IDEAL_CAMERA,
        camera_in_head_m=np.zeros(3),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([1000.0, 1000.0]),
            principal_point_px=np.array([640.0, 480.0]),
            distortion=np.zeros(5),
        ),
    )
    axis = plain.ray(640.0, 480.0, 0.0, 0.0).direction_runway
    np.testing.assert_allclose(axis, [0, 1, 0], atol=1e-12)
    left = plain.ray(640.0, 480.0, np.radians(10), 0.0).direction_runway
    assert left[0] < 0, "a positive pan turns the axis towards −x"
    up = plain.ray(640.0, 480.0, 0.0, np.radians(10)).direction_runway
    assert up[2] > 0, "a positive tilt raises the axis"
    ahead_right_low = plain.project(np.array([1.0, 100.0, -1.0]), 0.0, 0.0)
    assert ahead_right_low is not None
    assert ahead_right_low.pixel[0] > 640, "x right is u right"
    assert ahead_right_low.pixel[1] > 480, "below the axis is v down"
    assert plain.project(np.array([0.0, -5.0, 0.0]), 0.0, 0.0) is None


def test_the_chain_is_the_documented_one(rng: np.random.Generator) -> None:
    """X_camera = head_from_cameraᵀ (base_from_headᵀ runway_from_baseᵀ (X − ptu) − camera_in_head)."""
    for _ in range(20):
        q_base, q_camera = small_rotation(rng, 0.5), small_rotation(rng, 0.5)
        position, lever = rng.normal(0, 2, 3), rng.normal(0, 0.1, 3)
        lens = Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([900.0, 910.0]),
            principal_point_px=np.array([630.0, 470.0]),
            distortion=np.zeros(5),
        )
        head_from_camera = matrix_from_wxyz(IDEAL_CAMERA) @ matrix_from_wxyz(q_camera)
        geometry = StationGeometry(
            name="s",
            ptu_position_m=position,
            runway_from_base_wxyz=q_base,
            head_from_camera_wxyz=wxyz_from_matrix(head_from_camera),
            camera_in_head_m=lever,
            lens=lens,
        )
        pan, tilt = rng.uniform(-1, 1), rng.uniform(-0.5, 1.4)
        point = rng.normal(0, 30, 3) + [0, 100, 0]
        base_from_head = rotation_z(pan) @ rotation_x(tilt)
        camera = head_from_camera.T @ (base_from_head.T @ matrix_from_wxyz(q_base).T @ (point - position) - lever)
        projection = geometry.project(point, pan, tilt)
        if camera[2] <= 0.01:
            continue
        assert projection is not None
        expected = lens.focal_px * camera[:2] / camera[2] + lens.principal_point_px
        np.testing.assert_allclose(projection.pixel, expected, rtol=1e-9, atol=1e-6)
        assert projection.depth_m == pytest.approx(camera[2])


def test_distortion_is_opencvs(rng: np.random.Generator) -> None:
    cv2 = pytest.importorskip("cv2")
    lens = Lens(
        image_size_px=(1920, 1080),
        focal_px=np.array([874.5, 894.1]),
        principal_point_px=np.array([970.3, 531.3]),
        distortion=np.array([-0.2607, 0.0749, -0.000136, 0.000175, -0.00906]),
    )
    geometry = StationGeometry(
        name="s",
        ptu_position_m=np.zeros(3),
        runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
        head_from_camera_wxyz=IDEAL_CAMERA,
        camera_in_head_m=np.zeros(3),
        lens=lens,
    )
    K = np.array([[874.5, 0, 970.3], [0, 894.1, 531.3], [0, 0, 1]])
    for _ in range(100):
        camera = np.array([rng.uniform(-1, 1), rng.uniform(-0.6, 0.6), 1.0]) * 50.0
        expected = cv2.projectPoints(camera.reshape(1, 1, 3), np.zeros(3), np.zeros(3), K, lens.distortion)[0].ravel()
        projection = geometry.project(np.array([camera[0], camera[2], -camera[1]]), 0.0, 0.0)
        assert projection is not None
        np.testing.assert_allclose(projection.pixel, expected, atol=1e-6)


def test_a_point_far_outside_does_not_fold_back_into_the_image() -> None:
    """A polynomial fitted inside the image turns back outside; such a point must stay outside."""
    barrel = Lens(
        image_size_px=(1280, 960),
        focal_px=np.array([1000.0, 1000.0]),
        principal_point_px=np.array([640.0, 480.0]),
        distortion=np.array([-0.3, 0.0, 0.001, -0.001, 0.0]),
    )
    geometry = StationGeometry(
        name="s",
        ptu_position_m=np.zeros(3),
        runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
        head_from_camera_wxyz=IDEAL_CAMERA,
        camera_in_head_m=np.zeros(3),
        lens=barrel,
    )
    for degrees in (50, 60, 70, 80, 85):
        x = 100.0 * np.tan(np.radians(degrees))
        projection = geometry.project(np.array([x, 100.0, 0.0]), 0.0, 0.0)
        assert projection is not None
        assert not geometry.contains(projection.pixel), degrees
        twin = numeric_jacobian(geometry, np.array([x, 100.0, 0.0]), 0.0, 0.0)
        np.testing.assert_allclose(projection.jacobian, twin, rtol=1e-4, atol=1e-2)


def test_a_pixel_without_a_ray_is_an_error() -> None:
    strong = Lens(
        image_size_px=(1280, 960),
        focal_px=np.array([300.0, 300.0]),
        principal_point_px=np.array([640.0, 480.0]),
        distortion=np.array([-0.5, 0.0, 0.0, 0.0, 0.0]),
    )
    geometry = StationGeometry(
        name="wide",
        ptu_position_m=np.zeros(3),
        runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
        head_from_camera_wxyz=IDEAL_CAMERA,
        camera_in_head_m=np.zeros(3),
        lens=strong,
    )
    with pytest.raises(LensError, match="wide"):
        geometry.ray(float("nan"), 100.0, 0.0, 0.0)


def test_the_nose_of_the_bundled_landing(landing_1) -> None:
    """The documented chain puts truth's nose on truth's pixels: 0.01° of noise is about a pixel."""
    from groundstation.rig.rig import load_rig

    rig = load_rig(landing_1 / "rig.toml")
    truth = np.genfromtxt(landing_1 / "truth.csv", delimiter=",", names=True)
    ptu = np.genfromtxt(landing_1 / "ptu.csv", delimiter=",", names=True)
    for s in rig.stations:
        geometry = s.geometry()
        pan = np.radians(np.interp(truth["t_s"], ptu["t_s"], ptu[f"{s.name}_pan_deg"]))
        tilt = np.radians(np.interp(truth["t_s"], ptu["t_s"], ptu[f"{s.name}_tilt_deg"]))
        points = np.column_stack([truth["x_m"], truth["y_m"], truth["z_m"]])
        seen = np.column_stack([truth[f"{s.name}_u_px"], truth[f"{s.name}_v_px"]])
        expected = np.array(
            [geometry.project(X, a, b).pixel for X, a, b in zip(points, pan, tilt, strict=True)]  # type: ignore[union-attr]
        )
        error = expected - seen
        assert np.abs(error.mean(axis=0)).max() < 0.15
        # two readings of 0.01° noise, interpolated: 0.0075° is 0.87 px
        assert error.std(axis=0) == pytest.approx(0.87, abs=0.15)


def test_the_image_ends_half_a_pixel_outside_its_outermost_pixel_centres(rng: np.random.Generator) -> None:
    geometry = station(rng)
    for corner in ((-0.5, -0.5), (1279.5, -0.5), (-0.5, 959.5), (1279.5, 959.5)):
        assert geometry.contains(np.array(corner))
    for outside in ((-0.5001, 3.0), (1279.5001, 3.0), (3.0, -0.5001), (3.0, 959.5001)):
        assert not geometry.contains(np.array(outside))
    assert geometry.contains(np.array([9.5, 9.5]), margin_px=10.0)
    assert not geometry.contains(np.array([9.5, 9.4999]), margin_px=10.0)
    assert not geometry.contains(np.array([9.4999, 9.5]), margin_px=10.0)


@pytest.mark.parametrize("lean_rad", [0.0, 0.01, -0.02])
def test_the_lean_is_the_one_given(lean_rad: float) -> None:
    geometry = StationGeometry(
        name="s",
        ptu_position_m=np.zeros(3),
        runway_from_base_wxyz=np.array([1.0, 0, 0, 0]),
        head_from_camera_wxyz=IDEAL_CAMERA,
        camera_in_head_m=np.zeros(3),
        lens=LENS,
        lean_rad=lean_rad,
    )
    assert geometry.lean_rad == pytest.approx(lean_rad, abs=1e-15)
