"""One step of line tracking: predict, search about the prediction, descend, refine, gate, update."""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.config import MeasurementModel, TrackerConfig
from groundstation.onboard.edges.edge_measurement import EdgeMeasurement
from groundstation.onboard.edges.frame_geometry import (
    FrameGeometry,
    TrackerCamera,
    edge_noise,
    frame_geometry,
    other_pair_noise,
    pose_noise,
    width_prior,
    yaw_place_m,
)
from groundstation.onboard.edges.gradient_descent import descend
from groundstation.onboard.edges.kalman import LineState, LineUpdate, predict, update_crossings, update_lines
from groundstation.onboard.edges.kalman_kernel import between
from groundstation.onboard.edges.line_state import PITCH, ROLL, UP, C, D
from groundstation.onboard.edges.lines import lines_from_crossings, measurement_matrix, project_lines
from groundstation.onboard.edges.marking_removal import remove_markings
from groundstation.onboard.edges.markings import Change, Markings
from groundstation.onboard.edges.pose import NoseCameraPose, ground_from_pixels
from groundstation.onboard.edges.profile import edges_by_profile, reach_px
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import LampParallax, ProfileView
from groundstation.onboard.edges.report import EdgeMiss, Edges
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.seen_marks import SeenMarks, seen_marks
from groundstation.onboard.edges.strip import refine_edges, search_edges

# lamps are not taken to be seen farther out than from so many times their height: below, the camera is on the ground
_LEAST_ABOVE = 6.0
# runways as wide have the wider side lines
_WIDE_RUNWAY_M = 30.0
# of the announced width; narrower than Algorithm 1's pairs, which have 0.29 of it: two lines on one edge are no pair
_LEAST_WIDTH = 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackingStep:
    """Result of a step: the lines after it, as edges of the picture where rows contain them, and the measurement.

    ``found`` is None where nothing was measured or accepted; ``miss`` is the reason. ``yaw_place_m``: see
    `frame_geometry.yaw_place_m`.
    """

    state: LineState
    edges: Edges | None
    found: EdgeMeasurement | None
    miss: EdgeMiss
    yaw_place_m: float


def track_lines(
    camera: TrackerCamera,
    image: ImageArray,
    pose: NoseCameraPose,
    state: LineState,
    *,
    thorough: bool,
    markings: Markings | None = None,
    layouts: int = 0,
) -> TrackingStep:
    """Track lines into a picture (h, w, 3) uint8 BGR.

    Not ``thorough``: the strip's search alone measures them, without the descent; for one of several
    hypotheses. This number of ``layouts`` is compared, see `profile.edges_by_profile`.
    """
    config = camera.config
    predicted = predict(state, process_noise(config, state))
    pair = abs(float(predicted.mean[C] - predicted.mean[D])) > _LEAST_WIDTH * config.guess.width_m
    look = frame_geometry(camera, pose, predicted) if pair else None
    if look is None:
        miss = EdgeMiss.NO_BAND if pair else EdgeMiss.NO_PAIR
        return TrackingStep(state=predicted, edges=None, found=None, miss=miss, yaw_place_m=yaw_place_m(config, pose))
    if thorough and config.profile is not None:
        found = _by_profile(config, config.profile, image, look, predicted, markings, layouts=layouts)
    else:
        image = remove_markings(image, look.rows, config.paint_m * float(scale_of(look, predicted)[1]))
        found = _measure(config, image, look, predicted, thorough=thorough)
    if found is None:
        return _missed(config, look, predicted, EdgeMiss.FAINT, math.nan)
    if found.change is not Change.NONE:
        predicted = _loosened(config, predicted, found.change)
    update = _update(camera, predicted, look, found)
    if update.nis > config.gate:
        return _missed(config, look, predicted, EdgeMiss.GATED, update.nis)
    crossings, independent = _in_picture(config, predicted, look, found, update)
    lasting = _lasting(config, look, predicted, update.state, found)
    edges = Edges(
        state=update.state,
        rows_px=look.rows,
        crossings_px=crossings,
        covariance_px2=independent + lasting,
        systematic_px2=lasting,
        predicted_px=look.predicted,
        measured_px=found.crossings_px,
        nis=update.nis,
        marks=marks_of(config, found),
    )
    return TrackingStep(
        state=update.state, edges=edges, found=found, miss=EdgeMiss.NONE, yaw_place_m=yaw_place_m(config, look.pose)
    )


def _by_profile(
    config: TrackerConfig,
    profile: ProfileConfig,
    image: ImageArray,
    look: FrameGeometry,
    predicted: LineState,
    markings: Markings | None,
    *,
    layouts: int,
) -> EdgeMeasurement | None:
    """Return the edges where the profiles across them put them; the picture has its paint."""
    px_per_m = scale_of(look, predicted)
    prior = look.h @ predicted.covariance @ look.h.T + pose_noise(config, look)
    guess = look.predicted
    if (3.0 * np.sqrt(prior.diagonal()) > np.tile(reach_px(px_per_m, profile), 2)).any():
        cleaned = remove_markings(image, look.rows, config.paint_m * float(px_per_m[1]))
        wide = search_edges(cleaned, guess, look.rows, look.widths, look.across, prior, config.strip)
        if wide is None:
            return None
        guess = wide
    found = profiled(profile, image, look, predicted, guess, prior, markings, layouts=layouts)
    faint = found.evidence is not None and found.evidence.min() < profile.least_evidence
    return None if faint or found.contrast.min() < config.strip.least_contrast else found


def profiled(
    config: ProfileConfig,
    image: ImageArray,
    look: FrameGeometry,
    state: LineState,
    guess: FloatArray,
    prior: FloatArray,
    markings: Markings | None,
    *,
    layouts: int,
) -> EdgeMeasurement:
    """Return edges by profiles about initial crossings (4,), with a prior (4, 4) about the search's prediction."""
    px_per_m = scale_of(look, state)
    return edges_by_profile(
        image,
        guess,
        look.rows,
        px_per_m,
        look.predicted,
        prior,
        markings,
        config,
        layouts=layouts,
        view=view_of(look, state, config),
    )


def view_of(look: FrameGeometry, state: LineState, config: ProfileConfig) -> ProfileView:
    """Return how the runway is seen: where its lamps are, how well its width is known, metres in a row."""
    rows = np.array([[look.predicted[0], look.rows[0]], [look.predicted[1], look.rows[1]]])
    below = rows + np.array([0.0, 1.0])
    ground = ground_from_pixels(look.pose, look.kappa, np.vstack([rows, below]))[:, 1]
    along_m = np.abs(ground[2:] - ground[:2])
    return ProfileView(
        lamps=lamps_seen(look.pose.camera_threshold_m, state.mean, config.lamp_height_m),
        width=None if config.announced_m is None else width_prior(config.announced_m, look.pose, state),
        along_m=(float(along_m[0]), float(along_m[1])) if np.isfinite(along_m).all() else None,
    )


def scale_of(look: FrameGeometry, state: LineState) -> FloatArray:
    """Return the px in a metre across the runway, at the upper and the lower row (2,)."""
    return np.asarray(np.abs(look.predicted[2:] - look.predicted[:2]) / abs(float(state.mean[C] - state.mean[D])))


def side_lines_of(config: ProfileConfig, runway: RunwayGuess) -> ProfileConfig:
    """Return the configuration for a runway of the announced width, with side lines as wide as in Annex 14."""
    width_m = config.wide_line_width_m if runway.width_m >= _WIDE_RUNWAY_M else config.line_width_m
    return replace(config, line_width_m=width_m, announced_m=runway.width_m if runway.width_announced else None)


def lamps_seen(camera_m: FloatArray, mean: FloatArray, height_m: float) -> LampParallax:
    """Return where lamps of a height next to lines (a, b, c, d, …) are seen on the ground, from a camera (3,).

    By H / (H − h) farther from below the camera than they stand: half a metre on short final.
    """
    above_m = max(float(camera_m[2]), _LEAST_ABOVE * height_m)
    scale = above_m / (above_m - height_m)
    below = float(mean[:2] @ camera_m[:2])
    left, right = -float(mean[C]) - below, below + float(mean[D])
    return LampParallax(scale=scale, shift_m=((scale - 1.0) * left, (scale - 1.0) * right))


def marks_of(config: TrackerConfig, found: EdgeMeasurement) -> SeenMarks | None:
    """Return what is next to the edges, None where no profile was taken."""
    if config.profile is None or found.markings is None:
        return None
    return seen_marks(found.markings, config.profile)


def process_noise(config: TrackerConfig, state: LineState) -> FloatArray:
    """Return Q of a frame, (4, 4) or (7, 7)."""
    if config.measurement is MeasurementModel.LINES:
        return np.asarray(config.process_noise * np.eye(4))
    a, b = state.mean[:2]
    turn, shift = config.turn_sigma_rad, config.shift_sigma_m
    q = np.zeros((7, 7))
    q[:2, :2] = turn**2 * np.outer([-b, a], [-b, a])
    q[C, C] = q[D, D] = shift**2
    q[ROLL, ROLL] = q[PITCH, PITCH] = config.lasting_turn_rad**2
    q[UP, UP] = config.lasting_rise_m**2
    return q


def plain_edges(crossings_px: FloatArray) -> EdgeMeasurement:
    """Return crossings with a covariance of 1 px², where no other is given."""
    return EdgeMeasurement(crossings_px=crossings_px, covariance_px2=np.eye(4), contrast=np.ones(2), agreement=1.0)


def _measure(
    config: TrackerConfig, image: ImageArray, look: FrameGeometry, predicted: LineState, *, thorough: bool
) -> EdgeMeasurement | None:
    """Return the edges that the picture shows about the prediction."""
    guess = look.predicted
    if config.use_strip:
        prior = look.h @ predicted.covariance @ look.h.T + pose_noise(config, look)
        wide = search_edges(image, guess, look.rows, look.widths, look.across, prior, config.strip)
        near = None if wide is None else refine_edges(image, wide, look.rows, look.widths, look.across, config.strip)
        if wide is None or not thorough:
            return near
        guess = wide if near is None else near.crossings_px
    across = look.across if config.bands_across else None
    down = descend(image, guess, look.rows, look.widths, config.descent, across)
    if not config.use_strip:
        flat = down.energy >= -1e-9
        return None if flat else plain_edges(down.crossings_px)
    return refine_edges(image, down.crossings_px, look.rows, look.widths, look.across, config.strip)


def _loosened(config: TrackerConfig, state: LineState, change: Change) -> LineState:
    """Return lines of which the place is known no better than that of a pair at its start; their direction is kept.

    Where the layout changed it is their distance that is not known: both were alike too far out or in.
    """
    covariance, shift = state.covariance.copy(), config.start_shift_m**2
    covariance[C, C] += shift
    covariance[D, D] += shift
    if change is Change.LAYOUT:
        covariance[C, D] -= shift
        covariance[D, C] -= shift
    return LineState(mean=state.mean, covariance=covariance)


def _update(camera: TrackerCamera, predicted: LineState, look: FrameGeometry, found: EdgeMeasurement) -> LineUpdate:
    config = camera.config
    if config.measurement is MeasurementModel.LINES:
        lines = lines_from_crossings(found.crossings_px, look.rows)
        c_k = measurement_matrix(look.pose, camera.kappa)
        return update_lines(predicted, c_k, lines, config.line_noise * np.eye(6))
    noise = found.covariance_px2 + pose_noise(config, look)
    return update_crossings(predicted, look.predicted, look.h, found.crossings_px, noise)


def _in_picture(
    config: TrackerConfig, predicted: LineState, look: FrameGeometry, found: EdgeMeasurement, update: LineUpdate
) -> tuple[FloatArray, FloatArray]:
    """Return the edges in this picture, where the pose's error moves prediction and truth apart alike.

    Without what lasts.

    The prior of the crossings is H P Hᵀ + pose noise; the picture gives the rest. With the paper's measurement it
    is the projection of the updated state.
    """
    if config.measurement is MeasurementModel.LINES:
        crossings, h = project_lines(update.state.mean, look.e, look.rows)
        return crossings, np.asarray(h @ update.state.covariance @ h.T)
    prior = look.h @ predicted.covariance @ look.h.T + pose_noise(config, look)
    crossings, covariance = np.empty(4), np.empty((4, 4))
    between(look.predicted, prior, found.crossings_px, found.covariance_px2, crossings, covariance)
    if found.stated_px2 is not None:
        between(look.predicted, prior, found.crossings_px, found.stated_px2, np.empty(4), covariance)
    return crossings, covariance


def _lasting(
    config: TrackerConfig,
    look: FrameGeometry,
    predicted: LineState,
    state: LineState,
    found: EdgeMeasurement | None,
) -> FloatArray:
    """Return what more pictures do not average out, (4, 4) px²; the paper's measurement has none."""
    if config.measurement is MeasurementModel.LINES:
        return np.zeros((4, 4)) if found is not None else edge_noise(config, look.predicted, look.rows, predicted.mean)
    own = edge_noise(config, look.predicted, look.rows, predicted.mean, found)
    return own + other_pair_noise(config, look, state)


def _missed(
    config: TrackerConfig, look: FrameGeometry, predicted: LineState, miss: EdgeMiss, nis: float
) -> TrackingStep:
    """Return the prediction, with its own covariance."""
    lasting = _lasting(config, look, predicted, predicted, None)
    edges = Edges(
        state=predicted,
        rows_px=look.rows,
        crossings_px=look.predicted,
        covariance_px2=look.h @ predicted.covariance @ look.h.T + pose_noise(config, look) + lasting,
        systematic_px2=lasting,
        predicted_px=look.predicted,
        measured_px=None,
        nis=nis,
    )
    return TrackingStep(state=predicted, edges=edges, found=None, miss=miss, yaw_place_m=yaw_place_m(config, look.pose))
