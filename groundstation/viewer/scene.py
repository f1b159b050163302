"""Static entities of a Rerun recording: runway, stations, and the styles of the moving entities."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

import numpy as np
import rerun as rr

from groundstation.arrays import FloatArray
from groundstation.integrity.approach_advice import AdviceLevel
from groundstation.messages import DetectionStatus, TrackStatus
from groundstation.rig.rig import Rig, Station
from groundstation.viewer import entity_paths

_State = TypeVar("_State", bound=StrEnum)

DEFAULT_RUNWAY_LENGTH_M = 600.0
RUNWAY_MARGIN_M = 50.0
TICK_M = 100.0
LABEL_EVERY = 2
MIN_WIDTH_M = 4.0
# a frustum is drawn this fraction of the range that is to be seen long
FRUSTUM_LENGTH = 0.22
EXPECTED_RANGE_M = 400.0
# Rerun takes a negative width as one in points of the screen
FRUSTUM_LINE_UI_POINTS = -1.2
LABEL_OUTWARD = 1.9
GOOD, DOUBTFUL, BAD, IDLE = (60, 140, 80), (190, 140, 40), (170, 60, 55), (90, 95, 105)
TRACK_STATES = {
    TrackStatus.SEARCHING: IDLE,
    TrackStatus.ACQUIRING: DOUBTFUL,
    TrackStatus.TRACKING: GOOD,
    TrackStatus.COASTING: DOUBTFUL,
    TrackStatus.LOST: BAD,
}
ADVICE_LEVELS = {AdviceLevel.GO: GOOD, AdviceLevel.CAUTION: DOUBTFUL, AdviceLevel.WAVE_OFF: BAD}
DETECTION_STATES = {
    DetectionStatus.OK: GOOD,
    DetectionStatus.MISS: BAD,
    DetectionStatus.OUT_OF_VIEW: IDLE,
    DetectionStatus.GATED: DOUBTFUL,
    DetectionStatus.AMBIGUOUS: DOUBTFUL,
    DetectionStatus.CUT: DOUBTFUL,
    DetectionStatus.LATE: GOOD,
    DetectionStatus.EXCLUDED: BAD,
    DetectionStatus.INITIAL: IDLE,
}
PAVEMENT = (70, 74, 80)
MARKING = (165, 170, 175)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunwayOutline:
    """The strip that is drawn: from y = 0 to ``length_m``, x from ``left_m`` to ``right_m``, at z = 0.

    A drawing aid between the pedestals, not a surveyed runway.
    """

    left_m: float
    right_m: float
    length_m: float = DEFAULT_RUNWAY_LENGTH_M


def outline_between(rig: Rig, length_m: float = DEFAULT_RUNWAY_LENGTH_M) -> RunwayOutline:
    """Return the strip between the outermost pedestals of a rig."""
    x = [float(s.ptu_position_m[0]) for s in rig.stations]
    middle, half = (min(x) + max(x)) / 2, max(max(x) - min(x), MIN_WIDTH_M) / 2
    return RunwayOutline(left_m=middle - half, right_m=middle + half, length_m=length_m)


def long_enough(outline: RunwayOutline, furthest_y_m: float) -> RunwayOutline:
    """Return the outline, lengthened to the next tick beyond the furthest point of the track if need be."""
    needed = TICK_M * float(np.ceil((furthest_y_m + RUNWAY_MARGIN_M) / TICK_M))
    return RunwayOutline(left_m=outline.left_m, right_m=outline.right_m, length_m=max(outline.length_m, needed))


def log_runway(stream: rr.RecordingStream, outline: RunwayOutline) -> None:
    """Draw the strip with edges, centre line and a labelled stroke each 100 m."""
    left, right, end = outline.left_m, outline.right_m, outline.length_m
    corners = np.array([[left, 0, 0], [right, 0, 0], [right, end, 0], [left, end, 0]])
    stream.log(
        f"{entity_paths.RUNWAY}/surface",
        rr.Mesh3D(
            vertex_positions=corners - [0, 0, 0.05], triangle_indices=[[0, 1, 2], [0, 2, 3]], albedo_factor=PAVEMENT
        ),
        static=True,
    )
    ticks_m = np.arange(0.0, end + 1.0, TICK_M)
    middle = (left + right) / 2
    lines = [
        np.vstack([corners, corners[:1]]),
        np.array([[middle, 0.0, 0.0], [middle, end, 0.0]]),
        *(np.array([[left, y, 0.0], [right, y, 0.0]]) for y in ticks_m[1:]),
    ]
    stream.log(
        f"{entity_paths.RUNWAY}/lines",
        rr.LineStrips3D(lines, colors=MARKING, radii=rr.Radius.ui_points(0.8)),
        static=True,
    )
    labelled_m = ticks_m[LABEL_EVERY::LABEL_EVERY]
    places = np.column_stack([np.full(len(labelled_m), right + 2.0), labelled_m, np.zeros(len(labelled_m))])
    stream.log(
        f"{entity_paths.RUNWAY}/distance",
        rr.Points3D(
            places,
            labels=[f"{y:.0f} m" for y in labelled_m],
            colors=entity_paths.LABEL_COLOUR,
            radii=rr.Radius.ui_points(1.0),
            show_labels=True,
        ),
        static=True,
    )


def log_pedestal(stream: rr.RecordingStream, station: Station, number: int, middle_m: FloatArray) -> None:
    """Draw a station's pedestal and name.

    ``middle_m`` (3,) is the middle of all stations; names stand outside of it, clear of each other.
    """
    x, y, z = (float(v) for v in station.ptu_position_m)
    colour = entity_paths.station_colour(number)
    stream.log(
        f"{entity_paths.STATIONS}/{station.name}/pedestal",
        rr.LineStrips3D([[[x, y, 0.0], [x, y, z]]], colors=colour, radii=rr.Radius.ui_points(3.0)),
        static=True,
    )
    stream.log(
        f"{entity_paths.STATIONS}/{station.name}/name",
        rr.Points3D(
            [middle_m + LABEL_OUTWARD * (station.ptu_position_m - middle_m)],
            labels=[station.name],
            colors=entity_paths.LABEL_COLOUR,
            radii=rr.Radius.ui_points(0.1),
            show_labels=True,
        ),
        static=True,
    )


def log_station(stream: rr.RecordingStream, station: Station, number: int, middle_m: FloatArray) -> None:
    """Draw a station's pedestal and name (`log_pedestal`), and the frustum that its camera's pose will turn."""
    log_pedestal(stream, station, number, middle_m)
    colour = entity_paths.station_colour(number)
    _log_frames(stream, station)
    width, height = station.lens.image_size_px
    stream.log(
        entity_paths.camera(station.name),
        rr.Pinhole(
            parent_frame=entity_paths.frame(station.name, "camera"),
            child_frame=entity_paths.frame(station.name, "image"),
            focal_length=station.lens.focal_px,
            principal_point=station.lens.principal_point_px + 0.5,
            resolution=[width, height],
            image_plane_distance=FRUSTUM_LENGTH * EXPECTED_RANGE_M,
            color=colour,
            line_width=FRUSTUM_LINE_UI_POINTS,
        ),
        rr.TransformAxes3D(axis_length=0.0),
        static=True,
    )


def log_world(stream: rr.RecordingStream) -> None:
    """Log the axes of the scene, which are those of the runway frame."""
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log(
        entity_paths.WORLD,
        rr.Transform3D(
            translation=np.zeros(3), parent_frame=entity_paths.ROOT_FRAME, child_frame=entity_paths.RUNWAY_FRAME
        ),
        static=True,
    )


def _log_frames(stream: rr.RecordingStream, station: Station) -> None:
    """Log a station's two static frames: its base in the runway frame, its camera in the head frame."""
    name = station.name
    stream.log(
        entity_paths.base(name),
        rr.Transform3D(
            translation=station.ptu_position_m,
            quaternion=rr.Quaternion(xyzw=station.runway_from_base_wxyz[entity_paths.XYZW]),
            parent_frame=entity_paths.RUNWAY_FRAME,
            child_frame=entity_paths.frame(name, "base"),
        ),
        rr.TransformAxes3D(axis_length=0.0),
        static=True,
    )
    stream.log(
        entity_paths.camera(name),
        rr.Transform3D(
            translation=station.camera_in_head_m,
            quaternion=rr.Quaternion(xyzw=station.head_from_camera_wxyz[entity_paths.XYZW]),
            parent_frame=entity_paths.frame(name, "head"),
            child_frame=entity_paths.frame(name, "camera"),
        ),
        static=True,
    )


def fit_frustum(stream: rr.RecordingStream, station: Station, lower_m: FloatArray, upper_m: FloatArray) -> None:
    """Draw a frustum in proportion to the range at which the track, in the box (3,) to (3,), was seen."""
    furthest_m = float(
        np.linalg.norm(np.maximum(np.abs(upper_m - station.ptu_position_m), np.abs(lower_m - station.ptu_position_m)))
    )
    fitted = rr.Pinhole.from_fields(image_plane_distance=FRUSTUM_LENGTH * furthest_m)
    stream.log(entity_paths.camera(station.name), fitted, static=True)


def log_styles(stream: rr.RecordingStream) -> None:
    """Log the styles of the moving entities of the 3-D view."""
    thin = rr.Radius.ui_points(1.0)
    styles: dict[str, rr.AsComponents] = {
        entity_paths.EKF: rr.Points3D.from_fields(colors=entity_paths.EKF_COLOUR, radii=rr.Radius.ui_points(6.0)),
        entity_paths.EKF_PATH: rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(2.2)),
        entity_paths.EKF_ELLIPSOID: rr.Ellipsoids3D.from_fields(
            colors=entity_paths.EKF_COLOUR, line_radii=thin, fill_mode=rr.components.FillMode.MajorWireframe
        ),
        entity_paths.EKF_ELLIPSOIDS: rr.Ellipsoids3D.from_fields(
            colors=(*entity_paths.EKF_COLOUR, 110), line_radii=thin, fill_mode=rr.components.FillMode.MajorWireframe
        ),
        entity_paths.TRIANGULATION: rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.4)),
        entity_paths.TRACK_STATUS: _states(TRACK_STATES),
        entity_paths.PAIR_LATENCY: rr.SeriesLines(colors=entity_paths.EKF_COLOUR, names="pair", widths=1.5),
        entity_paths.NIS_BOUNDS: rr.SeriesLines(
            colors=[entity_paths.BOUND_COLOUR] * 2, names=["95 % lower", "95 % upper"], widths=[1.0, 1.0]
        ),
    }
    for entity, style in styles.items():
        stream.log(entity, style, static=True)


def log_approach_styles(stream: rr.RecordingStream) -> None:
    """Log the styles of an approach's plots, its lane of advice and the touchdown foretold."""
    height = entity_paths.EKF_COLOUR
    styles: dict[str, rr.AsComponents] = {
        entity_paths.ADVICE: _states(ADVICE_LEVELS),
        entity_paths.CENTRE_LINE_NEEDLE: rr.SeriesLines(
            colors=entity_paths.CENTRE_LINE_COLOUR, names="fly right", widths=1.5
        ),
        entity_paths.GLIDE_PATH_NEEDLE: rr.SeriesLines(
            colors=entity_paths.GLIDE_PATH_COLOUR, names="fly up", widths=1.5
        ),
        entity_paths.THRESHOLD_HEIGHT: rr.SeriesLines(
            colors=[height, *[entity_paths.dimmed(height)] * 2],
            names=["height", "−2σ", "+2σ"],
            widths=[1.5, 1.0, 1.0],
        ),
        entity_paths.TOUCHDOWN: rr.LineStrips3D.from_fields(
            colors=entity_paths.TOUCHDOWN_COLOUR, radii=rr.Radius.ui_points(1.5)
        ),
    }
    for entity, style in styles.items():
        stream.log(entity, style, static=True)


def log_camera_styles(stream: rr.RecordingStream, rigged: Station, number: int) -> None:
    """Log the styles of a camera's overlay and plots, and the border of its picture."""
    station, (width, height) = rigged.name, rigged.lens.image_size_px
    base = entity_paths.image(station)
    colour = entity_paths.station_colour(number)
    styles: dict[str, rr.AsComponents] = {
        f"{base}/border": rr.Boxes2D(
            centers=[width / 2, height / 2],
            half_sizes=[width / 2, height / 2],
            colors=entity_paths.BOUND_COLOUR,
            radii=rr.Radius.ui_points(0.5),
        ),
        f"{base}/roi": rr.Boxes2D.from_fields(colors=entity_paths.ROI_COLOUR, radii=rr.Radius.ui_points(1.0)),
        f"{base}/contour": rr.LineStrips2D.from_fields(
            colors=entity_paths.CONTOUR_COLOUR, radii=rr.Radius.ui_points(0.8)
        ),
        f"{base}/target": rr.Points2D.from_fields(radii=rr.Radius.ui_points(2.0)),
        f"{base}/prediction": rr.LineStrips2D.from_fields(
            colors=entity_paths.PREDICTION_COLOUR, radii=rr.Radius.ui_points(0.8)
        ),
        f"{base}/prediction/ellipse": rr.LineStrips2D.from_fields(
            colors=entity_paths.PREDICTION_COLOUR, radii=rr.Radius.ui_points(0.8)
        ),
        f"{entity_paths.NIS}/{station}": rr.SeriesPoints(
            colors=colour, names=station, markers="circle", marker_sizes=1.5
        ),
        f"{entity_paths.NIS}/{station}/refused": rr.SeriesPoints(
            colors=entity_paths.REFUSED_COLOUR, names=f"{station} refused", markers="cross", marker_sizes=3.0
        ),
        f"{entity_paths.LATENCY}/{station}": rr.SeriesLines(colors=colour, names=f"{station} detection", widths=1.0),
        f"{entity_paths.STATUS}/{station}": _states(DETECTION_STATES),
        **{
            f"{entity_paths.PTU}/{station}/{name}": rr.SeriesLines(
                colors=shade, names=f"{station} {name.replace('_', ' ')}", widths=1.2
            )
            for name, shade in (("pan", colour), ("tilt", colour), ("pan_rate", colour), ("tilt_rate", _paler(colour)))
        },
    }
    for entity, style in styles.items():
        stream.log(entity, style, static=True)


def _states(colours: Mapping[_State, tuple[int, int, int]]) -> rr.StateConfiguration:
    """Return the colours of the lanes of a status."""
    return rr.StateConfiguration(
        values=[str(state) for state in colours], colors=np.array(list(colours.values()), dtype=np.uint8)
    )


def _paler(colour: entity_paths.Colour) -> tuple[int, int, int]:
    """Return a lighter shade."""
    r, g, b = colour
    return (r + 255) // 2, (g + 255) // 2, (b + 255) // 2
