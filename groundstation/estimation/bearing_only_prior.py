"""What one camera alone leaves of a target: its bearing and how fast that turns, and little along the ray.

In the holder's polar coordinates, r its distance, d the ray, s = v·d and w = (v − s d)/r, the prior is taken apart; at
another distance r′ along the ray the target then moves at v′ = s′ d + r′ w. Of s′ the prior says s + g (r′ − r), g the
regression of s on r, with a variance that is widened by how many sigmas r was off. w is what the camera itself has
seen and stays as it is. docs/derivation.md, section 5.
"""

import numpy as np

from groundstation.arrays import FloatArray


class BearingOnlyPrior:
    """A target's prior (6,), (6, 6) as the camera at ``origin_m`` (3,) has it."""

    def __init__(self, target: FloatArray, covariance: FloatArray, origin_m: FloatArray) -> None:
        ray = target[:3] - origin_m
        self._origin_m, self._distance_m = origin_m, float(np.linalg.norm(ray))
        d = ray / self._distance_m
        self._along = float(target[3:] @ d)
        across = np.eye(3) - np.outer(d, d)
        self._turning = across @ target[3:] / self._distance_m
        w, r, s = self._turning, self._distance_m, self._along
        # how (r, s, w) go with position and velocity
        by_r = np.concatenate([d, np.zeros(3)])
        by_s = np.concatenate([w, d])
        by_w = np.hstack([-np.outer(w, d) / r - s * across / r**2, across / r])
        self._variance = float(by_r @ covariance @ by_r)
        self._slope = float(by_s @ covariance @ by_r) / self._variance
        self._left = max(float(by_s @ covariance @ by_s) - self._slope**2 * self._variance, 0.0)
        self._turning_spread = by_w @ covariance @ by_w.T

    def sigmas_to(self, point_m: FloatArray) -> float:
        """Return by how many of its sigmas the prior's distance differs from that of a point (3,)."""
        return abs(self._off(point_m)) / float(np.sqrt(self._variance))

    def velocity(self, point_m: FloatArray) -> FloatArray:
        """Return the velocity (3,) of a target at a point (3,)."""
        ray = point_m - self._origin_m
        speed = self._along + self._slope * self._off(point_m)
        return speed * ray / float(np.linalg.norm(ray)) + float(np.linalg.norm(ray)) * self._turning

    def velocity_slope(self, point_m: FloatArray) -> FloatArray:
        """Return ∂v/∂p (3, 3) of `velocity`, but for the turn of the ray, which is known to a pixel."""
        d = (point_m - self._origin_m) / float(np.linalg.norm(point_m - self._origin_m))
        return np.outer(self._turning + self._slope * d, d)

    def velocity_spread(self, point_m: FloatArray) -> FloatArray:
        """Return the covariance (3, 3) of the velocity of a target that is known to be at a point (3,)."""
        ray = point_m - self._origin_m
        distance = float(np.linalg.norm(ray))
        wrong = max(self.sigmas_to(point_m), 1.0)
        return distance**2 * self._turning_spread + wrong**2 * self._left * np.outer(ray, ray) / distance**2

    def _off(self, point_m: FloatArray) -> float:
        return float(np.linalg.norm(point_m - self._origin_m)) - self._distance_m
