"""Poses from a runway's corners drawn: a Rerun recording with one step for each picture."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from groundstation.errors import InputError, os_words
from groundstation.geometry.camera import Lens
from groundstation.onboard.pose.pose_solver import PoseStatus, RunwayPose
from groundstation.onboard.pose.runway import Runway
from groundstation.onboard.sinks import log_outline
from groundstation.viewer.entity_paths import XYZW
from groundstation.viewer.recording_file import written_recording
from groundstation.viewer.scene import BAD, DOUBTFUL, FRUSTUM_LENGTH, GOOD

TIMELINE = "picture"
CAMERA, IMAGE, PLACE = "threshold/camera", "threshold/camera/image", "threshold/place"
RANGE, REPROJECTION = "range/range_m", "reprojection/reprojection_px"
_COLOURS = {PoseStatus.OK: GOOD, PoseStatus.UNCERTAIN: DOUBTFUL, PoseStatus.RESIDUAL: BAD}
_PIXEL_CORNER_FROM_CENTRE = 0.5
_PLACE_UI_POINTS = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPose:
    """One row of the table: file name, status in words, and the drawing; None without one."""

    filename: str
    status: str
    runway: Runway | None
    pose: RunwayPose | None


def draw_poses(path: Path, lens: Lens, rows: Iterable[DrawnPose]) -> None:
    """Write the cameras of all rows in the near-threshold frame, the k-th row at step k of the timeline ``picture``.

    A picture without a pose shows no camera. The runway is drawn where one begins: once where all rows name the same.
    Raises `InputError` where the file, or the folder that it is to stand in, cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        wanted = "--rerun with a file that can be written"
        raise InputError(str(fault.filename or path), got=os_words(fault), wanted=wanted) from fault
    with written_recording(path, "groundstation", path.stem) as stream:
        _log_rows(stream, lens, rows)


def _log_rows(stream: rr.RecordingStream, lens: Lens, rows: Iterable[DrawnPose]) -> None:
    stream.send_blueprint(_blueprint())
    stream.log("threshold", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    outlined: Runway | None = None
    for k, row in enumerate(rows):
        stream.set_time(TIMELINE, sequence=k)
        if row.runway is not None and row.runway is not outlined:
            log_outline(stream, row.runway.corners_m)
            outlined = row.runway
        stream.log("status", rr.TextLog(f"{row.filename}: {row.status}"))
        if row.pose is None:
            # what an earlier picture showed would stand until the next pose
            for entity in (CAMERA, PLACE, RANGE, REPROJECTION):
                stream.log(entity, rr.Clear(recursive=True))
        else:
            _log_pose(stream, row.filename, row.pose, lens)


def _blueprint() -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="threshold", name="runway"),
            rrb.Vertical(
                rrb.TimeSeriesView(origin="range", name="range, m"),
                rrb.TimeSeriesView(origin="reprojection", name="reprojection, px"),
                rrb.TextLogView(origin="status", name="pictures"),
            ),
        ),
        collapse_panels=True,
    )


def _log_pose(stream: rr.RecordingStream, filename: str, pose: RunwayPose, lens: Lens) -> None:
    """Draw the camera as a frustum, in proportion to its range, and its place; log how far off and how well it fits."""
    colour = _COLOURS[pose.status]
    attitude = rr.Quaternion(xyzw=pose.runway_from_camera_wxyz[XYZW])
    stream.log(CAMERA, rr.Transform3D(translation=pose.position_m, quaternion=attitude))
    frustum = rr.Pinhole(
        focal_length=lens.focal_px,
        principal_point=lens.principal_point_px + _PIXEL_CORNER_FROM_CENTRE,
        resolution=list(lens.image_size_px),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=FRUSTUM_LENGTH * pose.range_m,
        color=colour,
    )
    stream.log(IMAGE, frustum)
    radius = rr.Radius.ui_points(_PLACE_UI_POINTS)
    stream.log(PLACE, rr.Points3D([pose.position_m], colors=[colour], radii=radius, labels=[filename]))
    stream.log(RANGE, rr.Scalars(pose.range_m))
    stream.log(REPROJECTION, rr.Scalars(pose.reprojection_px))
