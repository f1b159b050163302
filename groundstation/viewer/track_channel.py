"""Rows of the track: path, ellipsoids, triangulated points, latency, status and log."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.messages import TrackEstimate, TrackEvent, TrackState, TrackStatus, TriangulationStatus
from groundstation.viewer import entity_paths
from groundstation.viewer.columns import SIGMAS, ColumnBatch, present, scalars

ELLIPSOID_PERIOD_S = 1.0
LEVELS = {"WARNING": "WARN", "CRITICAL": "CRITICAL", "ERROR": "ERROR", "WARN": "WARN", "DEBUG": "DEBUG", "INFO": "INFO"}


# what a row of path, ellipsoid and status is made of
Known = TrackEstimate | TrackState


class TrackChannel:
    """Collects estimates and events and hands them over as columns; keeps the extent of the track, not the track."""

    def __init__(self) -> None:
        self._known: list[Known] = []
        self._events: list[TrackEvent] = []
        self._last_position: FloatArray | None = None
        self._last_ellipsoid_s = -np.inf
        self._last_status: TrackStatus | None = None
        self._changed_s = -np.inf
        self.first_t_s: float | None = None
        self.last_t_s: float | None = None
        self.lower_m = np.full(3, np.inf)
        self.upper_m = np.full(3, -np.inf)

    def __len__(self) -> int:
        return len(self._known)

    def add_state(self, state: TrackState) -> None:
        """Keep the answer to a heartbeat until the next `take`; while tracking, the pairs say it better."""
        if state.status is not TrackStatus.TRACKING:
            self._known.append(state)

    def add_estimate(self, estimate: TrackEstimate) -> None:
        """Keep an estimate until the next `take`."""
        self._known.append(estimate)
        if estimate.kinematics is not None:
            self.first_t_s = estimate.t_s if self.first_t_s is None else self.first_t_s
            self.last_t_s = estimate.t_s
            np.minimum(self.lower_m, estimate.kinematics.position_runway_m, out=self.lower_m)
            np.maximum(self.upper_m, estimate.kinematics.position_runway_m, out=self.upper_m)

    def add_event(self, event: TrackEvent) -> None:
        """Keep a line of the log until the next `take`."""
        self._events.append(event)

    def take(self) -> list[ColumnBatch]:
        """Return all rows since the last call and forget them."""
        known, self._known = self._known, []
        events, self._events = self._events, []
        batches = [_log(events)] if events else []
        if not known:
            return batches
        batches += [*self._position(known), *self._ellipsoids(known), *self._status(known)]
        estimates = [e for e in known if isinstance(e, TrackEstimate)]
        if not estimates:
            return batches
        t_s = [e.t_s for e in estimates]
        latency = scalars(entity_paths.PAIR_LATENCY, t_s, [(1e3 * e.latency_s,) for e in estimates])
        return [*batches, latency, _triangulated(estimates)]

    def _position(self, estimates: Sequence[Known]) -> list[ColumnBatch]:
        """Return the marker, and a stroke of the path from each estimate to the next."""
        t_s = np.array([e.t_s for e in estimates])
        positions = np.array([e.kinematics.position_runway_m for e in estimates if e.kinematics is not None])
        strokes, ends_s, colours = [], [], []
        for estimate in estimates:
            here = None if estimate.kinematics is None else estimate.kinematics.position_runway_m
            if here is not None and self._last_position is not None:
                strokes.append((self._last_position, here))
                ends_s.append(estimate.t_s)
                tracking = estimate.status is TrackStatus.TRACKING
                range_m = float(np.linalg.norm(here))
                colours.append(entity_paths.range_colour(range_m) if tracking else entity_paths.COASTING_COLOUR)
            self._last_position = here
        marker = rr.Points3D.columns(positions=positions.reshape(-1, 3))
        path = rr.LineStrips3D.columns(
            strips=np.array(strokes).reshape(-1, 2, 3), colors=np.array(colours, dtype=np.uint8).reshape(-1, 3)
        )
        return [
            ColumnBatch(
                entity=entity_paths.EKF, t_s=t_s, columns=marker.partition(present([e.kinematics for e in estimates]))
            ),
            ColumnBatch(entity=entity_paths.EKF_PATH, t_s=np.array(ends_s), columns=path),
        ]

    def _ellipsoids(self, estimates: Sequence[Known]) -> list[ColumnBatch]:
        """Return the current 3 sigma ellipsoid, and one each second that stays."""
        kept: list[Known] = []
        for estimate in estimates:
            due = estimate.t_s >= self._last_ellipsoid_s + ELLIPSOID_PERIOD_S
            if due and estimate.kinematics is not None:
                kept.append(estimate)
                self._last_ellipsoid_s = estimate.t_s
        return [
            _ellipsoid_rows(entity_paths.EKF_ELLIPSOID, estimates),
            _ellipsoid_rows(entity_paths.EKF_ELLIPSOIDS, kept),
        ]

    def _status(self, estimates: Sequence[Known]) -> list[ColumnBatch]:
        """Return a row for each change of the filter's state of knowledge."""
        statuses, at_s = [], []
        for estimate in estimates:
            if estimate.status is not self._last_status:
                self._last_status = estimate.status
                # the pair after a heartbeat may have an older stamp, and is the later news
                self._changed_s = max(self._changed_s, estimate.t_s)
                statuses.append(str(estimate.status))
                at_s.append(self._changed_s)
        columns = rr.StateChange.columns(state=statuses)
        return [ColumnBatch(entity=entity_paths.TRACK_STATUS, t_s=np.array(at_s), columns=columns)]


def _ellipsoid_rows(entity: str, estimates: Sequence[Known]) -> ColumnBatch:
    """Return the 3 sigma ellipsoid of each estimate; one without an estimate clears it."""
    known = [e.kinematics for e in estimates if e.kinematics is not None]
    centres = np.array([k.position_runway_m for k in known]).reshape(-1, 3)
    variances, axes = np.linalg.eigh(np.array([k.covariance[:3, :3] for k in known]).reshape(-1, 3, 3))
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]  # eigenvectors may come left-handed
    quaternions = np.array([wxyz_from_matrix(matrix)[entity_paths.XYZW] for matrix in axes]).reshape(-1, 4)
    columns = rr.Ellipsoids3D.columns(
        centers=centres, half_sizes=SIGMAS * np.sqrt(np.maximum(variances, 0.0)), quaternions=quaternions
    )
    counts = present([e.kinematics for e in estimates])
    return ColumnBatch(entity=entity, t_s=np.array([e.t_s for e in estimates]), columns=columns.partition(counts))


def _triangulated(estimates: Sequence[TrackEstimate]) -> ColumnBatch:
    """Return the triangulated points, red where the rays do not meet."""
    fixes = [(e.t_s, e.triangulation, e.triangulation_status) for e in estimates if e.triangulation is not None]
    colours = [
        entity_paths.TRIANGULATION_COLOUR if status is TriangulationStatus.OK else entity_paths.REFUSED_COLOUR
        for _, _, status in fixes
    ]
    columns = rr.Points3D.columns(
        positions=np.array([t.point_runway_m for _, t, _ in fixes]).reshape(-1, 3),
        colors=np.array(colours, dtype=np.uint8).reshape(-1, 3),
    )
    return ColumnBatch(entity=entity_paths.TRIANGULATION, t_s=np.array([t for t, _, _ in fixes]), columns=columns)


def _log(events: Sequence[TrackEvent]) -> ColumnBatch:
    """Return the lines of the log."""
    columns = rr.TextLog.columns(
        text=[e.text for e in events], level=[LEVELS.get(e.level.upper(), "INFO") for e in events]
    )
    return ColumnBatch(entity=f"{entity_paths.LOG}/track", t_s=np.array([e.t_s for e in events]), columns=columns)
