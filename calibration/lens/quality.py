"""How good a fitted lens is: on views it has not seen, and where in the image it is uncertain."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from calibration.lens.corners import BoardView
from calibration.lens.fit import LensFit, camera_matrix, fit_lens
from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens

_FOLDS = 5
_MAP_COLUMNS = 33
# the poses start within a hundredth of their noise; Newton's steps double the digits
_POSE_STEPS = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutViews:
    """Residuals of views by lenses that were fitted without them; each view's pose is its own.

    Attributes
    ----------
    rms_px : root mean square distance of a corner from its prediction.
    by_view_px : (views,) the same for each view.
    folds : in how many parts the views were split.
    """

    rms_px: float
    by_view_px: FloatArray
    folds: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UncertaintyMap:
    """One sigma (larger axis) of the image of a far direction, over the image.

    Attributes
    ----------
    u_px (columns,), v_px (rows,) : the grid.
    lens_px : (rows, columns) of the lens alone.
    aligned_px : (rows, columns) the remainder after the camera's orientation has been estimated with this same lens.
    aligned_deg : the same as an angle.
    """

    u_px: FloatArray
    v_px: FloatArray
    lens_px: FloatArray
    aligned_px: FloatArray
    aligned_deg: FloatArray


def hold_out(views: Sequence[BoardView], fit: LensFit, *, held: frozenset[str]) -> HeldOutViews:
    """Return the residuals of each part of the views by the lens that the other parts give.

    Raises
    ------
    IntrinsicsError : the views without one part do not determine the lens.
    """
    folds = min(_FOLDS, len(views))
    by_view = np.zeros(len(views))
    squares, corners = 0.0, 0
    for fold in range(folds):
        kept = [v for i, v in enumerate(views) if i % folds != fold]
        lens = fit_lens(kept, fit.lens.image_size_px, held=held, start=fit.lens).lens
        for i in range(fold, len(views), folds):
            residual = _residual(views[i], lens, fit.rotation[i], fit.translation_m[i])
            by_view[i] = np.sqrt(np.mean(np.sum(residual**2, axis=1)))
            squares += float(np.sum(residual**2))
            corners += len(residual)
    return HeldOutViews(rms_px=float(np.sqrt(squares / corners)), by_view_px=by_view, folds=folds)


def _residual(view: BoardView, lens: Lens, rotation: FloatArray, translation_m: FloatArray) -> FloatArray:
    """Return found minus predicted (n, 2), the pose refined for this lens from one close by (Gauss and Newton)."""
    matrix = camera_matrix(lens)
    r, t = rotation.copy(), translation_m.copy()
    residual = view.pixel
    for _ in range(_POSE_STEPS):
        predicted, jacobian = cv2.projectPoints(view.board_m, r, t, matrix, lens.distortion)
        residual = view.pixel - predicted.reshape(-1, 2)
        # columns scaled: rotations and a long lens's distance have little in common
        scale = np.linalg.norm(jacobian[:, :6], axis=0)
        step = np.linalg.lstsq(jacobian[:, :6] / scale, residual.reshape(-1), rcond=None)[0] / scale
        r, t = r + step[:3], t + step[3:]
    return residual


def uncertainty_map(lens: Lens, covariance: FloatArray, columns: int = _MAP_COLUMNS) -> UncertaintyMap:
    """Return the uncertainty of the image of a far direction, all over the image.

    A rotation of the camera is similar to a shift of the principal point, and the camera's orientation is estimated in
    the field with this lens. The second map is without the part of each error that such a rotation absorbs: the
    small rotation that fits the error best over the whole grid (least squares).
    """
    w, h = lens.image_size_px
    rows = max(3, round(columns * h / w))
    u_px, v_px = np.linspace(-0.5, w - 0.5, columns), np.linspace(-0.5, h - 0.5, rows)
    grid = np.stack(np.meshgrid(u_px, v_px), axis=-1).reshape(-1, 2)
    matrix = camera_matrix(lens)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-10)
    rays = cv2.undistortPoints(grid[:, None], matrix, lens.distortion, criteria=criteria).reshape(-1, 2)
    points = np.column_stack([rays, np.ones(len(rays))])
    jacobian: Any = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, lens.distortion)[1]
    turn, by_lens = jacobian[:, :3], jacobian[:, 6:15]
    left = by_lens - turn @ np.linalg.lstsq(turn, by_lens, rcond=None)[0]
    shape = (rows, columns)
    aligned = _larger_axis(left, covariance).reshape(shape)
    # distances on the sphere: a pixel off the axis is a smaller angle than one in the middle
    cosine = 1.0 / np.sqrt(1.0 + np.sum(rays**2, axis=1)).reshape(shape)
    degrees = np.degrees(aligned / lens.focal_px.mean() * cosine)
    return UncertaintyMap(
        u_px=u_px,
        v_px=v_px,
        lens_px=_larger_axis(by_lens, covariance).reshape(shape),
        aligned_px=aligned,
        aligned_deg=degrees,
    )


def _larger_axis(jacobian: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the larger sigma (n,) of pixels with derivative (2n, 9)."""
    each = jacobian.reshape(-1, 2, jacobian.shape[1])
    pixel = each @ covariance @ each.transpose(0, 2, 1)
    return np.sqrt(np.clip(np.linalg.eigvalsh(pixel)[:, 1], 0.0, None))
