"""The camera's motion from two pictures of flat ground: Algorithm 2.

Corners with SIFT descriptors, matched by Lowe's ratio, a homography by RANSAC, its decomposition into rotation,
translation over distance and normal, the solution that leaves every point in front of the camera, and the scale from
the height over the ground. Poses are then composed.

The camera's second frame is seen from the first: X₁ = R₁₂ X₂ + t₁₂, and H̃ = R₂₁ + t₂₁ n ᵀ / d maps pixels of the first
picture to the second (Eq. 37 as printed maps the other way). d is the distance of the ground along n from the first
camera (the sign of n towards the ground), averaged over the points as in step 7; "−R₁t₁" there is −R₁ᵀt₁.
"""

import math
from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from scipy.optimize import least_squares

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.rotation import rotation_from_vector
from groundstation.onboard.edges.pose import NoseCameraPose, ground_from_pixels

_BELOW_HORIZON_PX = 6.0
# the skyline is on the homography's line at infinity
_ABOVE_HORIZON_PX = 20.0
# of an aircraft whose motion no picture has shown: the inertial filter's prior of its speed, and a rate (chosen)
_UNKNOWN_SPEED_M_S, _UNKNOWN_RATE_RAD_S = 50.0, math.radians(10.0)


class CornerKind(Enum):
    """Where two pictures are compared: Harris corners of the ground, or extrema over scales, of the skyline too."""

    HARRIS = "harris"
    EXTREMA = "extrema"


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """Tuning of Algorithm 2.

    Attributes
    ----------
    kind : of corners; the paper's are Harris's.
    corners, quality, apart_px : corners at most; of Harris's least strength as a share of the best one's, distance.
    patch_px : size of a Harris corner's descriptor.
    blur_px, contrast : of extrema: sigma that takes a texture's and the camera's noise away, least contrast.
    ratio : Lowe's.
    tolerance_px, least_inliers : RANSAC's.
    refine : fit rotation and translation again to the matches, the ground being known from the first pose.
    seed : of RANSAC.
    """

    kind: CornerKind = CornerKind.EXTREMA
    corners: int = 600
    quality: float = 0.002
    apart_px: float = 5.0
    patch_px: float = 12.0
    blur_px: float = 1.6
    contrast: float = 0.003
    ratio: float = 0.8
    tolerance_px: float = 1.0
    least_inliers: int = 20
    refine: bool = True
    seed: int = 7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """The second camera in the first one's frame: rotation (3, 3), translation (3,) m; and how many points agreed."""

    first_from_second: FloatArray
    second_in_first_m: FloatArray
    inliers: int


class NoMotion(Enum):
    """Why two pictures give no motion."""

    FEW_MATCHES = "too few points of the ground match"
    NO_HOMOGRAPHY = "the matches agree on no homography"
    NO_SOLUTION = "no decomposition leaves the points in front of the camera"


def horizon_rows(pose: NoseCameraPose, kappa: FloatArray, width: int) -> FloatArray:
    """Return the horizon's row for each column (width,)."""
    line = np.linalg.inv(kappa).T @ pose.threshold_from_camera[2]
    return np.asarray(-(line[0] * np.arange(width) + line[2]) / line[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CornerFeatures:
    """Corners of a picture (n, 2) px with their descriptors (n, 128)."""

    pixels: FloatArray
    descriptors: FloatArray


def ground_features(image: ImageArray, pose: NoseCameraPose, kappa: FloatArray, config: MotionConfig) -> CornerFeatures:
    """Return corners with SIFT descriptors: Harris's below the horizon, or extrema of the ground and the skyline."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if config.kind is CornerKind.EXTREMA:
        return _extrema(np.asarray(grey, np.uint8), pose, kappa, config)
    horizon = horizon_rows(pose, kappa, grey.shape[1]) + _BELOW_HORIZON_PX
    mask = (np.arange(grey.shape[0])[:, None] > horizon[None, :]).astype(np.uint8)
    corners: FloatArray | None = cv2.goodFeaturesToTrack(  # type: ignore[assignment]
        grey, config.corners, config.quality, config.apart_px, mask=mask, useHarrisDetector=True, k=0.04
    )
    if corners is None:
        return CornerFeatures(pixels=np.empty((0, 2)), descriptors=np.empty((0, 128), np.float32))
    points = [cv2.KeyPoint(float(u), float(v), config.patch_px) for u, v in corners[:, 0]]
    sift = cv2.SIFT.create(contrastThreshold=0.0)
    points, descriptors = sift.compute(grey, points)  # type: ignore[assignment]
    pixels = np.array([point.pt for point in points], dtype=np.float64).reshape(-1, 2)
    return CornerFeatures(pixels=pixels, descriptors=np.asarray(descriptors))


def _extrema(grey: ImageArray, pose: NoseCameraPose, kappa: FloatArray, config: MotionConfig) -> CornerFeatures:
    top = horizon_rows(pose, kappa, grey.shape[1]) - _ABOVE_HORIZON_PX
    mask = 255 * (np.arange(grey.shape[0])[:, None] > top[None, :]).astype(np.uint8)
    sift = cv2.SIFT.create(nfeatures=config.corners, contrastThreshold=config.contrast)
    points, descriptors = sift.detectAndCompute(cv2.GaussianBlur(grey, (0, 0), config.blur_px), mask)
    if descriptors is None or not points:
        return CornerFeatures(pixels=np.empty((0, 2)), descriptors=np.empty((0, 128), np.float32))
    pixels = np.array([point.pt for point in points], dtype=np.float64).reshape(-1, 2)
    return CornerFeatures(pixels=pixels, descriptors=np.asarray(descriptors))


def matched(first: CornerFeatures, second: CornerFeatures, ratio: float) -> tuple[FloatArray, FloatArray]:
    """Return pixels (n, 2) of both pictures whose best match is better than ``ratio`` times the second best."""
    if len(first.pixels) < 2 or len(second.pixels) < 2:
        return np.empty((0, 2)), np.empty((0, 2))
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first.descriptors, second.descriptors, k=2)
    good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < ratio * p[1].distance]
    return first.pixels[[m.queryIdx for m in good]], second.pixels[[m.trainIdx for m in good]]


def recover_motion(
    first_px: FloatArray, second_px: FloatArray, pose: NoseCameraPose, kappa: FloatArray, config: MotionConfig
) -> Motion | NoMotion:
    """Return the motion between two pictures from matched pixels (n, 2) of both; ``pose`` is the first one's."""
    if len(first_px) < config.least_inliers:
        return NoMotion.FEW_MATCHES
    cv2.setRNGSeed(config.seed)
    homography, inliers = cv2.findHomography(first_px, second_px, cv2.RANSAC, config.tolerance_px)
    if homography is None or int(inliers.sum()) < config.least_inliers:
        return NoMotion.NO_HOMOGRAPHY
    good = inliers.ravel() > 0
    motion = decompose(np.asarray(homography, np.float64), first_px[good], pose, kappa)
    if config.refine:
        return refined_motion(first_px[good], second_px[good], motion, pose, kappa, config.tolerance_px)
    return motion


def refined_motion(
    first_px: FloatArray,
    second_px: FloatArray,
    start: Motion | NoMotion,
    pose: NoseCameraPose,
    kappa: FloatArray,
    scale_px: float,
) -> Motion | NoMotion:
    """Return the motion whose second picture fits best, its points on the ground of the first pose; not in the paper.

    A homography has eight numbers where six are unknown; the decomposition uses the two for a normal and a distance
    that the pose gives more accurately. Robust least squares (soft L1 at ``scale_px``) from ``start``, or from rest.
    """
    ground = ground_from_pixels(pose, kappa, first_px)
    seen = np.isfinite(ground).all(axis=1)
    points = (np.column_stack([ground, np.zeros(len(ground))]) - pose.camera_threshold_m)[seen] @ (
        pose.threshold_from_camera
    )
    wanted = second_px[seen]
    if len(points) < 6:
        return NoMotion.FEW_MATCHES
    first = np.zeros(6)
    if isinstance(start, Motion):
        first[:3] = cv2.Rodrigues(start.first_from_second.T)[0].ravel()
        first[3:] = start.second_in_first_m

    def residuals(x: FloatArray) -> FloatArray:
        second = (points - x[3:]) @ rotation_from_vector(x[:3]).T
        depth = np.maximum(second[:, 2], 0.1)
        u = kappa[0, 0] * second[:, 0] / depth + kappa[0, 2]
        v = kappa[1, 1] * second[:, 1] / depth + kappa[1, 2]
        return np.concatenate([u - wanted[:, 0], v - wanted[:, 1]])

    best = least_squares(residuals, first, loss="soft_l1", f_scale=scale_px, x_scale=np.array([0.01] * 3 + [1.0] * 3))
    if not isinstance(start, Motion) or best.cost > least_squares_cost(residuals(np.zeros(6)), scale_px):
        again = least_squares(
            residuals, np.zeros(6), loss="soft_l1", f_scale=scale_px, x_scale=np.array([0.01] * 3 + [1.0] * 3)
        )
        best = again if again.cost < best.cost else best
    return Motion(
        first_from_second=rotation_from_vector(best.x[:3]).T, second_in_first_m=best.x[3:], inliers=int(seen.sum())
    )


def least_squares_cost(residuals: FloatArray, scale: float) -> float:
    """Return scipy's cost of residuals (n,) under soft L1."""
    return float(scale**2 * np.sum(np.sqrt(1.0 + (residuals / scale) ** 2) - 1.0))


def decompose(
    homography: FloatArray, used_px: FloatArray, pose: NoseCameraPose, kappa: FloatArray
) -> Motion | NoMotion:
    """Return the motion behind a homography (3, 3) of pixels: of its four, the one with points in front of the camera.

    Where two remain, the one whose normal is nearer to the vertical of the pose. ``used_px`` (n, 2), first picture.
    """
    _, rotations, translations, normals = cv2.decomposeHomographyMat(homography, kappa)
    rays = np.column_stack([used_px, np.ones(len(used_px))]) @ np.linalg.inv(kappa).T
    down = -pose.threshold_from_camera[2]
    best, most = None, -np.inf
    for r, t, normal in zip(rotations, translations, normals, strict=True):
        rotation, translation = np.asarray(r, np.float64), np.asarray(t, np.float64)
        n = np.asarray(normal, np.float64).ravel()
        # n·X = d > 0 for points in front
        if np.mean(rays @ n > 0.0) < 0.99:
            continue
        upright = float(n @ down)
        if upright > most:
            best, most = (rotation, translation.ravel(), n), upright
    if best is None:
        return NoMotion.NO_SOLUTION
    rotation, translation, n = best
    distance = _distance(used_px, n, pose, kappa)
    # X₂ = R X₁ + (t/d)·d
    return Motion(
        first_from_second=rotation.T,
        second_in_first_m=np.asarray(-rotation.T @ translation * distance),
        inliers=len(used_px),
    )


def _distance(pixels: FloatArray, normal: FloatArray, pose: NoseCameraPose, kappa: FloatArray) -> float:
    """Return d, steps 6 and 7: points back on the ground, into the camera's frame, and their mean along n."""
    ground = ground_from_pixels(pose, kappa, pixels)
    seen = np.isfinite(ground).all(axis=1)
    points = np.column_stack([ground[seen], np.zeros(int(seen.sum()))])
    camera = (points - pose.camera_threshold_m) @ pose.threshold_from_camera
    # far points know the normal's error best and the distance worst
    return float(np.median(camera @ normal))


def composed(pose: NoseCameraPose, motion: Motion) -> NoseCameraPose:
    """Return the second camera's pose from the first one's, Eq. 39."""
    return NoseCameraPose(
        threshold_from_camera=pose.threshold_from_camera @ motion.first_from_second,
        camera_threshold_m=pose.threshold_from_camera @ motion.second_in_first_m + pose.camera_threshold_m,
    )


def motion_between(first: NoseCameraPose, second: NoseCameraPose) -> Motion:
    """Return the motion of known poses."""
    camera_from_threshold = first.threshold_from_camera.T
    return Motion(
        first_from_second=camera_from_threshold @ second.threshold_from_camera,
        second_in_first_m=camera_from_threshold @ (second.camera_threshold_m - first.camera_threshold_m),
        inliers=0,
    )


def share_of(motion: Motion, share: float) -> Motion:
    """Return the motion of a share of the time at the same rates; above 1 it goes on."""
    turn = np.asarray(cv2.Rodrigues(motion.first_from_second)[0], np.float64).ravel()
    return Motion(
        first_from_second=rotation_from_vector(share * turn),
        second_in_first_m=share * motion.second_in_first_m,
        inliers=motion.inliers,
    )


def turn_of(motion: Motion) -> float:
    """Return the angle of a motion's rotation, rad."""
    return float(np.linalg.norm(cv2.Rodrigues(motion.first_from_second)[0]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OdometryStep:
    """A picture's pose, the motion (None for the first picture), and how sure it is.

    ``failure`` is why the picture gave no motion, None where it did. The motion is then the last one at the same rates,
    and ``turn_rad`` and ``shift_m`` are its size, as sigmas: 0 for a motion that was measured.
    """

    pose: NoseCameraPose
    motion: Motion | None
    failure: NoMotion | None = None
    turn_rad: float = 0.0
    shift_m: float = 0.0


class VisualOdometry:
    """Poses from pictures alone, from a first pose on; where a picture gives no motion the last rates continue.

    Attributes
    ----------
    pose : of the last picture. failures : of all pictures that gave no motion, why.
    """

    def __init__(self, kappa: FloatArray, start: NoseCameraPose, config: MotionConfig | None = None) -> None:
        self._kappa = kappa
        self._config = config or MotionConfig()
        self._features: CornerFeatures | None = None
        # a picture whose features are not needed yet
        self._unread: ImageArray | None = None
        self._t_s = math.nan
        self._last: Motion | None = None
        self._last_s = 0.0
        self.pose = start
        self.failures: list[NoMotion] = []

    def step(self, t_s: float, image: ImageArray) -> OdometryStep:
        """Take the next picture (h, w, 3) and return its pose; the first one has the pose that it was started with."""
        if self._unread is not None:
            self._features = ground_features(self._unread, self.pose, self._kappa, self._config)
            self._unread = None
        features = ground_features(image, self.pose, self._kappa, self._config)
        before, self._features = self._features, features
        interval_s, self._t_s = t_s - self._t_s, t_s
        if before is None:
            return OdometryStep(pose=self.pose, motion=None)
        first, second = matched(before, features, self._config.ratio)
        motion = recover_motion(first, second, self.pose, self._kappa, self._config)
        if isinstance(motion, NoMotion):
            self.failures.append(motion)
            return self._continued(interval_s, motion)
        self._last, self._last_s = motion, interval_s
        self.pose = composed(self.pose, motion)
        return OdometryStep(pose=self.pose, motion=motion)

    def restart(self, t_s: float, image: ImageArray, pose: NoseCameraPose) -> None:
        """Continue from a picture whose pose is known; the last motion is that of two known poses."""
        if self._unread is not None and t_s > self._t_s:
            self._last, self._last_s = motion_between(self.pose, pose), t_s - self._t_s
        self.pose, self._t_s, self._unread = pose, t_s, image

    def _continued(self, interval_s: float, failure: NoMotion) -> OdometryStep:
        """Return a picture's pose by the last rates; at rest where there are none, as far as an aircraft may come."""
        if self._last is None or self._last_s <= 0.0:
            motion = Motion(first_from_second=np.eye(3), second_in_first_m=np.zeros(3), inliers=0)
            turn_rad, shift_m = interval_s * _UNKNOWN_RATE_RAD_S, interval_s * _UNKNOWN_SPEED_M_S
        else:
            motion = share_of(self._last, interval_s / self._last_s)
            turn_rad, shift_m = turn_of(motion), float(np.linalg.norm(motion.second_in_first_m))
        self.pose = composed(self.pose, motion)
        return OdometryStep(pose=self.pose, motion=motion, failure=failure, turn_rad=turn_rad, shift_m=shift_m)
