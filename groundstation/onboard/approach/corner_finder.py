"""Corners of the runway from its tracked edges: the edges say where to look, the thresholds are measured there.

All pixels are those of a picture without distortion.
"""

import enum
from dataclasses import dataclass

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.approach.config import ApproachConfig, CornerMethod
from groundstation.onboard.approach.strip_end import strip_end_shift
from groundstation.onboard.edges.lines import PITCH, ROLL, UP
from groundstation.onboard.edges.pose import CameraPose, corrected_pose, pixels_from_points
from groundstation.onboard.edges.report import Edges
from groundstation.onboard.pose.corners import Side, corners_from_lines, fit_side, meet, refine_corners
from groundstation.onboard.pose.runway import Runway
from groundstation.onboard.pose.susan import susan_corner

# a threshold's prediction is known to this of the band that is left of the edges
_REACH_SHARE = 0.25
_SUSAN_THRESHOLD = 25.0
_BORDER_PX = 2.0
# ways in which edges may lie wrong for good: both on the ground, four ends, two thresholds shifted and turned
LASTING_COUNT = 10


class NoCorners(enum.StrEnum):
    """Why a picture with edges gave no corners."""

    OUT_OF_PICTURE = "out_of_picture"
    FLAT = "flat"
    NO_NEAR = "no_near_threshold"
    NO_FAR = "no_far_threshold"
    NO_CORNER = "no_corner"
    TURNED = "turned"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundCorners:
    """Corners, ordered as `runway.CORNERS`.

    Attributes
    ----------
    pixels : (4, 2) px. start_px : (4, 2) where they were looked for.
    covariance_px2 : (4, 2, 2) of what each picture has anew.
    lasting_px : (8, m) what lasts for the flight: columns of one sigma each, u and v of one corner after the other.
    """

    pixels: FloatArray
    start_px: FloatArray
    covariance_px2: FloatArray
    lasting_px: FloatArray

    @property
    def whole_covariance_px2(self) -> FloatArray:
        """Return both parts together, (4, 2, 2)."""
        rows = self.lasting_px.reshape(4, 2, -1)
        return np.asarray(self.covariance_px2 + rows @ np.swapaxes(rows, 1, 2))


def find_corners(
    image: ImageArray,
    edges: Edges,
    pose: CameraPose,
    runway: Runway,
    kappa: FloatArray,
    config: ApproachConfig,
    pose_fits: bool = False,
) -> FoundCorners | NoCorners:
    """Return the runway's corners in a picture.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR.
    edges : tracked in this picture, with what the tracker knows to be wrong with ``pose``.
    pose : what the tracker was told.
    pose_fits : whether that pose is made of such corners itself: then it shows the thresholds' places as it is, and
        closely.
    """
    start = start_corners(edges, pose if pose_fits else _corrected(pose, edges), runway, kappa)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.float64)
    h, w = grey.shape
    if start is None or not _inside(start, w, h):
        return NoCorners.OUT_OF_PICTURE
    height = float(start[[0, 3], 1].mean() - start[[1, 2], 1].mean())
    if height < config.least_height_px:
        return NoCorners.FLAT
    if not pose_fits:
        moved = _by_strip(image.astype(np.float64), start, height, config)
        if isinstance(moved, NoCorners):
            return moved
        start = moved
        if not _inside(start, w, h):
            return NoCorners.OUT_OF_PICTURE
    reach = float(np.clip(_REACH_SHARE * height, *config.reach_px))
    if config.corners is CornerMethod.EDGES:
        found = _from_edges(grey, edges, start, reach, config)
    elif config.corners is CornerMethod.SIDES:
        refined = refine_corners(grey, start, reach)
        found = NoCorners.NO_CORNER if refined is None else (refined.pixels, refined.covariance_px2)
    else:
        found = _susan(grey, start, reach, config)
    if isinstance(found, NoCorners):
        return found
    pixels, covariance = found
    if np.linalg.norm(pixels - start, axis=1).max() > 4.0 * config.reach_px[1]:
        return NoCorners.TURNED
    return FoundCorners(
        pixels=pixels,
        start_px=start,
        covariance_px2=covariance + _anew(config),
        lasting_px=lasting_modes(pixels, runway, config),
    )


def start_corners(edges: Edges, pose: CameraPose, runway: Runway, kappa: FloatArray) -> FloatArray | None:
    """Return where the tracked edges meet the thresholds that a pose predicts, (4, 2) px, or None."""
    predicted = pixels_from_points(pose, kappa, runway.corners_m)
    if not np.isfinite(predicted).all():
        return None
    left, right = (_line(*ends) for ends in _ends(edges))
    near, far = _line(predicted[0], predicted[3]), _line(predicted[1], predicted[2])
    return corners_from_lines(left, right, near, far)


def lasting_modes(pixels: FloatArray, runway: Runway, config: ApproachConfig) -> FloatArray:
    """Return the columns (8, `LASTING_COUNT`) of what lasts: both edges on the ground and at each end, both thresholds.

    A threshold's shift along the runway moves its corners along the sides.
    """
    columns = []
    # pairs of corners: left side (near, far), right side (near, far)
    for near, far in ((0, 1), (3, 2)):
        shift = np.zeros((4, 2))
        for k, other in ((near, 3 - near), (far, 3 - far)):
            across = pixels[other] - pixels[k]
            shift[k] = config.side_sigma_m * across / runway.width_m
        columns.append(shift.ravel())
    for k in range(4):
        end = np.zeros((4, 2))
        end[k, 0] = config.side_sigma_px
        columns.append(end.ravel())
    for pair, along_m, sigma_px in (
        (((0, 1), (3, 2)), config.near_sigma_m, config.end_sigma_px),
        (((1, 0), (2, 3)), 0.0, config.far_end_sigma_px),
    ):
        shift, turned = np.zeros((4, 2)), np.zeros((4, 2))
        for sign, (k, other) in zip((1.0, -1.0), pair, strict=True):
            side = pixels[other] - pixels[k]
            # a metre takes more of the side's picture at its near end than on its average
            by_metres = along_m / runway.length_m * _stretch(pixels, k, other)
            by_blur = sigma_px / max(abs(float(side[1])), 1.0)
            shift[k] = np.hypot(by_metres, by_blur) * side
            # the same with its ends opposite: a threshold that seems turned
            turned[k] = sign * by_blur * side
        columns += [shift.ravel(), turned.ravel()]
    return np.stack(columns, axis=1)


def _corrected(pose: CameraPose, edges: Edges) -> CameraPose:
    """Return a pose without what the tracker has found to be wrong with it for good."""
    mean = edges.state.mean
    return corrected_pose(pose, *(float(v) for v in mean[[ROLL, PITCH, UP]])) if mean.size > UP else pose


def _by_strip(image: FloatArray, start: FloatArray, height: float, config: ApproachConfig) -> FloatArray | NoCorners:
    """Return the start moved to where the strip between the edges is seen to end, first near, then far."""
    shift = strip_end_shift(image, start, config.search_px, float(np.clip(0.12 * height, 2.5, 5.0)))
    if shift is None:
        return NoCorners.NO_NEAR
    start = _moved_down(start, shift, (0, 1, 2, 3))
    # what is left at the far end is the height's error, a share of the picture of the runway
    reach = float(np.clip(config.height_share * height, 2.0, config.search_px))
    shift = strip_end_shift(image, start, reach, float(np.clip(0.06 * height, 1.5, 3.0)), far=True)
    return NoCorners.NO_FAR if shift is None else _moved_down(start, shift, (1, 2))


def _moved_down(corners: FloatArray, rows: float, which: tuple[int, ...]) -> FloatArray:
    """Return corners (4, 2), some of them moved down along their sides by so many rows."""
    moved = corners.copy()
    for near, far in ((0, 1), (3, 2)):
        along = (corners[near] - corners[far]) / (corners[near, 1] - corners[far, 1])
        for k in {near, far} & set(which):
            moved[k] += rows * along
    return moved


def _stretch(pixels: FloatArray, k: int, other: int) -> float:
    """Return how much longer a metre appears at one end of a side than on its average: the widths' ratio."""
    widths = [float(np.linalg.norm(pixels[i] - pixels[3 - i])) for i in (k, other)]
    return widths[0] / max(widths[1], 1.0)


def _inside(pixels: FloatArray, w: int, h: int) -> bool:
    return bool(((pixels >= _BORDER_PX) & (pixels <= np.array([w, h]) - 1.0 - _BORDER_PX)).all())


def _ends(edges: Edges) -> list[tuple[FloatArray, FloatArray]]:
    """Return the lower and the upper end (2,) of each edge, px."""
    upper, lower = edges.rows_px
    return [(np.array([u[1], lower]), np.array([u[0], upper])) for u in edges.crossings_px.reshape(2, 2)]


def _line(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the line (3,) through two pixels."""
    return np.cross([*first, 1.0], [*second, 1.0])


def _tracked_side(edges: Edges, number: int) -> Side:
    """Return a tracked edge as a side: offset and slope about its middle."""
    lower, upper = _ends(edges)[number]
    span = upper - lower
    length = float(np.linalg.norm(span))
    along = span / length
    # a shift along the row, as an offset across the line
    across_u = -along[1]
    block = edges.covariance_px2[2 * number : 2 * number + 2, 2 * number : 2 * number + 2]
    # the ends as crossings are ordered: upper, lower
    to_line = across_u * np.array([[0.5, 0.5], [1.0 / length, -1.0 / length]])
    return Side(point=0.5 * (lower + upper), along=along, covariance=to_line @ block @ to_line.T, contrast=1.0)


def _from_edges(
    grey: FloatArray, edges: Edges, start: FloatArray, reach: float, config: ApproachConfig
) -> tuple[FloatArray, FloatArray] | NoCorners:
    """Return corners (4, 2) and covariances (4, 2, 2): tracked edges, thresholds measured between them."""
    left, right = (_tracked_side(edges, number) for number in (0, 1))
    pixels, covariance = np.empty((4, 2)), np.empty((4, 2, 2))
    for (a, b), missing in (((0, 3), NoCorners.NO_NEAR), ((1, 2), NoCorners.NO_FAR)):
        threshold = fit_side(grey, start[a], start[b], reach)
        if threshold is None:
            return missing
        for k, side in ((a, left), (b, right)):
            met = meet(side, threshold)
            if met is None:
                return missing
            pixels[k], covariance[k] = met
    return pixels, covariance


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
