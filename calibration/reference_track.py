"""An aircraft's DGPS log as a smooth path: position and velocity at any instant at which fixes stand close together."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline, make_smoothing_spline

from groundstation.arrays import FloatArray, MaskArray
from groundstation.evaluation.series import ReferenceSeries, nose_from_antenna

_CUBIC = 3
_LEAST_FIXES = _CUBIC + 1
# fewer do not tell their noise from their path
_LEAST_TO_SMOOTH = 12
# the response of the path to one fix is looked at so far to either side, at so many points from fix to fix
_REACH_S = 2.0
_FINE = 8
_SMALL = 0.01
_MOST_FOR_NOISE = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPoints:
    """The antenna at n instants.

    Attributes
    ----------
    position_m, velocity_m_s, sigma_m : (n, 3) runway frame.
    runway_from_body : (n, 3, 3), body x forward, y right, z down, by the direction of motion with zero roll.
    turning_per_s : (n, 3, 3) the rate of that.
    usable : (n,) False in gaps and beyond the ends; the numbers mean nothing there.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    sigma_m: FloatArray
    runway_from_body: FloatArray
    turning_per_s: FloatArray
    usable: MaskArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathNoise:
    """What white noise of the fixes does to a smoothed path.

    Attributes
    ----------
    lags_s : (m,) from 0 on, evenly; beyond the last, nothing is in common.
    covariance : (3, m) of the path's errors so far apart, for fixes of unit variance, by axis.
    """

    lags_s: FloatArray
    covariance: FloatArray

    @property
    def reach_s(self) -> float:
        """The last lag at which something is in common."""
        return float(self.lags_s[-1])

    def at(self, lags_s: FloatArray) -> FloatArray:
        """Return the covariances (n, 3) at lags (n,)."""
        return np.column_stack([np.interp(np.abs(lags_s), self.lags_s, axis, right=0.0) for axis in self.covariance])


def path_noise(t_s: FloatArray, position_m: FloatArray) -> PathNoise:
    """Return how the errors of a path through fixes (n, 3) go together: the response to one fix, with itself.

    The response in the middle of the path is taken for all of it.
    """
    n = len(t_s)
    if n < _LEAST_FIXES:
        return PathNoise(lags_s=np.array([0.0, 1e-3]), covariance=np.ones((3, 2)) * [1.0, 0.0])
    step = float(np.median(np.diff(t_s)))
    middle = n // 2
    fine = step / _FINE
    reach = min(_REACH_S, 0.5 * float(t_s[-1] - t_s[0]))
    count = int(reach / fine)
    around = fine * np.arange(-count, count + 1)
    inside = np.clip(t_s[middle] + around, t_s[0], t_s[-1])
    rows = []
    for axis, before in enumerate(_splines(t_s, position_m)):
        pushed = position_m[:, axis].copy()
        # so little that the smoothness chosen stays what it is
        push = 1e-4 * max(float(np.std(np.diff(pushed))), 1e-6)
        pushed[middle] += push
        after = _spline(t_s, pushed)
        response = (after(inside) - before(inside)) / push
        rows.append(response)
    responses = np.array(rows)
    felt = np.flatnonzero(np.abs(responses).max(axis=0) > _SMALL * np.abs(responses).max())
    width = max(count - int(felt[0]), int(felt[-1]) - count, _FINE)
    responses = responses[:, max(count - width, 0) : count + width + 1]
    # with itself, and faded to nothing: both keep it a covariance, and straight lines between the lags do, too
    lags = responses.shape[1]
    together = np.array([np.correlate(r, r, mode="full")[lags - 1 :] / _FINE for r in responses])
    return PathNoise(lags_s=np.asarray(fine * np.arange(lags)), covariance=together * (1.0 - np.arange(lags) / lags))


class ReferenceTrack:
    """Cubic splines along the fixes, one for each stretch without a gap longer than ``max_gap_s``.

    They are smoothed, by generalised cross-validation: a spline through noisy fixes is quieter between two of them than
    at one, and a camera's clock would be drawn to where it is quiet.

    ``step_s`` is the usual time between two fixes; ``noise`` what the fixes' noise does to the path.
    """

    __slots__ = ("_axes", "_reference", "_splines", "noise", "step_s")

    def __init__(self, reference: ReferenceSeries, max_gap_s: float) -> None:
        self._reference = reference
        t = reference.t_s
        self.step_s = float(np.median(np.diff(t))) if len(t) > 1 else max_gap_s
        cuts = np.flatnonzero(np.diff(t) > max_gap_s + 1e-9) + 1
        stretches = [k for k in np.split(np.arange(len(t)), cuts) if len(k) >= _LEAST_FIXES]
        self._splines = [(float(t[k[0]]), float(t[k[-1]]), _splines(t[k], reference.position_m[k])) for k in stretches]
        longest = max(stretches, key=len, default=np.arange(0))
        half = len(longest) // 2
        longest = longest[max(half - _MOST_FOR_NOISE // 2, 0) : half + _MOST_FOR_NOISE // 2]
        self.noise = path_noise(t[longest], reference.position_m[longest])
        axes = [reference.position_m - nose_from_antenna(reference, axis).position_m for axis in np.eye(3)]
        self._axes = np.stack(axes, axis=2)

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


def _splines(t_s: FloatArray, position_m: FloatArray) -> list[BSpline]:
    """Return a spline of time for each axis of positions (n, 3)."""
    return [_spline(t_s, axis) for axis in position_m.T]


def _spline(t_s: FloatArray, values: FloatArray) -> BSpline:
    if len(t_s) < _LEAST_TO_SMOOTH:
        return make_interp_spline(t_s, values, k=_CUBIC)
    return make_smoothing_spline(t_s, values)
