"""The approach as planned: a straight glide path to an aim point on the runway."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedApproach:
    """A straight descent over the centre line.

    Attributes
    ----------
    glide_path_rad : angle of descent.
    aim_past_threshold_m : where the glide path meets the surface, along the landing direction past the threshold.
    speed_m_s : planned speed over ground, None if unknown.
    """

    glide_path_rad: float
    aim_past_threshold_m: float = 0.0
    speed_m_s: float | None = None

    def height_m(self, along_m: float) -> float:
        """Return the path's height over the threshold at ``along_m`` past the threshold (negative before it)."""
        return math.tan(self.glide_path_rad) * (self.aim_past_threshold_m - along_m)
