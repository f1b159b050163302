"""The edge tracker: one picture and one pose in, the runway's edges with their covariance out.

Order in a frame: rows that hold runway; nothing tracked: Algorithm 1; else predict the lines, search about them, go
down the energy, settle, gate, update.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.config import Measurement, TrackerConfig
from groundstation.onboard.edges.descent import descend
from groundstation.onboard.edges.detection import NoPair, detect
from groundstation.onboard.edges.kalman import LineState, LineUpdate, predict, update_crossings, update_lines
from groundstation.onboard.edges.lines import (
    PITCH,
    ROLL,
    UP,
    C,
    D,
    bias_jacobian,
    line_map,
    lines_from_crossings,
    measurement_matrix,
    pose_jacobian,
    project_lines,
    shifted,
    state_from_crossings,
)
from groundstation.onboard.edges.paint import without_paint
from groundstation.onboard.edges.plausible import plausible
from groundstation.onboard.edges.pose import CameraPose, corrected_pose
from groundstation.onboard.edges.report import EdgeMiss, EdgeReport, Edges, EdgeStatus
from groundstation.onboard.edges.search_band import NoBand, across_direction, band_rows, band_widths
from groundstation.onboard.edges.strip import FoundEdges, find_edges, settle

_FIRST_SIGMA_PX = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Look:
    """A frame's geometry: pose, line map E, rows, crossings of the prediction, how they move, bands."""

    pose: CameraPose
    e: FloatArray
    rows: FloatArray
    predicted: FloatArray
    h: FloatArray
    by_pose: FloatArray
    widths: FloatArray
    across: FloatArray


class EdgeTracker:
    """Follows the runway's edges through the pictures of one camera without distortion.

    Parameters
    ----------
    kappa : intrinsic matrix (3, 3).
    image_size_px : (w, h).
    """

    def __init__(self, kappa: FloatArray, image_size_px: tuple[int, int], config: TrackerConfig) -> None:
        self._kappa = kappa
        self._size = image_size_px
        self._config = config
        self._state: LineState | None = None
        self._missed = 0

    def start(self, state: LineState) -> None:
        """Go on from lines that are known."""
        self._state = state
        self._missed = 0

    def step(self, image: ImageArray, pose: CameraPose) -> EdgeReport:
        """Take one picture (h, w, 3) uint8 BGR and its pose."""
        if self._state is None:
            return self._search(image, pose)
        predicted = predict(self._state, self._process_noise(self._state))
        look = self._look(pose, predicted)
        if look is None:
            return self._coast(predicted, None, EdgeMiss.NO_BAND, math.nan)
        px_per_m = float(np.abs(look.predicted[3] - look.predicted[1]) / abs(predicted.mean[C] - predicted.mean[D]))
        image = without_paint(image, look.rows, self._config.paint_m * px_per_m)
        found = self._measure(image, look, predicted)
        if found is None:
            return self._coast(predicted, look, EdgeMiss.FAINT, math.nan)
        update = self._update(predicted, look, found)
        if update.nis > self._config.gate:
            return self._coast(predicted, look, EdgeMiss.GATED, update.nis)
        self._state, self._missed = update.state, 0
        crossings, covariance = self._in_picture(predicted, look, found, update)
        edges = Edges(
            state=update.state,
            rows_px=look.rows,
            crossings_px=crossings,
            covariance_px2=covariance,
            predicted_px=look.predicted,
            measured_px=found.crossings_px,
            nis=update.nis,
        )
        return EdgeReport(status=EdgeStatus.TRACKING, miss=EdgeMiss.NONE, edges=edges)

    def _process_noise(self, state: LineState) -> FloatArray:
        if self._config.measurement is Measurement.LINES:
            return np.asarray(self._config.process_noise * np.eye(4))
        a, b = state.mean[:2]
        turn, shift = self._config.turn_sigma_rad, self._config.shift_sigma_m
        q = np.zeros((7, 7))
        q[:2, :2] = turn**2 * np.outer([-b, a], [-b, a])
        q[C, C] = q[D, D] = shift**2
        q[ROLL, ROLL] = q[PITCH, PITCH] = self._config.lasting_turn_rad**2
        q[UP, UP] = self._config.lasting_rise_m**2
        return q

    def _look(self, pose: CameraPose, state: LineState) -> _Look | None:
        """Return the geometry of a frame, None where no rows hold runway."""
        mean = state.mean[:4]
        lasting = state.mean.size > 4
        if lasting:
            pose = corrected_pose(pose, *(float(v) for v in state.mean[[ROLL, PITCH, UP]]))
        rows = band_rows(
            pose,
            self._kappa,
            self._size,
            self._config.guess,
            middle_m=-0.5 * float(mean[C] + mean[D]),
            width_m=abs(float(mean[C] - mean[D])),
        )
        if isinstance(rows, NoBand):
            return None
        e = line_map(pose, self._kappa)
        predicted, h = project_lines(mean, e, rows)
        by_pose = pose_jacobian(predicted, rows, pose, self._kappa)
        if lasting:
            h = np.hstack([h, bias_jacobian(by_pose, pose)])
        widths = self._widths(mean, e, rows, predicted)
        return _Look(
            pose=pose,
            e=e,
            rows=rows,
            predicted=predicted,
            h=h,
            by_pose=by_pose,
            widths=widths,
            across=across_direction(e),
        )

    def _widths(self, mean: FloatArray, e: FloatArray, rows: FloatArray, crossings: FloatArray) -> FloatArray:
        band = min(self._config.band_m, 0.45 * abs(float(mean[C] - mean[D])))
        outer, _ = project_lines(shifted(mean, band), e, rows)
        across = across_direction(e) if self._config.use_strip else None
        widths = band_widths(crossings, outer, rows, self._config.least_band_px, across)
        return np.minimum(widths, self._config.most_band_px)

    def _pose_noise(self, look: _Look) -> FloatArray:
        """Return what the pose's uncertainty is at the crossings, (4, 4) px²."""
        if self._config.measurement is Measurement.LINES:
            return np.zeros((4, 4))
        sigmas = np.array([self._config.attitude_sigma_rad] * 3 + list(self._config.position_sigma_m))
        return np.asarray((look.by_pose * sigmas**2) @ look.by_pose.T)

    def _measure(self, image: ImageArray, look: _Look, predicted: LineState) -> FoundEdges | None:
        """Return the edges that the picture shows about the prediction."""
        config, guess = self._config, look.predicted
        if config.use_strip:
            prior = look.h @ predicted.covariance @ look.h.T + self._pose_noise(look)
            wide = find_edges(image, guess, look.rows, look.widths, look.across, np.sqrt(np.diag(prior)), config.strip)
            if wide is None:
                return None
            guess = wide.crossings_px
        across = look.across if config.use_strip else None
        down = descend(image, guess, look.rows, look.widths, config.descent, across)
        if not config.use_strip:
            flat = down.energy >= -1e-9
            return None if flat else _plain(down.crossings_px)
        return settle(image, down.crossings_px, look.rows, look.widths, look.across, config.strip)

    def _update(self, predicted: LineState, look: _Look, found: FoundEdges) -> LineUpdate:
        if self._config.measurement is Measurement.LINES:
            lines = lines_from_crossings(found.crossings_px, look.rows)
            c_k = measurement_matrix(look.pose, self._kappa)
            return update_lines(predicted, c_k, lines, self._config.line_noise * np.eye(6))
        noise = found.covariance_px2 + self._pose_noise(look)
        return update_crossings(predicted, look.predicted, look.h, found.crossings_px, noise)

    def _in_picture(
        self, predicted: LineState, look: _Look, found: FoundEdges, update: LineUpdate
    ) -> tuple[FloatArray, FloatArray]:
        """Return the edges in this picture, where the pose's error moves prediction and truth apart alike.

        The prior of the crossings is H P Hᵀ + pose noise; the picture says the rest. With the paper's measurement it
        is the projection of the updated state.
        """
        if self._config.measurement is Measurement.LINES:
            crossings, h = project_lines(update.state.mean, look.e, look.rows)
            return crossings, np.asarray(h @ update.state.covariance @ h.T)
        prior = look.h @ predicted.covariance @ look.h.T + self._pose_noise(look)
        gain = np.linalg.solve(prior + found.covariance_px2, prior).T
        crossings = look.predicted + gain @ (found.crossings_px - look.predicted)
        return crossings, gain @ found.covariance_px2 + self._edge_noise(look.predicted, predicted.mean)

    def _edge_noise(self, crossings: FloatArray, mean: FloatArray) -> FloatArray:
        """Return what the definition of an edge leaves open, (4, 4) px²: alike at both ends of a line."""
        px_per_m = np.abs(crossings[2:] - crossings[:2]) / max(abs(float(mean[C] - mean[D])), 1.0)
        own = np.outer(px_per_m, px_per_m) * self._config.edge_sigma_m**2
        return np.block([[own, np.zeros((2, 2))], [np.zeros((2, 2)), own]])

    def _coast(self, predicted: LineState, look: _Look | None, miss: EdgeMiss, nis: float) -> EdgeReport:
        """Go on with the prediction, or give up after too many frames."""
        self._missed += 1
        self._state = predicted if self._missed <= self._config.coast_frames else None
        status = EdgeStatus.COASTING if self._state is not None else EdgeStatus.SEARCHING
        if look is None or self._state is None:
            return EdgeReport(status=status, miss=miss, edges=None)
        edges = Edges(
            state=predicted,
            rows_px=look.rows,
            crossings_px=look.predicted,
            covariance_px2=look.h @ predicted.covariance @ look.h.T
            + self._pose_noise(look)
            + self._edge_noise(look.predicted, predicted.mean),
            predicted_px=look.predicted,
            measured_px=None,
            nis=nis,
        )
        return EdgeReport(status=status, miss=miss, edges=edges)

    def _search(self, image: ImageArray, pose: CameraPose) -> EdgeReport:
        """Run Algorithm 1, and start the filter from what it finds."""
        config = self._config
        rows = band_rows(pose, self._kappa, self._size, self._config.guess)
        if isinstance(rows, NoBand):
            return EdgeReport(status=EdgeStatus.SEARCHING, miss=EdgeMiss.NO_BAND, edges=None)
        e = line_map(pose, self._kappa)
        half = 0.5 * self._config.guess.width_m
        middle, _ = project_lines(np.array([1.0, 0.0, -half, half]), e, rows)
        px_per_m = np.abs(middle[2:] - middle[:2]) / (2.0 * half)
        image = without_paint(image, rows, self._config.paint_m * float(px_per_m[1]))
        pair = detect(
            image, rows, px_per_m, self._config.detection, lambda x: plausible(x, rows, pose, self._kappa, config)
        )
        if isinstance(pair, NoPair):
            return EdgeReport(status=EdgeStatus.SEARCHING, miss=EdgeMiss.NO_PAIR, edges=None)
        found = self._first_look(image, pair.crossings_px, rows, pose, e)
        if found is None:
            return EdgeReport(status=EdgeStatus.SEARCHING, miss=EdgeMiss.FAINT, edges=None)
        update = self._first_update(found, rows, pose)
        self.start(update.state)
        edges = Edges(
            state=update.state,
            rows_px=rows,
            crossings_px=found.crossings_px,
            covariance_px2=found.covariance_px2 + self._edge_noise(found.crossings_px, update.state.mean),
            predicted_px=pair.crossings_px,
            measured_px=found.crossings_px,
            nis=math.nan,
        )
        return EdgeReport(status=EdgeStatus.TRACKING, miss=EdgeMiss.NONE, edges=edges)

    def _first_update(self, found: FoundEdges, rows: FloatArray, pose: CameraPose) -> LineUpdate:
        """Return the filter's start: next to nothing known of the lines, and the pose's errors as configured."""
        config = self._config
        mean = state_from_crossings(found.crossings_px, rows, pose, self._kappa)
        prior = np.diag([0.0, 0.0, 100.0, 100.0, *[config.lasting_attitude_rad**2] * 2, config.lasting_height_m**2])
        prior[:2, :2] = config.start_turn_rad**2 * np.outer([-mean[1], mean[0]], [-mean[1], mean[0]])
        if config.measurement is Measurement.LINES:
            state = LineState(mean=mean, covariance=prior[:4, :4])
        else:
            state = LineState(mean=np.concatenate([mean, np.zeros(3)]), covariance=prior)
        e = line_map(pose, self._kappa)
        predicted, h = project_lines(mean, e, rows)
        by_pose = pose_jacobian(predicted, rows, pose, self._kappa)
        if state.mean.size > 4:
            h = np.hstack([h, bias_jacobian(by_pose, pose)])
        look = _Look(
            pose=pose,
            e=e,
            rows=rows,
            predicted=predicted,
            h=h,
            by_pose=by_pose,
            widths=np.ones((2, 2)),
            across=across_direction(e),
        )
        noise = found.covariance_px2 + self._pose_noise(look)
        return update_crossings(state, predicted, h, found.crossings_px, noise)

    def _first_look(
        self, image: ImageArray, crossings: FloatArray, rows: FloatArray, pose: CameraPose, e: FloatArray
    ) -> FoundEdges | None:
        """Return a detected pair, made better by what follows it in every other frame."""
        mean = state_from_crossings(crossings, rows, pose, self._kappa)
        if not np.isfinite(mean).all():
            return None
        widths = self._widths(mean, e, rows, project_lines(mean, e, rows)[0])
        sigma, across = np.full(4, _FIRST_SIGMA_PX), across_direction(e)
        if self._config.use_strip:
            wide = find_edges(image, crossings, rows, widths, across, sigma, self._config.strip)
            if wide is None:
                return None
            crossings = wide.crossings_px
        along = across if self._config.use_strip else None
        down = descend(image, crossings, rows, widths, self._config.descent, along)
        if not self._config.use_strip:
            return _plain(down.crossings_px)
        return settle(image, down.crossings_px, rows, widths, across, self._config.strip)


def _plain(crossings_px: FloatArray) -> FoundEdges:
    """Return crossings with a covariance of 1 px², where nothing says better."""
    return FoundEdges(crossings_px=crossings_px, covariance_px2=np.eye(4), contrast=np.ones(2))
