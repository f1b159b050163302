"""Results of the detection in one frame: a detection, or a miss with its reason.

Part of `groundstation.messages`, which has them all, with the same units.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.box import Box


class DetectionStatus(StrEnum):
    """Outcome of the detection in one frame of one camera; the words of ``detections.csv``.

    ``late``: the frame arrived late and was used as if it had been in time, by reprocessing from its time on.
    ``initial``: one of the pixels by which the target was found; the filter had no target then.
    """

    OK = "ok"
    MISS = "miss"
    OUT_OF_VIEW = "out_of_view"
    GATED = "gated"
    AMBIGUOUS = "ambiguous"
    CUT = "cut"
    LATE = "late"
    EXCLUDED = "excluded"
    INITIAL = "initial"

    @property
    def used(self) -> bool:
        """Whether the filter used the pixel with its full weight."""
        return self in (DetectionStatus.OK, DetectionStatus.LATE)


class MissReason(StrEnum):
    """Why a detector gave no target point."""

    LOW_CONTRAST = "low_contrast"
    NO_REGION = "no_region"
    WRONG_SIZE = "wrong_size"
    AMBIGUOUS = "ambiguous"
    CUT = "cut"
    OUT_OF_VIEW = "out_of_view"
    NO_PTU_ANGLE = "no_ptu_angle"
    NOT_ACQUIRED = "not_acquired"
    LATE = "late"
    NOT_RECORDED = "not_recorded"
    NOT_SEARCHED = "not_searched"
    DETECTION_FAILED = "detection_failed"
    OTHER_PICTURE_SIZE = "other_picture_size"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointHypothesis:
    """Where the target point may be: (2,) u and v, their covariance (2, 2), and how probable it is that it is there."""

    pixel: FloatArray
    covariance_px2: FloatArray
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Detection:
    """A target found in one image.

    Attributes
    ----------
    u_px, v_px : the target point (the aircraft's nose) in full-image pixels.
    covariance_px2 : (2, 2) covariance of that point, of u and v.
    noise_px2 : (2, 2) px² of u and v, the part of ``covariance_px2`` that is independent in each frame.
    centroid_px : (2,) centre of the silhouette.
    box : the silhouette's bounding box in full-image pixels.
    area_px : the silhouette's area.
    contour_px : (n, 2) float32, its outline in full-image pixels, pieces separated by a row of NaN.
    contrast_to_noise : measured contrast of silhouette against background on the channel used.
    channel : name of that channel.
    cut : True where the silhouette touches the image border.
    log_odds : that the silhouette is an aircraft's, by the learned channel; None without it.
    hypotheses : where the target point may be, given the direction of flight, which the point above does not
        contain: it is what this picture shows. None where that direction is unknown.
    """

    u_px: float
    v_px: float
    covariance_px2: FloatArray
    noise_px2: FloatArray
    centroid_px: FloatArray
    box: Box[float]
    area_px: float
    contour_px: NDArray[np.float32]
    contrast_to_noise: float
    channel: str
    cut: bool = False
    log_odds: float | None = None
    hypotheses: tuple[PointHypothesis, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Miss:
    """No target point; ``reason`` says why, and ``detail`` explains it in words."""

    reason: MissReason
    detail: str = ""


# log odds of aircraft from which on something is recognised. As the mean of a target: with the first weights, on 41
# train worlds not trained on, larger in 96 % of 3,670 epochs with the aircraft as the target, and in 9 % of 67 with
# something else
RECOGNISED_LOG_ODDS = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class RecognisedPixel:
    """The likeliest aircraft in a whole frame: its point in full-image pixels, and its log odds of aircraft."""

    u_px: float
    v_px: float
    log_odds: float


# how long before the start of a target a pixel of its tentative track may be
INITIAL_PIXELS_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class InitialPixel:
    """A pixel by which a target was found, or that it explains, in a frame that has been reported without it.

    ``t_s`` and ``station`` are those of the frame's `CameraReport`; ``sigma_px`` is one sigma of u and v. At most
    `INITIAL_PIXELS_S` older than the target. ``track_id`` is the number of the target's track.
    """

    t_s: float
    station: str
    u_px: float
    v_px: float
    sigma_px: float
    track_id: int | None = None


class OutcomeKind(StrEnum):
    """What becomes of a track: it is confirmed, or, before that, dropped, or displaced by a better one.

    What has displaced it is the target instead; of one that is dropped it is not known whether it was.
    """

    CONFIRMED = "confirmed"
    DROPPED = "dropped"
    DISPLACED = "displaced"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackOutcome:
    """The outcome of the track of this number; a given target is confirmed at its start."""

    track_id: int
    kind: OutcomeKind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Innovation:
    """One measurement update: residual, its covariance, its normalised square and the verdict."""

    residual: FloatArray
    covariance: FloatArray
    nis: float
    dof: int
    accepted: bool
