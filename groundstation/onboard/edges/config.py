"""Tuning of the edge tracker, with its defaults and with the paper's numbers."""

import math
from dataclasses import dataclass, field, replace
from enum import Enum

from groundstation.onboard.edges.camera_file import PoseNoise
from groundstation.onboard.edges.detection import EdgeDetectionConfig
from groundstation.onboard.edges.gradient_descent import DescentConfig, Energy
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.strip import StripConfig


class MeasurementModel(Enum):
    """The measurement of a picture: the paper's six numbers, or crossings with their own covariance."""

    LINES = "lines"
    CROSSINGS = "crossings"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerConfig:
    """Tuning of the tracker.

    Attributes
    ----------
    measurement : quantity that the filter measures.
    use_strip : search about the prediction before the descent, and refine to a fraction of a pixel after it.
    bands_across : take the means along the image of a line across the runway; otherwise along the lines' normals.
    profile : for the runway, the profile across each edge is the measurement; None: the strip or the descent (crossings
        only).
    paint_m : bright markings narrower than this are removed first, painted lines and lamps; 0 for none.
    first_band_m : width of the neighbourhoods in the first measurement of a pair, on the ground; wide ones are not
        attracted by markings within the runway.
    band_m, least_band_px, most_band_px : width of the neighbourhoods on the ground, and its limits in the picture.
    attitude_sigma_rad, position_sigma_m : errors of a pose, independent in each frame (crossings only).
    estimate_noise : take a pose's attitude for noisier than that where measurements show it (crossings only).
    lasting_attitude_rad, lasting_height_m : constant ones: roll and pitch, and height; estimated (crossings only).
    lasting_yaw_rad, lasting_across_m : of yaw and of the place across the runway, for the status; None: as large as
        those of roll and pitch, and of height.
    lasting_turn_rad, lasting_rise_m : process noise of these per frame.
    turn_sigma_rad, shift_sigma_m : process noise per frame, of the lines' direction and of c and d.
    start_turn_rad, start_shift_m, start_width : prior sigmas of a pair: direction, position, factor in
        width; position and width have long tails.
    hypotheses : pairs that are tracked in parallel until one is confirmed as the runway.
    confirm_frames : minimum number of frames for that; 1 uses Algorithm 1's best pair at once and permanently.
    margin : minimum lead of the best pair's score over the others'.
    doubt_agreement, doubt_missed, doubt_score, doubt_frames : a runway with less agreement of its edges' colours, more
        successive misses, or a lower score is compared with Algorithm 1's pairs; not again for so many frames.
    least_score : of a pair that may be taken for the runway.
    tracked_agreement, tracked_contrast : least agreement of the edges' colours in a picture, and least share of its
        usual contrast that an edge has of what the other one has of its own, with which the runway's edges are tracked;
        below they may be other lines. Of 721 frames of 60 drawn approaches of 20 pictures that would track, 11 had less
        agreement, 8 of them with an end more than 2 px off, and 2 such a share, both so far off (train 0-59).
    tracked_width, tracked_nis, tracked_sigmas : with which a pair is tracked: most factor between its width and the
        announced one; most mean NIS of the last pictures (4 is expected), beyond which it moves otherwise than the
        poses say; most sigmas of the poses' lasting errors by which its direction, and its place at the threshold, are
        off. Of 1,960 frames of 160 approaches, 120 of them on bright ground, 57 were misleading before and 8 with
        these; of 1,731 frames with edges to 2 px 13 are lost (train 0-39, 500000-500119).
    check_frames : number of frames after which it is compared in any case.
    work : units of work in a frame: tracking a pair is one (the runway three), Algorithm 1 one, a measurement of one of
        its pairs one. Tracking has priority; a search gets the rest, but at least one; without tracked pairs, all.
    edge_sigma_m, edge_sigma_px : possible distance between the visible edge and the pavement's, for paint, lamps and
        shoulders, equal along an edge, and for blur and haze at either end; it does not average out and is added to the
        reported covariance (crossings only).
    profile_sigma_m, profile_sigma_px : the same for the ambiguity that remains in a profile with markings.
    plain_contrast : contrast (0 to 1) below which an edge is faint, and ``edge_sigma_px`` increases as it decreases,
        ``profile_sigma_px`` as its square.
    gate : largest normalised innovation squared of an accepted measurement, 4 degrees of freedom.
    coast_frames : number of frames for which the lines are predicted without measurement before a new search.
    line_noise, process_noise : the paper's U and Q, per element (lines only).
    """

    measurement: MeasurementModel = MeasurementModel.CROSSINGS
    use_strip: bool = True
    bands_across: bool = True
    guess: RunwayGuess = field(default_factory=RunwayGuess)
    descent: DescentConfig = field(default_factory=DescentConfig)
    strip: StripConfig = field(default_factory=StripConfig)
    detection: EdgeDetectionConfig = field(default_factory=EdgeDetectionConfig)
    profile: ProfileConfig | None = field(default_factory=ProfileConfig)
    paint_m: float = 1.2
    first_band_m: float = 5.0
    band_m: float = 2.5
    least_band_px: float = 2.5
    most_band_px: float = 40.0
    attitude_sigma_rad: float = math.radians(0.25)
    position_sigma_m: tuple[float, float, float] = (0.15, 0.15, 0.15)
    estimate_noise: bool = True
    lasting_attitude_rad: float = math.radians(0.7)
    lasting_height_m: float = 1.5
    lasting_yaw_rad: float | None = None
    lasting_across_m: float | None = None
    lasting_turn_rad: float = math.radians(0.02)
    lasting_rise_m: float = 0.02
    turn_sigma_rad: float = math.radians(0.05)
    shift_sigma_m: float = 0.05
    start_turn_rad: float = math.radians(4.0)
    start_shift_m: float = 5.0
    start_width: float = 1.25
    hypotheses: int = 3
    confirm_frames: int = 4
    margin: float = 0.5
    doubt_agreement: float = 0.3
    doubt_missed: int = 3
    doubt_score: float = 1.0
    least_score: float = 0.0
    tracked_agreement: float = 0.35
    tracked_contrast: float = 0.5
    tracked_width: float = 1.4
    tracked_nis: float = 8.0
    tracked_sigmas: float = 5.0
    doubt_frames: int = 5
    check_frames: int = 30
    work: int = 5
    edge_sigma_m: float = 0.35
    edge_sigma_px: float = 0.6
    profile_sigma_m: float = 0.18
    profile_sigma_px: float = 0.12
    plain_contrast: float = 0.07
    gate: float = 25.0
    coast_frames: int = 10
    line_noise: float = 0.01
    process_noise: float = 0.01


def without_log(config: TrackerConfig) -> TrackerConfig:
    """Return the tuning for poses by the motion between pictures, whose errors add up: more is new in each frame."""
    return replace(
        config,
        position_sigma_m=(0.3, 0.3, 0.3),
        lasting_turn_rad=math.radians(0.4),
        lasting_rise_m=0.6,
        turn_sigma_rad=math.radians(0.4),
        shift_sigma_m=1.2,
        estimate_noise=False,
    )


def with_noise(config: TrackerConfig, noise: PoseNoise) -> TrackerConfig:
    """Return the tuning for poses with the noise that is stated; what is not stated stays, or is estimated."""
    return replace(
        config,
        attitude_sigma_rad=config.attitude_sigma_rad if noise.attitude_rad is None else noise.attitude_rad,
        position_sigma_m=config.position_sigma_m if noise.position_m is None else (noise.position_m,) * 3,
        lasting_attitude_rad=noise.lasting_attitude_rad or config.lasting_attitude_rad,
        lasting_height_m=noise.lasting_height_m or config.lasting_height_m,
        lasting_yaw_rad=noise.lasting_yaw_rad or config.lasting_yaw_rad,
        lasting_across_m=noise.lasting_across_m or config.lasting_across_m,
        estimate_noise=config.estimate_noise and noise.attitude_rad is None,
    )


def config_by_poses(guess: RunwayGuess, noise: PoseNoise | None) -> TrackerConfig:
    """Return the tuning for a log's poses with their stated noise; None: for poses by the motion between pictures."""
    config = TrackerConfig(guess=guess)
    return without_log(config) if noise is None else with_noise(config, noise)


def paper_config(guess: RunwayGuess, energy: Energy = Energy.AS_PRINTED) -> TrackerConfig:
    """Return the paper's tracker: gradient descent from the prediction, U and Q as printed, nothing doubted."""
    return TrackerConfig(
        measurement=MeasurementModel.LINES,
        use_strip=False,
        bands_across=False,
        profile=None,
        paint_m=0.0,
        guess=guess,
        descent=DescentConfig(energy=energy, adaptive_gamma=False),
        gate=math.inf,
        confirm_frames=1,
        estimate_noise=False,
    )
