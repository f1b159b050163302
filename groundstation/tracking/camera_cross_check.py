"""Comparison of reference positions with the cameras' own triangulation, which no reference has ever moved.

The filter's gate alone does not protect a target from a receiver that drifts: each position passes near the last one,
and the target follows. Triangulated points do not follow.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.estimation.updates.reference_update import NosePosition

# χ² with three degrees of freedom, probability 0.99: while two cameras detect the target, a position refused in vain
# costs little, and one accepted wrongly moves the target
_GATE = 11.34
# points whose differences are compared; their pixel noise is independent, their pointing errors are not
_MOST, _FEWEST = 10, 3
# variance of a median over that of the mean, for normal noise
_MEDIAN_VARIANCE = 0.5 * math.pi
# of χ² with three degrees of freedom
_MEDIAN_CHI2 = 2.366


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TriangulatedPoint:
    """A point (3,) m at a time, and its covariance (3, 3) by pixels alone, and by pointing errors alone."""

    t_s: float
    point_runway_m: FloatArray
    by_pixels_m2: FloatArray
    by_pointing_m2: FloatArray


class CameraCrossCheck:
    """Compares reference positions with what two or more cameras triangulate.

    Parameters
    ----------
    pointing_sigma_rad : by station, 1 sigma of its pointing by the rig's stated errors, before any reference.
    most_age_s : an older point says nothing about the target now.
    residual_gate_sigma : rays that miss each other by more sigmas make no point.
    """

    def __init__(self, pointing_sigma_rad: Mapping[str, float], most_age_s: float, residual_gate_sigma: float) -> None:
        self._pointing_sigma_rad = pointing_sigma_rad
        self._most_age_s = most_age_s
        self._residual_gate_sigma = residual_gate_sigma
        self._newest: TriangulatedPoint | None = None
        self._untriangulated: tuple[float, tuple[tuple[str, TriangulationView], ...]] | None = None
        self._compared_s = -math.inf
        self._differences: deque[tuple[float, FloatArray]] = deque(maxlen=_MOST)

    def add(self, t_s: float, views: Iterable[tuple[str, TriangulationView]]) -> None:
        """Take the views (station, view) of an epoch; they are triangulated when a reference position needs them."""
        taken = tuple(views)
        if len(taken) >= 2:
            self._untriangulated = t_s, taken

    def _triangulate(self) -> TriangulatedPoint | None:
        """Return the newest point; that of the views taken last, where their rays meet."""
        if self._untriangulated is None:
            return self._newest
        (t_s, views), self._untriangulated = self._untriangulated, None
        exact = [replace(view, angle_sigma_rad=0.0) for _, view in views]
        stated = [
            replace(view, angle_sigma_rad=math.hypot(view.angle_sigma_rad, self._pointing_sigma_rad[station]))
            for station, view in views
        ]
        by_pixels, point = triangulate(exact), triangulate(stated)
        if by_pixels is not None and point is not None and point.residual_sigma <= self._residual_gate_sigma:
            self._newest = TriangulatedPoint(
                t_s=t_s,
                point_runway_m=point.point_runway_m,
                by_pixels_m2=by_pixels.covariance_m2,
                by_pointing_m2=point.covariance_m2 - by_pixels.covariance_m2,
            )
        return self._newest

    def contradicts(self, t_s: float, nose: NosePosition) -> bool:
        """Return whether a reference's nose position is not where the cameras have the target.

        False without a recent point.
        """
        newest = self._triangulate()
        if newest is None or abs(t_s - newest.t_s) > self._most_age_s:
            return False
        ahead = t_s - newest.t_s
        difference = nose.position_m - newest.point_runway_m - ahead * nose.velocity_m_s
        if newest.t_s > self._compared_s:
            self._compared_s = newest.t_s
            self._differences.append((t_s, difference))
        recent = self._recent(t_s)
        if len(recent) < _FEWEST:
            return False
        # a gross outlier among the pixels moves one point along the rays, and no median
        usual = np.median(recent, axis=0)
        noise = newest.by_pixels_m2
        if _distance(difference - usual, noise) > _distance(difference, noise):
            # a receiver that agrees again is used at once
            return False
        # where points scatter by more than the stated pixel noise, outliers in half of them even, so does the median
        excess = max(float(np.median([_distance(each - usual, noise) for each in recent])) / _MEDIAN_CHI2, 1.0)
        spread = newest.by_pointing_m2 + nose.covariance_m2 + (excess * _MEDIAN_VARIANCE / len(recent)) * noise
        return _distance(usual, spread) > _GATE

    def _recent(self, t_s: float) -> list[FloatArray]:
        return [found for then, found in self._differences if t_s - then <= self._most_age_s]

    def distance_m(self, t_s: float, nose: NosePosition) -> float:
        """Return how far a reference's nose position is from the newest point, moved with the target; 0 without one."""
        newest = self._newest
        if newest is None:
            return 0.0
        return float(np.linalg.norm(nose.position_m - newest.point_runway_m - (t_s - newest.t_s) * nose.velocity_m_s))


def _distance(difference: FloatArray, covariance: FloatArray) -> float:
    """Return the squared Mahalanobis distance of a difference (3,)."""
    return float(difference @ np.linalg.solve(covariance, difference))
