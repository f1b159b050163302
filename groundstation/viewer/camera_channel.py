"""Rows of one camera: pose of its frustum, overlay of its picture, plots and status."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.special import gammaincinv

from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.geometry.station import StationGeometry
from groundstation.messages import CameraReport, Detection, DetectionStatus, Miss
from groundstation.viewer import entity_paths
from groundstation.viewer.columns import (
    CORNER_FROM_CENTRE_PX,
    ColumnBatch,
    crosses,
    ellipses,
    outline_pieces,
    present,
    scalars,
)
from groundstation.viewer.media import EmbeddedVideo

CROSS_PX = (12.0, 36.0)
CROSS_STROKES = 4
NIS_CONFIDENCE = 0.95


@lru_cache
def nis_bounds(dof: int) -> tuple[float, float]:
    """Return the two-sided 95 % bounds of a chi-square with ``dof`` degrees of freedom."""
    tail = (1.0 - NIS_CONFIDENCE) / 2.0
    return 2.0 * float(gammaincinv(dof / 2, tail)), 2.0 * float(gammaincinv(dof / 2, 1.0 - tail))


class CameraChannel:
    """Collects one station's reports and hands them over as columns.

    Parameters
    ----------
    geometry : the station's measurement geometry, for the pose of its frustum.
    video : the station's video as it is in the recording; an empty one without any.
    frame_numbers : the video's frame of each pair, by the pair's number; None: the same.
    """

    def __init__(
        self, geometry: StationGeometry, video: EmbeddedVideo, frame_numbers: Mapping[int, int] | None = None
    ) -> None:
        self.station = geometry.name
        self._geometry = geometry
        self._video = video
        self._frame_numbers = frame_numbers
        self._reports: list[CameraReport] = []
        self._last_status: DetectionStatus | None = None
        self._last_angles: tuple[float, float, float] | None = None
        self.frames_beyond_video = 0

    def __len__(self) -> int:
        return len(self._reports)

    def add(self, report: CameraReport) -> None:
        """Keep a report until the next `take`; its picture is let go."""
        self._reports.append(report if report.image is None else replace(report, image=None))

    def take(self) -> list[ColumnBatch]:
        """Return all rows since the last call and forget them."""
        reports, self._reports = self._reports, []
        if not reports:
            return []
        return [
            *self._frames(reports),
            *_overlay(self.station, reports),
            *self._pointing(reports),
            *_plots(self.station, reports),
            *self._status(reports),
        ]

    def _frames(self, reports: Sequence[CameraReport]) -> list[ColumnBatch]:
        """Refer each frame to its own presentation timestamp; a number beyond the video refers to nothing."""
        if not len(self._video):
            return []
        own = self._frame_numbers
        numbers = np.array([r.epoch if own is None else own.get(r.epoch, -1) for r in reports], dtype=np.int64)
        inside = (numbers >= 0) & (numbers < len(self._video))
        self.frames_beyond_video += int(np.count_nonzero(~inside))
        t_s, columns = np.array([r.t_s for r in reports])[inside], self._video.references(numbers[inside])
        return [ColumnBatch(entity=entity_paths.image(self.station), t_s=t_s, columns=columns)]

    def _pointing(self, reports: Sequence[CameraReport]) -> list[ColumnBatch]:
        """Turn the head and plot the angles with their rates, wherever the angles are known."""
        angles = [(r.t_s, r.pan_rad, r.tilt_rad) for r in reports if r.pan_rad is not None and r.tilt_rad is not None]
        if not angles:
            return []
        t_s = [t for t, _, _ in angles]
        turns = [
            wxyz_from_matrix(self._geometry.base_from_head(pan, tilt))[entity_paths.XYZW] for _, pan, tilt in angles
        ]
        columns = rr.Transform3D.columns(
            quaternion=np.array(turns),
            parent_frame=[entity_paths.frame(self.station, "base")] * len(turns),
            child_frame=[entity_paths.frame(self.station, "head")] * len(turns),
        )
        base = f"{entity_paths.PTU}/{self.station}"
        batches = [ColumnBatch(entity=entity_paths.head(self.station), t_s=np.array(t_s), columns=columns)]
        known = np.array(([] if self._last_angles is None else [self._last_angles]) + angles)
        self._last_angles = angles[-1]
        steps = np.diff(known, axis=0)
        moving = steps[:, 0] > 0
        rates = np.degrees(steps[moving, 1:] / steps[moving, :1])
        for axis, name in enumerate(("pan", "tilt")):
            degrees = [(math.degrees(row[1 + axis]),) for row in angles]
            batches.append(scalars(f"{base}/{name}", t_s, degrees))
            batches.append(
                scalars(f"{base}/{name}_rate", known[1:, 0][moving].tolist(), rates[:, axis : axis + 1].tolist())
            )
        return batches

    def _status(self, reports: Sequence[CameraReport]) -> list[ColumnBatch]:
        """Return a row for each change of status, for the lanes and for the log."""
        changes: list[CameraReport] = []
        for report in reports:
            if report.status is not self._last_status:
                changes.append(report)
                self._last_status = report.status
        t_s = np.array([r.t_s for r in changes])
        states = [str(r.status) for r in changes]
        return [
            ColumnBatch(
                entity=f"{entity_paths.STATUS}/{self.station}", t_s=t_s, columns=rr.StateChange.columns(state=states)
            ),
            ColumnBatch(
                entity=f"{entity_paths.LOG}/{self.station}",
                t_s=t_s,
                columns=rr.TextLog.columns(
                    text=[_describe(r) for r in changes],
                    level=["INFO" if r.status.used else "WARN" for r in changes],
                ),
            ),
        ]


def _describe(report: CameraReport) -> str:
    """Say a camera's status in words."""
    if not isinstance(report.result, Miss):
        return f"{report.station}: {report.status}"
    detail = f" ({report.result.detail})" if report.result.detail else ""
    return f"{report.station}: {report.status}, {report.result.reason}{detail}"


def _overlay(station: str, reports: Sequence[CameraReport]) -> list[ColumnBatch]:
    """Return what is drawn over the picture; a report without an item clears it."""
    t_s = np.array([r.t_s for r in reports])
    base = entity_paths.image(station)
    rois = [r.roi for r in reports if r.roi is not None]
    half_sizes = np.array([(roi.w / 2, roi.h / 2) for roi in rois]).reshape(-1, 2)
    corners = np.array([(roi.x0, roi.y0) for roi in rois], dtype=np.float64).reshape(-1, 2)
    roi_columns = rr.Boxes2D.columns(centers=corners + half_sizes, half_sizes=half_sizes)
    return [
        ColumnBatch(entity=f"{base}/roi", t_s=t_s, columns=roi_columns.partition(present([r.roi for r in reports]))),
        *_found(base, t_s, reports),
        *_predicted(base, t_s, reports),
    ]


def _found(base: str, t_s: NDArray[np.float64], reports: Sequence[CameraReport]) -> list[ColumnBatch]:
    """Return the silhouette's outline and the target point, grey where the point was not used."""
    found = [r.result if isinstance(r.result, Detection) else None for r in reports]
    pieces = [outline_pieces(d.contour_px) if d is not None else [] for d in found]
    strips = [strip for row in pieces for strip in row]
    points = np.array([(d.u_px, d.v_px) for d in found if d is not None]).reshape(-1, 2)
    colours = [
        entity_paths.TARGET_COLOUR if r.status.used else entity_paths.BOUND_COLOUR
        for r in reports
        if isinstance(r.result, Detection)
    ]
    point_columns = rr.Points2D.columns(
        positions=points + CORNER_FROM_CENTRE_PX, colors=np.array(colours, dtype=np.uint8).reshape(-1, 3)
    )
    return [
        ColumnBatch(
            entity=f"{base}/contour",
            t_s=t_s,
            columns=rr.LineStrips2D.columns(strips=strips).partition([len(row) for row in pieces]),
        ),
        ColumnBatch(entity=f"{base}/target", t_s=t_s, columns=point_columns.partition(present(found))),
    ]


def _predicted(base: str, t_s: NDArray[np.float64], reports: Sequence[CameraReport]) -> list[ColumnBatch]:
    """Return the cross at the predicted pixel, and its 3 sigma ellipse."""
    centres = np.array([r.predicted_px for r in reports if r.predicted_px is not None]).reshape(-1, 2)
    spread = [
        (r.predicted_px, r.predicted_covariance_px2)
        if r.predicted_px is not None and r.predicted_covariance_px2 is not None
        else None
        for r in reports
    ]
    means = np.array([row[0] for row in spread if row is not None]).reshape(-1, 2)
    covariances = np.array([row[1] for row in spread if row is not None]).reshape(-1, 2, 2)
    counts = present([r.predicted_px for r in reports])
    return [
        ColumnBatch(
            entity=f"{base}/prediction",
            t_s=t_s,
            columns=rr.LineStrips2D.columns(strips=crosses(centres, *CROSS_PX)).partition(CROSS_STROKES * counts),
        ),
        ColumnBatch(
            entity=f"{base}/prediction/ellipse",
            t_s=t_s,
            columns=rr.LineStrips2D.columns(strips=ellipses(means, covariances)).partition(present(spread)),
        ),
    ]


def _plots(station: str, reports: Sequence[CameraReport]) -> list[ColumnBatch]:
    """Return detection time in ms and the normalised innovation squared, used and refused apart."""
    batches = [
        scalars(f"{entity_paths.LATENCY}/{station}", [r.t_s for r in reports], [(1e3 * r.elapsed_s,) for r in reports])
    ]
    judged = [(r.t_s, r.innovation) for r in reports if r.innovation is not None]
    for name, accepted in ((station, True), (f"{station}/refused", False)):
        rows = [(t, (i.nis,)) for t, i in judged if i.accepted is accepted]
        batches.append(scalars(f"{entity_paths.NIS}/{name}", [t for t, _ in rows], [nis for _, nis in rows]))
    bounds = [nis_bounds(i.dof) for _, i in judged]
    return [*batches, scalars(entity_paths.NIS_BOUNDS, [t for t, _ in judged], bounds)]
