"""Tuning of the chain from pictures to a trajectory."""

import enum
import math
from dataclasses import dataclass, field

from groundstation.onboard.pose.inertial_filter import InertialConfig


class CornerMethod(enum.StrEnum):
    """How corners follow from the tracked edges and the thresholds' predicted places.

    ``edges``: tracked edges meet thresholds that are seen between them; ``sides``: all four sides are
    measured again; ``susan``: the strongest SUSAN corner near each, as in the paper.
    """

    EDGES = "edges"
    SIDES = "sides"
    SUSAN = "susan"


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachConfig:
    """Tuning of the chain.

    Attributes
    ----------
    inertial : the filter.
    give_up_after : so many poses refused in a row, before it is trusted, and it starts again: the first corners may be
        wrong ones.
    corners : how corners are found.
    reach_px : how far from the seen thresholds a side or a corner is looked for, at least and at most.
    search_px : how far up and down both thresholds are looked for at most; while the pose comes from outside the far
        one then by itself within ``height_share`` of the runway's picture.
    settled_after, width_share : so many frames in a row the edges must have been tracked, and so close to the runway's
        width, before the first pose is believed.
    least_height_px : the thresholds' distance in the picture below which no corners are taken.
    near_sigma_px, far_sigma_px, susan_sigma_px : what a fit's own covariance leaves out and each picture has again.
    side_sigma_m, side_sigma_px : what a tracked edge and the pavement may lie apart for the whole flight, on the
        ground and, for blur and haze, in the picture.
    clear_levels, most_faint : pavement that differs from the ground next to it by fewer grey levels (over brightness
        and colours, both sides) has edges less sure in the picture, by the ratio, at most so much.
    dark_grey, lamp_sigma_m, lamp_sigma_px : in a darker picture lamps are lit, and edges are drawn to them.
    scatter_share, most_share, most_scatter : how fast the covariance that pictures have again follows the innovations'
        mean normalised square over its expectation, what one counts at most, and how far the factor may grow.
    changing_s, changing_share : edges also lie wrong for some seconds: period, and size next to what lasts.
    near_sigma_m, end_sigma_px : the same of a threshold, whose bars begin 6 m behind it, and of its blur;
        ``far_end_…`` of the far one.
    faint_px : what a threshold's rows are again besides, over the rise of the difference in units of its noise.
    confirmed_after : so many poses taken since the filter's start, and its fixes are given out: the first two fit any
        velocity, so that two wrong ones begin as well as two right ones.
    trusted_after : so many poses since the filter's start, and it says where thresholds are looked for.
    trusted_attitude_rad, trusted_share : and its attitude and position (share of the range) are known to this.
    """

    inertial: InertialConfig = field(default_factory=InertialConfig)
    give_up_after: int = 6
    corners: CornerMethod = CornerMethod.EDGES
    reach_px: tuple[float, float] = (2.0, 3.5)
    search_px: float = 12.0
    height_share: float = 0.15
    settled_after: int = 6
    width_share: float = 0.25
    least_height_px: float = 5.0
    near_sigma_px: float = 0.3
    far_sigma_px: float = 0.6
    susan_sigma_px: float = 2.5
    side_sigma_m: float = 0.7
    side_sigma_px: float = 1.2
    near_sigma_m: float = 3.0
    end_sigma_px: float = 0.7
    faint_px: float = 5.0
    clear_levels: float = 150.0
    most_faint: float = 2.5
    dark_grey: float = 115.0
    lamp_sigma_m: float = 1.5
    lamp_sigma_px: float = 2.5
    changing_s: float = 8.0
    changing_share: float = 0.7
    scatter_share: float = 0.1
    most_share: float = 10.0
    most_scatter: float = 100.0
    far_end_sigma_px: float = 1.5
    confirmed_after: int = 4
    trusted_after: int = 10
    trusted_attitude_rad: float = math.radians(0.6)
    trusted_share: float = 0.1
