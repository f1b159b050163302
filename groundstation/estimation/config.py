"""Tuning of the filter, of loss and of acquisition."""

from dataclasses import dataclass, fields
from enum import StrEnum

from groundstation.estimation import state_model

# larger than anything this is about, small enough to be squared a few times
_LARGEST = 1e9


def require_positive(config: object, but: tuple[str, ...] = ()) -> None:
    """Raise `ValueError` unless every number of a configuration is > 0 and of a usual size.

    Fields named in ``but`` may be zero or negative.
    """
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, bool) or not isinstance(number, (int, float)):
                continue
            # written so that NaN is none of them
            if not abs(number) <= _LARGEST or (number <= 0 and item.name not in but):
                raise ValueError(f"{item.name} = {number:g}, which is not {'of a usual size' if number > 0 else '> 0'}")


class OutOfViewWeighting(StrEnum):
    """What becomes of a pixel when the target may be outside the image."""

    CONSISTENT = "consistent"  # noise R/T, T the predicted probability mass inside the image
    GAIN = "gain"  # gain T·K, in Joseph's form
    PAPER = "paper"  # innovation times the paper's T, covariance as if T were 1


class CalibrationUse(StrEnum):
    """What becomes of the errors of rig and clocks that the filter carries."""

    CONSIDER = "consider"  # they keep value and variance; the track's covariance contains what they cause
    # learnt while a reference position is there or three stations see the target (clocks of the stations not),
    # considered otherwise
    REFERENCE = "reference"
    ESTIMATE = "estimate"  # always learnt, from the assumed motion, too


class FilterImplementation(StrEnum):
    """Which program predicts, updates and smooths; the models are the same."""

    COMPILED = "compiled"  # this project's kernels
    FILTERPY = "filterpy"  # filterpy's classes, much slower: the reference that the kernels are compared with


class Predictor(StrEnum):
    """Which curve places the region of interest."""

    HERMITE = "hermite"
    CURVE = "curve"
    INHERITED_CURVE = "inherited-curve"
    LINE = "line"


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimationConfig:
    """Tuning of the EKF.

    Attributes
    ----------
    implementation : of the filter's arithmetic: compiled, or filterpy's plain classes, for replay.
    acceleration_psd_m2_s3 : (x, y, z) power spectral density of the aircraft's white acceleration in steady flight.
    manoeuvre_psd_m2_s3 : the same in flare, braking and brake release; equal to the first, there is but one way of
        flying.
    steady_s, manoeuvre_s : how long the aircraft flies in either way, on average.
    detection_lasting_share : so much of a detection's variance is an error that lasts …
    detection_lasting_s : … for about so long, and is not averaged away; a share of 0 takes every error as new.
    calibration : what becomes of the errors that rig.toml gives covariances for.
    reference_hold_s : a reference counts as there for so long after its newest position.
    reference_clock_sigma_s : and its clock may be so far off the session's, 1 sigma.
    reference_antenna_sigma_m : and its antenna so far from the nose (forward, right, down) where session.toml has no
        lever arm; a lateral offset cannot be separated from an error of pan common to all stations.
    ptu_acceleration_psd_rad2_s3 : power spectral density of each PTU axis's white acceleration.
    ptu_max_rate_deg_s : no PTU turns faster; a reading that implies more is a spike.
    encoder_gate_sigma : a reading further from its prediction is held back until the next one confirms it.
    gate_probability : share of true pixels that the chi-square gate lets pass.
    out_of_view : the weighting of pixels near and beyond the border.
    paper_border_sigma_px : s of the paper's T = exp(−d²/2s²).
    min_view_probability : below it the target counts as out of view and the detector does not look.
    width_sigma_log : noise of the logarithm of a silhouette's width, independent from frame to frame.
    alone_after_s : a camera is alone when no other has contributed for so long: its pixels then leave the range as it
        is, and a silhouette's width gives one.
    miss_memory_s : misses of one camera within such a time have the same cause, and count as one.
    doubtful_existence : below this probability that the track is the target, whole frames are searched again …
    lost_existence : … and below this one it is lost.
    lost_sigma_px, lost_sigma_m : the track is lost when the predicted pixel or the position gets this uncertain.
    lost_after_s : and at the latest after so long without any accepted pixel.
    coast_after_s : where time passes and no pair is answered for so long, the track coasts; in operation at least two
        and a half periods of the cameras.
    confirm_after_s, confirm_fixes : after so long without any accepted pixel, the status is tracking at so many fixes.
    search_again_s : without a fix for so long, the whole frames are searched again next to the prediction; and without
        any pixel for so long, an aircraft that is found where the target may be is followed instead.
    proof_fixes, proof_s : a target found by searching needs so many fixes within so long, or it is dropped.
    settled_velocity_sigma_m_s : and is reported once its velocity is known so well in every direction, and is not zero.
    false_target_s, false_target_m : a target found by searching must move so far in so long, or it is dropped.
    standing_s, standing_m : and one that has is dropped once it has not come so far in so long; for a multirotor, which
        may hover, in an hour. One that the learned channel recognises is kept in both cases, and not reported.
    predictor : which curve predicts the region of interest's centre.
    residual_gate_sigma : rays that miss each other by more sigmas make no baseline point.
    target_point_sigma_spans : one sigma, forward, to the right and upward on the aircraft and in spans, of the
        difference between the detected point and the target point, which lasts for the whole flight.
    target_point_behind_lead_spans : so far is the nose ahead of the one that the learned channel detects, along an
        aircraft that is seen straight from behind, which hides its nose.
    target_point_behind_spans : further sigma of the difference, along such an aircraft.
    target_point_behind_up_spans : further sigma of it, upward on an aircraft that is seen straight from behind.
    labelled_sigma_px : noise of a pixel that someone else has found.
    fix_window_s : detections without frames: stations seen within this time count as one fix.
    late_horizon_s : a late reading or frame is still fused in its place if it is at most so much older than the
        filter; 0 refuses all that is late.
    late_max_entries : for that, so many readings, frames and decisions are kept at most.
    """

    implementation: FilterImplementation = FilterImplementation.COMPILED
    acceleration_psd_m2_s3: tuple[float, float, float] = state_model.STEADY_PSD_M2_S3
    manoeuvre_psd_m2_s3: tuple[float, float, float] = state_model.MANOEUVRE_PSD_M2_S3
    steady_s: float = state_model.STEADY_S
    manoeuvre_s: float = state_model.MANOEUVRE_S
    detection_lasting_share: float = state_model.CORRELATED_SHARE
    detection_lasting_s: float = state_model.CORRELATION_TIME_S
    calibration: CalibrationUse = CalibrationUse.REFERENCE
    reference_hold_s: float = 0.5
    reference_clock_sigma_s: float = state_model.REFERENCE_CLOCK_SIGMA_S
    reference_antenna_sigma_m: tuple[float, float, float] = state_model.REFERENCE_ANTENNA_SIGMA_M
    ptu_acceleration_psd_rad2_s3: float = state_model.PTU_ACCELERATION_PSD_RAD2_S3
    ptu_max_rate_deg_s: float = 120.0
    encoder_gate_sigma: float = 6.0
    gate_probability: float = 0.9995
    out_of_view: OutOfViewWeighting = OutOfViewWeighting.CONSISTENT
    paper_border_sigma_px: float = 50.0
    min_view_probability: float = 0.02
    width_sigma_log: float = state_model.WIDTH_SIGMA_LOG
    alone_after_s: float = 0.5
    miss_memory_s: float = 1.0
    doubtful_existence: float = 0.5
    lost_existence: float = 1e-3
    lost_sigma_px: float = 200.0
    lost_sigma_m: float = 60.0
    lost_after_s: float = 8.0
    coast_after_s: float = 0.25
    confirm_after_s: float = 0.5
    confirm_fixes: int = 2
    search_again_s: float = 1.0
    proof_fixes: int = 3
    proof_s: float = 1.0
    settled_velocity_sigma_m_s: float = 4.0
    false_target_s: float = 4.0
    false_target_m: float = 8.0
    standing_s: float = 5.0
    standing_m: float = 20.0
    predictor: Predictor = Predictor.HERMITE
    residual_gate_sigma: float = 5.0
    target_point_sigma_spans: tuple[float, float, float] = state_model.TARGET_POINT_SIGMA_SPANS
    target_point_behind_lead_spans: float = state_model.TARGET_POINT_BEHIND_LEAD_SPANS
    target_point_behind_spans: float = state_model.TARGET_POINT_BEHIND_SPANS
    target_point_behind_up_spans: float = state_model.TARGET_POINT_BEHIND_UP_SPANS
    labelled_sigma_px: float = state_model.LABELLED_SIGMA_PX
    fix_window_s: float = 0.06
    late_horizon_s: float = 0.5
    late_max_entries: int = 1000

    def __post_init__(self) -> None:
        unsigned = (
            "detection_lasting_share",
            "late_horizon_s",
            "target_point_sigma_spans",
            "target_point_behind_lead_spans",
            "target_point_behind_spans",
            "target_point_behind_up_spans",
        )
        require_positive(self, but=unsigned)
        if not 0 <= self.detection_lasting_share < 1:
            raise ValueError(f"detection_lasting_share {self.detection_lasting_share} outside 0 … 1")
        if min(self.target_point_sigma_spans) < 0:
            raise ValueError(f"target_point_sigma_spans {self.target_point_sigma_spans} < 0")
        for name in ("target_point_behind_lead_spans", "target_point_behind_spans", "target_point_behind_up_spans"):
            if (behind := getattr(self, name)) < 0:
                raise ValueError(f"{name} {behind} < 0")
        if self.late_horizon_s < 0:
            raise ValueError(f"late_horizon_s {self.late_horizon_s} < 0")
        if not self.gate_probability < 1:
            raise ValueError(f"gate_probability {self.gate_probability} outside 0 … 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class InitiationConfig:
    """Tuning of how candidates of several cameras become a track.

    Attributes
    ----------
    min_range_m, max_range_m : distance of a plausible target from each of two stations.
    min_height_m, max_height_m : its z in the runway frame.
    min_size_m, max_size_m : its width when the span is not known.
    size_tolerance : when it is, the apparent width may be this factor smaller or larger; where the learned channel sees
        an aircraft in both cameras, it may also be as small as min_size_m: the fuselage alone.
    size_agreement : two cameras' widths may differ by this factor.
    candidate_sigma_px, candidate_sigma_share : noise of a candidate's centre, and as a share of its width besides.
    moving_sigma_share : that of a candidate found by its motion, as a share of the whole aircraft's width …
    usual_span_m : … for which this span is taken where none is given.
    residual_gate_sigma : rays further apart than this don't belong together.
    acceleration_psd_m2_s3 : manoeuvres of a tentative track.
    hits : a tentative track is confirmed after so many fixes …
    max_misses : … and dropped after so many epochs in a row without one.
    min_age_s : and not before this age.
    min_speed_m_s, max_speed_m_s : a target moves (not asked of pixels that someone else has labelled).
    motion_sigma : its velocity differs from zero by this many sigmas.
    max_link_square : mean normalised square (3 degrees of freedom) of its steps; chance pairings jump more.
    min_noise_scale, scale_hits : after so many fixes their noise is judged by how they jump, down to this share of
        the variance assumed.
    min_relative_score : its mean score against that of the clearest tentative track.
    recognised_odds, recognised_hits : mean log odds of aircraft by the learned channel, in both cameras and so many
        fixes, from which a track is confirmed without motion …
    unlikely_odds, unlikely_age_s : … and below which it must have moved for so long. Searching 56 train worlds not
        trained on, with these numbers a target is found after 0.87 s in the mean, in 4 worlds a false one first, and 57
        false tracks would be confirmed if the search went on; with 3 and -3, 0.81 s, 8 and 114.
    unlikely_age_per_odds_s : and so much longer for each unit of log odds below, at most 9 s in all: in the meantime an
        aircraft may be found instead of a bird. Chosen. Of 26 train worlds with birds it changes one (a bird is
        followed for 1.6 s less), of validate it keeps the bird of world 45 out, as 0.3 s would not. The figures of the
        two before are of without it. What the channel had no time to look at must have moved for ``unlikely_age_s``.
    start_position_sigma_m : added to a confirmed track's position: its centre is not yet its nose.
    start_share : so many times a single fix's covariance is added too, and the velocity's is so much larger:
        candidates' errors do not average out.
    """

    min_range_m: float = 10.0
    max_range_m: float = 3000.0
    min_height_m: float = -3.0
    max_height_m: float = 400.0
    min_size_m: float = 0.4
    max_size_m: float = 30.0
    size_tolerance: float = 2.5
    size_agreement: float = 2.0
    candidate_sigma_px: float = 1.0
    candidate_sigma_share: float = 0.03
    moving_sigma_share: float = 0.08
    usual_span_m: float = 2.0
    residual_gate_sigma: float = 3.5
    acceleration_psd_m2_s3: float = 1.0
    hits: int = 6
    max_misses: int = 4
    min_age_s: float = 0.3
    min_speed_m_s: float = 2.0
    max_speed_m_s: float = 150.0
    motion_sigma: float = 6.0
    max_link_square: float = 6.0
    min_noise_scale: float = 0.25
    scale_hits: int = 8
    min_relative_score: float = 0.4
    recognised_odds: float = 2.5
    recognised_hits: int = 4
    unlikely_odds: float = 2.0
    unlikely_age_s: float = 2.0
    unlikely_age_per_odds_s: float = 0.5
    start_position_sigma_m: float = 0.5
    start_share: float = 4.0

    def __post_init__(self) -> None:
        require_positive(
            self,
            but=(
                "min_height_m",
                "min_age_s",
                "min_speed_m_s",
                "start_share",
                "unlikely_odds",
                "unlikely_age_per_odds_s",
            ),
        )
        for name in ("hits", "recognised_hits"):
            if getattr(self, name) < 2:
                raise ValueError(f"{name} {getattr(self, name)} < 2")
        if min(self.min_age_s, self.unlikely_age_per_odds_s, self.start_share) < 0:
            raise ValueError("min_age_s, unlikely_age_per_odds_s and start_share must be ≥ 0")
        if not 0 <= self.min_speed_m_s < self.max_speed_m_s:
            raise ValueError("min_speed_m_s must be ≥ 0 and below max_speed_m_s")

    def moving_age_s(self, odds: float | None) -> float:
        """Return how long what has these mean log odds of aircraft must have moved, s; None: without such a channel."""
        if odds is None or odds >= self.unlikely_odds:
            return 0.0
        return self.unlikely_age_s + self.unlikely_age_per_odds_s * (self.unlikely_odds - odds)
