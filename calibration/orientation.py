"""Pose of a station from bearings to known points, without an initial value.

Bearings are unit vectors in the station's base frame, from pixel, lens and pan-tilt angles.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import LensError, StationGeometry

_HYPOTHESES = 200
_SEED = 20240501
_REFINEMENTS = 5
# a bearing further off than so many times the median is left out of the refinement
_INLIER_FACTOR = 3.0
_PNP_ERROR = 0.02
# beyond this from the middle bearing a plane picture of the bearings is stretched too far
_MAX_OFF_AXIS = np.cos(np.radians(75.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseGuess:
    """A pose and how well it fits.

    ``runway_from_base`` (3, 3); ``position_m`` (3,) runway frame; ``median_rad`` the median angle by which the
    bearings miss.
    """

    runway_from_base: FloatArray
    position_m: FloatArray
    median_rad: float


def bearings_in_base(geometry: StationGeometry, pixels_px: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3), base frame, of pixels (n, 2) at pan and tilt (n, 2); NaN where a pixel has no ray."""
    runway_from_base = geometry.packed[0:9].reshape(3, 3)
    bearings = np.full((len(pixels_px), 3), np.nan)
    for k, ((u, v), (pan, tilt)) in enumerate(zip(pixels_px, angles_rad, strict=True)):
        try:
            ray = geometry.ray(float(u), float(v), float(pan), float(tilt))
        except LensError:
            continue
        bearings[k] = ray.direction_runway @ runway_from_base
    return bearings


def find_orientation(bearings: FloatArray, points_m: FloatArray, position_m: FloatArray) -> PoseGuess:
    """Return the rotation that turns bearings (n, 3) towards points (n, 3) seen from a known position (3,).

    Least median over rotations of two bearings each, then Kabsch's rotation of those that fit.
    """
    towards = points_m - position_m
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    n = len(bearings)
    generator = np.random.default_rng(_SEED)
    first, second = generator.integers(0, n, (2, _HYPOTHESES))
    # of the draws, those far apart turn the rotation about the line of sight the least
    apart = np.linalg.norm(np.cross(bearings[first], bearings[second]), axis=1)
    chosen = np.argsort(-apart)[: _HYPOTHESES // 2]
    first, second = first[chosen], second[chosen]
    rotations = _triads(towards[first], towards[second]) @ np.swapaxes(_triads(bearings[first], bearings[second]), 1, 2)
    misses = _angles(np.einsum("hij,nj->hni", rotations, bearings), towards[None])
    best = rotations[int(np.argmin(np.median(misses, axis=1)))]
    for _ in range(_REFINEMENTS):
        miss = _angles(bearings @ best.T, towards)
        keep = miss <= max(_INLIER_FACTOR * float(np.median(miss)), 1e-9)
        best = kabsch(bearings[keep], towards[keep])
    median = float(np.median(_angles(bearings @ best.T, towards)))
    return PoseGuess(runway_from_base=best, position_m=position_m, median_rad=median)


def find_pose(bearings: FloatArray, points_m: FloatArray) -> PoseGuess | None:
    """Return orientation and position from bearings (n, 3) to points (n, 3), or None where there is no such pose.

    A plane picture of the bearings about their middle, and OpenCV's SQPnP under RANSAC on it.
    """
    middle = np.median(bearings, axis=0)
    middle /= np.linalg.norm(middle)
    side = np.cross(middle, np.eye(3)[int(np.argmin(np.abs(middle)))])
    side /= np.linalg.norm(side)
    camera_from_base = np.stack([side, np.cross(middle, side), middle])
    seen = bearings @ camera_from_base.T
    front = seen[:, 2] > _MAX_OFF_AXIS
    if front.sum() < 8:
        return None
    origin = points_m.mean(axis=0)
    plane = seen[front, :2] / seen[front, 2:]
    cv2.setRNGSeed(1)
    found, turn, shift, _ = cv2.solvePnPRansac(
        *(points_m[front] - origin, plane, np.eye(3), None),
        flags=cv2.SOLVEPNP_SQPNP,
        reprojectionError=_PNP_ERROR,
        iterationsCount=300,
        confidence=0.9999,
    )
    if not found:
        return None
    camera_from_runway = cv2.Rodrigues(turn)[0]
    position = origin - camera_from_runway.T @ shift.ravel()
    runway_from_base = camera_from_runway.T @ camera_from_base
    towards = points_m - position
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    median = float(np.median(_angles(bearings @ runway_from_base.T, towards)))
    return PoseGuess(runway_from_base=runway_from_base, position_m=position, median_rad=median)


def find_position(bearings_runway: FloatArray, points_m: FloatArray) -> FloatArray:
    """Return the point (3,) nearest to all lines through points (n, 3) along bearings (n, 3), runway frame."""
    across = np.eye(3) - bearings_runway[:, :, None] * bearings_runway[:, None, :]
    total = across.sum(axis=0)
    return np.asarray(np.linalg.lstsq(total, np.einsum("nij,nj->i", across, points_m), rcond=None)[0])


def kabsch(of: FloatArray, onto: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) that takes vectors (n, 3) best onto others (n, 3), in the sense of least squares."""
    u, _, vt = np.linalg.svd(onto.T @ of)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt)


def _triads(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return right-handed axes (h, 3, 3), as columns, from pairs of directions (h, 3)."""
    x = a + b
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    z = np.cross(a, b)
    z /= np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-12)
    return np.stack([x, np.cross(z, x), z], axis=2)


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles between unit vectors of the last axis, rad; exact where they are small."""
    return 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b, axis=-1), 0.0, 1.0))
