"""Guided search: where in one camera's picture an aircraft may be that another camera shows.

The ray of a candidate is a line in another camera's picture, its epipolar line. The candidate's width limits how far
away an aircraft can be, and with that the part of the line: as many target widths as the cameras are spans apart. It
also gives the width to expect there. Looking along it takes far fewer windows than a search of the whole picture.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.geometry.station import LensError, Ray, StationGeometry

# candidates of the learned channel that guide the others: less likely an aircraft than not is no guide
_LEAST_ODDS = 0.0
# guides of a frame, of so many candidates: the line of each takes half a millisecond. Next to a guide whose log odds
# are larger by so much another one only takes its windows
_GUIDES, _MOST_CANDIDATES, _FAR_LIKELIER = 2, 6, 2.0
# older candidates say little on where the aircraft is now: two frames of the slowest cameras in use
_NEWEST_S = 0.25
# spans, m: the widths of the bank's airframes, 1.2 to 6 m, and a fuselage alone, which is seen a third as wide
_SPANS_M = (0.5, 6.5)
# a given span, seen from an angle, or of which a window shows a part
_GIVEN_SPAN_RANGE = (0.35, 1.15)
# places along the line are so far apart, target widths: a window shows what is within 1.4 of them of its middle
_STEP_WIDTHS = 1.2
# windows of a frame that are spent on them, and steps to each side of the usual span
_PLACES, _MOST_STEPS = 2, 60
# a camera that shows a candidate so near to a place, in target widths, of about that width and about as likely, needs
# no guide to it; nor does one at another width, which is the same object
_NEAR, _WIDER, _LESS_LIKELY = 0.8, 1.6, 1.0
# so far away the camera's own movement with its head is nothing
_FAR_M = 1e5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuidedPlace:
    """A place (2,) of a picture, px, and how wide a target would be there, px."""

    pixel: FloatArray
    width_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _View:
    """A camera's geometry at pan and tilt, rad."""

    geometry: StationGeometry
    pan_rad: float
    tilt_rad: float


class GuidedSearch:
    """The likely candidates of each camera, and where they would be in the others.

    Parameters
    ----------
    stations : geometries by name.
    config : limits of range and height.
    span_m : the target's wing span, None if unknown.
    """

    def __init__(self, stations: Mapping[str, StationGeometry], config: InitiationConfig, span_m: float | None) -> None:
        self._stations, self._config = stations, config
        low, high = _SPANS_M if span_m is None else (span_m * share for share in _GIVEN_SPAN_RANGE)
        self._spans_m = float(low), float(high)
        self._usual_m = min(max(config.usual_span_m if span_m is None else span_m, low), high)
        self._likely: dict[str, list[CameraCandidate]] = {}
        self._turns: dict[str, int] = {}

    def reset(self) -> None:
        """Discard the candidates."""
        self._likely.clear()
        self._turns.clear()

    def add(self, station: str, candidates: Sequence[CameraCandidate]) -> None:
        """Take the candidates of a camera's newest frame in place of those before."""
        likely = [c for c in candidates if c.odds is not None and c.odds > _LEAST_ODDS and c.width_px]
        self._likely[station] = sorted(likely, key=lambda c: -(c.odds or 0.0))

    def places(self, station: str, t_s: float, pan_rad: float, tilt_rad: float) -> list[GuidedPlace]:
        """Return some places of a camera's picture at these angles, the next ones in turn, usual spans first.

        The turn goes on when a guide changes, and begins again after a frame without any.
        """
        view = _View(geometry=self._stations[station], pan_rad=pan_rad, tilt_rad=tilt_rad)
        recent = [c for c in self._likely.get(station, []) if abs(t_s - c.t_s) <= _NEWEST_S]
        own = [now for c in recent if (now := _at_angles(c, view)) is not None]
        lines: list[list[tuple[float, GuidedPlace]]] = []
        least = -math.inf
        for guide in self._guides_of(station, t_s)[:_MOST_CANDIDATES]:
            if (guide.odds or 0.0) < least:
                break
            line = list(self._along(guide, view))
            if line and not any(_is_known(guide, place, own) for _, place in line):
                lines.append(line)
                least = max(least, (guide.odds or 0.0) - _FAR_LIKELIER)
            if len(lines) == _GUIDES:
                break
        found = [
            place
            for _, place in sorted(chain.from_iterable(lines), key=lambda each: abs(math.log(each[0] / self._usual_m)))
        ]
        if not found:
            self._turns.pop(station, None)
            return []
        turn = self._turns.get(station, 0)
        self._turns[station] = turn + _PLACES
        return [found[(turn + k) % len(found)] for k in range(min(_PLACES, len(found)))]

    def _guides_of(self, station: str, t_s: float) -> list[CameraCandidate]:
        """Return the candidates of other cameras, the likeliest first, of several at one place only that."""
        others = [c for name, likely in self._likely.items() if name != station for c in likely]
        chosen: list[CameraCandidate] = []
        for c in sorted(others, key=lambda c: -(c.odds or 0.0)):
            if abs(t_s - c.t_s) <= _NEWEST_S and not any(_is_one(c, d) for d in chosen):
                chosen.append(c)
        return chosen

    def _along(self, guide: CameraCandidate, view: _View) -> Iterator[tuple[float, GuidedPlace]]:
        """Yield the places of a candidate's epipolar line that are in the picture, each with the span there, m."""
        station = self._stations[guide.station]
        try:
            ray = station.ray(guide.pixel[0], guide.pixel[1], guide.pan_rad, guide.tilt_rad)
        except LensError:
            return
        c, range_per_span = self._config, float(station.lens.focal_px[0]) / max(guide.width_px or 0.0, 1.0)
        low, high = np.clip(self._spans_m, c.min_range_m / range_per_span, c.max_range_m / range_per_span)
        usual = min(max(self._usual_m, float(low)), float(high))
        for end, is_first in ((float(high), True), (float(low), False)):
            for span_m, place in _walk(ray, range_per_span, usual, end, view):
                height_m = float((ray.origin_runway_m + span_m * range_per_span * ray.direction_runway)[2])
                # both ways begin at the usual span
                is_new = is_first or span_m != usual
                if is_new and c.min_height_m <= height_m <= c.max_height_m:
                    yield span_m, place


def _walk(
    ray: Ray, range_per_span: float, first_m: float, last_m: float, view: _View
) -> Iterator[tuple[float, GuidedPlace]]:
    """Yield the places in a picture from one span to another along a ray, a step from each other."""
    span_m, entered, size = first_m, False, view.geometry.image_size_px
    for _ in range(_MOST_STEPS):
        range_m = span_m * range_per_span
        place, per_range_px = _place(ray, range_m, span_m, view)
        outside_px = math.inf if place is None else _outside_px(place.pixel, size)
        if place is not None and outside_px == 0.0:
            yield span_m, place
            entered = True
        elif entered and place is not None and outside_px > _STEP_WIDTHS * place.width_px:
            return
        if span_m == last_m:
            return
        growth = 0.5
        if place is not None:
            # out of the picture a step is longer, if not so long that it crosses it
            step_px = max(_STEP_WIDTHS * place.width_px, 0.8 * outside_px)
            growth = min(step_px / max(per_range_px, 1e-9), growth)
        span_m = min(span_m * (1.0 + growth), last_m) if last_m > first_m else max(span_m / (1.0 + growth), last_m)


def _place(ray: Ray, range_m: float, span_m: float, view: _View) -> tuple[GuidedPlace | None, float]:
    """Return where a point of a ray is in a camera, None behind it, and how far it moves as its range doubles, px."""
    at, size = range_m * ray.direction_runway, span_m * float(view.geometry.lens.focal_px[0])
    here = view.geometry.project(ray.origin_runway_m + at, view.pan_rad, view.tilt_rad)
    beyond = view.geometry.project(ray.origin_runway_m + 1.02 * at, view.pan_rad, view.tilt_rad)
    if here is None or beyond is None:
        return None, 0.0
    moved_px = float(np.hypot(*(beyond.pixel - here.pixel))) / 0.02
    return GuidedPlace(pixel=here.pixel, width_px=size / here.depth_m), moved_px


def _outside_px(pixel: FloatArray, size_px: tuple[int, int]) -> float:
    """Return how far a point (2,) is out of a picture (w, h), 0 inside."""
    beyond = np.maximum(np.maximum(-0.5 - pixel, pixel - (np.array(size_px) - 0.5)), 0.0)
    return float(np.hypot(*beyond))


def _at_angles(c: CameraCandidate, view: _View) -> CameraCandidate | None:
    """Return a candidate where it is in a view of its camera at other angles; None where it is not in front of it."""
    try:
        ray = view.geometry.ray(c.pixel[0], c.pixel[1], c.pan_rad, c.tilt_rad)
    except LensError:
        return None
    seen = view.geometry.project(ray.origin_runway_m + _FAR_M * ray.direction_runway, view.pan_rad, view.tilt_rad)
    return None if seen is None else replace(c, pixel=seen.pixel)


def _is_known(guide: CameraCandidate, place: GuidedPlace, own: Sequence[CameraCandidate]) -> bool:
    """Return whether a camera shows at a guided place what the guide may be."""
    for c in own:
        near = math.hypot(*(c.pixel - place.pixel)) <= _NEAR * place.width_px
        alike = max(c.width_px or 0.0, place.width_px) <= _WIDER * min(c.width_px or 0.0, place.width_px)
        if near and alike and (c.odds or 0.0) >= (guide.odds or 0.0) - _LESS_LIKELY:
            return True
    return False


def _is_one(c: CameraCandidate, likelier: CameraCandidate) -> bool:
    """Return whether two candidates of one camera are the same object, at whatever widths."""
    reach_px = 0.5 * max(c.width_px or 0.0, likelier.width_px or 0.0)
    return c.station == likelier.station and math.hypot(*(c.pixel - likelier.pixel)) <= reach_px
