"""The track of one camera, live in Rerun: the picture with what is drawn over it, and its status."""

from types import TracebackType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.detection.pixel_track import PixelTrack
from groundstation.messages import Detection, TrackStatus
from groundstation.viewer import entity_paths
from groundstation.viewer.columns import CORNER_FROM_CENTRE_PX, outline_pieces

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
        for entity, colour in (("roi", entity_paths.ROI_COLOUR), ("contour", entity_paths.CONTOUR_COLOUR)):
            style = rr.Boxes2D if entity == "roi" else rr.LineStrips2D
            stream.log(f"{PICTURE}/{entity}", style.from_fields(colors=[colour]), static=True)
        stream.log(f"{PICTURE}/box", rr.Boxes2D.from_fields(colors=[entity_paths.EKF_COLOUR]), static=True)
        stream.log(
            f"{PICTURE}/target", rr.Points2D.from_fields(colors=[entity_paths.TARGET_COLOUR], radii=[-4.0]), static=True
        )

    def __enter__(self) -> "LiveTrackView":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._stream.disconnect()

    def write(self, image: ImageArray, track: PixelTrack) -> None:
        """Send one frame (h, w, 3) BGR and its track."""
        send = self._stream
        send.set_time(entity_paths.TIMELINE, duration=np.timedelta64(round(track.t_s * 1e9), "ns"))
        picture = rr.Image(image, color_model=rr.ColorModel.BGR).compress(jpeg_quality=_JPEG_QUALITY)
        send.log(PICTURE, picture)
        found = track.result if isinstance(track.result, Detection) else None
        # an entity without elements clears what was drawn before
        strips = [] if found is None else outline_pieces(found.contour_px)
        points = [] if found is None else [(found.u_px + CORNER_FROM_CENTRE_PX, found.v_px + CORNER_FROM_CENTRE_PX)]
        send.log(f"{PICTURE}/roi", _boxes(track.roi))
        send.log(f"{PICTURE}/box", _boxes(None if found is None else found.box, CORNER_FROM_CENTRE_PX))
        send.log(f"{PICTURE}/contour", rr.LineStrips2D.from_fields(strips=strips))
        send.log(f"{PICTURE}/target", rr.Points2D.from_fields(positions=points))
        if track.status is not self._status:
            self._status = track.status
            level = "INFO" if track.status in _GOOD else "WARN"
            send.log(STATUS, rr.TextLog(track.status.value, level=level))


def _boxes(box: Box[int] | Box[float] | None, offset_px: float = 0.0) -> rr.Boxes2D:
    """Return one box, or none."""
    if box is None:
        return rr.Boxes2D.from_fields(centers=[], half_sizes=[])
    w, h = box.size
    centre = (box.x0 + 0.5 * w + offset_px, box.y0 + 0.5 * h + offset_px)
    return rr.Boxes2D.from_fields(centers=[centre], half_sizes=[(0.5 * w, 0.5 * h)])
