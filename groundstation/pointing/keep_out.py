"""Keep-out zones of a lens: around the Sun, and in sectors of a head's angles that the user has closed.

A zone is described by its clearance: the lens's distance outside it, rad, negative inside. A turn of the head by
(δpan, δtilt) changes no clearance by more than |δpan| + |δtilt|, since neither axis moves the optical axis by more
than its own angle.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import rotation_y
from groundstation.pointing.sun import SunOverPlace
from groundstation.rig.ptu_axes import IDEAL_AXES, PtuAxes

if TYPE_CHECKING:
    # its compiled kernels cost the PTUs' process, which is sent the axis, half a second of a core
    from groundstation.geometry.station import StationGeometry

# below it, refraction (0.6°) and the disc's radius (0.3°) counted, nothing of the Sun is over the horizon
_SUN_SET_RAD = math.radians(-1.0)
# cells of a box that are smaller than this are taken for points
_LEAST_CELL_RAD = math.radians(0.01)
_STEP_RAD = math.radians(0.5)
# rounding, and the paths between two checked points, which are straight in angles and not on the sphere
_TOLERANCE_RAD = math.radians(0.002)
_ROUNDING_RAD = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Sector:
    """Angles of a head that its lens is kept out of, rad, as the head's readings count; pan is taken modulo a turn."""

    pan_rad: tuple[float, float]
    tilt_rad: tuple[float, float]

    def clearance(self, pan_rad: FloatArray, tilt_rad: FloatArray) -> FloatArray:
        """Return how far angles (…) are outside, rad."""
        (pan_0, pan_1), (tilt_0, tilt_1) = self.pan_rad, self.tilt_rad
        pan = np.abs((pan_rad - (pan_0 + pan_1) / 2.0 + math.pi) % math.tau - math.pi) - 0.5 * (pan_1 - pan_0)
        tilt = np.abs(tilt_rad - (tilt_0 + tilt_1) / 2.0) - 0.5 * (tilt_1 - tilt_0)
        outside = np.hypot(np.maximum(pan, 0.0), np.maximum(tilt, 0.0))
        return np.asarray(np.where(outside > 0.0, outside, np.maximum(pan, tilt)))

    def clearance_at(self, pan_rad: float, tilt_rad: float) -> float:
        """Return the same of one pair of angles, to the last bit: arrays of one number take four times as long."""
        (pan_0, pan_1), (tilt_0, tilt_1) = self.pan_rad, self.tilt_rad
        pan = abs((pan_rad - (pan_0 + pan_1) / 2.0 + math.pi) % math.tau - math.pi) - 0.5 * (pan_1 - pan_0)
        tilt = abs(tilt_rad - (tilt_0 + tilt_1) / 2.0) - 0.5 * (tilt_1 - tilt_0)
        if pan > 0.0 and tilt > 0.0:
            # not that of `math`, which rounds otherwise
            return float(np.hypot(pan, tilt))
        return max(pan, tilt)


@dataclass(frozen=True, kw_only=True, eq=False)
class LensAxis:
    """Mounting of a lens on a head: ``base_from_runway`` (3, 3), the optical axis (3,) in the head, the lean, rad.

    Angles of the head are its readings, of which ``axes`` makes pan and tilt. It has no slots, for cached properties.
    """

    base_from_runway: FloatArray
    axis_head: FloatArray
    lean_rad: float
    axes: PtuAxes = IDEAL_AXES

    @classmethod
    def of(cls, geometry: "StationGeometry", axes: PtuAxes = IDEAL_AXES) -> "LensAxis":
        """Return a calibrated station's."""
        base_from_runway = geometry.packed[0:9].reshape(3, 3).T.copy()
        return cls(
            base_from_runway=base_from_runway,
            axis_head=geometry.packed[12:21].reshape(3, 3)[:, 2].copy(),
            lean_rad=geometry.lean_rad,
            axes=axes,
        )

    def clearance(self, off_rad: FloatArray, kept_rad: float) -> FloatArray:
        """Return by how much a head may turn, rad, until its axis, (…) rad off, is ``kept_rad`` off."""
        backlash_rad, most_turn = self._bounds
        return np.asarray((off_rad - kept_rad - backlash_rad) / most_turn)

    def clearance_at(self, off_rad: float, kept_rad: float) -> float:
        """Return the same of one axis."""
        backlash_rad, most_turn = self._bounds
        return (off_rad - kept_rad - backlash_rad) / most_turn

    def angle_to(self, direction_runway: FloatArray, pan_rad: FloatArray, tilt_rad: FloatArray) -> FloatArray:
        """Return the angle between the optical axis and a unit direction (3,), rad, at readings (…) of the head."""
        if not self._ideal:
            pan_rad, tilt_rad = self.axes.middle_angles(pan_rad, tilt_rad)
        x, y, z = (self.base_from_runway @ direction_runway).tolist()
        c, s = np.cos(tilt_rad), np.sin(tilt_rad)
        # the axis in a base that does not pan
        bx, by, bz = (level + c * forward + s * upward for level, forward, upward in self._parts)
        along = np.cos(pan_rad) * (x * bx + y * by) + np.sin(pan_rad) * (y * bx - x * by) + z * bz
        return np.asarray(np.arccos(np.clip(along, -1.0, 1.0)))

    def angle_at(self, direction_runway: FloatArray, pan_rad: float, tilt_rad: float) -> float:
        """Return the same at one pair of readings, to the last bit."""
        if not self._ideal:
            pan, tilt = self.axes.middle_angles(np.asarray(pan_rad), np.asarray(tilt_rad))
            pan_rad, tilt_rad = float(pan), float(tilt)
        x, y, z = (self.base_from_runway @ direction_runway).tolist()
        # those of `math` round otherwise
        c, s = float(np.cos(tilt_rad)), float(np.sin(tilt_rad))
        bx, by, bz = (level + c * forward + s * upward for level, forward, upward in self._parts)
        along = float(np.cos(pan_rad)) * (x * bx + y * by) + float(np.sin(pan_rad)) * (y * bx - x * by) + z * bz
        return float(np.arccos(min(max(along, -1.0), 1.0)))

    @cached_property
    def _ideal(self) -> bool:
        return self.axes.is_ideal_apart_from_lean

    @cached_property
    def _bounds(self) -> tuple[float, float]:
        """Half the backlash of both axes, which side of it a head is on being unknown, and the most that they turn."""
        return 0.5 * (self.axes.pan_backlash_rad + self.axes.tilt_backlash_rad), self.axes.most_turn

    @cached_property
    def _parts(self) -> list[tuple[float, float, float]]:
        """Each axis of the optical axis in a base that does not pan: constant, cosine and sine part of its tilt."""
        lean = rotation_y(self.lean_rad)
        # Rx(tilt) a = (ax, 0, 0) + cos(tilt) (0, ay, az) + sin(tilt) (0, −az, ay)
        level = lean @ np.array([self.axis_head[0], 0.0, 0.0])
        forward = lean @ np.array([0.0, self.axis_head[1], self.axis_head[2]])
        upward = lean @ np.array([0.0, -self.axis_head[2], self.axis_head[1]])
        return list(zip(level.tolist(), forward.tolist(), upward.tolist(), strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class SunZone:
    """A cone about the Sun, of so many rad from its middle to the optical axis."""

    sun: SunOverPlace
    angle_rad: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeepOut:
    """All that one station's lens is kept out of.

    Attributes
    ----------
    lens : how the head carries it.
    sun : the cone about the Sun, None where it is not avoided.
    sectors : closed to the head.
    utc_zero_s : the Unix time at zero of the clock that times ``t_s`` are of.
    """

    lens: LensAxis
    sun: SunZone | None
    sectors: tuple[Sector, ...]
    utc_zero_s: float

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to keep out of."""
        return self.sun is None and not self.sectors

    def since(self, zero_s: float) -> "KeepOut":
        """Return the same for a clock that shows zero when this one's shows ``zero_s``."""
        return replace(self, utc_zero_s=self.utc_zero_s + zero_s)

    def zones(self, t_s: float) -> "ClosedZones":
        """Return the closed zones at one time."""
        direction = None
        if self.sun is not None:
            direction = self.sun.sun.direction_runway(self.utc_zero_s + t_s)
            if direction[2] < math.sin(_SUN_SET_RAD):
                direction = None
        return ClosedZones(keep_out=self, sun_runway=direction)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedZones:
    """The zones closed to a lens at one time; ``sun_runway`` (3,) is None while the Sun is down or not avoided."""

    keep_out: KeepOut
    sun_runway: FloatArray | None

    @property
    def is_empty(self) -> bool:
        """Whether nothing is closed now."""
        return self.sun_runway is None and not self.keep_out.sectors

    def clearance(self, pan_rad: FloatArray, tilt_rad: FloatArray) -> FloatArray:
        """Return the lens's distance outside all zones at angles (…), rad; infinite without zones."""
        out = [sector.clearance(pan_rad, tilt_rad) for sector in self.keep_out.sectors]
        if self.sun_runway is not None and self.keep_out.sun is not None:
            off = self.keep_out.lens.angle_to(self.sun_runway, pan_rad, tilt_rad)
            out.append(self.keep_out.lens.clearance(off, self.keep_out.sun.angle_rad))
        if not out:
            return np.full(np.broadcast_shapes(np.shape(pan_rad), np.shape(tilt_rad)), np.inf)
        return np.asarray(reduce(np.minimum, out))

    def at(self, angles_rad: tuple[float, float]) -> float:
        """Return how far the lens is outside all zones at (pan, tilt), rad."""
        pan_rad, tilt_rad = float(angles_rad[0]), float(angles_rad[1])
        if not (math.isfinite(pan_rad) and math.isfinite(tilt_rad)):
            return float(self.clearance(np.array(pan_rad), np.array(tilt_rad)))
        out = [sector.clearance_at(pan_rad, tilt_rad) for sector in self.keep_out.sectors]
        if self.sun_runway is not None and self.keep_out.sun is not None:
            off = self.keep_out.lens.angle_at(self.sun_runway, pan_rad, tilt_rad)
            out.append(self.keep_out.lens.clearance_at(off, self.keep_out.sun.angle_rad))
        return min(out, default=math.inf)

    def words(self, angles_rad: tuple[float, float]) -> str:
        """Return in words which zone is nearest to the lens at (pan, tilt), and how near."""
        pan, tilt = np.array(angles_rad[0]), np.array(angles_rad[1])
        found: list[tuple[float, str]] = []
        if self.sun_runway is not None and self.keep_out.sun is not None:
            off, kept = float(self.keep_out.lens.angle_to(self.sun_runway, pan, tilt)), self.keep_out.sun.angle_rad
            found.append((off - kept, f"the Sun ({math.degrees(off):.1f}° off it; {math.degrees(kept):.1f}° are kept)"))
        for n, sector in enumerate(self.keep_out.sectors):
            away = float(sector.clearance(pan, tilt))
            where = f"{math.degrees(away):.1f}° outside" if away >= 0 else f"{math.degrees(-away):.1f}° inside"
            found.append((away, f"sector {n + 1} ({where})"))
        return min(found)[1] if found else "nothing"

    def box_is_clear(self, begin: tuple[float, float], end: tuple[float, float], margin_rad: float) -> bool:
        """Return whether a head may move from angles to others, each axis at its own speed: by any path between.

        If it starts inside a zone, or nearer than the margin, no part of any path may lead further in.
        """
        if self.is_empty:
            return True
        (pan_0, tilt_0), (pan_1, tilt_1) = begin, end
        here = self.at(begin) - margin_rad
        if here > abs(pan_1 - pan_0) + abs(tilt_1 - tilt_0):
            return True
        if here < 0.0:
            return self._leads_out(begin, end, margin_rad)
        centres = np.array([[0.5 * (pan_0 + pan_1), 0.5 * (tilt_0 + tilt_1)]])
        half = np.array([0.5 * abs(pan_1 - pan_0), 0.5 * abs(tilt_1 - tilt_0)])
        if self.at(end) < margin_rad:
            return False
        while True:
            values = self.clearance(centres[:, 0], centres[:, 1]) - margin_rad
            if np.any(values < 0.0):
                return False
            centres = centres[values < half.sum()]
            if not len(centres) or half.sum() < _LEAST_CELL_RAD:
                return True
            longer = int(half[1] > half[0])
            half = half.copy()
            half[longer] *= 0.5
            shift = np.zeros(2)
            shift[longer] = half[longer]
            centres = np.concatenate([centres - shift, centres + shift])

    def _leads_out(self, begin: tuple[float, float], end: tuple[float, float], margin_rad: float) -> bool:
        """Return whether an inside point never gets deeper along either axis, and an outside one stays outside."""
        counts = [min(max(math.ceil(abs(b - a) / _STEP_RAD), 1), 240) + 1 for a, b in zip(begin, end, strict=True)]
        pan, tilt = (np.linspace(a, b, n) for a, b, n in zip(begin, end, counts, strict=True))
        depth = np.minimum(self.clearance(pan[:, None], tilt[None, :]) - margin_rad, 0.0)
        never_deeper = np.all(np.diff(depth, axis=0) >= -_TOLERANCE_RAD) and np.all(
            np.diff(depth, axis=1) >= -_TOLERANCE_RAD
        )
        return bool(never_deeper and _ends_no_deeper(depth.ravel()))

    def way_is_clear(self, way_rad: FloatArray, margin_rad: float) -> bool:
        """Return whether a head may move along closely spaced points (n, 2), from the first on.

        If it starts inside a zone, or nearer than the margin, it may not get deeper.
        """
        if self.is_empty:
            return True
        return _stays_out(self.clearance(way_rad[:, 0], way_rad[:, 1]) - margin_rad)


def _stays_out(off_rad: FloatArray) -> bool:
    """Return whether a way (n,) so far outside stays there, or gets no deeper where it starts inside."""
    depth = np.minimum(off_rad, 0.0)
    if depth[0] >= 0.0:
        return bool(np.all(depth == 0.0))
    return bool(np.all(np.diff(depth) >= -_TOLERANCE_RAD) and _ends_no_deeper(depth))


def _ends_no_deeper(depth_rad: FloatArray) -> bool:
    """Return whether a way ends no deeper than it began: many short ones, each within the tolerance, lead nowhere."""
    return bool(depth_rad[-1] >= depth_rad[0] - _ROUNDING_RAD and np.all(depth_rad >= depth_rad[0] - _TOLERANCE_RAD))


def coasting_ways(
    angles_rad: FloatArray, rates_rad_s: FloatArray, hold_s: float, brakes_rad_s2: FloatArray
) -> list[FloatArray]:
    """Return where a head gets to, (n, 2) rad for each of rates (w, 2): held for a time, then braked to rest."""
    end_s = hold_s + np.max(np.abs(rates_rad_s) / brakes_rad_s2, axis=1)
    counts = np.ceil(_reach_rad(rates_rad_s, hold_s, brakes_rad_s2) / _STEP_RAD).clip(4, 240).astype(int).tolist()
    # of all at once: most are short, and calls would take longer than the arithmetic
    t = np.concatenate([np.linspace(0.0, end, n + 1) for end, n in zip(end_s.tolist(), counts, strict=True)])[:, None]
    lengths = [n + 1 for n in counts]
    rates = np.repeat(rates_rad_s, lengths, axis=0)
    braked = np.minimum(np.maximum(t - hold_s, 0.0), np.abs(rates) / brakes_rad_s2)
    moved = rates * (np.minimum(t, hold_s) + braked) - 0.5 * np.sign(rates) * brakes_rad_s2 * braked**2
    return _parted(angles_rad + moved, lengths)


def _reach_rad(rates_rad_s: FloatArray, hold_s: float, brakes_rad_s2: FloatArray) -> FloatArray:
    """Return how far rates (w, 2) lead, (w,) rad: the sum of both axes."""
    return np.asarray(np.sum(np.abs(rates_rad_s) * hold_s + 0.5 * rates_rad_s**2 / brakes_rad_s2, axis=1))


def _parted(rows: FloatArray, lengths: list[int]) -> list[FloatArray]:
    ends = np.cumsum(lengths).tolist()
    return [rows[end - length : end] for end, length in zip(ends, lengths, strict=True)]


def rates_are_clear(
    zones: ClosedZones,
    angles_rad: FloatArray,
    rates_rad_s: list[FloatArray],
    hold_s: float,
    brakes_rad_s2: FloatArray,
    margin_rad: float,
) -> bool:
    """Return whether a head that turns at some of these rates (2,), or between them, may hold them and then brake."""
    if zones.is_empty:
        return True
    # a rate that is commanded again and again is several of them, and nothing lies between equal ones
    ways = list({(float(v[0]), float(v[1])): v for v in rates_rad_s}.values())
    for one, other in pairwise(rates_rad_s):
        if np.any(one != other):
            ways += [one + share * (other - one) for share in (0.25, 0.5, 0.75)]
    rates = np.array(ways)
    farthest = float(_reach_rad(rates, hold_s, brakes_rad_s2).max())
    if zones.at((float(angles_rad[0]), float(angles_rad[1]))) - margin_rad > farthest:
        return True
    found = coasting_ways(angles_rad, rates, hold_s, brakes_rad_s2)
    points = np.concatenate(found)
    off = zones.clearance(points[:, 0], points[:, 1]) - margin_rad
    return all(_stays_out(part) for part in _parted(off, [len(way) for way in found]))
