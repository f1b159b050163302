"""Existence probability of the track, from detections and missed detections.

As in integrated probabilistic data association (Mušicki, Evans & Stanković 1994): a missed detection multiplies the
odds by 1 − P_D p_v, with p_v the predicted probability inside the image and P_D the recent detection rate of the
camera; an accepted pixel z with innovation covariance S multiplies them by 1 − P_D + P_D N(z; ẑ, S) / λ, limited to a
constant: with an uncertain prediction, clutter of density λ lies inside the gate as easily as the target. The causes
of missed detections persist (a bird, a dark hill), so frames of one camera within a memory τ count as one: a frame Δt
after the previous one enters with the exponent Δt/τ. Frames without a detection attempt have no effect.
"""

import math

from groundstation.arrays import FloatArray
from groundstation.estimation.variance_check import require_definite

_FIRST_DETECTION = 0.8
_LEAST_DETECTION, _MOST_DETECTION = 0.3, 0.95
# P_D is averaged over this time, and only updated while the target is inside the image with this probability
_DETECTION_MEMORY_S = 15.0
_SURELY = 0.9
_MOST_HIT_FACTOR = 20.0
# density of accepted false candidates: about one in a window of 180 × 180 px, and in the larger ones in which large
# targets are sought, 2.5 times their width: what looks like a target of 300 px is not found in each part of such a one
_CLUTTER_PER_PX2 = 3e-5
_WINDOW_WIDTHS = 2.5
_MOST_ODDS = 999.0
_FIRST_ODDS = 19.0


class ExistenceProbability:
    """The probability that one target exists where it is predicted.

    ``memory_s`` is τ.
    """

    def __init__(self, memory_s: float) -> None:
        self._memory_s = memory_s
        self._odds = _FIRST_ODDS
        self._detection: dict[str, float] = {}
        self._looked_s: dict[str, float] = {}

    @property
    def probability(self) -> float:
        """The probability, 0 … 1."""
        return self._odds / (1.0 + self._odds)

    def start(self) -> None:
        """Reset the odds and the detection rates for a new target."""
        self._odds = _FIRST_ODDS
        self._detection.clear()
        self._looked_s.clear()

    def detection_probability(self, station: str) -> float:
        """Return P_D of one camera, from its recent detections."""
        return min(max(self._detection.get(station, _FIRST_DETECTION), _LEAST_DETECTION), _MOST_DETECTION)

    def hit(
        self, station: str, t_s: float, residual_px: FloatArray, covariance_px2: FloatArray, width_px: float = 0.0
    ) -> None:
        """Update with an accepted pixel: innovation (2,), its covariance (2, 2), and the width of the target.

        Raises `LinAlgError` for a covariance that is not positive definite.
        """
        require_definite(covariance_px2, f"innovation of {station}")
        self._learn(station, t_s, 1.0, 1.0)
        P_D = self.detection_probability(station)
        a, b, c = float(covariance_px2[0, 0]), float(covariance_px2[1, 1]), float(covariance_px2[0, 1])
        u, v = float(residual_px[0]), float(residual_px[1])
        determinant = a * b - c * c
        nis = (b * u * u - 2.0 * c * u * v + a * v * v) / determinant
        density = math.exp(-0.5 * nis) / (2.0 * math.pi * math.sqrt(determinant))
        clutter = 1.0 / max(1.0 / _CLUTTER_PER_PX2, (_WINDOW_WIDTHS * width_px) ** 2)
        factor = min(1.0 - P_D + P_D * density / clutter, _MOST_HIT_FACTOR)
        self._odds = min(self._odds * factor, _MOST_ODDS)

    def miss(self, station: str, t_s: float, in_view: float) -> float:
        """Update with a missed detection, the target being in the image with probability ``in_view``.

        Returns the detection probability of this single frame: 1 − (1 − P_D)^(Δt/τ).
        """
        P_D = self.detection_probability(station)
        power = self._learn(station, t_s, 0.0, in_view)
        share = 1.0 - (1.0 - P_D) ** power
        self._odds *= 1.0 - share * in_view
        return share

    def _learn(self, station: str, t_s: float, found: float, in_view: float) -> float:
        """Update P_D; return the exponent Δt/τ of the frame."""
        since_s = max(t_s - self._looked_s.get(station, t_s), 0.0)
        # an out-of-sequence frame does not move the time of the newest one back
        self._looked_s[station] = max(t_s, self._looked_s.get(station, t_s))
        if in_view >= _SURELY:
            # weighted by the existence probability: without a target a miss carries no information on P_D
            rate = self.probability * min(since_s / _DETECTION_MEMORY_S, 0.5)
            old = self._detection.get(station, _FIRST_DETECTION)
            self._detection[station] = old + rate * (found - old)
        return min(since_s / self._memory_s, 1.0)
