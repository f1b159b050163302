"""A candidate of one camera: where an aircraft may be in a picture, and what is known of it."""

from dataclasses import dataclass

from groundstation.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraCandidate:
    """One candidate of one camera: pixel (2,) at ``t_s``, width in px (None if unknown), score, and the angles then.

    ``moving`` marks a candidate detected by its motion: it may cover only a part of the aircraft, so that position and
    width are coarse, unless ``sigma_px`` gives the sigma of u and v. ``labelled`` marks an external label, which is
    confirmed without the motion test. ``odds`` are log odds of aircraft by the learned channel, None without it.
    """

    t_s: float
    station: str
    pixel: FloatArray
    width_px: float | None
    score: float
    pan_rad: float
    tilt_rad: float
    angle_sigma_rad: float
    moving: bool = False
    labelled: bool = False
    sigma_px: float | None = None
    odds: float | None = None
