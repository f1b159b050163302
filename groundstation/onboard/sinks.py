"""Runway edges drawn: into the pictures, and as a Rerun recording."""

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.line_state import A, B, C, D
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.report import EdgeReport, EdgeStatus
from groundstation.viewer.recording_file import written_recording

_COLOURS = {
    EdgeStatus.ACQUIRING: (230, 200, 60),
    EdgeStatus.TRACKING: (90, 230, 90),
    EdgeStatus.COASTING: (60, 190, 255),
    EdgeStatus.SEARCHING: (80, 80, 255),
}
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_JPEG_QUALITY = 80
_CORNER_FROM_CENTRE_PX = 0.5
_SHIFT = 4


def draw_edges(
    image: ImageArray, index: int, t_s: float, report: EdgeReport | None, corners: FloatArray | None
) -> ImageArray:
    """Return a copy of a frame (h, w, 3) BGR with the edges between ``corners`` (4, 2) px, and its status."""
    picture = image.copy()
    status = "no pose" if report is None else report.status.value
    if report is not None and corners is not None:
        for line in np.round(corners.reshape(2, 2, 2) * 2**_SHIFT).astype(int):
            start, end = (tuple(int(v) for v in point) for point in line)
            cv2.line(picture, start, end, _COLOURS[report.status], 2, cv2.LINE_AA, _SHIFT)
    scale = max(0.5, picture.shape[1] / 1400)
    text = f"{index}  {t_s:.2f} s  {status}"
    (w, h), below = cv2.getTextSize(text, _FONT, scale, 1)
    cv2.rectangle(picture, (0, 0), (w + 12, h + below + 12), (0, 0, 0), cv2.FILLED)
    cv2.putText(picture, text, (6, 6 + h), _FONT, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def log_outline(stream: rr.RecordingStream, runway_m: FloatArray, *, static: bool = False) -> None:
    """Draw a runway's outline through its corners (4, 3), near-threshold frame, for good or from now on."""
    outline = np.vstack([runway_m, runway_m[:1]])
    stream.log("threshold/runway", rr.LineStrips3D([outline], colors=[[200, 200, 200]]), static=static)


class EdgesRecording:
    """Writes pictures, edges and the camera's path to a Rerun recording."""

    def __init__(self, path: Path, name: str, length_m: float) -> None:
        self._opened = ExitStack()
        self._stream = self._opened.enter_context(written_recording(path, "groundstation", name))
        self._length_m = length_m
        self._path: list[FloatArray] = []
        self._stream.send_blueprint(
            rrb.Blueprint(
                rrb.Horizontal(
                    rrb.Spatial2DView(origin="camera", name="nose camera"),
                    rrb.Spatial3DView(origin="threshold", name="runway"),
                ),
                collapse_panels=True,
            )
        )

    def __enter__(self) -> "EdgesRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.__exit__(kind, fault, trace)

    def write(
        self,
        image: ImageArray,
        t_s: float,
        report: EdgeReport | None,
        corners_px: FloatArray | None,
        pose: NoseCameraPose | None,
    ) -> None:
        """Send one frame (h, w, 3) BGR, its edges between corners (4, 2) px, and the pose that it was given."""
        send = self._stream
        send.set_time("time", duration=np.timedelta64(round(t_s * 1e9), "ns"))
        send.log("camera/image", rr.Image(image, color_model=rr.ColorModel.BGR).compress(jpeg_quality=_JPEG_QUALITY))
        strips = [] if corners_px is None else (corners_px.reshape(2, 2, 2) + _CORNER_FROM_CENTRE_PX).tolist()
        send.log("camera/image/edges", rr.LineStrips2D(strips, colors=[[90, 230, 90]]))
        send.log("status", rr.TextLog("no pose" if report is None else f"{report.status.value} {report.miss.value}"))
        if report is not None and report.edges is not None:
            send.log("threshold/edges", rr.LineStrips3D(self._ground(report.edges.state.mean), colors=[[90, 230, 90]]))
        if pose is not None:
            self._path.append(pose.camera_threshold_m)
            send.log("threshold/camera", rr.Points3D([pose.camera_threshold_m], radii=[-4.0]))
            send.log("threshold/path", rr.LineStrips3D([np.array(self._path)]))

    def _ground(self, mean: FloatArray) -> list[FloatArray]:
        """Return both lines on the ground, from the threshold to the far end."""
        along = np.array([-mean[B], mean[A], 0.0])
        normal = np.array([mean[A], mean[B], 0.0])
        return [np.array([-mean[k] * normal, -mean[k] * normal - self._length_m * along]) for k in (C, D)]
