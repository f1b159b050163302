"""Where the detected point is on an aircraft that the detector has not seen before.

The difference to the target point is about the same in all pictures of a flight, so that no filter averages it away and
no residual shows it: the estimate is corrected by its mean and its covariance enlarged at the output.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.messages import Kinematics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetPointError:
    """The detected point's error, in spans, by how an aircraft flies in front of cameras.

    One that flies away hides its nose: where that is inferred to be is behind the nose in the mean, and more uncertain.

    Attributes
    ----------
    sigma_spans : (3,) one sigma forward, to the right and upward on an aircraft that flies towards the cameras.
    hidden_lead_spans : so far is the nose ahead of the detected point in the mean, along an aircraft that is seen
        straight from behind; nothing where it flies across the line of sight.
    hidden_spans : (3,) further sigma, forward, to the right and upward, of one that is seen straight from behind.
    eyes_m : (3,) each, the positions of the cameras in the runway frame.
    """

    sigma_spans: FloatArray
    hidden_lead_spans: float
    hidden_spans: FloatArray
    eyes_m: Sequence[FloatArray]

    @classmethod
    def by(cls, config: EstimationConfig, eyes_m: Sequence[FloatArray], *, inferred: bool) -> "TargetPointError":
        """Return the configured error; ``inferred``: the learned channel has inferred where a hidden nose is."""
        return cls(
            sigma_spans=np.array(config.target_point_sigma_spans),
            hidden_lead_spans=config.target_point_behind_lead_spans if inferred else 0.0,
            hidden_spans=np.array((config.target_point_behind_spans, 0.0, config.target_point_behind_up_spans)),
            eyes_m=eyes_m,
        )

    def corrected(self, kinematics: Kinematics, span_m: float) -> Kinematics:
        """Return the estimate of the detected point as one of the target point, for an aircraft with a span in m."""
        hidden = self._hidden_share(kinematics)
        sigma_m = span_m * np.sqrt(self.sigma_spans**2 + hidden * self.hidden_spans**2)
        position_m = kinematics.position_runway_m + self.lead_m(kinematics, span_m)
        return with_point_error(replace(kinematics, position_runway_m=position_m), sigma_m)

    def lead_m(self, kinematics: Kinematics, span_m: float) -> FloatArray:
        """Return how far (3,) the target point is ahead of the detected one in the mean, runway frame, m."""
        hidden = self._hidden_share(kinematics)
        return span_m * hidden * self.hidden_lead_spans * _expected_direction(kinematics)

    def _hidden_share(self, kinematics: Kinematics) -> float:
        """Return the mean of the squared cosines between path and lines of sight: 1 straight from behind, 0 towards."""
        velocity_m_s = kinematics.velocity_runway_m_s
        if not velocity_m_s.any() or not self.eyes_m:
            return 0.0
        away = [_cosine(velocity_m_s, kinematics.position_runway_m - eye_m) for eye_m in self.eyes_m]
        return float(np.mean(np.square(np.maximum(away, 0.0))))


def with_point_error(kinematics: Kinematics, sigma_m: FloatArray) -> Kinematics:
    """Return an estimate whose position covers the detected point's error.

    ``sigma_m`` (3,) is one sigma of it forward, to the right and upward on the aircraft, m. The aircraft's axes are
    those of its path, so that a small crab angle is neglected; while the direction of the velocity is uncertain, the
    error counts in every horizontal direction.
    """
    forward, right, up = (float(s) ** 2 for s in sigma_m)
    horizontal_m_s = kinematics.velocity_runway_m_s[:2]
    speed2 = float(horizontal_m_s @ horizontal_m_s)
    noise2 = max(float(np.trace(kinematics.covariance[3:5, 3:5])), 0.0)
    spread = np.eye(2) / 2.0
    if speed2 > 0.0:
        # of the direction's second moment, what is known of it
        known = speed2 / (speed2 + noise2)
        spread = known * np.outer(horizontal_m_s, horizontal_m_s) / speed2 + (1.0 - known) * spread
    covariance = kinematics.covariance.copy()
    covariance[:2, :2] += right * np.eye(2) + (forward - right) * spread
    covariance[2, 2] += up
    return replace(kinematics, covariance=covariance)


def _expected_direction(kinematics: Kinematics) -> FloatArray:
    """Return the mean (3,) of the direction of flight: shorter than 1, the less the velocity is known."""
    velocity_m_s = kinematics.velocity_runway_m_s
    noise2 = max(float(np.trace(kinematics.covariance[3:, 3:])), 0.0)
    length_m_s = math.sqrt(float(velocity_m_s @ velocity_m_s) + noise2)
    return velocity_m_s / length_m_s if length_m_s > 0.0 else np.zeros(3)


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
