"""Poses, runways and painted pictures that the tests of the edges share."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, nose_pose

KAPPA = np.array([[620.0, 0.0, 319.5], [0.0, 610.0, 239.5], [0.0, 0.0, 1.0]])
SIZE = (640, 480)
RUNWAY = np.array([1.0, 0.0, -9.0, 9.0])
ROWS = np.array([262.0, 300.0])


def approach(
    *, x: float = 3.0, y: float = 150.0, z: float = 15.0, roll: float = 0.03, pitch: float = -0.03, yaw: float = 0.04
) -> NoseCameraPose:
    """Return a pose on an approach; rad and m."""
    return nose_pose(np.array([x, y, z]), Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw))


def numeric(function, x: FloatArray, step: float = 1e-6) -> FloatArray:  # type: ignore[no-untyped-def]
    """Return the central differences of a function (n,) → (m,), (m, n)."""
    columns = []
    for k in range(x.size):
        h = np.zeros(x.size)
        h[k] = step
        columns.append((np.atleast_1d(function(x + h)) - np.atleast_1d(function(x - h))) / (2.0 * step))
    return np.stack(columns, axis=1)


def smooth_picture(seed: int) -> ImageArray:
    """Return a picture (480, 640, 3) without edges: blurred noise of full contrast."""
    noise = np.random.default_rng(seed).uniform(0, 255, (480, 640, 3))
    blurred = cv2.GaussianBlur(noise, (0, 0), 5.0)
    low, high = blurred.min(), blurred.max()
    return (255.0 * (blurred - low) / (high - low)).astype(np.uint8)


def painted_runway(
    pose: NoseCameraPose, *, inside: tuple[int, int, int] = (90, 90, 95), outside: tuple[int, int, int] = (50, 110, 80),
    noise: float = 3.0, seed: int = 3, lines: FloatArray = RUNWAY,
) -> ImageArray:  # fmt: skip
    """Return a picture (480, 640, 3) of plain ground and a plain endless runway, a pixel of blur, noise."""
    rows = np.array([245.0, 479.0])
    ends, _ = project_lines(lines, line_map(pose, KAPPA), rows)
    t = ((np.arange(480) - rows[0]) / (rows[1] - rows[0]))[:, None]
    left, right = (ends[k] * (1 - t) + ends[k + 1] * t for k in (0, 2))
    u = np.arange(640)[None, :]
    # each pixel a box along its row
    share = np.clip(u + 0.5 - left, 0, 1) * np.clip(right - u + 0.5, 0, 1) * (t >= 0.0)
    # blurred before it is coloured, as float32, and the channels of a row in one axis: a sixth of the time
    blurred = cv2.GaussianBlur(share.astype(np.float32), (0, 0), 1.0)
    ground, change = (np.tile(np.asarray(c, np.float32), 640) for c in (outside, np.subtract(inside, outside)))
    noisy = cv2.merge([blurred] * 3).reshape(480, -1) * change
    noisy += ground
    noisy += _noise(seed, noise)
    np.round(noisy, out=noisy)
    return np.clip(noisy, 0, 255, out=noisy).astype(np.uint8).reshape(480, 640, 3)


@lru_cache(maxsize=16)
def _noise(seed: int, sigma: float) -> NDArray[np.float32]:
    """Return a picture's noise (480, 640·3): the tests draw the same few, and drawing takes longer than painting."""
    return np.random.default_rng(seed).normal(0.0, sigma, (480, 640 * 3)).astype(np.float32)
