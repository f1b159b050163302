"""Corners of the runway from its tracked edges: the edges give the search region, in which the thresholds are measured.

All pixels are those of a picture without distortion.
"""

import enum
from dataclasses import dataclass, replace

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.line_state import PITCH, ROLL, UP
from groundstation.onboard.edges.pose import NoseCameraPose, corrected_pose, pixels_from_points
from groundstation.onboard.edges.report import Edges
from groundstation.onboard.pose.corners import corners_from_lines, refine_corners
from groundstation.onboard.pose.runway import Runway
from groundstation.onboard.pose.susan import susan_corner
from groundstation.onboard.visual_inertial.config import ApproachConfig, CornerMethod
from groundstation.onboard.visual_inertial.corner_errors import (
    systematic_modes,
    systematic_sigmas,
    tracked_modes,
    weights_of_ends,
)
from groundstation.onboard.visual_inertial.threshold_detection import DetectedThreshold, detect_threshold

# a corner's start is known to this of the runway's height in the picture
_REACH_SHARE = 0.25
# less finds more corners, and none of them is the pavement's: better none
_SUSAN_THRESHOLD = 25.0
_BORDER_PX = 2.0
# rows compared on either side of a threshold, of the runway's height; and how far from its prediction at least
_NEAR_WINDOW, _FAR_WINDOW = 0.08, 0.05
_LEAST_REACH_PX = 2.5
# an undetected threshold: its corners are on the tracked edges, anywhere along them
_ANYWHERE_PX = 40.0
_NEAR, _FAR = (0, 3), (1, 2)


class NoCorners(enum.StrEnum):
    """Why a picture with edges gave no corners."""

    OUT_OF_PICTURE = "out_of_picture"
    FLAT = "flat"
    NO_NEAR = "no_near_threshold"
    NO_THRESHOLD = "no_threshold"
    NO_CORNER = "no_corner"
    TURNED = "turned"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundCorners:
    """Corners, ordered as `runway.CORNERS`.

    Attributes
    ----------
    pixels : (4, 2) px. start_px : (4, 2) their predictions.
    covariance_px2 : (4, 2, 2) errors of each picture; a threshold that is not confirmed leaves its corners free
        along the edges.
    systematic_px : (8, m) constant errors of the flight: columns of one sigma each, u and v corner by corner.
    near_seen, far_seen : whether the thresholds are confirmed in this picture.
    """

    pixels: FloatArray
    start_px: FloatArray
    covariance_px2: FloatArray
    systematic_px: FloatArray
    near_seen: bool = True
    far_seen: bool = True

    @property
    def seen_px(self) -> FloatArray:
        """Return the corners (4, 2) whose threshold is confirmed, NaN for the others."""
        seen = np.array([self.near_seen, self.far_seen, self.far_seen, self.near_seen])
        return np.where(seen[:, None], self.pixels, np.nan)

    @property
    def whole_covariance_px2(self) -> FloatArray:
        """Return both parts together, (4, 2, 2)."""
        rows = self.systematic_px.reshape(4, 2, -1)
        return np.asarray(self.covariance_px2 + rows @ np.swapaxes(rows, 1, 2))


def find_corners(
    image: ImageArray,
    edges: Edges,
    pose: NoseCameraPose,
    runway: Runway,
    kappa: FloatArray,
    config: ApproachConfig,
    row_sigma_px: FloatArray | None = None,
) -> FoundCorners | NoCorners:
    """Return the runway's corners in a picture.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR.
    edges : tracked in this picture, with the estimated constant errors of ``pose``.
    pose : the tracker's input pose.
    row_sigma_px : (2,) sigmas of the near and the far threshold's row by that pose, if made of such corners itself;
        None for an external pose, of which only the edges are known.
    """
    inside = row_sigma_px is not None
    start = start_corners(edges, pose if inside else _corrected(pose, edges), runway, kappa)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.float64)
    size = grey.shape[1], grey.shape[0]
    if start is None or not _inside(start, *size):
        return NoCorners.OUT_OF_PICTURE
    height = float(start[[0, 3], 1].mean() - start[[1, 2], 1].mean())
    if height < config.least_height_px:
        return NoCorners.FLAT
    near, far = _thresholds(image, start, height, row_sigma_px, config)
    if near is None and (far is None or not inside):
        return NoCorners.NO_THRESHOLD if inside else NoCorners.NO_NEAR
    moved = _moved(start, near, far, together=not inside)
    if not _inside(moved, *size):
        return NoCorners.OUT_OF_PICTURE
    reach = float(np.clip(_REACH_SHARE * height, *config.reach_px))
    if config.corners is CornerMethod.EDGES:
        found: tuple[FloatArray, FloatArray] | NoCorners = (moved, _along_edges(edges, moved, near, far, config))
    elif config.corners is CornerMethod.SIDES:
        refined = refine_corners(grey, moved, reach)
        found = NoCorners.NO_CORNER if refined is None else (refined.pixels, refined.covariance_px2)
    else:
        found = _susan(grey, moved, reach, config)
    if isinstance(found, NoCorners):
        return found
    pixels, covariance = found
    if np.linalg.norm(pixels - moved, axis=1).max() > 4.0 * config.reach_px[1]:
        return NoCorners.TURNED
    if config.corners is CornerMethod.EDGES:
        systematic = tracked_modes(pixels, edges, runway, config)
    else:
        levels = min(seen.levels for seen in (near, far) if seen is not None)
        systematic = systematic_modes(pixels, runway, systematic_sigmas(config, levels, dark=_is_dark(grey, config)))
    return FoundCorners(
        pixels=pixels,
        start_px=start,
        covariance_px2=covariance + _anew(config),
        systematic_px=systematic,
        near_seen=near is not None,
        far_seen=far is not None,
    )


def _is_dark(grey: FloatArray, config: ApproachConfig) -> bool:
    """Return whether the lower half of a picture (h, w) is as dark as at night."""
    return float(np.median(grey[grey.shape[0] // 2 :: 4, ::4])) < config.dark_grey


def start_corners(edges: Edges, pose: NoseCameraPose, runway: Runway, kappa: FloatArray) -> FloatArray | None:
    """Return where the tracked edges meet the thresholds that a pose predicts, (4, 2) px, or None."""
    predicted = pixels_from_points(pose, kappa, runway.corners_m)
    if not np.isfinite(predicted).all():
        return None
    left, right = (_line(*ends) for ends in _ends(edges))
    near, far = _line(predicted[0], predicted[3]), _line(predicted[1], predicted[2])
    return corners_from_lines(left, right, near, far)


def _corrected(pose: NoseCameraPose, edges: Edges) -> NoseCameraPose:
    """Return a pose corrected by the constant errors that the tracker has estimated."""
    mean = edges.state.mean
    return corrected_pose(pose, *(float(v) for v in mean[[ROLL, PITCH, UP]])) if mean.size > UP else pose


def _thresholds(
    image: ImageArray, start: FloatArray, height: float, row_sigma_px: FloatArray | None, config: ApproachConfig
) -> tuple[DetectedThreshold | None, DetectedThreshold | None]:
    """Return the near and the far threshold as far as they are confirmed, relative to ``start``.

    With an external pose the near one is searched for first: the pitch's error moves both equally, and the rest at
    the far end is the height's, a share of the runway's picture.
    """
    near_window = float(np.clip(_NEAR_WINDOW * height, 1.5, 4.0))
    far_window = float(np.clip(_FAR_WINDOW * height, 1.5, 3.0))
    if row_sigma_px is not None:
        near_reach, far_reach = np.clip(3.0 * row_sigma_px, _LEAST_REACH_PX, config.search_px)
        # both thresholds are never taken for each other
        near_reach, far_reach = min(near_reach, 0.4 * height), min(far_reach, 0.4 * height)
        near = detect_threshold(image, start, float(near_reach), near_window)
        return near, detect_threshold(image, start, float(far_reach), far_window, far=True)
    near = detect_threshold(image, start, min(config.search_px, 0.4 * height), near_window)
    if near is None:
        return None, None
    shift = float(near.shift_px.mean())
    reach = float(np.clip(config.height_share * height, 2.0, config.search_px))
    far = detect_threshold(image, _moved_down(start, np.full(4, shift)), reach, far_window, far=True)
    if far is not None:
        far = replace(far, shift_px=far.shift_px + shift)
    return near, far


def _moved(
    start: FloatArray, near: DetectedThreshold | None, far: DetectedThreshold | None, *, together: bool
) -> FloatArray:
    """Return corners (4, 2) moved to the seen thresholds; ``together``: one that is not seen moves with the other."""
    rows = np.zeros(4)
    if together and near is not None:
        rows[:] = near.shift_px.mean()
    for seen, which in ((near, _NEAR), (far, _FAR)):
        if seen is not None:
            # the left corner's row, and the right one's
            rows[[which[0], which[1]]] = seen.shift_px
    return _moved_down(start, rows)


def _moved_down(corners: FloatArray, rows: FloatArray) -> FloatArray:
    """Return corners (4, 2) moved down along their sides by so many rows (4,)."""
    moved = corners.copy()
    for near, far in ((0, 1), (3, 2)):
        along = (corners[near] - corners[far]) / (corners[near, 1] - corners[far, 1])
        for k in (near, far):
            moved[k] += rows[k] * along
    return moved


def _inside(pixels: FloatArray, w: int, h: int) -> bool:
    return bool(((pixels >= _BORDER_PX) & (pixels <= np.array([w, h]) - 1.0 - _BORDER_PX)).all())


def _ends(edges: Edges) -> list[tuple[FloatArray, FloatArray]]:
    """Return the lower and the upper end (2,) of each edge, px."""
    upper, lower = edges.rows_px
    return [(np.array([u[1], lower]), np.array([u[0], upper])) for u in edges.crossings_px.reshape(2, 2)]


def _line(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the line (3,) through two pixels."""
    return np.cross([*first, 1.0], [*second, 1.0])


def _along_edges(
    edges: Edges,
    corners: FloatArray,
    near: DetectedThreshold | None,
    far: DetectedThreshold | None,
    config: ApproachConfig,
) -> FloatArray:
    """Return covariances (4, 2, 2) of corners on the tracked edges: across by these, along by the thresholds.

    What lasts of the edges is no part of it.
    """
    independent = edges.covariance_px2 - edges.systematic_px2
    covariance = np.empty((4, 2, 2))
    for seen, which in ((near, _NEAR), (far, _FAR)):
        for number, k in enumerate(which):
            weights = weights_of_ends(edges, float(corners[k, 1]))
            block = independent[2 * number : 2 * number + 2, 2 * number : 2 * number + 2]
            side = corners[_NEAR[number]] - corners[_FAR[number]]
            along = side / side[1]
            if seen is None:
                sigma = _ANYWHERE_PX
            else:
                sigma = float(np.hypot(seen.sigma_px[number], config.faint_px / seen.rise))
            covariance[k] = sigma**2 * np.outer(along, along)
            covariance[k, 0, 0] += float(weights @ block @ weights)
    return covariance


def _susan(
    grey: FloatArray, start: FloatArray, reach: float, config: ApproachConfig
) -> tuple[FloatArray, FloatArray] | NoCorners:
    found = [susan_corner(grey, corner, max(round(reach), 2), _SUSAN_THRESHOLD) for corner in start]
    pixels = np.array([corner for corner in found if corner is not None])
    if len(pixels) < 4:
        return NoCorners.NO_CORNER
    return pixels, np.broadcast_to(config.susan_sigma_px**2 * np.eye(2), (4, 2, 2))


def _anew(config: ApproachConfig) -> FloatArray:
    """Return what every picture adds, (4, 2, 2)."""
    sigmas = np.array([config.near_sigma_px, config.far_sigma_px, config.far_sigma_px, config.near_sigma_px])
    return np.asarray(sigmas[:, None, None] ** 2 * np.eye(2))
