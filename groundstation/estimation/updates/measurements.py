"""The measurements of the filter; the journal keeps them to repeat updates with late data."""

from dataclasses import dataclass
from typing import NamedTuple

from groundstation.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TargetPixel:
    """The target's pixel (2,) in the camera of ``station`` with covariance (2, 2), ``row_dt_s`` after its stamp.

    ``correlated_share`` of the covariance is a time-correlated error.
    """

    station: str
    pixel: FloatArray
    covariance_px2: FloatArray
    row_dt_s: float = 0.0
    correlated_share: float = 0.0


class EncoderReading(NamedTuple):
    """A reading of pan and tilt, valid ``ahead_s`` after the filter time.

    ``variance_rad2`` is the noise of each angle; ``clock_sigma_s`` times the rate is added to it as noise.
    """

    pan_rad: float
    tilt_rad: float
    ahead_s: float
    variance_rad2: float
    clock_sigma_s: float


@dataclass(frozen=True, slots=True, eq=False)
class ReferencePosition:
    """A reference position of the target (3,), runway frame, with covariance (3, 3), stamped ``ahead_s`` after now.

    With ``may_replace`` it may replace the target's position; otherwise other measurements confirm that position. One
    that is ``contradicted`` by other measurements is not used.
    """

    position_m: FloatArray
    covariance_m2: FloatArray
    ahead_s: float = 0.0
    may_replace: bool = True
    contradicted: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SilhouetteWidth:
    """The width of the target's silhouette in the camera of ``station``, px, for an assumed span.

    ``alone`` means that no other camera sees the target.
    """

    station: str
    width_px: float
    span_m: float
    alone: bool


@dataclass(frozen=True, slots=True, eq=False)
class MissedDetection:
    """A frame of ``station`` in which the target was not detected; the probability of detection inside the image."""

    station: str
    detection_probability: float
