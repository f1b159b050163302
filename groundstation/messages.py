"""Records exchanged between packages: input events and output reports.

All times are seconds in the session clock unless a name states otherwise, all lengths metres in the
``runway`` frame, all angles radians, all pixels OpenCV pixels (0, 0 = centre of the upper-left pixel).
Arrays are float64 unless stated.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from groundstation.arrays import FloatArray
from groundstation.box import Box
from groundstation.detection_messages import INITIAL_PIXELS_S as INITIAL_PIXELS_S
from groundstation.detection_messages import Detection as Detection
from groundstation.detection_messages import DetectionStatus as DetectionStatus
from groundstation.detection_messages import InitialPixel as InitialPixel
from groundstation.detection_messages import Innovation as Innovation
from groundstation.detection_messages import Miss as Miss
from groundstation.detection_messages import MissReason as MissReason
from groundstation.detection_messages import OutcomeKind as OutcomeKind
from groundstation.detection_messages import PointHypothesis as PointHypothesis
from groundstation.detection_messages import RecognisedPixel as RecognisedPixel
from groundstation.detection_messages import TrackOutcome as TrackOutcome
from groundstation.geometry.head_rates import HeadRates
from groundstation.picture import Picture


# --------------------------------------------------------------------------------------------- events in
@dataclass(frozen=True, slots=True, kw_only=True)
class PtuSample:
    """A station's ``pan_rad`` and ``tilt_rad`` at session time ``t_s``, of encoders, whose sigma the rig states.

    Of a picture are ``sigma_rad``, of each axis, and ``encoder_off_rad``: how far encoders read too far about there.
    Its ``t_s`` is when the rows that told were exposed, not the stamp of the frame.
    """

    t_s: float
    station: str
    pan_rad: float
    tilt_rad: float
    sigma_rad: float | None = None
    encoder_off_rad: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One camera image; ``t_s`` is its mid-exposure, ``epoch`` the number of its stereo pair.

    ``image`` is as the camera gave it, distorted; `Tracker.step` also takes an array, (h, w, 3) uint8 BGR or (h, w).
    """

    t_s: float
    station: str
    epoch: int
    image: Picture


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelMeasurement:
    """A target pixel that someone else has found (a detections-only session).

    ``sigma_px`` is one sigma of u and of v, its noise white; None takes the tuning's (``labelled_sigma_px``).
    """

    t_s: float
    station: str
    epoch: int
    u_px: float
    v_px: float
    sigma_px: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Epoch:
    """All frames of stereo pair ``epoch`` have been sent; ``t_s`` is the mean of their stamps.

    ``stations`` are those of the pair. The pipeline answers it with one `TrackEstimate` at ``t_s``.
    """

    t_s: float
    epoch: int
    stations: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Heartbeat:
    """Time has passed: the session's clock shows ``t_s``, whatever the devices have delivered or not.

    The pipeline answers it with one `TrackState`.
    """

    t_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterReset:
    """The filter failed, and the pipeline forgot everything at ``t_s``; ``why`` is for people.

    ``in_vain`` states that it failed at the event right before this one, which then has no result.
    """

    t_s: float
    why: str
    in_vain: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class DgpsFix:
    """One reference position in its own clock: ``t_s`` is the DGPS clock, not the session's.

    ``position_runway_m`` is (3,), the antenna; ``sigma_m`` (3,) is one sigma per axis, or None if not given.
    """

    t_s: float
    position_runway_m: FloatArray
    sigma_m: FloatArray | None = None
    status: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceFix:
    """A position of the target point from another source, to learn the rig's errors from.

    ``position_runway_m`` (3,), ``sigma_m`` (3,) of each axis; ``t_s`` in the session's clock as far as it is known: the
    filter carries what it may be off.
    """

    t_s: float
    position_runway_m: FloatArray
    sigma_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class CarriedError:
    """An error of calibration or of a clock that the filter carries: what it is now, and one sigma now and before.

    In rad, m, px, s, s/s or without unit, by ``name`` (docs/conventions.md). ``estimated`` states whether this
    filter ever estimates it, or only considers it.
    """

    name: str
    value: float
    sigma: float
    prior_sigma: float
    estimated: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameAngles:
    """Pan and tilt by the picture of a station's frame of ``t_s``, ``delay_s`` after that stamp, with one sigma."""

    t_s: float
    station: str
    pan_rad: float
    tilt_rad: float
    sigma_rad: float
    delay_s: float = 0.0


Arrival = PtuSample | Frame | PixelMeasurement | ReferenceFix | Epoch
Event = Arrival | FrameAngles | Heartbeat | FilterReset


# ------------------------------------------------------------------------------------------ reports out
class TrackStatus(StrEnum):
    """The filter's state of knowledge; the words of ``track.csv``."""

    SEARCHING = "searching"
    ACQUIRING = "acquiring"
    TRACKING = "tracking"
    COASTING = "coasting"
    LOST = "lost"


class TriangulationStatus(StrEnum):
    """The words of ``triangulation.csv``: a point, too few views, or rays that do not meet."""

    OK = "ok"
    ONE_VIEW = "one_view"
    RESIDUAL = "residual"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Triangulation:
    """The baseline's answer for one pair.

    Attributes
    ----------
    midpoint_runway_m : (3,) the point halfway between the rays.
    point_runway_m : (3,) the maximum-likelihood point.
    covariance_m2 : (3, 3) of the maximum-likelihood point.
    gap_m : the rays' distance.
    residual_sigma : the maximum-likelihood reprojection residual in sigmas (root of chi-square).
    """

    midpoint_runway_m: FloatArray
    point_runway_m: FloatArray
    covariance_m2: FloatArray
    gap_m: float
    residual_sigma: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InitialState:
    """A start that is given, in the runway frame.

    Attributes
    ----------
    t_s : session time.
    position_runway_m, velocity_runway_m_s : (3,) position and velocity.
    sigma_position_m, sigma_velocity_m_s : (3,) one sigma per axis.
    """

    t_s: float
    position_runway_m: FloatArray
    velocity_runway_m_s: FloatArray
    sigma_position_m: FloatArray
    sigma_velocity_m_s: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kinematics:
    """Position and velocity of the target point in the runway frame.

    Attributes
    ----------
    position_runway_m, velocity_runway_m_s : (3,) position and velocity.
    covariance : (6, 6) of both, m², m²/s and m²/s².
    """

    position_runway_m: FloatArray
    velocity_runway_m_s: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraReport:
    """One camera's part in one step.

    Attributes
    ----------
    status, result : the outcome; a `Detection`, or a `Miss` with its reason.
    roi : where the detector looked, if it did.
    predicted_px, predicted_covariance_px2 : (2,) and (2, 2) of the target point expected before looking, if any.
    pan_rad, tilt_rad, rates : of the head at mid-exposure, as used and by the filter before the pixel; None if unknown.
    innovation, elapsed_s : None unless the filter judged the pixel; time of the detection.
    channel_contrast : in some frames, the silhouette's contrast-to-noise on each channel, also the paper's saturation.
    image : the picture, if reports keep them.
    recognised : of a frame that was searched whole, the likeliest aircraft, also if it is not the target.
    track_id : number of the track whose pixel was sought, which may not be confirmed yet; None without one.
    """

    t_s: float
    station: str
    epoch: int
    status: DetectionStatus
    result: Detection | Miss
    roi: Box[int] | None
    predicted_px: FloatArray | None
    predicted_covariance_px2: FloatArray | None
    pan_rad: float | None
    tilt_rad: float | None
    innovation: Innovation | None
    elapsed_s: float
    channel_contrast: Mapping[str, float] | None = None
    image: Picture | None = None
    recognised: RecognisedPixel | None = None
    track_id: int | None = None
    rates: HeadRates | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackEstimate:
    """The answer to one stereo pair: the state of knowledge and, if there is one, the estimate at ``t_s``.

    Attributes
    ----------
    status : the state of knowledge.
    kinematics : the estimate, None without one.
    triangulation_status, triangulation : the baseline's answer; None unless two or more cameras gave a point.
    latency_s : time from the arrival of the pair's first frame to this answer.
    seen_by : the stations whose pixel the filter accepted: of one alone only the bearing is measured.
    """

    t_s: float
    epoch: int
    status: TrackStatus
    kinematics: Kinematics | None
    triangulation_status: TriangulationStatus
    triangulation: Triangulation | None
    latency_s: float = 0.0
    seen_by: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackState:
    """The answer to a heartbeat: the state of knowledge at ``t_s``, predicted from all that is fused; of no pair."""

    t_s: float
    status: TrackStatus
    kinematics: Kinematics | None


class Purpose(StrEnum):
    """Why a PTU is turned."""

    TRACK = "track"
    SEARCH = "search"
    HOLD = "hold"
    PARK = "park"
    KEEP_OUT = "keep out"


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingCommand:
    """How a station's PTU shall turn from ``t_s`` on: at these rates, and so that it is at these angles by then.

    Angles in rad, rates in rad/s, as in `PtuSample`; a unit is commanded by one or the other, as its protocol permits.
    """

    t_s: float
    station: str
    pan_rad: float
    tilt_rad: float
    pan_rate_rad_s: float
    tilt_rate_rad_s: float
    purpose: Purpose


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackEvent:
    """Something worth a line in the log: status changes, losses, refused readings."""

    t_s: float
    level: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepReport:
    """All that one `Pipeline.step` brought forth; often empty, since frames wait for their angles.

    ``states`` answer heartbeats, and are newer than the ``estimates`` next to them. ``initial_pixels`` belong to frames
    of this step or earlier ones: those of the tentative track that has become the target in this one. ``outcomes`` say
    which tracks were confirmed, dropped or displaced.
    """

    cameras: tuple[CameraReport, ...] = ()
    estimates: tuple[TrackEstimate, ...] = ()
    events: tuple[TrackEvent, ...] = field(default=())
    states: tuple[TrackState, ...] = ()
    initial_pixels: tuple[InitialPixel, ...] = ()
    outcomes: tuple[TrackOutcome, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nothing came of the step."""
        found = self.initial_pixels or self.outcomes
        return not (self.cameras or self.estimates or self.events or self.states or found)
