"""The slow part of an encoder's error, learnt from pictures that tell the angles, and carried to the readings between.

Noise and steps differ from reading to reading; a wrong zero, scale or gear does not. A rig states one sigma for all of
it; half of its variance is taken to be slow, and to belong to the place: it is forgotten as the axis turns away.
"""

import math
from dataclasses import replace
from typing import NamedTuple

from groundstation.geometry.angles import wrap_rad
from groundstation.messages import FrameAngles, PtuSample

# of the encoder's variance
_SLOW_SHARE = 0.5
# errors of gears change over degrees
_LENGTH_RAD = math.radians(2.0)
# of the slow variance, from one picture to the next: temperature, a base that settles
_DRIFT_SHARE = 0.01


class EncoderOffset(NamedTuple):
    """By how much an encoder reads too far in pan and tilt, as of a picture at the angles ``at_rad``."""

    off_rad: tuple[float, float] = (0.0, 0.0)
    at_rad: tuple[float, float] = (0.0, 0.0)

    def near(self, pan_rad: float, tilt_rad: float) -> tuple[float, float]:
        """Return it at other angles."""
        (pan_off, tilt_off), (pan, tilt) = self.off_rad, self.at_rad
        return pan_off * _kept(pan_rad - pan), tilt_off * _kept(tilt_rad - tilt)

    def corrected(self, sample: PtuSample) -> PtuSample:
        """Return an encoder's reading without it."""
        if self.off_rad == (0.0, 0.0):
            return sample
        pan, tilt = self.near(sample.pan_rad, sample.tilt_rad)
        return replace(sample, pan_rad=sample.pan_rad - pan, tilt_rad=sample.tilt_rad - tilt)


NO_OFFSET = EncoderOffset()


class OffsetEstimator:
    """Learns one head's offset from pictures: of each axis a Gauss-Markov process in its angle.

    Parameters
    ----------
    sigma_rad : of one reading of the encoder, all its errors together.
    """

    def __init__(self, sigma_rad: float) -> None:
        self.offset = NO_OFFSET
        self._slow = _SLOW_SHARE * sigma_rad**2
        self._noise = sigma_rad**2 - self._slow
        self._variance = (self._slow, self._slow)

    def take(self, pan_rad: float, tilt_rad: float, variance_share: float, found: FrameAngles) -> None:
        """Take the angles of a picture, where the encoder has others; ``variance_share`` as interpolation leaves it."""
        noise = self._noise * variance_share + found.sigma_rad**2
        offs, variances = [], []
        axes = zip((pan_rad, tilt_rad), (found.pan_rad, found.tilt_rad), strict=True)
        for k, (read, true) in enumerate(axes):
            kept = _kept(true - self.offset.at_rad[k])
            before = kept**2 * self._variance[k] + (1.0 - kept**2) * self._slow
            before = min(before + _DRIFT_SHARE * self._slow, self._slow)
            gain = before / (before + noise) if before > 0.0 else 0.0
            off = kept * self.offset.off_rad[k]
            offs.append(off + gain * (wrap_rad(read - true) - off))
            variances.append((1.0 - gain) * before)
        self._variance = (variances[0], variances[1])
        self.offset = EncoderOffset((offs[0], offs[1]), (found.pan_rad, found.tilt_rad))


def _kept(away_rad: float) -> float:
    """Return the share of an offset that holds so far away."""
    return math.exp(-abs(wrap_rad(away_rad)) / _LENGTH_RAD)
