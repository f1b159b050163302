"""The track of one camera, live in Rerun: the picture with what is drawn over it, and its status."""

from types import TracebackType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from groundstation.arrays import ImageArray
from groundstation.detection.pixel_track import PixelTrack
from groundstation.messages import Detection, TrackStatus
from groundstation.sinks import rerun_tree as tree
from groundstation.sinks.rerun_columns import CORNER_FROM_CENTRE_PX, outline_pieces

APPLICATION = "groundstation"
PICTURE = "camera/image"
STATUS = "status/track"
_JPEG_QUALITY = 80
_GOOD = (TrackStatus.TRACKING, TrackStatus.ACQUIRING)


class LiveTrackView:
    """Sends frames and what was found in them to a Rerun recording as they come.

    Parameters
    ----------
    stream : where to send them; it is closed at the end.
    name : the recording's title.
    """

    def __init__(self, stream: rr.RecordingStream, name: str) -> None:
        self._stream = stream
        self._status: TrackStatus | None = None
        stream.send_recording_name(name)
        stream.send_blueprint(
            rrb.Blueprint(
                rrb.Vertical(
                    rrb.Spatial2DView(origin=PICTURE, name="camera"),
                    rrb.TextLogView(origin=STATUS, name="status"),
                    row_shares=[5, 1],
                ),
                collapse_panels=True,
            )
        )
        for entity, colour in (("roi", tree.ROI_COLOUR), ("contour", tree.CONTOUR_COLOUR)):
            style = rr.Boxes2D if entity == "roi" else rr.LineStrips2D
            stream.log(f"{PICTURE}/{entity}", style.from_fields(colors=[colour]), static=True)
        stream.log(f"{PICTURE}/box", rr.Boxes2D.from_fields(colors=[tree.EKF_COLOUR]), static=True)
        stream.log(f"{PICTURE}/target", rr.Points2D.from_fields(colors=[tree.TARGET_COLOUR], radii=[-4.0]), static=True)

    def __enter__(self) -> "LiveTrackView":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._stream.disconnect()

    def write(self, image: ImageArray, track: PixelTrack) -> None:
        """Send one frame (h, w, 3) BGR and its track."""
        send = self._stream
        send.set_time(tree.TIMELINE, duration=np.timedelta64(round(track.t_s * 1e9), "ns"))
        picture = rr.Image(image, color_model=rr.ColorModel.BGR).compress(jpeg_quality=_JPEG_QUALITY)
        send.log(PICTURE, picture)
        roi, found = track.roi, track.result
        if roi is None:
            send.log(f"{PICTURE}/roi", rr.Clear(recursive=False))
        else:
            send.log(f"{PICTURE}/roi", _box(roi.x, roi.y, roi.w, roi.h))
        if isinstance(found, Detection):
            x, y, w, h = found.box
            send.log(f"{PICTURE}/box", _box(x + CORNER_FROM_CENTRE_PX, y + CORNER_FROM_CENTRE_PX, w, h))
            send.log(f"{PICTURE}/contour", rr.LineStrips2D.from_fields(strips=outline_pieces(found.contour_px)))
            point = np.array([[found.u_px, found.v_px]]) + CORNER_FROM_CENTRE_PX
            send.log(f"{PICTURE}/target", rr.Points2D.from_fields(positions=point))
        else:
            for entity in ("box", "contour", "target"):
                send.log(f"{PICTURE}/{entity}", rr.Clear(recursive=False))
        if track.status is not self._status:
            self._status = track.status
            level = "INFO" if track.status in _GOOD else "WARN"
            send.log(STATUS, rr.TextLog(track.status.value, level=level))


def _box(x: float, y: float, w: float, h: float) -> rr.Boxes2D:
    return rr.Boxes2D.from_fields(centers=[(x + 0.5 * w, y + 0.5 * h)], half_sizes=[(0.5 * w, 0.5 * h)])
