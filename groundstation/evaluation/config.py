"""Tuning of the comparison with a reference: what counts as frozen, lagging, a glitch or a gap."""

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise


class OffsetSource(StrEnum):
    """Which positions are aligned with the reference to find the clock offset."""

    TRACK = "track"
    TRIANGULATION = "triangulation"


_ABOVE_ZERO = (
    "huber_sigma",
    "glitch_sigma",
    "glitch_min_m",
    "frozen_sigma",
    "lag_sigma",
    "lag_min_s",
    "lag_unprompted_min_s",
    "prior_position_sigma_m",
    "prior_velocity_sigma_m_s",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationConfig:
    """Tuning of the evaluation.

    Attributes
    ----------
    range_bins_m : edges of the range bins in y, runway frame; the last bin is open.
    max_interpolation_gap_s : the reference is not interpolated over a longer gap.
    max_offset_s : the clock offset is searched within ± this.
    offset_from : align the filter's track or the triangulated points.
    huber_sigma : beyond so many sigmas a residual counts linearly, not squared.
    frozen_tolerance_m : fixes closer together than this may be one held fix …
    frozen_min_motion_m : … if the track moved at least so far meanwhile …
    frozen_sigma : … and so many sigmas of track and reference.
    lag_window_s : length of the windows in which the offset is estimated separately.
    lag_sigma, lag_min_s : a window lags when its offset exceeds the session's by so many sigmas and seconds,
        after a freeze or a gap …
    lag_unprompted_min_s : … and by so much where neither came before it.
    glitch_sigma, glitch_min_m : a fix is a glitch when it departs so far from the curve of its neighbours.
    glitch_max_s : and no longer than this.
    prior_position_sigma_m, prior_velocity_sigma_m_s : prior of the posterior bound at its start.
    """

    range_bins_m: tuple[float, ...] = (0.0, 60.0, 100.0, 150.0, 250.0, 400.0, 700.0)
    max_interpolation_gap_s: float = 0.5
    max_offset_s: float = 3.0
    offset_from: OffsetSource = OffsetSource.TRIANGULATION
    huber_sigma: float = 2.0
    frozen_tolerance_m: float = 0.05
    frozen_min_motion_m: float = 0.5
    frozen_sigma: float = 5.0
    lag_window_s: float = 2.0
    lag_sigma: float = 4.0
    lag_min_s: float = 0.04
    lag_unprompted_min_s: float = 0.3
    glitch_sigma: float = 8.0
    glitch_min_m: float = 0.15
    glitch_max_s: float = 0.6
    prior_position_sigma_m: float = 10.0
    prior_velocity_sigma_m_s: float = 5.0

    def __post_init__(self) -> None:
        edges = self.range_bins_m
        if len(edges) < 1 or any(b <= a for a, b in pairwise(edges)):
            raise ValueError(f"range_bins_m {list(edges)} not rising")
        if min(self.max_interpolation_gap_s, self.lag_window_s, self.max_offset_s) <= 0:
            raise ValueError("max_interpolation_gap_s, lag_window_s and max_offset_s must be > 0")
        for name in _ABOVE_ZERO:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} {getattr(self, name):g} not > 0")
        if min(self.frozen_tolerance_m, self.glitch_max_s) < 0:
            raise ValueError("frozen_tolerance_m and glitch_max_s must be ≥ 0")
