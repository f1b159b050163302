"""Result of the single-camera tracker for one frame."""

from dataclasses import dataclass, replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.box import Box, box_of_size
from groundstation.messages import Detection, Miss, TrackStatus


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelTrack:
    """State of the track after one frame.

    Attributes
    ----------
    t_s : the frame's time.
    status : ``tracking`` where ``result`` is a detection, ``coasting`` where a target is predicted but not detected.
    result : the detection in this frame, or the miss with its reason.
    roi : the searched window, None if the whole frame was searched.
    predicted_px : (2,) the prediction, None without one.
    """

    t_s: float
    status: TrackStatus
    result: Detection | Miss
    roi: Box[int] | None
    predicted_px: FloatArray | None


def in_full(track: PixelTrack, scale: int) -> PixelTrack:
    """Return a track of the working picture in px of the full one."""
    if scale == 1:
        return track
    offset = 0.5 * (scale - 1)
    roi, result, predicted = track.roi, track.result, track.predicted_px
    if roi is not None:
        roi = box_of_size(roi.x0 // scale, roi.y0 // scale, max(roi.w // scale, 1), max(roi.h // scale, 1))
    if isinstance(result, Detection):
        x, y = (result.box.x0 + 0.5) / scale - 0.5, (result.box.y0 + 0.5) / scale - 0.5
        result = replace(
            result,
            u_px=(result.u_px - offset) / scale,
            v_px=(result.v_px - offset) / scale,
            covariance_px2=result.covariance_px2 / scale**2,
            noise_px2=result.noise_px2 / scale**2,
            centroid_px=(result.centroid_px - offset) / scale,
            box=box_of_size(x, y, result.box.w / scale, result.box.h / scale),
            area_px=result.area_px / scale**2,
            contour_px=((result.contour_px - offset) / scale).astype(np.float32),
        )
    if predicted is not None:
        predicted = (predicted - offset) / scale
    return replace(track, roi=roi, result=result, predicted_px=predicted)
