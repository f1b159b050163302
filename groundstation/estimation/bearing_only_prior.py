"""Prior of a target tracked by one camera: bearing and bearing rate are observed, the range is not.

In polar coordinates of the camera, with distance r, ray d, s = v·d and w = (v − s d)/r, the velocity at another
distance r′ along the ray is v′ = s′ d + r′ w. The prior of s′ is s + g (r′ − r), with g the regression of s on r; its
variance is inflated by the deviation of r in sigmas. w is observed by the camera and stays unchanged.
docs/derivation.md, section 5.
"""

import numpy as np

from groundstation.arrays import FloatArray


class BearingOnlyPrior:
    """The prior (6,), (6, 6) of a target in polar coordinates of the camera at ``origin_m`` (3,)."""

    def __init__(self, target: FloatArray, covariance: FloatArray, origin_m: FloatArray) -> None:
        ray = target[:3] - origin_m
        self._origin_m, self._distance_m = origin_m, float(np.linalg.norm(ray))
        d = ray / self._distance_m
        self._along = float(target[3:] @ d)
        across = np.eye(3) - np.outer(d, d)
        self._turning = across @ target[3:] / self._distance_m
        w, r, s = self._turning, self._distance_m, self._along
        # Jacobians of (r, s, w) by position and velocity
        by_r = np.concatenate([d, np.zeros(3)])
        by_s = np.concatenate([w, d])
        by_w = np.hstack([-np.outer(w, d) / r - s * across / r**2, across / r])
        self._variance = float(by_r @ covariance @ by_r)
        self._slope = float(by_s @ covariance @ by_r) / self._variance
        self._left = max(float(by_s @ covariance @ by_s) - self._slope**2 * self._variance, 0.0)
        self._turning_spread = by_w @ covariance @ by_w.T

    def sigmas_to(self, point_m: FloatArray) -> float:
        """Return the difference between the distance of a point (3,) and that of the prior, in sigmas."""
        return abs(self._off(point_m)) / float(np.sqrt(self._variance))

    def velocity(self, point_m: FloatArray) -> FloatArray:
        """Return the velocity (3,) of a target at a point (3,)."""
        ray = point_m - self._origin_m
        speed = self._along + self._slope * self._off(point_m)
        return speed * ray / float(np.linalg.norm(ray)) + float(np.linalg.norm(ray)) * self._turning

    def velocity_slope(self, point_m: FloatArray) -> FloatArray:
        """Return ∂v/∂p (3, 3) of `velocity`, neglecting the rotation of the ray, which is known to a pixel."""
        d = (point_m - self._origin_m) / float(np.linalg.norm(point_m - self._origin_m))
        return np.outer(self._turning + self._slope * d, d)

    def velocity_spread(self, point_m: FloatArray) -> FloatArray:
        """Return the covariance (3, 3) of the velocity, given the position (3,)."""
        ray = point_m - self._origin_m
        distance = float(np.linalg.norm(ray))
        wrong = max(self.sigmas_to(point_m), 1.0)
        return distance**2 * self._turning_spread + wrong**2 * self._left * np.outer(ray, ray) / distance**2

    def _off(self, point_m: FloatArray) -> float:
        return float(np.linalg.norm(point_m - self._origin_m)) - self._distance_m
