"""One step of lines that are followed: predict, look about the prediction, go down, settle, gate, update."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.config import Measurement, TrackerConfig
from groundstation.onboard.edges.descent import descend
from groundstation.onboard.edges.kalman import LineState, LineUpdate, predict, update_crossings, update_lines
from groundstation.onboard.edges.kalman_kernel import between
from groundstation.onboard.edges.lines import (
    PITCH,
    ROLL,
    UP,
    C,
    D,
    lines_from_crossings,
    measurement_matrix,
    project_lines,
)
from groundstation.onboard.edges.look import Look, Lookout, edge_noise, look_at, pose_noise
from groundstation.onboard.edges.paint import without_paint
from groundstation.onboard.edges.pose import CameraPose
from groundstation.onboard.edges.profile import Marks, ProfileConfig, edges_by_profile, reach_px
from groundstation.onboard.edges.report import EdgeMiss, Edges
from groundstation.onboard.edges.strip import FoundEdges, search_edges, settle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Followed:
    """What came of a step: the lines after it, as edges of the picture where rows hold them, and what was seen.

    ``found`` is None where nothing was measured or accepted; ``miss`` says why.
    """

    state: LineState
    edges: Edges | None
    found: FoundEdges | None
    miss: EdgeMiss


def follow(
    lookout: Lookout,
    image: ImageArray,
    pose: CameraPose,
    state: LineState,
    *,
    thorough: bool,
    marks: Marks | None = None,
    checks: bool = True,
) -> Followed:
    """Follow lines into a picture (h, w, 3) uint8 BGR.

    Not ``thorough``: the strip's search alone says where they are, without the descent; for lines that are one of
    several possibilities. With ``checks`` what is remembered of profiles is doubted, see `profile.edges_by_profile`.
    """
    config = lookout.config
    predicted = predict(state, process_noise(config, state))
    look = look_at(lookout, pose, predicted)
    if look is None:
        return Followed(state=predicted, edges=None, found=None, miss=EdgeMiss.NO_BAND)
    px_per_m = float(np.abs(look.predicted[3] - look.predicted[1]) / abs(predicted.mean[C] - predicted.mean[D]))
    if thorough and config.profile is not None:
        found = by_profile(config, image, look, predicted, marks, checks=checks)
    else:
        image = without_paint(image, look.rows, config.paint_m * px_per_m)
        found = _measure(config, image, look, predicted, thorough=thorough)
    if found is None:
        return _missed(config, look, predicted, EdgeMiss.FAINT, math.nan)
    if found.strayed:
        predicted = _loosened(config, predicted)
    update = _update(lookout, predicted, look, found)
    if update.nis > config.gate:
        return _missed(config, look, predicted, EdgeMiss.GATED, update.nis)
    crossings, covariance = _in_picture(config, predicted, look, found, update)
    edges = Edges(
        state=update.state,
        rows_px=look.rows,
        crossings_px=crossings,
        covariance_px2=covariance,
        predicted_px=look.predicted,
        measured_px=found.crossings_px,
        nis=update.nis,
    )
    return Followed(state=update.state, edges=edges, found=found, miss=EdgeMiss.NONE)


def by_profile(
    config: TrackerConfig, image: ImageArray, look: Look, predicted: LineState, marks: Marks | None, *, checks: bool
) -> FoundEdges | None:
    """Return the edges where the profiles across them put them; the picture has its paint."""
    profile = config.profile
    if profile is None:
        return None
    width_m = abs(float(predicted.mean[C] - predicted.mean[D]))
    px_per_m = np.abs(look.predicted[2:] - look.predicted[:2]) / width_m
    prior = look.h @ predicted.covariance @ look.h.T + pose_noise(config, look)
    guess = look.predicted
    if (3.0 * np.sqrt(prior.diagonal()) > np.tile(reach_px(px_per_m, profile), 2)).any():
        cleaned = without_paint(image, look.rows, config.paint_m * float(px_per_m[1]))
        wide = search_edges(cleaned, guess, look.rows, look.widths, look.across, prior, config.strip)
        if wide is None:
            return None
        guess = wide
    found = profiled(profile, image, look, predicted, guess, prior, marks, checks=checks)
    return None if found.contrast.min() < config.strip.least_contrast else found


def profiled(
    config: ProfileConfig,
    image: ImageArray,
    look: Look,
    state: LineState,
    guess: FloatArray,
    prior: FloatArray,
    marks: Marks | None,
    *,
    checks: bool,
) -> FoundEdges:
    """Return edges by profiles about a guess (4,), with a prior (4, 4) about where the look predicts them."""
    width_m = abs(float(state.mean[C] - state.mean[D]))
    px_per_m = np.abs(look.predicted[2:] - look.predicted[:2]) / width_m
    found = edges_by_profile(image, guess, look.rows, px_per_m, look.predicted, prior, marks, config, checks=checks)
    return FoundEdges(
        crossings_px=found.crossings_px,
        covariance_px2=found.covariance_px2,
        contrast=found.contrast,
        agreement=found.agreement,
        marks=found.marks,
        strayed=found.strayed,
    )


def process_noise(config: TrackerConfig, state: LineState) -> FloatArray:
    """Return Q of a frame, (4, 4) or (7, 7)."""
    if config.measurement is Measurement.LINES:
        return np.asarray(config.process_noise * np.eye(4))
    a, b = state.mean[:2]
    turn, shift = config.turn_sigma_rad, config.shift_sigma_m
    q = np.zeros((7, 7))
    q[:2, :2] = turn**2 * np.outer([-b, a], [-b, a])
    q[C, C] = q[D, D] = shift**2
    q[ROLL, ROLL] = q[PITCH, PITCH] = config.lasting_turn_rad**2
    q[UP, UP] = config.lasting_rise_m**2
    return q


def plain_edges(crossings_px: FloatArray) -> FoundEdges:
    """Return crossings with a covariance of 1 px², where nothing says better."""
    return FoundEdges(crossings_px=crossings_px, covariance_px2=np.eye(4), contrast=np.ones(2), agreement=1.0)


def _measure(
    config: TrackerConfig, image: ImageArray, look: Look, predicted: LineState, *, thorough: bool
) -> FoundEdges | None:
    """Return the edges that the picture shows about the prediction."""
    guess = look.predicted
    if config.use_strip:
        prior = look.h @ predicted.covariance @ look.h.T + pose_noise(config, look)
        wide = search_edges(image, guess, look.rows, look.widths, look.across, prior, config.strip)
        near = None if wide is None else settle(image, wide, look.rows, look.widths, look.across, config.strip)
        if wide is None or not thorough:
            return near
        guess = wide if near is None else near.crossings_px
    across = look.across if config.bands_across else None
    down = descend(image, guess, look.rows, look.widths, config.descent, across)
    if not config.use_strip:
        flat = down.energy >= -1e-9
        return None if flat else plain_edges(down.crossings_px)
    return settle(image, down.crossings_px, look.rows, look.widths, look.across, config.strip)


def _loosened(config: TrackerConfig, state: LineState) -> LineState:
    """Return lines of which the place is known no better than that of a pair at its start; their direction is kept."""
    covariance = state.covariance.copy()
    covariance[C, C] += config.start_shift_m**2
    covariance[D, D] += config.start_shift_m**2
    return LineState(mean=state.mean, covariance=covariance)


def _update(lookout: Lookout, predicted: LineState, look: Look, found: FoundEdges) -> LineUpdate:
    config = lookout.config
    if config.measurement is Measurement.LINES:
        lines = lines_from_crossings(found.crossings_px, look.rows)
        c_k = measurement_matrix(look.pose, lookout.kappa)
        return update_lines(predicted, c_k, lines, config.line_noise * np.eye(6))
    noise = found.covariance_px2 + pose_noise(config, look)
    return update_crossings(predicted, look.predicted, look.h, found.crossings_px, noise)


def _in_picture(
    config: TrackerConfig, predicted: LineState, look: Look, found: FoundEdges, update: LineUpdate
) -> tuple[FloatArray, FloatArray]:
    """Return the edges in this picture, where the pose's error moves prediction and truth apart alike.

    The prior of the crossings is H P Hᵀ + pose noise; the picture says the rest. With the paper's measurement it
    is the projection of the updated state.
    """
    if config.measurement is Measurement.LINES:
        crossings, h = project_lines(update.state.mean, look.e, look.rows)
        return crossings, np.asarray(h @ update.state.covariance @ h.T)
    prior = look.h @ predicted.covariance @ look.h.T + pose_noise(config, look)
    crossings, covariance = np.empty(4), np.empty((4, 4))
    between(look.predicted, prior, found.crossings_px, found.covariance_px2, crossings, covariance)
    return crossings, covariance + edge_noise(config, look.predicted, predicted.mean, found.contrast)


def _missed(config: TrackerConfig, look: Look, predicted: LineState, miss: EdgeMiss, nis: float) -> Followed:
    """Return the prediction, with its own covariance."""
    edges = Edges(
        state=predicted,
        rows_px=look.rows,
        crossings_px=look.predicted,
        covariance_px2=look.h @ predicted.covariance @ look.h.T
        + pose_noise(config, look)
        + edge_noise(config, look.predicted, predicted.mean),
        predicted_px=look.predicted,
        measured_px=None,
        nis=nis,
    )
    return Followed(state=predicted, edges=edges, found=None, miss=miss)
