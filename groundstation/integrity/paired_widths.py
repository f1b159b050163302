"""Widths of silhouettes in pairs of pictures, with the point that was triangulated from them."""

from collections.abc import Iterator
from dataclasses import dataclass

from groundstation.arrays import FloatArray
from groundstation.messages import CameraReport, Detection, StepReport, TriangulationStatus

# pictures that wait for the estimate of their pair
_MOST_WAITING = 64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairWidths:
    """Widths in px of a pair's silhouettes by station, two and more, and the point (3,), m, runway frame."""

    widths_px: dict[str, float]
    position_m: FloatArray


class PairedWidths:
    """Joins the widths of pictures to the estimate of their pair."""

    def __init__(self) -> None:
        self._waiting: dict[int, dict[str, float]] = {}

    def of(self, report: StepReport) -> Iterator[PairWidths]:
        """Yield the pairs that a step completes, of silhouettes that the filter used and no border cuts."""
        for camera in report.cameras:
            width_px = _width_px(camera)
            if width_px is not None:
                self._waiting.setdefault(camera.epoch, {})[camera.station] = width_px
        for estimate in report.estimates:
            widths = self._waiting.pop(estimate.epoch, {})
            point = estimate.triangulation
            if point is not None and estimate.triangulation_status is TriangulationStatus.OK and len(widths) > 1:
                yield PairWidths(widths_px=widths, position_m=point.point_runway_m)
        while len(self._waiting) > _MOST_WAITING:
            del self._waiting[next(iter(self._waiting))]


def _width_px(camera: CameraReport) -> float | None:
    """Return the width of a silhouette that the filter used and no border cuts."""
    found = camera.result
    used = isinstance(found, Detection) and camera.innovation is not None and camera.innovation.accepted
    if not used or not isinstance(found, Detection) or found.cut or found.box.w <= 0.0:
        return None
    return found.box.w
