"""The lens that fits the corners best, by OpenCV's solver, and its covariance.

With J the derivative of all predicted pixels by all parameters (lens and one pose for each view) and s² the variance of
the residuals over their degrees of freedom, the covariance is s² (JᵀJ)⁻¹. The lens's part of the inverse is that of the
Schur complement, in which the poses are eliminated view by view. OpenCV's solver stops early where parameters of very
different size are correlated, as with long lenses (k3 there is of the order of 100); Gauss-Newton steps on scaled
columns complete the convergence.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from calibration.errors import IntrinsicsError
from calibration.lens.corners import BoardView
from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.chi_square import chi_square_quantile

_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
# what may be held at zero, and OpenCV's flag for it
HOLDABLE = {"k2": cv2.CALIB_FIX_K2, "k3": cv2.CALIB_FIX_K3, "p": cv2.CALIB_ZERO_TANGENT_DIST}
_HELD_COLUMNS = {"k2": (5,), "k3": (8,), "p": (6, 7)}
_STEPS = 30
# of each parameter's sigma
_STEP_IS_NOTHING = 1e-4
# scaled to correlations, a smaller eigenvalue than this is no information at all
_NO_INFORMATION = 1e-13
# correlated parameters of a lens: focal lengths; radial distortion; centre and tangential distortion
_GROUPS = ((0, 1), (4, 5, 8), (2, 3, 6, 7))
# of lenses whose corners' errors are all new, so many keep the sigmas that follow from that
_CHANCE = 0.95
# below it Student's t has no variance
_LEAST_FREEDOM = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LensFit:
    """A fitted lens.

    Attributes
    ----------
    lens : the lens.
    covariance : (9, 9) of `lens_model.PARAMETERS`, px and the distortion's units; zero in the rows of fixed ones.
    white_sigma : (9,) one sigma of each if every corner's error were independent; ``covariance`` adds those of views.
    opencv_sigma : (9,) the standard deviations reported by OpenCV.
    residual : for each view (n, 2), detected minus predicted, px.
    rotation, translation_m : for each view (3,), board to camera: Rodrigues vector, m.
    rms_px : root mean square distance of a corner from its prediction; sigma_px: the same for one coordinate, over
        the degrees of freedom.
    focal_distance_correlation : of log focal length and the mean log distance of the boards.
    """

    lens: Lens
    covariance: FloatArray
    white_sigma: FloatArray
    opencv_sigma: FloatArray
    residual: tuple[FloatArray, ...]
    rotation: tuple[FloatArray, ...]
    translation_m: tuple[FloatArray, ...]
    rms_px: float
    sigma_px: float
    focal_distance_correlation: float

    @property
    def sigma(self) -> FloatArray:
        """Return one sigma of each of `lens_model.PARAMETERS` (9,)."""
        return np.sqrt(np.diag(self.covariance))


def camera_matrix(lens: Lens) -> FloatArray:
    """Return OpenCV's camera matrix (3, 3)."""
    (fx, fy), (cx, cy) = lens.focal_px, lens.principal_point_px
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def fit_lens(
    views: Sequence[BoardView],
    image_size_px: tuple[int, int],
    *,
    held: frozenset[str] = frozenset(),
    start: Lens | None = None,
) -> LensFit:
    """Fit lens and poses to the corners of several views.

    Parameters
    ----------
    held : those of `HOLDABLE` that stay zero; ``p`` is p1 and p2.
    start : a lens near the solution, for speed; None lets OpenCV find one.

    Raises
    ------
    IntrinsicsError : the solver fails, or the views do not determine the lens.
    """
    flags = sum(HOLDABLE[name] for name in held)
    columns = [i for i in range(9) if not any(i in _HELD_COLUMNS[name] for name in held)]
    matrix: Any
    distortion: Any
    matrix, distortion = np.eye(3), np.zeros(5)
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
        free = np.isin(np.arange(4, 9), columns)
        matrix, distortion = camera_matrix(start), np.where(free, start.distortion, 0.0)
    try:
        solved: Any = cv2.calibrateCameraExtended(
            [v.board_m.astype(np.float32) for v in views],
            [v.pixel.astype(np.float32) for v in views],
            image_size_px,
            matrix,
            distortion,
            flags=flags,
            criteria=_CRITERIA,
        )
    except cv2.error as fault:
        raise _undetermined(len(views)) from fault
    _, matrix, distortion, rotation, translation, opencv_sigma, _, _ = solved
    lens = Lens(
        image_size_px=image_size_px,
        focal_px=np.array([matrix[0, 0], matrix[1, 1]]),
        principal_point_px=matrix[:2, 2].copy(),
        distortion=distortion.reshape(-1)[:5].copy(),
    )
    if not all(np.all(np.isfinite(v)) for v in (lens.focal_px, lens.principal_point_px, lens.distortion)):
        raise _undetermined(len(views))
    solution = _LensSolution(
        lens=lens,
        rotation=tuple(np.asarray(r, dtype=np.float64).reshape(3) for r in rotation),
        translation_m=tuple(np.asarray(t, dtype=np.float64).reshape(3) for t in translation),
    )
    solution = _finished(views, solution, columns)
    return _with_covariance(views, solution, np.asarray(opencv_sigma).reshape(-1)[:9], columns)


def _undetermined(views: int) -> IntrinsicsError:
    return IntrinsicsError(
        "the pictures",
        got=f"{views} views that do not determine the lens",
        wanted="boards tilted both ways by 20 to 45 degrees, near and far, all over the image",
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LensSolution:
    """A lens, and each view's pose: Rodrigues vector and translation (3,)."""

    lens: Lens
    rotation: tuple[FloatArray, ...]
    translation_m: tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Linearised:
    """One view: residual (2n,), derivative by pose (2n, 6: rotation, translation) and by the lens (2n, 9)."""

    residual: FloatArray
    by_pose: FloatArray
    by_lens: FloatArray


def _linearise(views: Sequence[BoardView], solution: _LensSolution) -> list[_Linearised]:
    lines = []
    matrix, distortion = camera_matrix(solution.lens), solution.lens.distortion
    for view, rotation, translation in zip(views, solution.rotation, solution.translation_m, strict=True):
        projected: Any = cv2.projectPoints(view.board_m, rotation, translation, matrix, distortion)
        predicted, jacobian = projected
        residual = (view.pixel - predicted.reshape(-1, 2)).reshape(-1)
        lines.append(_Linearised(residual=residual, by_pose=jacobian[:, :6], by_lens=jacobian[:, 6:15]))
    return lines


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LensNormalEquations:
    """Normal equations of the lens alone, the poses eliminated, in units of ``scale``: matrix · step = right."""

    matrix: FloatArray
    right: FloatArray
    scale: FloatArray


def _normal(lines: Sequence[_Linearised], columns: list[int]) -> _LensNormalEquations:
    stacked = np.vstack([line.by_lens[:, columns] for line in lines])
    scale = np.linalg.norm(stacked, axis=0)
    matrix = np.zeros((len(columns), len(columns)))
    right = np.zeros(len(columns))
    for line in lines:
        # an orthogonal basis of a pose's effects is better conditioned for a long lens than its normal equations
        basis, _ = np.linalg.qr(line.by_pose / np.linalg.norm(line.by_pose, axis=0))
        by_lens = line.by_lens[:, columns] / scale
        rest = by_lens - basis @ (basis.T @ by_lens)
        matrix += rest.T @ rest
        right += rest.T @ line.residual
    return _LensNormalEquations(matrix=matrix, right=right, scale=scale)


def _finished(views: Sequence[BoardView], solution: _LensSolution, columns: list[int]) -> _LensSolution:
    """Return the converged solution; raises where the cost has no minimum."""
    lines = _linearise(views, solution)
    for _ in range(_STEPS):
        cost = sum(float(line.residual @ line.residual) for line in lines)
        normal = _normal(lines, columns)
        _check_determined(normal, len(views))
        step = np.linalg.solve(normal.matrix, normal.right) / normal.scale
        noise = np.sqrt(cost / sum(len(line.residual) for line in lines))
        sigma = noise * np.sqrt(np.diag(np.linalg.inv(normal.matrix))) / normal.scale
        for shorter in (1.0, 0.5, 0.25, 0.1, 0.01):
            moved = _moved(solution, lines, columns, shorter * step)
            ahead = _linearise(views, moved)
            if sum(float(line.residual @ line.residual) for line in ahead) <= cost:
                solution, lines = moved, ahead
                break
        else:
            break
        if np.all(np.abs(step) < _STEP_IS_NOTHING * (sigma + 1e-12)):
            break
    return solution


def _check_determined(normal: _LensNormalEquations, views: int) -> None:
    eigenvalues = np.linalg.eigvalsh(normal.matrix) if np.all(np.isfinite(normal.matrix)) else np.zeros(1)
    if eigenvalues[0] < _NO_INFORMATION:
        raise _undetermined(views)


def _moved(
    solution: _LensSolution, lines: Sequence[_Linearised], columns: list[int], step: FloatArray
) -> _LensSolution:
    """Return the solution with the lens moved by ``step`` and each pose to where it fits best then (linearised)."""
    change = np.zeros(9)
    change[columns] = step
    rotation, translation = [], []
    for line, r, t in zip(lines, solution.rotation, solution.translation_m, strict=True):
        scale = np.linalg.norm(line.by_pose, axis=0)
        pose = np.linalg.lstsq(line.by_pose / scale, line.residual - line.by_lens @ change, rcond=None)[0] / scale
        rotation.append(r + pose[:3])
        translation.append(t + pose[3:])
    lens = Lens(
        image_size_px=solution.lens.image_size_px,
        focal_px=solution.lens.focal_px + change[:2],
        principal_point_px=solution.lens.principal_point_px + change[2:4],
        distortion=solution.lens.distortion + change[4:],
    )
    return _LensSolution(lens=lens, rotation=tuple(rotation), translation_m=tuple(translation))


def _with_covariance(
    views: Sequence[BoardView], solution: _LensSolution, opencv_sigma: FloatArray, columns: list[int]
) -> LensFit:
    """Return the fit with its covariance; raises where the views leave a direction of the lens open."""
    lines = _linearise(views, solution)
    normal = _normal(lines, columns)
    _check_determined(normal, len(views))
    residuals = np.concatenate([line.residual for line in lines])
    freedom = len(residuals) - len(columns) - 6 * len(views)
    variance = float(residuals @ residuals) / max(freedom, 1)
    inverse = np.linalg.inv(normal.matrix) / np.outer(normal.scale, normal.scale)
    free = np.ix_(columns, columns)
    covariance = np.zeros((9, 9))
    covariance[free] = 0.5 * variance * (inverse + inverse.T)
    white_sigma = np.sqrt(np.diag(covariance))
    covariance[free] = _raised(covariance[free], _over_views(lines, columns, normal), len(views), columns)
    return LensFit(
        lens=solution.lens,
        covariance=covariance,
        white_sigma=white_sigma,
        opencv_sigma=opencv_sigma,
        residual=tuple(line.residual.reshape(-1, 2) for line in lines),
        rotation=solution.rotation,
        translation_m=solution.translation_m,
        rms_px=float(np.sqrt(residuals @ residuals / (len(residuals) / 2))),
        sigma_px=float(np.sqrt(variance)),
        focal_distance_correlation=_focal_distance_correlation(solution, lines, covariance, variance),
    )


def _over_views(lines: Sequence[_Linearised], columns: list[int], normal: _LensNormalEquations) -> FloatArray:
    """Return the covariance (p, p) of the free parameters as the views themselves scatter: the jackknife over views.

    A bent print, a blur or a light from one side shifts the corners of a view together; they do not average out in it.
    """
    inverse = np.linalg.inv(normal.matrix)
    unit = np.eye(len(columns))
    scores = []
    for line in lines:
        basis, _ = np.linalg.qr(line.by_pose / np.linalg.norm(line.by_pose, axis=0))
        by_lens = line.by_lens[:, columns] / normal.scale
        rest = by_lens - basis @ (basis.T @ by_lens)
        # the fit has followed each view by its leverage: the residual without it
        scores.append(np.linalg.lstsq(unit - rest.T @ rest @ inverse, rest.T @ line.residual, rcond=None)[0])
    meat = np.array(scores).T @ np.array(scores) * (len(lines) - 1) / len(lines)
    return np.asarray(inverse @ meat @ inverse / np.outer(normal.scale, normal.scale))


def _raised(covariance: FloatArray, seen: FloatArray, views: int, columns: list[int]) -> FloatArray:
    """Return a covariance (p, p), enlarged where the views scatter by more: ``seen`` (p, p), by the jackknife.

    Combination by combination within `_GROUPS`: correlated parameters are known far better together than alone, and
    enlarging one by itself would rotate that. Scatter within chance for so few views, in the worst of p combinations,
    has no effect; the addition is widened to the variance of Student's t, n/(n − 2) with n + 1 views.
    """
    sigma = np.sqrt(np.diag(covariance))
    unit, seen = covariance / np.outer(sigma, sigma), seen / np.outer(sigma, sigma)
    axes = np.zeros_like(unit)
    for group in _GROUPS:
        own = [place for place, column in enumerate(columns) if column in group]
        axes[np.ix_(own, own)] = np.linalg.eigh(unit[np.ix_(own, own)])[1]
    size = axes.T @ unit @ axes
    ratio = np.diag(axes.T @ seen @ axes) / np.maximum(np.diag(size), _NO_INFORMATION)
    freedom = max(views - 1, 1)
    limit = chi_square_quantile(_CHANCE ** (1.0 / len(ratio)), freedom) / freedom
    # a variance estimated from so few views is itself uncertain: Student's t with that freedom is wider; that of the
    # corners' own noise is estimated from all of them
    wider = freedom / (freedom - 2.0) if freedom > _LEAST_FREEDOM else 1.0
    raised = np.sqrt(np.where(ratio > limit, 1.0 + wider * (ratio - 1.0), 1.0))
    spread = sigma[:, None] * axes * raised
    return np.asarray(spread @ size @ spread.T)


def _focal_distance_correlation(
    solution: _LensSolution, lines: Sequence[_Linearised], covariance: FloatArray, variance: float
) -> float:
    """Return the correlation of log f (mean of fx, fy) with the mean log distance of the boards.

    A pose's error is −(PᵀP)⁻¹PᵀL times the lens's error, plus its own noise; P, L the derivatives by pose and lens.
    """
    by_lens = np.zeros(9)
    own = 0.0
    for line, t in zip(lines, solution.translation_m, strict=True):
        scale = np.linalg.norm(line.by_pose, axis=0)
        pull = np.linalg.pinv(line.by_pose / scale)[5] / scale[5] / t[2] / len(lines)
        by_lens -= pull @ line.by_lens
        own += variance * float(pull @ pull)
    focal = np.zeros(9)
    focal[:2] = 0.5 / solution.lens.focal_px
    spread = np.sqrt((focal @ covariance @ focal) * (by_lens @ covariance @ by_lens + own))
    return float(focal @ covariance @ by_lens / spread) if spread > 0 else 0.0
