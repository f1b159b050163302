"""The wing span that a track's silhouettes have at its range, against the one that was given.

A wrong baseline, a pan angle that is off or a wrong span leave pixels, angles and rays in agreement: range and size are
wrong together. An aircraft's silhouette is about as wide as its span from ahead, less in a turn, and at most a quarter
wider than the span, from the side; of one that is half hidden or found in part it is narrower.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.paired_widths import PairedWidths
from groundstation.messages import StepReport

_LEAST_EPOCHS, _MOST_WIDTHS = 30, 400
# of the given span: wider than any view of the longest delta's fuselage by a quarter; narrower than a fuselage found
# alone, whose width is 0.09 to 0.3 spans from ahead
_WIDEST, _NARROWEST = 1.6, 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class SpanFault:
    """Silhouettes as wide as ``seen_m`` in the median of ``count``, of an aircraft whose span is ``given_m``."""

    seen_m: float
    given_m: float
    count: int

    def line(self) -> str:
        """Return the fault as a line for people."""
        return (
            f"at the track's range the aircraft's silhouettes are {self.seen_m:.2g} m wide (median of {self.count}) "
            f"and its span is given as {self.given_m:.3g} m: span, baseline, focal length or angles are wrong"
        )


class ApparentSpanMonitor:
    """Collects widths of silhouettes of a run, and compares them with the span at its end.

    ``stations`` are all stations of the rig by name; ``span_m`` is the given span, None where there is none.
    """

    def __init__(self, stations: Mapping[str, StationGeometry], span_m: float | None) -> None:
        self._eyes = {name: s.camera_pose(0.0, 0.0).position_runway_m for name, s in stations.items()}
        self._focal_px = {name: float(s.lens.focal_px[0]) for name, s in stations.items()}
        self._span_m = span_m
        self._pairs = PairedWidths()
        self._spans_m: list[float] = []
        self._every = self._seen = 1

    def add(self, report: StepReport) -> None:
        """Take widths, and the ranges of the pairs that they are of."""
        if self._span_m is None:
            return
        for pair in self._pairs.of(report):
            self._add(pair.widths_px, pair.position_m)

    def _add(self, widths_px: Mapping[str, float], position_m: FloatArray) -> None:
        self._seen += 1
        if self._seen % self._every:
            return
        spans = [
            w * float(np.linalg.norm(position_m - self._eyes[n])) / self._focal_px[n] for n, w in widths_px.items()
        ]
        # the camera that shows most of it
        self._spans_m.append(max(spans))
        if len(self._spans_m) >= _MOST_WIDTHS:
            del self._spans_m[::2]
            self._every *= 2

    def fault(self) -> SpanFault | None:
        """Return the fault; None where the silhouettes can be of such an aircraft, or are too few to tell."""
        if self._span_m is None or len(self._spans_m) < _LEAST_EPOCHS:
            return None
        seen_m = float(np.median(self._spans_m))
        if _NARROWEST * self._span_m <= seen_m <= _WIDEST * self._span_m:
            return None
        return SpanFault(seen_m=seen_m, given_m=self._span_m, count=len(self._spans_m))
