"""The aim of all stations without a target: a point in the air that sweeps the search volume.

All cameras observe one place at a time, because detection needs two of them. After a loss that is the predicted
position of the target, swept over its uncertainty; without one, the sector in which aircraft arrive.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Kinematics

# steps of a quarter of a view's dwell in which a sweep is evaluated ahead
_SKIPPED = 120
# the pattern is of points on a plane across the runway
_MOST_DEG = 80.0
# of half a view: what of a place's surroundings need not be swept, as one view holds it
_HELD_ANYWAY = 0.9
# half views from one ring of a sweep to the next
_RING_STEP = 2.0 * _HELD_ANYWAY
# of a view's dwell: a sweep of what one view holds lasts so long, and then its surroundings have grown
_LEAST_SWEEP = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchConfig:
    """The searched volume, and the speed of the search.

    Attributes
    ----------
    azimuth_deg, elevation_deg : (low, high) of the sector, seen from the runway's origin; azimuth to the right of +y.
    range_m : range at which the cameras' views meet.
    dwell_s : least time for which a place stays in view.
    lost_s : duration of the search at the predicted position after a loss.
    sigmas : extent of that search.
    acceleration_psd_m2_s3 : manoeuvres of a lost aircraft, per axis.
    """

    azimuth_deg: tuple[float, float] = (-5.0, 5.0)
    elevation_deg: tuple[float, float] = (0.5, 8.0)
    range_m: float = 500.0
    dwell_s: float = 3.0
    lost_s: float = 15.0
    sigmas: float = 3.0
    acceleration_psd_m2_s3: float = 10.0

    def __post_init__(self) -> None:
        if not (self.azimuth_deg[0] < self.azimuth_deg[1] and self.elevation_deg[0] < self.elevation_deg[1]):
            raise ValueError("azimuth_deg and elevation_deg must be low, high")
        if max(map(abs, (*self.azimuth_deg, *self.elevation_deg))) > _MOST_DEG:
            raise ValueError(f"azimuth_deg and elevation_deg must be from -{_MOST_DEG:g} to {_MOST_DEG:g}")
        if min(self.range_m, self.dwell_s, self.sigmas) <= 0 or min(self.lost_s, self.acceleration_psd_m2_s3) < 0:
            raise ValueError("range_m, dwell_s and sigmas must be > 0, lost_s and acceleration_psd_m2_s3 ≥ 0")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LostSweep:
    """One sweep over where a lost target may be, from where it is predicted outwards.

    ``after_s`` (n,) are times after the loss, rising, ``points`` (n, 2) where the aim is then, x and z in half views
    from the prediction; in between it goes straight.
    """

    after_s: FloatArray
    points: FloatArray

    @classmethod
    def outwards(
        cls, begin_s: float, end_s: float, start: FloatArray, aims: tuple[FloatArray, FloatArray], speed: float
    ) -> "_LostSweep":
        """Return the sweep from ``start`` (2,) to the middle, and round this in ever wider rings.

        ``aims`` are the lowest and the highest (2,) that are swept, ``speed`` is in half views a second and axis;
        rings that would begin after ``end_s`` are left out.
        """
        low, high = aims
        middle = np.clip(0.0, low, high)
        after_s, places = [begin_s], [start]

        def go_to(x: float, z: float) -> None:
            place = np.array([x, z])
            after_s.append(after_s[-1] + float(np.abs(place - places[-1]).max()) / speed)
            places.append(place)

        go_to(*middle)
        furthest = max(float((middle - low).max()), float((high - middle).max()))
        for ring in range(1, math.ceil(furthest / _RING_STEP) + 1):
            if after_s[-1] > end_s:
                break
            left, down = np.maximum(middle - ring * _RING_STEP, low)
            right, up = np.minimum(middle + ring * _RING_STEP, high)
            for x, z in ((right, middle[1]), (right, up), (left, up), (left, down), (right, down), (right, middle[1])):
                go_to(x, z)
        return cls(after_s=np.array(after_s), points=np.array(places))

    def at(self, after_s: float) -> FloatArray:
        """Return the aim (2,) at a time after the loss, its last one from its end on."""
        return np.array([np.interp(after_s, self.after_s, column) for column in self.points.T])


class SearchPattern:
    """The common aim of all stations, as a function of time."""

    def __init__(self, stations: Mapping[str, StationGeometry], config: SearchConfig) -> None:
        self._config = config
        # half of the narrowest camera's field of view, as tangents
        self._view = np.min([_half_view(g) for g in stations.values()], axis=0)
        self._lost: tuple[float, Kinematics] | None = None
        self._sweeps: list[_LostSweep] = []

    def seen(self, t_s: float, kinematics: Kinematics) -> None:
        """Remember where the target is, for when it is lost."""
        self._lost = (t_s, kinematics)
        self._sweeps = []

    def after_loss(self, t_s: float) -> bool:
        """Return whether a target was there so recently that it is searched for where it must have gone."""
        return self._lost is not None and 0.0 <= t_s - self._lost[0] <= self._config.lost_s

    def ahead_s(self, t_s: float, allowed: Callable[[FloatArray], bool], already_s: float = 0.0) -> float:
        """Return the time by which the sweep is advanced to reach a permitted point (3,), as it is if there is none.

        ``already_s`` is by how much it is advanced. A closed region thus costs no time: all stations continue where it
        ends. After a loss the sweep is not advanced for longer than it must be, as it follows the target.
        """
        step_s = 0.25 * self._config.dwell_s
        from_s = 0.0 if self.after_loss(t_s) else already_s
        ahead = (from_s + k * step_s for k in range(_SKIPPED))
        return next((each for each in ahead if allowed(self.point(t_s + each))), from_s)

    def point(self, t_s: float) -> FloatArray:
        """Return the aim (3,), runway frame."""
        if self._lost is not None and self.after_loss(t_s):
            return self._around(t_s, *self._lost)
        config = self._config
        azimuth, elevation = np.radians(config.azimuth_deg), np.radians(config.elevation_deg)
        middle = np.array([math.tan(azimuth.mean()), 1.0, math.tan(elevation.mean())]) * config.range_m
        half = 0.5 * config.range_m * np.array([np.ptp(np.tan(azimuth)), np.ptp(np.tan(elevation))])
        return self._swept(t_s, middle, half)

    def _around(self, t_s: float, lost_s: float, kinematics: Kinematics) -> FloatArray:
        """Return the aim ``t_s`` after a loss, by the motion at the loss."""
        after_s = t_s - lost_s
        across, up = self._sweep(after_s, kinematics).at(after_s) * self._half_view(after_s, kinematics)
        x, y, z = kinematics.position_runway_m + after_s * kinematics.velocity_runway_m_s
        # an aircraft is not below the runway
        return np.array([x + across, y, max(z + up, 0.0)])

    def _half_view(self, after_s: float, kinematics: Kinematics) -> FloatArray:
        """Return half of what a view holds at the predicted range, (2,) m of x and z."""
        y = kinematics.position_runway_m[1] + after_s * kinematics.velocity_runway_m_s[1]
        return np.asarray(self._view * max(float(y), 1.0))

    def _sweep(self, after_s: float, kinematics: Kinematics) -> _LostSweep:
        """Return the sweep at a time after the loss: each is over what it was when the one before ended.

        Of a sweep that grows with the time, the place would depend on the session's age, and leap.
        """
        least_s = _LEAST_SWEEP * self._config.dwell_s
        if not self._sweeps:
            self._sweeps = [self._new_sweep(0.0, np.zeros(2), kinematics)]
        while (last := self._sweeps[-1]).after_s[0] <= after_s:
            next_s = max(float(last.after_s[-1]), float(last.after_s[0]) + least_s)
            self._sweeps.append(self._new_sweep(next_s, last.at(next_s), kinematics))
        begun = bisect_right([float(sweep.after_s[0]) for sweep in self._sweeps], after_s)
        return self._sweeps[max(begun - 1, 0)]

    def _new_sweep(self, begin_s: float, start: FloatArray, kinematics: Kinematics) -> _LostSweep:
        """Return a sweep of the target's surroundings, as large as they are when the shortest one would end."""
        config = self._config
        dt = begin_s + _LEAST_SWEEP * config.dwell_s
        P, psd = kinematics.covariance, config.acceleration_psd_m2_s3
        variance = np.diag(P[:3, :3] + dt * (P[:3, 3:] + P[3:, :3]) + dt**2 * P[3:, 3:]) + psd * dt**3 / 3.0
        half = config.sigmas * np.sqrt(np.maximum(variance[[0, 2]], 0.0))
        z = float(kinematics.position_runway_m[2] + dt * kinematics.velocity_runway_m_s[2])
        half_view = self._half_view(dt, kinematics)
        low, high = (np.array([sign * half[0], max(z + sign * half[1], 0.0) - z]) / half_view for sign in (-1.0, 1.0))
        # what one view holds is held with the prediction as near to its middle as may be
        ends = low + _HELD_ANYWAY, high - _HELD_ANYWAY
        aims = np.minimum(*ends), np.maximum(*ends)
        held = ends[0] >= ends[1]
        nearest = np.clip(0.0, *aims)
        aims = np.where(held, nearest, aims[0]), np.where(held, nearest, aims[1])
        return _LostSweep.outwards(begin_s, config.lost_s, start, aims, 2.0 / config.dwell_s)

    def _swept(self, t_s: float, middle: FloatArray, half: FloatArray) -> FloatArray:
        """Return a point that sweeps x and z about ``middle`` by ``half`` (2,), less what one view holds anyway."""
        seen = self._view * max(float(middle[1]), 1.0)
        reach = np.maximum(half - _HELD_ANYWAY * seen, 0.0)
        speed = 2.0 * seen / self._config.dwell_s
        across, up = _serpentine(t_s, reach, speed, rows=math.ceil(reach[1] / seen[1]) + 1)
        return middle + np.array([across, 0.0, up])


def _half_view(station: StationGeometry) -> FloatArray:
    """Return half of a camera's field of view to the side and up, as tangents (2,), however it is mounted.

    It is how far the picture reaches from its middle along the horizon and the vertical: of a camera on its side the
    picture's height is what it sees to the side.
    """
    half = 0.5 * np.array(station.image_size_px) / station.lens.focal_px
    # how far u and v point to the side (first row) and up (second row)
    axes = np.abs(station.camera_pose(0.0, 0.0).runway_from_camera[[0, 2], :2])
    axes /= np.maximum(np.hypot(axes[:, 0], axes[:, 1]), 1e-9)[:, None]
    return np.asarray((half / np.maximum(axes, 1e-9)).min(axis=1), np.float64)


def _serpentine(t_s: float, reach: FloatArray, speed: FloatArray, rows: int) -> tuple[float, float]:
    """Return the point of a sweep of ±``reach`` (2,) at a time: along one row, up to the next, back along that, …

    The rows are one view's height apart; from the top the sweep returns downwards in the same way.
    """
    along_s, up_s = 2.0 * reach[0] / speed[0], 2.0 * reach[1] / speed[1] / max(rows - 1, 1)
    lap_s = along_s + up_s
    if lap_s == 0.0:
        return 0.0, 0.0
    # rows up, rows down: 0 … rows − 1 and back, the ends twice
    lap, within_s = divmod(t_s, lap_s)
    row = int(lap) % (2 * rows)
    level = row if row < rows else 2 * rows - 1 - row
    further = 0 if row in (rows - 1, 2 * rows - 1) else (1 if row < rows else -1)
    share = min(within_s / along_s, 1.0) if along_s > 0 else 1.0
    climbed = max(within_s - along_s, 0.0) / up_s * further if up_s > 0 else 0.0
    across = (2.0 * share - 1.0) * reach[0] * (1 if row % 2 == 0 else -1)
    up = ((level + climbed) / max(rows - 1, 1) * 2.0 - 1.0) * reach[1] if rows > 1 else 0.0
    return float(across), float(up)
