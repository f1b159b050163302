"""Pictures of the target with its silhouette over the ranges of a run: a bounded number is kept, few are shown.

Ranges are divided into bins of equal ratio; of each bin the first pair is kept in which all cameras show the target.
Only then is a part of the picture copied, so a run costs a few dozen copies, however long it is.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection_messages import Detection
from groundstation.messages import CameraReport, StepReport, TrackEstimate, TrackStatus
from groundstation.picture import Picture

SHOWN_RANGES = 5
_BINS_PER_OCTAVE = 4
# nearer and farther targets share the first and the last bin
_NEAREST_M, _FARTHEST_M = 8.0, 16_000.0
# of the shown part: its width in widths of the silhouette, its least width, its shape
_WIDTHS, _LEAST_PX, _ASPECT = 1.8, 44, 4 / 3
# a wider part is kept in fewer pixels: a page shows it smaller than that
_MOST_PX = 400


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Silhouette:
    """The target in one picture.

    Attributes
    ----------
    station : the camera's.
    t_s : time of the exposure, session clock.
    range_m : from the station to the estimated position.
    part : the picture's part that is to be shown, px; it may extend beyond ``kept``.
    kept : the part of which there are pixels.
    pixels : (h, w, 3) BGR of ``kept``, reduced where it is large.
    detection : outline and target point in the whole picture.
    """

    station: str
    t_s: float
    range_m: float
    part: Box[int]
    kept: Box[int]
    pixels: ImageArray
    detection: Detection


class SilhouetteCollector:
    """A sink that keeps pictures of the tracked target, one pair for each bin of range.

    ``places_runway_m`` are the stations' positions (3,) by name. Frames without a picture are passed over.
    """

    def __init__(self, places_runway_m: Mapping[str, FloatArray]) -> None:
        self._places = dict(places_runway_m)
        self._waiting: dict[str, CameraReport] = {}
        self._kept: dict[int, tuple[Silhouette, ...]] = {}

    def write(self, report: StepReport) -> None:
        """Keep the pictures of a pair whose range is new; a pair's frames come before its estimate."""
        for camera in report.cameras:
            if camera.image is not None:
                self._waiting[camera.station] = camera
        for estimate in report.estimates:
            self._take(estimate)

    def close(self) -> None:
        """Let go of the pictures that wait for an estimate."""
        self._waiting.clear()

    def shown(self) -> tuple[tuple[Silhouette, ...], ...]:
        """Return at most `SHOWN_RANGES` pairs from far to near, evenly spread over the logarithm of the range."""
        bins = sorted(self._kept, reverse=True)
        if len(bins) > SHOWN_RANGES:
            wanted = np.linspace(bins[0], bins[-1], SHOWN_RANGES)
            nearest = [min(bins, key=lambda k: abs(k - place)) for place in wanted]
            bins = sorted(set(nearest), reverse=True)
        return tuple(self._kept[k] for k in bins)

    def _take(self, estimate: TrackEstimate) -> None:
        """Keep the frames of a tracked pair where its bin has none, or fewer."""
        if estimate.status is not TrackStatus.TRACKING or estimate.kinematics is None:
            return
        place = estimate.kinematics.position_runway_m
        frames = [c for c in self._waiting.values() if c.epoch == estimate.epoch and _seen(c)]
        if not frames or not np.isfinite(place).all():
            return
        ranges_m = [float(np.linalg.norm(place - self._places[c.station])) for c in frames]
        which = _bin_of(min(ranges_m))
        if len(frames) > len(self._kept.get(which, ())):
            found = [_silhouette(c, range_m) for c, range_m in zip(frames, ranges_m, strict=True)]
            self._kept[which] = tuple(silhouette for silhouette in found if silhouette is not None)


def _seen(camera: CameraReport) -> bool:
    """Return whether the filter used a silhouette of this frame."""
    return camera.status.used and isinstance(camera.result, Detection) and len(camera.result.contour_px) > 0


def _bin_of(range_m: float) -> int:
    """Return the number of a range's bin."""
    return math.floor(_BINS_PER_OCTAVE * math.log2(min(max(range_m, _NEAREST_M), _FARTHEST_M)))


def _silhouette(camera: CameraReport, range_m: float) -> Silhouette | None:
    """Copy the part of a frame around its silhouette; None where none of its pixels are there."""
    found, image = camera.result, camera.image
    if not isinstance(found, Detection) or image is None:
        return None
    part = _part_around(found.box)
    kept = image.available(part)
    if kept is None:
        return None
    return Silhouette(
        station=camera.station,
        t_s=camera.t_s,
        range_m=range_m,
        part=part,
        kept=kept,
        pixels=_reduced(image, kept),
        detection=found,
    )


def _part_around(box: Box[float]) -> Box[int]:
    """Return the part of a picture to be shown around a silhouette's box."""
    half_w = 0.5 * max(_WIDTHS * max(box.w, _ASPECT * box.h), float(_LEAST_PX))
    half_h = half_w / _ASPECT
    u, v = 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)
    return Box(round(u - half_w), round(v - half_h), round(u + half_w), round(v + half_h))


def _reduced(image: Picture, kept: Box[int]) -> ImageArray:
    """Return a copy of a window of a picture in at most `_MOST_PX` columns."""
    pixels = image.preview_of(kept)
    if kept.w <= _MOST_PX:
        return pixels.copy()
    size = (_MOST_PX, max(round(kept.h * _MOST_PX / kept.w), 1))
    reduced: NDArray[np.uint8] = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    return reduced
