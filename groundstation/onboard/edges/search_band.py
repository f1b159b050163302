"""The rows of the picture with runway, by altitude and attitude: the range of all other steps.

The paper sweeps between two lines "related to the elevation of the UAV" and keeps their distance in a table. Here
they follow from the pose: the rows of the ground between two distances, cut where the picture ends.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.line_kernel import horizon_direction, seen_rows, widths_between
from groundstation.onboard.edges.pose import NoseCameraPose


class NoBand(Enum):
    """Reasons for having no rows to search."""

    BEHIND = "the runway is not in front of the camera"
    TOO_FLAT = "the runway is seen too flat"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunwayGuess:
    """Approximate prior knowledge of a runway: m.

    Attributes
    ----------
    width_m, length_m : width limits plausible pairs of edges; the band ends before the far end.
    width_announced : the width is this runway's, and counts as evidence and in the covariance; a usual one does not.
    margin_m : kept off both ends, for the error of the position.
    margin_px, margin_share : kept off in the picture too, for the error of the attitude: px, but at most a
        share of the rows.
    slope_rad : assumed glide path of an aircraft of which only the height is known.
    """

    width_m: float = 20.0
    length_m: float = 500.0
    width_announced: bool = True
    margin_m: float = 6.0
    margin_px: float = 6.0
    margin_share: float = 0.15
    slope_rad: float = math.radians(4.0)


def band_rows(
    pose: NoseCameraPose,
    kappa: FloatArray,
    image_size_px: tuple[int, int],
    guess: RunwayGuess,
    *,
    least_rows: float = 8.0,
    middle_m: float = 0.0,
    width_m: float | None = None,
) -> FloatArray | NoBand:
    """Return the upper and the lower row (2,) between which both edges run, or the reason why there are none.

    ``middle_m`` and ``width_m`` are the assumed position of the edges across the runway, as far as it is known.
    Near the threshold the lower row is that of the picture, or that below which an edge leaves it sideways.
    """
    w, h = image_size_px
    half = 0.5 * (guess.width_m if width_m is None else width_m)
    ahead = pose.threshold_from_camera[:, 2]
    start = min(-guess.margin_m, float(pose.camera_threshold_m[1]) - 2.0)
    end = -guess.length_m + guess.margin_m
    if ahead[1] > -0.5 or start < end:
        return NoBand.BEHIND
    rows = np.empty(2)
    sides = (middle_m + half, middle_m - half)
    if not seen_rows(pose.threshold_from_camera, pose.camera_threshold_m, kappa, (w, h), sides, (start, end), rows):
        return NoBand.BEHIND
    margin = min(guess.margin_px, guess.margin_share * float(rows[1] - rows[0]))
    rows[0] += margin
    rows[1] -= margin
    return rows if rows[1] - rows[0] >= least_rows else NoBand.TOO_FLAT


def position_by_height(height_m: float, guess: RunwayGuess) -> FloatArray:
    """Return where an aircraft of which only the height is known is taken to be, threshold frame (3,) m."""
    return np.array([0.0, height_m / math.tan(guess.slope_rad), height_m])


def across_direction(e: FloatArray) -> FloatArray:
    """Return the image's direction (2,) of a line across the runway far ahead, to the right: that of the horizon.

    ``e`` is the line map E; the horizon is the image of the ground's line at infinity.
    """
    direction = np.empty(2)
    horizon_direction(e, direction)
    return direction


def band_widths(
    crossings_px: FloatArray,
    shifted_px: FloatArray,
    rows_px: FloatArray,
    least_px: float,
    across: FloatArray | None = None,
) -> FloatArray:
    """Return ℓ (2, 2): distance in the picture of lines shifted on the ground from the edges (Section III.B).

    At least ``least_px``; along ``across`` (2,), or the normals where it is None; line 1 and 2, at both rows.
    """
    widths = np.empty((2, 2))
    widths_between(crossings_px, shifted_px, rows_px, least_px, np.zeros(2) if across is None else across, widths)
    return widths
