"""How a pose follows its corners: what noise of each picture, and what lasts for the flight, make of it."""

import numpy as np

from groundstation.arrays import FloatArray


def pose_jacobian_of_pixels(
    points_m: FloatArray,
    kappa: FloatArray,
    position_m: FloatArray,
    runway_from_camera: FloatArray,
    covariance_px2: FloatArray,
) -> FloatArray | None:
    """Return the derivative of a least-squares pose by its pixels, (6, 2n): D = (HᵀWH)⁻¹HᵀW.

    Rows: position (m), rotation vector (rad) as in `RunwayPose`; columns: u and v of one point after the other.
    None where a point is behind the camera, or the points do not determine a pose.

    Parameters
    ----------
    points_m : (n, 3), runway frame.
    kappa : intrinsic matrix (3, 3) of a lens without distortion.
    covariance_px2 : (n, 2, 2), the weights' inverse W⁻¹.
    """
    H = pixel_jacobian_of_pose(points_m, kappa, position_m, runway_from_camera)
    if H is None:
        return None
    weighted = np.vstack([np.linalg.solve(c, H[2 * k : 2 * k + 2]) for k, c in enumerate(covariance_px2)])
    try:
        return np.asarray(np.linalg.solve(H.T @ weighted, weighted.T))
    except np.linalg.LinAlgError:
        return None


def pixel_jacobian_of_pose(
    points_m: FloatArray, kappa: FloatArray, position_m: FloatArray, runway_from_camera: FloatArray
) -> FloatArray | None:
    """Return how pixels move with the pose, (2n, 6); X = Rᵀ(P − c) gives δX = −Rᵀδc + Rᵀ[P − c]× δθ."""
    arms = points_m - position_m
    X = arms @ runway_from_camera
    if (X[:, 2] <= 0.1).any():
        return None
    rows = []
    for arm, (x, y, z) in zip(arms, X, strict=True):
        by_point = np.array([[1.0 / z, 0.0, -x / z**2], [0.0, 1.0 / z, -y / z**2]])
        skew = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
        rows.append(kappa[:2, :2] @ by_point @ runway_from_camera.T @ np.hstack([-np.eye(3), skew]))
    return np.vstack(rows)
