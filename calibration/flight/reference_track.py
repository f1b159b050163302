"""An aircraft's DGPS log as a smooth path: position and velocity at any instant at which fixes stand close together."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from calibration.flight.smoothing_spline import smoothing_spline
from groundstation.arrays import FloatArray, MaskArray
from groundstation.evaluation.position_series import ReferenceSeries, smooth_velocity

_CUBIC = 3
_LEAST_FIXES = _CUBIC + 1
# fewer do not separate noise from path
_LEAST_TO_SMOOTH = 12
# a nose's motion from the antenna's, and the step of its derivative by the arm
_POINTING_ROUNDS = 2
_STEP_M = 0.1
_LEAST_SPEED_M_S = 1.0
_WINDOW_S = 0.6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPoints:
    """The antenna at n instants.

    Attributes
    ----------
    position_m, velocity_m_s, sigma_m : (n, 3) runway frame.
    runway_from_body : (n, 3, 3), body x forward, y right, z down, by the direction of motion with zero roll; where
        the track was `ReferenceTrack.pointed`, the derivative of the arm from nose to antenna by its place in the body.
    beside_m : (n, 3) the arm minus runway_from_body @ antenna_in_body.
    turning_per_s, beside_m_s : (n, 3, 3), (n, 3) the rates of both.
    usable : (n,) False in gaps and beyond the ends; the numbers mean nothing there.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    sigma_m: FloatArray
    runway_from_body: FloatArray
    beside_m: FloatArray
    turning_per_s: FloatArray
    beside_m_s: FloatArray
    usable: MaskArray

    def nose_m(self, antenna_in_body_m: FloatArray) -> FloatArray:
        """Return the nose (n, 3) m for an antenna (3,) m from it."""
        return np.asarray(self.position_m - self.beside_m - self.runway_from_body @ antenna_in_body_m)

    def nose_velocity_m_s(self, antenna_in_body_m: FloatArray) -> FloatArray:
        """Return the nose's velocity (n, 3) m/s."""
        return np.asarray(self.velocity_m_s - self.beside_m_s - self.turning_per_s @ antenna_in_body_m)


class ReferenceTrack:
    """Cubic splines along the fixes, one for each stretch without a gap longer than ``max_gap_s``.

    They are smoothed, by generalised cross-validation: a spline through noisy fixes is quieter between two of them than
    at one, and a camera's clock would be drawn to where it is quiet.

    ``step_s`` is the usual time between two fixes; ``stretches`` are the fixes that have a path through them.
    """

    __slots__ = ("_axes", "_beside", "_rates", "_reference", "_runs", "_splines", "_velocity", "step_s", "stretches")

    def __init__(self, reference: ReferenceSeries, max_gap_s: float) -> None:
        self._reference = reference
        t = reference.t_s
        self.step_s = float(np.median(np.diff(t))) if len(t) > 1 else max_gap_s
        cuts = np.flatnonzero(np.diff(t) > max_gap_s + 1e-9) + 1
        stretches = [k for k in np.split(np.arange(len(t)), cuts) if len(k) >= _LEAST_FIXES]
        self.stretches = tuple(
            ReferenceSeries(t_s=t[k], position_m=reference.position_m[k], sigma_m=reference.sigma_m[k])
            for k in stretches
        )
        self._splines = [(float(s.t_s[0]), float(s.t_s[-1]), _splines(s.t_s, s.position_m)) for s in self.stretches]
        self._rates: list[Sequence[BSpline] | None] = []
        self._runs = tuple(stretches)
        self._velocity = smooth_velocity(t, reference.position_m, _WINDOW_S)
        for k, (_, _, splines) in zip(stretches, self._splines, strict=True):
            # a spline through the whole stretch is quieter than a line through a few fixes
            self._velocity[k] = np.column_stack([spline(t[k], nu=1) for spline in splines])
        self._axes = _frames(self._velocity)
        self._beside = np.zeros((len(t), 3))

    def pointed(self, antenna_in_body_m: FloatArray) -> "ReferenceTrack":
        """Return the same path with the body along its nose's motion, for an antenna (3,) m there from the nose.

        In a turn the antenna and the nose move differently: metres of lever arm would be centimetres wrong. A
        longer arm also rotates the body: ``runway_from_body`` is then the derivative of the antenna's position.
        """
        other = copy(self)
        steps = _STEP_M * np.eye(3)
        ends = [(self._arm(antenna_in_body_m + d), self._arm(antenna_in_body_m - d)) for d in steps]
        other._axes = np.stack([(up - down) / (2.0 * _STEP_M) for up, down in ends], axis=2)
        other._beside = self._arm(antenna_in_body_m) - other._axes @ antenna_in_body_m
        return other

    def _arm(self, antenna_in_body_m: FloatArray) -> FloatArray:
        """Return from nose to antenna (n, 3) m in the runway frame at the fixes."""
        arm = _frames(self._velocity) @ antenna_in_body_m
        for _ in range(_POINTING_ROUNDS):
            turning = np.zeros_like(arm)
            for k in self._runs:
                turning[k] = np.gradient(arm[k], self._reference.t_s[k], axis=0)
            arm = _frames(self._velocity - turning) @ antenna_in_body_m
        return np.asarray(arm)

    def along(
        self, paths: Sequence[Sequence[BSpline]], rates: Sequence[Sequence[BSpline] | None] = ()
    ) -> "ReferenceTrack":
        """Return the same fixes with other paths: three splines for each of ``stretches``.

        ``rates`` are splines of the velocity where it is not the paths' derivative.
        """
        other = copy(self)
        other._rates = list(rates)
        ends = [(float(s.t_s[0]), float(s.t_s[-1])) for s in self.stretches]
        other._splines = [(*end, list(path)) for end, path in zip(ends, paths, strict=True)]
        return other

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last instant of the fixes, in the log's clock."""
        t = self._reference.t_s
        return (float(t[0]), float(t[-1])) if len(t) else (np.inf, -np.inf)

    def at(self, t_s: FloatArray) -> TrackPoints:
        """Return the antenna at instants (n,) of the log's clock."""
        n = len(t_s)
        position, velocity, usable = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
        for (first, last, splines), rates in zip_longest(self._splines, self._rates):
            inside = (t_s >= first) & (t_s <= last)
            for axis, spline in enumerate(splines):
                position[inside, axis] = spline(t_s[inside])
                velocity[inside, axis] = spline(t_s[inside], nu=1) if rates is None else rates[axis](t_s[inside])
            usable |= inside
        if not self._splines:
            nothing = np.zeros((n, 3))
            return TrackPoints(
                position_m=nothing,
                velocity_m_s=nothing,
                sigma_m=nothing + 1.0,
                runway_from_body=np.zeros((n, 3, 3)),
                beside_m=nothing,
                turning_per_s=np.zeros((n, 3, 3)),
                beside_m_s=nothing,
                usable=usable,
            )
        t = self._reference.t_s
        right = np.clip(np.searchsorted(t, t_s), 1, len(t) - 1)
        gap = t[right] - t[right - 1]
        share = np.clip((t_s - t[right - 1]) / gap, 0.0, 1.0)[:, None]
        sigma = self._reference.sigma_m
        blend = share[:, :, None]
        return TrackPoints(
            position_m=position,
            velocity_m_s=velocity,
            sigma_m=(1.0 - share) * sigma[right - 1] + share * sigma[right],
            runway_from_body=(1.0 - blend) * self._axes[right - 1] + blend * self._axes[right],
            beside_m=(1.0 - share) * self._beside[right - 1] + share * self._beside[right],
            turning_per_s=(self._axes[right] - self._axes[right - 1]) / gap[:, None, None],
            beside_m_s=(self._beside[right] - self._beside[right - 1]) / gap[:, None],
            usable=usable,
        )


def _frames(velocity_m_s: FloatArray) -> FloatArray:
    """Return runway_from_body (n, 3, 3) of what moves so (n, 3): x along it, zero roll.

    Where it hardly moves, or straight up, the nearest direction in the list is kept; where it never does, none.
    """
    level = np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1])
    moving = np.flatnonzero(level > _LEAST_SPEED_M_S)
    if not len(moving):
        return np.zeros((len(velocity_m_s), 3, 3))
    here = np.arange(len(velocity_m_s))
    after = np.clip(np.searchsorted(moving, here), 0, len(moving) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(moving[after] - here) <= np.abs(moving[before] - here)
    velocity = velocity_m_s[moving[np.where(nearer, after, before)]]
    forward = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([forward, right, np.cross(forward, right)], axis=2)


def _splines(t_s: FloatArray, position_m: FloatArray) -> list[BSpline]:
    """Return a spline of time for each axis of positions (n, 3)."""
    return [_spline(t_s, axis) for axis in position_m.T]


def _spline(t_s: FloatArray, values: FloatArray) -> BSpline:
    if len(t_s) < _LEAST_TO_SMOOTH:
        return make_interp_spline(t_s, values, k=_CUBIC)
    return smoothing_spline(t_s, values)
