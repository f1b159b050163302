"""Views of a runway from an approach, for the tests of its pose."""

import numpy as np

from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z, wxyz_from_matrix
from groundstation.onboard.pose.pose_solver import PointCorrespondences
from groundstation.onboard.pose.runway import Runway, rectangle
from groundstation.onboard.pose.simulated_approach import BODY_FROM_FORWARD_CAMERA, RUNWAY_FROM_LEVEL_BODY

RUNWAY = rectangle(900.0, 30.0)
LENS = Lens(
    image_size_px=(1280, 960),
    focal_px=np.array([1400.0, 1390.0]),
    principal_point_px=np.array([642.0, 475.0]),
    distortion=np.array([-0.1, 0.03, 1e-3, -5e-4, 0.0]),
)


def pose_on_approach(rng: np.random.Generator, range_m: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and runway_from_camera (3, 3) somewhere on a sloppy approach."""
    away = rng.uniform(150.0, 1800.0) if range_m is None else range_m
    glide = np.radians(rng.uniform(2.5, 6.0))
    side = rng.normal(0.0, 0.02) * away
    position = np.array([side, away * np.cos(glide), away * np.sin(glide)])
    yaw, pitch, roll = np.radians([rng.normal(0, 3), rng.normal(-3, 2), rng.normal(0, 8)])
    body = RUNWAY_FROM_LEVEL_BODY @ rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)
    return position, body @ BODY_FROM_FORWARD_CAMERA


def project(points_m: np.ndarray, position: np.ndarray, runway_from_camera: np.ndarray, lens: Lens) -> np.ndarray:
    """Pixels (n, 2) by OpenCV's own projection."""
    import cv2

    camera_from_runway = runway_from_camera.T
    K = np.array(
        [
            [lens.focal_px[0], 0, lens.principal_point_px[0]],
            [0, lens.focal_px[1], lens.principal_point_px[1]],
            [0, 0, 1],
        ]
    )
    vector, _ = cv2.Rodrigues(camera_from_runway)
    pixels, _ = cv2.projectPoints(points_m, vector, -camera_from_runway @ position, K, lens.distortion)
    return np.asarray(pixels[:, 0])


def seen(
    rng: np.random.Generator, pose: tuple[np.ndarray, np.ndarray], sigma_px: float, runway: Runway = RUNWAY
) -> PointCorrespondences:
    """The corners with noise."""
    exact = project(runway.corners_m, *pose, LENS)
    return PointCorrespondences(
        points_m=runway.corners_m,
        pixels=exact + sigma_px * rng.standard_normal(exact.shape),
        covariance_px2=np.broadcast_to(max(sigma_px, 1e-3) ** 2 * np.eye(2), (len(exact), 2, 2)),
        lens=LENS,
    )


def quaternion(pose: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """runway_from_camera as a quaternion."""
    return wxyz_from_matrix(pose[1])
