"""Tuning of the chain from pictures to a trajectory."""

import enum
import math
from dataclasses import dataclass, field

from groundstation.onboard.pose.inertial import InertialConfig


class CornerMethod(enum.StrEnum):
    """How corners follow from the tracked edges and the thresholds' predicted places.

    ``edges``: tracked edges meet thresholds that are measured along their length; ``sides``: all four sides are
    measured anew; ``susan``: the strongest SUSAN corner near each, as in the paper.
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
    give_up_after : so many poses refused in a row, before it is trusted, and it starts anew: the first corners may be
        wrong ones.
    corners : how corners are found.
    reach_px : how far from its predicted place a threshold or a corner is looked for, at least and at most.
    search_px : how far up and down both thresholds are looked for while the pose comes from outside;
        ``height_share`` of the runway's picture the far one then by itself.
    settled_after, width_share : so many frames in a row the edges must have been tracked, and so close to the runway's
        width, before the first pose is believed.
    least_height_px : the thresholds' distance in the picture below which no corners are taken.
    near_sigma_px, far_sigma_px, susan_sigma_px : what a fit's own covariance leaves out and each picture has anew.
    side_sigma_m, side_sigma_px : what a tracked edge and the pavement may lie apart for the whole flight, on the
        ground and, for blur and haze, in the picture.
    near_sigma_m, end_sigma_px : the same of a threshold: paint and slabs, and blur; ``far_end_…`` of the far one.
    trusted_after : so many poses since the filter's start, and the tracker is told its pose, not the one from outside.
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
    susan_sigma_px: float = 1.0
    side_sigma_m: float = 0.7
    side_sigma_px: float = 1.2
    near_sigma_m: float = 0.7
    end_sigma_px: float = 0.3
    far_end_sigma_px: float = 1.5
    trusted_after: int = 10
    trusted_attitude_rad: float = math.radians(0.6)
    trusted_share: float = 0.1
