"""Registration of two frames of a turning camera.

A camera that turns about its own centre moves the far scene by a homography. It is known from the pan-tilt
angles, or found on the pictures' corners; either way the rest of a pixel is measured on the scene's texture.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry import kernels
from groundstation.geometry.camera import Lens

# columns of textured pixels
_X, _Y, _GREY, _BY_X, _BY_Y = 0, 1, 2, 3, 4
_GRID = 5  # points per side from which a rotation becomes a homography
_TEXTURE = 4.0  # grey levels per px: gradients below it are noise
_TEXTURE_STEP = 3
_MIN_TEXTURED = 60
_BLOCKS = 8
_BLOCK_TEXTURED, _MIN_TEXTURED_BLOCKS = 10, 6  # texture in fewer of the blocks may be the target itself
_STEPS = 8
_ROBUST = 8.0  # grey levels
_LEAST_MISPLACED_PX, _UNKNOWN_MISPLACED_PX = 0.12, 1.5
_MEDIAN_TO_SIGMA = 1.5
_CORNERS = 160
_MIN_TRACKED = 12


class TurningView:
    """Pixels of the working image as rays of the camera, to predict the effect of a rotation on the picture."""

    def __init__(self, lens: Lens, scale: float, size: tuple[int, int]) -> None:
        x, y = np.meshgrid(np.linspace(0, size[0] - 1, _GRID), np.linspace(0, size[1] - 1, _GRID))
        self._pixels = np.stack([x.ravel(), y.ravel()], axis=1)
        self._scale = scale
        self._focal, self._centre = lens.focal_px, lens.principal_point_px
        self._k = np.concatenate([lens.distortion, [lens.radius_limit]])
        full = self._pixels * scale + 0.5 * (scale - 1.0)
        rays = np.ones((len(full), 3))
        out = np.empty(2)
        good = np.zeros(len(full), np.bool_)
        for i, (u, v) in enumerate((full - self._centre) / self._focal):
            good[i] = kernels.undistort(self._k, u, v, out)
            rays[i, :2] = out
        self._pixels, self._rays = self._pixels[good], rays[good]

    def homography(self, new_from_old: FloatArray) -> FloatArray | None:
        """Return the (3, 3) homography of working pixels for a rotation; None if the views do not overlap."""
        turned = self._rays @ new_from_old.T
        ahead = turned[:, 2] > 0.2
        if int(ahead.sum()) < 6:
            return None
        moved = kernels.distort_rays(self._k, turned[ahead])
        full = moved * self._focal + self._centre
        working = (full - 0.5 * (self._scale - 1.0)) / self._scale
        found, _ = cv2.findHomography(self._pixels[ahead], working, 0)
        return None if found is None else np.asarray(found, np.float64)


@njit(cache=True)
def textured(grey: ImageArray) -> FloatArray:
    """Return the textured pixels as rows x, y, grey, ∂x, ∂y."""
    h, w = grey.shape
    rows = np.empty(((h // _TEXTURE_STEP + 1) * (w // _TEXTURE_STEP + 1), 5))
    n = 0
    for y in range(1, h - 1, _TEXTURE_STEP):
        for x in range(1, w - 1, _TEXTURE_STEP):
            gx = 0.5 * (float(grey[y, x + 1]) - float(grey[y, x - 1]))
            gy = 0.5 * (float(grey[y + 1, x]) - float(grey[y - 1, x]))
            if gx * gx + gy * gy >= _TEXTURE * _TEXTURE:
                rows[n, _X], rows[n, _Y], rows[n, _GREY], rows[n, _BY_X], rows[n, _BY_Y] = x, y, grey[y, x], gx, gy
                n += 1
    return rows[:n]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameAlignment:
    """``old_from_new`` (3, 3), pixels to pixels, and one sigma of its misplacement, px."""

    old_from_new: FloatArray
    misplaced_px: float


@njit(cache=True, inline="always")
def _misfit(row: FloatArray, old: ImageArray, H: FloatArray, sx: float, sy: float) -> tuple[bool, float]:
    """Return whether a textured pixel is in the old picture, and its difference in grey levels."""
    x, y = row[_X] + sx, row[_Y] + sy
    d = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    u, v = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / d, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / d
    iu, iv = math.floor(u), math.floor(v)
    if iu < 0 or iv < 0 or iu + 1 >= old.shape[1] or iv + 1 >= old.shape[0]:
        return False, 0.0
    fu, fv = u - iu, v - iv
    top = (1 - fu) * old[iv, iu] + fu * old[iv, iu + 1]
    low = (1 - fu) * old[iv + 1, iu] + fu * old[iv + 1, iu + 1]
    return True, (1 - fv) * top + fv * low - row[_GREY]


@njit(cache=True)
def _shift(rows: FloatArray, old: ImageArray, H: FloatArray, limit: float) -> tuple[float, float, bool]:
    """Return the shift of the new pixels that is left before the warp, and whether it was found."""
    sx, sy = 0.0, 0.0
    for step in range(_STEPS):
        hxx, hxy, hyy, bx, by, n = 1e-9, 0.0, 1e-9, 0.0, 0.0, 0
        # far from the solution large differences are the signal, not the outliers
        width = _ROBUST * (4.0 if step < 3 else 1.0)
        for k in range(rows.shape[0]):
            inside, e = _misfit(rows[k], old, H, sx, sy)
            if not inside:
                continue
            weight = 1.0 / (1.0 + (e / width) ** 2)
            gx, gy = rows[k, _BY_X], rows[k, _BY_Y]
            hxx += weight * gx * gx
            hxy += weight * gx * gy
            hyy += weight * gy * gy
            bx += weight * gx * e
            by += weight * gy * e
            n += 1
        determinant = hxx * hyy - hxy * hxy
        if n < _MIN_TEXTURED or determinant <= 1e-4 * hxx * hyy:
            return 0.0, 0.0, False
        dx, dy = (hyy * bx - hxy * by) / determinant, (hxx * by - hxy * bx) / determinant
        length = math.hypot(dx, dy)
        if length > 2.0:
            dx, dy = 2.0 * dx / length, 2.0 * dy / length
        sx -= dx
        sy -= dy
        if abs(sx) > limit or abs(sy) > limit:
            return 0.0, 0.0, False
        if step >= 3 and length < 0.01:
            return sx, sy, True
    return sx, sy, True


@njit(cache=True)
def _misplacements(rows: FloatArray, old: ImageArray, H: FloatArray) -> FloatArray:
    """Return |difference| / gradient of the textured pixels in the old picture, px."""
    out = np.empty(rows.shape[0])
    n = 0
    for k in range(rows.shape[0]):
        inside, e = _misfit(rows[k], old, H, 0.0, 0.0)
        if inside:
            out[n] = abs(e) / math.hypot(rows[k, _BY_X], rows[k, _BY_Y])
            n += 1
    return out[:n]


def align(rows: FloatArray, old: ImageArray, old_from_new: FloatArray, limit_px: float) -> FrameAlignment:
    """Refine a predicted homography by one shift measured on the new picture's textured pixels.

    Without enough texture the prediction stands; then little in the picture can be misplaced visibly.
    """
    sx, sy, found = _shift(rows, old, old_from_new, limit_px)
    if found:
        old_from_new = old_from_new @ np.array([[1.0, 0.0, sx], [0.0, 1.0, sy], [0.0, 0.0, 1.0]])
    errors = _misplacements(rows, old, old_from_new)
    if errors.size < _MIN_TEXTURED:
        return FrameAlignment(old_from_new=old_from_new, misplaced_px=_UNKNOWN_MISPLACED_PX)
    typical = _MEDIAN_TO_SIGMA * float(np.median(errors))
    return FrameAlignment(old_from_new=old_from_new, misplaced_px=max(typical, _LEAST_MISPLACED_PX))


def image_motion(old: ImageArray, new: ImageArray) -> FloatArray | None:
    """Return the homography from one picture to the next as the scene's corners show it; None if they do not."""
    corners = cv2.goodFeaturesToTrack(old, _CORNERS, 0.02, 8)
    if corners is None or len(corners) < _MIN_TRACKED:
        return None
    moved, good, _ = cv2.calcOpticalFlowPyrLK(old, new, corners, np.empty_like(corners), winSize=(15, 15), maxLevel=3)
    kept = good.ravel() == 1
    if int(kept.sum()) < _MIN_TRACKED:
        return None
    found, inliers = cv2.estimateAffinePartial2D(corners[kept], moved[kept], ransacReprojThreshold=1.0)
    if found is None or int(inliers.sum()) < max(_MIN_TRACKED, 0.4 * int(kept.sum())):
        return None
    return np.vstack([found, [0.0, 0.0, 1.0]])


def widespread(rows: FloatArray, w: int, h: int) -> bool:
    """Return whether the textured pixels are in enough blocks of the image."""
    block = (rows[:, _Y] * _BLOCKS / h).astype(np.int64) * _BLOCKS + (rows[:, _X] * _BLOCKS / w).astype(np.int64)
    return int((np.bincount(block) >= _BLOCK_TEXTURED).sum()) >= _MIN_TEXTURED_BLOCKS
