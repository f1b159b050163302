"""The camera's pose agrees with the ray and the projection of the same station."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.geometry.station import StationGeometry

LENS = Lens(
    image_size_px=(1280, 960),
    focal_px=np.array([6684.3, 6680.9]),
    principal_point_px=np.array([646.82, 471.36]),
    distortion=np.zeros(5),
)
HEAD_FROM_CAMERA = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def _station(base_wxyz: list[float]) -> StationGeometry:
    quaternion = np.array(base_wxyz)
    return StationGeometry(
        name="left",
        ptu_position_m=np.array([-5.4, 0.2, 1.6]),
        runway_from_base_wxyz=quaternion / np.linalg.norm(quaternion),
        head_from_camera_wxyz=wxyz_from_matrix(HEAD_FROM_CAMERA),
        camera_in_head_m=np.array([0.01, 0.06, 0.05]),
        lens=LENS,
    )


@given(
    pan_rad=st.floats(-3.1, 3.1),
    tilt_rad=st.floats(-1.5, 1.5),
    tip=st.lists(st.floats(-0.02, 0.02), min_size=3, max_size=3),
    u_px=st.floats(0.0, 1279.0),
    v_px=st.floats(0.0, 959.0),
)
def test_the_pose_carries_a_pixels_ray(
    pan_rad: float, tilt_rad: float, tip: list[float], u_px: float, v_px: float
) -> None:
    station = _station([1.0, *tip])
    pose = station.camera_pose(pan_rad, tilt_rad)
    ray = station.ray(u_px, v_px, pan_rad, tilt_rad)
    ray_camera = np.array([*((np.array([u_px, v_px]) - LENS.principal_point_px) / LENS.focal_px), 1.0])
    direction = pose.runway_from_camera @ ray_camera
    np.testing.assert_allclose(pose.position_runway_m, ray.origin_runway_m, atol=1e-12)
    np.testing.assert_allclose(direction / np.linalg.norm(direction), ray.direction_runway, atol=1e-12)
    np.testing.assert_allclose(pose.runway_from_camera.T @ pose.runway_from_camera, np.eye(3), atol=1e-12)


def test_at_rest_the_camera_points_along_the_runway() -> None:
    pose = _station([1.0, 0.0, 0.0, 0.0]).camera_pose(0.0, 0.0)
    np.testing.assert_allclose(pose.runway_from_camera[:, 2], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose.runway_from_camera[:, 1], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(pose.position_runway_m, [-5.39, 0.26, 1.65], atol=1e-12)


def test_positive_pan_turns_left_and_positive_tilt_up() -> None:
    axis = _station([1.0, 0.0, 0.0, 0.0]).camera_pose(0.1, 0.2).runway_from_camera[:, 2]
    assert axis[0] < 0 < axis[2]
