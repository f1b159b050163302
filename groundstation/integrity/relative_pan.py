"""A pan angle that is off while two stations' rays still meet, by how the aircraft's width changes with the range.

With the heads' pan angles off by δ against each other the parallax gives 1/r = 1/R + δ/b in place of 1/R, with b the
baseline across the line of sight. An aircraft of a constant span S looks S/R wide, which is S (1/r − δ/b): over a
flight a regression of the width on 1/r and 1/b gives S and δ. A wrong baseline, focal length or span changes S alone.
An aircraft that turns, or is found in part, changes its width by itself: one whose direction to the line of sight
changes is left alone, and so are widths that do not follow the line. Wing tips that fade, some pixels at each range,
are of the same form: a pan is named only where a span was given that the widths contradict as stored, far where they
are too narrow, and agree with once the fault is removed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.paired_widths import PairedWidths, PairWidths
from groundstation.messages import StepReport

_LEAST_PAIRS, _MOST_PAIRS = 60, 400
# nearest and farthest tenth of the ranges
_LEAST_RATIO = 1.5
# of the widths about the line, as a share; found silhouettes of one aspect scatter by 0.02
_MOST_SCATTER = 0.04
# ranges that are off by less are not named
_LEAST_FACTOR = 1.35
# errors of neighbouring pairs are one: of so many pairs one counts
_CORRELATED_PAIRS = 10.0
_SIGMAS = 3.0
_ROUNDS = 4
# of the given span: what contradicts it as stored (too narrow is what faded tips are, too), and what agrees
_NARROWEST, _WIDEST, _AGREES = 0.6, 1.25, 0.15
# the direction of flight to the line of sight may change by so much along a flight, by the means of so many parts of it
_MOST_TURN_RAD = math.radians(20.0)
_PARTS = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class PanFault:
    """Pan angles off by ``pan_rad`` against each other: true ranges are ``factor`` times those of the track."""

    stations: tuple[str, str]
    pan_rad: float
    factor: float

    def line(self) -> str:
        """Return the fault as a line for people."""
        one, other = self.stations
        too = "short" if self.factor > 1.0 else "long"
        share = abs(1.0 - 1.0 / self.factor)
        return (
            "the aircraft's width does not change with its range as that of one aircraft does: the directions of "
            f"{one} and {other} look off by {abs(math.degrees(self.pan_rad)):.1f} deg against each other, "
            f"which makes ranges {100.0 * share:.0f} % too {too}: survey them again"
        )


class RelativePanMonitor:
    """Collects widths and ranges of a run's pairs, and looks for a relative pan at its end.

    ``stations`` are all stations of the rig by name; of more than two a wrong pan shows in their rays.
    ``span_m`` is the given span; None where there is none, and nothing is named.
    """

    def __init__(self, stations: Mapping[str, StationGeometry], span_m: float | None) -> None:
        self._span_m = span_m
        self._eyes = {name: s.camera_pose(0.0, 0.0).position_runway_m for name, s in stations.items()}
        self._focal_px = {name: float(s.lens.focal_px[0]) for name, s in stations.items()}
        self._pairs = PairedWidths()
        self._rows: list[tuple[float, float, float]] = []
        self._places_m: list[FloatArray] = []
        self._every = self._seen = 1

    def add(self, report: StepReport) -> None:
        """Take widths, and the points of the pairs that they are of."""
        if len(self._eyes) != 2 or self._span_m is None:
            return
        for pair in self._pairs.of(report):
            self._add(pair)

    def _add(self, pair: PairWidths) -> None:
        self._seen += 1
        if self._seen % self._every:
            return
        one, other = (self._eyes[name] for name in self._eyes)
        sight = pair.position_m - (one + other) / 2.0
        range_m = float(np.linalg.norm(sight))
        across_m = float(np.linalg.norm(np.cross(other - one, sight / range_m)))
        # the camera that shows most of it
        width = max(w / self._focal_px[name] for name, w in pair.widths_px.items())
        self._rows.append((1.0 / range_m, 1.0 / across_m, width))
        self._places_m.append(sight[:2])
        if len(self._rows) >= _MOST_PAIRS:
            del self._rows[::2], self._places_m[::2]
            self._every *= 2

    def fault(self) -> PanFault | None:
        """Return the fault; None where widths and ranges agree, or say too little."""
        if self._span_m is None or len(self._rows) < _LEAST_PAIRS:
            return None
        inverse, across, width = np.array(self._rows).T
        near, far = np.quantile(inverse, [0.9, 0.1])
        if near < _LEAST_RATIO * far or _turn_rad(np.array(self._places_m)) > _MOST_TURN_RAD:
            return None
        fit = _fit(np.column_stack([inverse, across]) / width[:, None])
        if fit is None:
            return None
        pan_rad, sigma_rad, span_m = fit
        stored = float(np.median(width / inverse)) / self._span_m
        if _NARROWEST <= stored <= _WIDEST or abs(span_m / self._span_m - 1.0) > _AGREES:
            return None
        middle, across_middle = float(np.median(inverse)), float(np.median(across))
        # named where even the least pan that the widths allow makes so much of a difference
        least_rad = math.copysign(max(abs(pan_rad) - _SIGMAS * sigma_rad, 0.0), pan_rad)
        true, least_true = (middle - pan * across_middle for pan in (pan_rad, least_rad))
        if true <= 0.0 or 1.0 / _LEAST_FACTOR < middle / least_true < _LEAST_FACTOR:
            return None
        first, second = self._eyes
        return PanFault(stations=(first, second), pan_rad=pan_rad, factor=middle / true)


def _turn_rad(places_m: FloatArray) -> float:
    """Return by how much the direction of flight to the line of sight changes along places (n, 2), rad.

    Wrong ranges along constant bearings leave it as it is.
    """
    means = np.array([part.mean(axis=0) for part in np.array_split(places_m, _PARTS)])
    flown, sight = np.diff(means, axis=0), (means[1:] + means[:-1]) / 2.0
    angles = np.arctan2(flown[:, 1], flown[:, 0]) - np.arctan2(sight[:, 1], sight[:, 0])
    return float(np.ptp(np.unwrap(angles)))


def _fit(terms: FloatArray) -> tuple[float, float, float] | None:
    """Return pan and one sigma, rad, and the span, m, from rows (n, 2) of 1/r and 1/b over the width.

    None where widths scatter.
    """
    kept = np.ones(len(terms), dtype=np.bool_)
    solved: FloatArray = np.zeros(2)
    scatter = math.inf
    for _ in range(_ROUNDS):
        solved = np.asarray(np.linalg.lstsq(terms[kept], np.ones(int(kept.sum())), rcond=None)[0], np.float64)
        residual = terms @ solved - 1.0
        scatter = 1.4826 * float(np.median(np.abs(residual)))
        kept = np.abs(residual) <= 3.0 * max(scatter, 1e-6)
    if scatter > _MOST_SCATTER or solved[0] <= 0.0 or kept.sum() < 0.7 * len(terms):
        return None
    covariance = np.linalg.pinv(terms[kept].T @ terms[kept]) * max(scatter, 1e-6) ** 2 * _CORRELATED_PAIRS
    pan = float(-solved[1] / solved[0])
    by = np.array([-pan, -1.0]) / solved[0]
    return pan, float(np.sqrt(by @ covariance @ by)), float(solved[0])
