"""A flight by nose camera drawn: edges and corners into the pictures, and all of it as a Rerun recording."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.edges.edges_file import corner_pixels
from groundstation.onboard.edges.undistortion import Undistorter
from groundstation.onboard.pose.agreement import PositionTrack
from groundstation.onboard.pose.runway import CORNERS
from groundstation.onboard.sinks import draw_edges, log_outline
from groundstation.onboard.visual_inertial.nose_report import NoseReport
from groundstation.viewer.recording_file import written_recording

_CORNER_BGR = (60, 60, 255)
_CORNER_RGB = [255, 60, 60]
_EDGE_RGB = [90, 230, 90]
_JPEG_QUALITY = 80
_CORNER_FROM_CENTRE_PX = 0.5
_SHIFT = 4
_NOSE_M = 8.0


def draw_sight(
    image: ImageArray, index: int, report: NoseReport, corners_px: FloatArray | None, flat: Undistorter
) -> ImageArray:
    """Return a copy of a frame (h, w, 3) BGR with edges, corners (4, 2) px and what became of it."""
    picture = draw_edges(image, index, report.t_s, report.edges, _edge_ends(report, flat))
    if corners_px is not None:
        for corner in np.round(corners_px[np.isfinite(corners_px).all(axis=1)] * 2**_SHIFT).astype(int):
            cv2.circle(picture, (int(corner[0]), int(corner[1])), 5 * 2**_SHIFT, _CORNER_BGR, 1, cv2.LINE_AA, _SHIFT)
    words = report.outcome
    if report.fix is not None:
        x, y, z = report.fix.position_m
        sx, sy, sz = np.sqrt(np.diag(report.fix.covariance)[:3])
        # OpenCV before 5 writes ASCII only
        words += f"  x {x:.1f}  y {y:.0f}  z {z:.1f} m, sigma {sx:.1f}  {sy:.0f}  {sz:.1f}"
    scale = max(0.5, picture.shape[1] / 1400)
    place = (6, picture.shape[0] - 10)
    (w, h), below = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    cv2.rectangle(picture, (0, place[1] - h - 6), (w + 12, place[1] + below + 4), (0, 0, 0), cv2.FILLED)
    cv2.putText(picture, words, place, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def _edge_ends(report: NoseReport, flat: Undistorter) -> FloatArray | None:
    edges = None if report.edges is None else report.edges.edges
    return None if edges is None else flat.original(corner_pixels(edges))


class FlyRecording:
    """Writes pictures with edges and corners, each picture's own pose, the filter's track with its sigma, the ground's.

    Parameters
    ----------
    runway_m : (4, 3) corners of the runway. ground : the ground station's track over the threshold, or None.
    """

    def __init__(self, path: Path, name: str, runway_m: FloatArray, ground: PositionTrack | None) -> None:
        self._opened = ExitStack()
        self._stream = self._opened.enter_context(written_recording(path, "groundstation", name))
        self._path: list[FloatArray] = []
        self._seen: list[FloatArray] = []
        self._stream.send_blueprint(
            rrb.Blueprint(
                rrb.Horizontal(
                    rrb.Spatial2DView(origin="camera", name="nose camera"),
                    rrb.Vertical(
                        rrb.Spatial3DView(origin="threshold", name="runway"),
                        rrb.TimeSeriesView(origin="sigma", name="1 sigma, m"),
                    ),
                ),
                collapse_panels=True,
            )
        )
        log_outline(self._stream, runway_m, static=True)
        if ground is not None:
            track = rr.LineStrips3D([ground.position_m], colors=[[90, 160, 255]])
            self._stream.log("threshold/ground_track", track, static=True)

    def __enter__(self) -> "FlyRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.__exit__(kind, fault, trace)

    def write(self, image: ImageArray, report: NoseReport, corners_px: FloatArray | None, flat: Undistorter) -> None:
        """Send one frame (h, w, 3) BGR and its report."""
        send = self._stream
        send.set_time("time", duration=np.timedelta64(round(report.t_s * 1e9), "ns"))
        send.log("camera/image", rr.Image(image, color_model=rr.ColorModel.BGR).compress(jpeg_quality=_JPEG_QUALITY))
        ends = _edge_ends(report, flat)
        strips = [] if ends is None else (ends.reshape(2, 2, 2) + _CORNER_FROM_CENTRE_PX).tolist()
        send.log("camera/image/edges", rr.LineStrips2D(strips, colors=[_EDGE_RGB]))
        if corners_px is None:
            send.log("camera/image/corners", rr.Clear(recursive=False))
        else:
            seen = np.flatnonzero(np.isfinite(corners_px).all(axis=1))
            points = rr.Points2D(
                corners_px[seen] + _CORNER_FROM_CENTRE_PX,
                colors=[_CORNER_RGB],
                radii=[-4.0],
                labels=[CORNERS[k] for k in seen],
            )
            send.log("camera/image/corners", points)
        send.log("status", rr.TextLog(report.outcome))
        if report.pose is not None:
            self._seen.append(report.pose.position_m)
            send.log("threshold/poses", rr.Points3D(np.array(self._seen), colors=[_CORNER_RGB], radii=[-2.0]))
        if report.fix is None:
            return
        fix = report.fix
        self._path.append(fix.position_m)
        send.log("threshold/track", rr.LineStrips3D([np.array(self._path)], colors=[_EDGE_RGB]))
        nose = _NOSE_M * matrix_from_wxyz(fix.runway_from_body_wxyz)[:, 0]
        send.log("threshold/nose", rr.Arrows3D(origins=[fix.position_m], vectors=[nose], colors=[_EDGE_RGB]))
        sigma = np.sqrt(np.diag(fix.covariance)[:3])
        send.log("threshold/sigma", rr.Ellipsoids3D(centers=[fix.position_m], half_sizes=[2.0 * sigma]))
        for axis, value in zip("xyz", sigma, strict=True):
            send.log(f"sigma/{axis}", rr.Scalars(float(value)))
