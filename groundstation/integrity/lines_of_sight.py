"""Where the cameras of a run look, by the rig and the heads' angles: what to say of a run that found nothing.

A rig whose quaternions are in another order, places with axes in another order, and angles from another zero leave the
pictures' motion as it is and turn the cameras elsewhere: to the zenith, behind the runway, along the line between
the stations. No pixels are needed to see that, and where there is a reference, it tells how far off it is.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Event, PtuSample

# a look at each head so often is enough for medians; of a long run every second is dropped
_EVERY_S, _MOST_LOOKS = 0.2, 1000
# between two cameras' directions, off the line between their stations, above the horizon: beyond these it is told
_APART_DEG, _ALONG_DEG, _HIGHEST_DEG, _LOWEST_DEG = 60.0, 15.0, 60.0, -30.0
# a reference is out of the pictures from so far outside of their corners on: clocks may differ by seconds
_OUTSIDE_DEG = 10.0
_LEAST_COMMON = 5
# an aircraft is told to have been in the pictures for so much of the time
_LEAST_SEEN = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPositions:
    """Positions (n, 3) of the aircraft at times (n,) s of the session, called ``name`` in a message."""

    name: str
    t_s: FloatArray
    position_m: FloatArray


class LinesOfSight:
    """Collects where each camera looks during a run.

    Parameters
    ----------
    stations : all stations of the rig by name.
    turning : names of those that turn: without a reading nothing is known of them.
    """

    def __init__(self, stations: Mapping[str, StationGeometry], turning: Iterable[str] = ()) -> None:
        self._stations, self._turning = dict(stations), frozenset(turning)
        self._looks: dict[str, list[tuple[float, float, float]]] = {name: [] for name in stations}
        self._every_s = dict.fromkeys(stations, _EVERY_S)

    def watched(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events, and take the readings from them."""
        for event in events:
            if isinstance(event, PtuSample) and event.station in self._looks:
                self._add(event)
            yield event

    def _add(self, sample: PtuSample) -> None:
        looks = self._looks[sample.station]
        if looks and sample.t_s < looks[-1][0] + self._every_s[sample.station]:
            return
        looks.append((sample.t_s, sample.pan_rad, sample.tilt_rad))
        if len(looks) >= _MOST_LOOKS:
            del looks[::2]
            self._every_s[sample.station] *= 2.0

    def line(self, references: Iterable[KnownPositions] = ()) -> str | None:
        """Return in a line where the cameras look, if that is no way to see an aircraft land; None if it is."""
        known = [name for name in self._stations if self._looks[name] or name not in self._turning]
        axes = {name: self._axes(name) for name in known}
        middles = {name: _mean_direction(axis) for name, (_, axis) in axes.items()}
        told = list(self._apart(middles))
        if len(known) == len(self._stations):
            told += [line for of in references for line in self._outside(axes, of)]
        steep = any(not _LOWEST_DEG <= _elevation_deg(axis) <= _HIGHEST_DEG for axis in middles.values())
        if not told and not steep:
            return None
        where = ", ".join(f"{name} {_direction_words(axis)}" for name, axis in middles.items())
        return "; ".join([f"by rig and angles the cameras look: {where} (on average)", *told])

    def _axes(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the times (n,) of a station's looks, and the unit directions (n, 3) of its optical axis."""
        looks = np.array(self._looks[name] or [(math.nan, 0.0, 0.0)])
        poses = [self._stations[name].camera_pose(pan, tilt).runway_from_camera for _, pan, tilt in looks]
        return looks[:, 0], np.array([pose[:, 2] for pose in poses])

    def _apart(self, middles: Mapping[str, FloatArray]) -> Iterator[str]:
        """Yield a line on each pair of stations that look into different directions, or along the line between them."""
        for a, b in itertools.combinations(middles, 2):
            apart_deg = _angle_deg(middles[a], middles[b])
            between = self._eye(b) - self._eye(a)
            if apart_deg > _APART_DEG:
                yield f"{a} and {b} look {apart_deg:.0f}° apart"
            elif np.linalg.norm(between) > 0.0:
                off_deg = _angle_deg(middles[a] + middles[b], between)
                if min(off_deg, 180.0 - off_deg) < _ALONG_DEG:
                    yield f"{a} and {b} stand one behind the other in that direction, from which no range follows"

    def _outside(self, axes: Mapping[str, tuple[FloatArray, FloatArray]], known: KnownPositions) -> Iterator[str]:
        """Yield a line if the known positions are out of the pictures of all stations."""
        off_deg = {}
        for name in axes:
            seen = self._seen_from(name, axes[name], known)
            if seen is None:
                return
            off = float(np.median(seen.off_deg))
            if off <= self._half_field_deg(name) + _OUTSIDE_DEG:
                return
            off_deg[name] = off
        words = " and ".join(f"{off:.0f}° off {name}'s" for name, off in off_deg.items())
        yield f"{known.name} has the aircraft {words} (median), in no picture: rig, angles, or that are wrong"

    def in_pictures(self, references: Iterable[KnownPositions], span_m: float | None) -> str | None:
        """Return in a line that by a reference two cameras had the aircraft in their pictures; None if they had not.

        For a run that has tracked none. ``span_m`` is the wing span, None where it is not known.
        """
        for known in references:
            seen = {}
            for name in self._stations:
                if not self._looks[name] and name in self._turning:
                    continue
                found = self._seen_from(name, self._axes(name), known)
                if found is not None and np.mean(found.off_deg < self._inner_field_deg(name)) > _LEAST_SEEN:
                    seen[name] = found
            if len(seen) > 1:
                words = " and ".join(f"{name} ({self._size_words(name, of, span_m)})" for name, of in seen.items())
                return (
                    f"no target was tracked, though {known.name} has the aircraft in the pictures of {words}: "
                    "are lens, angles, clocks and places right?"
                )
        return None

    def _size_words(self, name: str, seen: "_SeenFrom", span_m: float | None) -> str:
        distance_m = float(np.median(seen.distance_m))
        words = f"at {distance_m:.0f} m"
        if span_m is None:
            return words
        width_px = span_m / distance_m * float(self._stations[name].lens.focal_px[0])
        return f"{words}, up to {width_px:.0f} px wide"

    def _seen_from(self, name: str, axes: tuple[FloatArray, FloatArray], known: KnownPositions) -> "_SeenFrom | None":
        """Return where known positions are for a station while it looks; None where they have no time in common."""
        t_s, axis = axes
        # a fixed station looks the same way all the time
        at_s = known.t_s if np.isnan(t_s[0]) else t_s
        common = (at_s >= known.t_s[0]) & (at_s <= known.t_s[-1])
        if np.count_nonzero(common) < _LEAST_COMMON:
            return None
        there = np.stack([np.interp(at_s[common], known.t_s, column) for column in known.position_m.T], axis=1)
        line = there - self._eye(name)
        distance_m = np.maximum(np.linalg.norm(line, axis=1), 1e-9)
        cosine = np.sum(line * (axis if len(axis) == 1 else axis[common]), axis=1) / distance_m
        return _SeenFrom(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), distance_m)

    def _eye(self, name: str) -> FloatArray:
        return self._stations[name].camera_pose(0.0, 0.0).position_runway_m

    def _half_field_deg(self, name: str) -> float:
        lens = self._stations[name].lens
        return math.degrees(math.atan(0.5 * float(np.hypot(*(np.array(lens.image_size_px) / lens.focal_px)))))

    def _inner_field_deg(self, name: str) -> float:
        """Return how far off the optical axis a point is in the picture in all directions."""
        lens = self._stations[name].lens
        return math.degrees(math.atan(0.5 * float(np.min(np.array(lens.image_size_px) / lens.focal_px))))


class _SeenFrom(NamedTuple):
    """How far off a camera's axis known positions are, deg, and how far away, m, (n,) each."""

    off_deg: FloatArray
    distance_m: FloatArray


def _mean_direction(axis: FloatArray) -> FloatArray:
    return np.asarray(axis.mean(axis=0))


def _angle_deg(a: FloatArray, b: FloatArray) -> float:
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))


def _elevation_deg(axis: FloatArray) -> float:
    return math.degrees(math.atan2(float(axis[2]), math.hypot(*axis[:2])))


def _direction_words(axis: FloatArray) -> str:
    """Return a direction in the runway frame: x right, y along the runway, z up."""
    right_deg, up_deg = math.degrees(math.atan2(float(axis[0]), float(axis[1]))), _elevation_deg(axis)
    side, way = "right" if right_deg >= 0.0 else "left", "up" if up_deg >= 0.0 else "down"
    return f"{abs(right_deg):.0f}° to the {side} of +y and {abs(up_deg):.0f}° {way}"
