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
    give_up_after : number of successive refused poses, before it is trusted, after which it restarts: the first corners
        may be wrong.
    corners : method of finding corners.
    reach_px : search distance of a side or a corner from the detected thresholds, at least and at most.
    search_px : largest search distance of both thresholds up and down; while the pose is external the far
        one then within ``height_share`` of the runway's picture.
    settled_after, width_share : number of successive frames with tracked edges, which the tracker has compared for at
        least three before, and their agreement with the runway's width, before the first pose is used.
    least_height_px : the thresholds' distance in the picture below which no corners are used.
    near_sigma_px, far_sigma_px, susan_sigma_px : errors of each picture beyond a fit's own covariance.
    side_sigma_m, side_sigma_px : constant distance between a tracked edge and the pavement over the flight, on the
        ground and, for blur and haze, in the picture.
    clear_levels, most_faint : pavement that differs from the ground next to it by fewer grey levels (over brightness
        and colours, both sides) has edges with larger sigmas in the picture, by the ratio, at most so much.
    dark_grey, lamp_sigma_m, lamp_sigma_px : in a darker picture lamps are on, and edges are biased to them.
    scatter_share, most_share, most_scatter : rate at which the covariance of each picture follows the innovations'
        mean normalised square over its expectation, the limit of one innovation, and the limit of the factor.
    changing_s, changing_share : edges also have errors for some seconds: period, and size relative to constant ones.
    near_sigma_m, end_sigma_px : the same of a threshold, whose bars begin 6 m behind it, and of its blur;
        ``far_end_…`` of the far one.
    width_sigma : how well the announced width is known, as a share of it; learnt where a height is known.
    height_memory_s : for how long the filter's own error in height stays about the same.
    faint_px : additional error of a threshold's rows, over the rise of the difference in units of its noise.
    confirmed_after : number of poses since the filter's start before its fixes are reported: the first two fit any
        velocity, so that two wrong ones start it as well as two right ones.
    trusted_after : number of poses since the filter's start before it predicts the thresholds.
    trusted_attitude_rad, trusted_share : and the required sigmas of attitude and position (share of the range).
    """

    inertial: InertialConfig = field(default_factory=InertialConfig)
    give_up_after: int = 6
    corners: CornerMethod = CornerMethod.EDGES
    reach_px: tuple[float, float] = (2.0, 3.5)
    search_px: float = 12.0
    height_share: float = 0.15
    settled_after: int = 3
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
    width_sigma: float = 0.02
    height_memory_s: float = 3.0
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
