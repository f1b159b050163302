"""An aircraft's DGPS log as a smooth path: position and velocity at any instant at which fixes stand close together."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from calibration.smoothing_spline import smoothing_spline
from groundstation.arrays import FloatArray, MaskArray
from groundstation.evaluation.series import ReferenceSeries, nose_from_antenna

_CUBIC = 3
_LEAST_FIXES = _CUBIC + 1
# fewer do not tell their noise from their path
_LEAST_TO_SMOOTH = 12
_POINTING_ROUNDS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPoints:
    """The antenna at n instants.

    Attributes
    ----------
    position_m, velocity_m_s, sigma_m : (n, 3) runway frame.
    runway_from_body : (n, 3, 3), body x forward, y right, z down, by the direction of motion with zero roll: the
        antenna's, or the nose's where the track was `ReferenceTrack.pointed`.
    turning_per_s : (n, 3, 3) the rate of that.
    usable : (n,) False in gaps and beyond the ends; the numbers mean nothing there.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    sigma_m: FloatArray
    runway_from_body: FloatArray
    turning_per_s: FloatArray
    usable: MaskArray


class ReferenceTrack:
    """Cubic splines along the fixes, one for each stretch without a gap longer than ``max_gap_s``.

    They are smoothed, by generalised cross-validation: a spline through noisy fixes is quieter between two of them than
    at one, and a camera's clock would be drawn to where it is quiet.

    ``step_s`` is the usual time between two fixes; ``stretches`` are the fixes that have a path through them.
    """

    __slots__ = ("_axes", "_reference", "_splines", "step_s", "stretches")

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
        self._axes = _axes(reference)

    def pointed(self, antenna_in_body_m: FloatArray) -> "ReferenceTrack":
        """Return the same path with the body along its nose's motion, for an antenna (3,) at that place from the nose.

        In a turn the antenna moves elsewhere than the nose: metres of lever arm would be put centimetres wrong.
        """
        other, given = copy(self), self._reference
        for _ in range(_POINTING_ROUNDS):
            nose_m = given.position_m - other._axes @ antenna_in_body_m
            other._axes = _axes(ReferenceSeries(t_s=given.t_s, position_m=nose_m, sigma_m=given.sigma_m))
        return other

    def along(self, paths: Sequence[Sequence[BSpline]]) -> "ReferenceTrack":
        """Return the same fixes with other paths: three splines for each of ``stretches``."""
        other = copy(self)
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
        for first, last, splines in self._splines:
            inside = (t_s >= first) & (t_s <= last)
            for axis, spline in enumerate(splines):
                position[inside, axis], velocity[inside, axis] = spline(t_s[inside]), spline(t_s[inside], nu=1)
            usable |= inside
        if not self._splines:
            nothing = np.zeros((n, 3))
            return TrackPoints(
                position_m=nothing,
                velocity_m_s=nothing,
                sigma_m=nothing + 1.0,
                runway_from_body=np.zeros((n, 3, 3)),
                turning_per_s=np.zeros((n, 3, 3)),
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
            turning_per_s=(self._axes[right] - self._axes[right - 1]) / gap[:, None, None],
            usable=usable,
        )


def _axes(moving: ReferenceSeries) -> FloatArray:
    """Return runway_from_body (n, 3, 3) by the direction in which a series moves."""
    axes = [moving.position_m - nose_from_antenna(moving, axis).position_m for axis in np.eye(3)]
    return np.stack(axes, axis=2)


def _splines(t_s: FloatArray, position_m: FloatArray) -> list[BSpline]:
    """Return a spline of time for each axis of positions (n, 3)."""
    return [_spline(t_s, axis) for axis in position_m.T]


def _spline(t_s: FloatArray, values: FloatArray) -> BSpline:
    if len(t_s) < _LEAST_TO_SMOOTH:
        return make_interp_spline(t_s, values, k=_CUBIC)
    return smoothing_spline(t_s, values)
