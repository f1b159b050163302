"""A target that one camera has held for long is placed anew when a second camera sees it.

One camera alone tells where the target is across its ray. Along the ray the filter has what the motion model allows,
a needle of tens of metres after seconds; and since each pixel was linearised where the needle's middle was thought to
be, the needle is too short, and not quite where the ray is. An update by the second camera's pixel takes all that for
knowledge. What the first camera does know is where the target is in its own image, and how fast it moves there: so
those two are kept, the position is where the two rays meet, and the velocity is what `BearingOnlyPrior` says there.
docs/derivation.md, "Placed anew".
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from groundstation.arrays import FloatArray
from groundstation.estimation.bearing_only_prior import BearingOnlyPrior
from groundstation.estimation.compiled_filter import innovation_covariance
from groundstation.estimation.measurement import PixelModel, PixelPrediction
from groundstation.estimation.state import StateLayout

# a pixel meets a needle where one sigma along that bends it by more sigmas of its noise, or is more of the depth, …
_BENT_SIGMA, _LONG_SHARE = 1.0, 0.1
# … and that is pinned by a camera in whose image it is straight to this, and known to so many sigmas of noise
_STRAIGHT_SIGMA, _PINNED_SIGMA = 1.0, 10.0
# a prior that is off by more sigmas of its length is none of this target
_MOST_SIGMA = 6.0
_BEHIND = 1e3  # residual where a trial point is behind a camera, sigmas
_NOTHING = np.zeros((2, 2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """A pixel (2,) of ``station`` with covariance (2, 2), exposed ``row_dt_s`` after its stamp."""

    station: str
    pixel: FloatArray
    covariance_px2: FloatArray
    row_dt_s: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reinitialisation:
    """A target placed anew.

    ``target`` (6,) position and velocity, ``covariance`` (6, 6) without what the rig does to it, ``sensitivity``
    (6, m) to the carried errors; ``residual`` (2,) of the second camera's pixel, px, with covariance (2, 2); ``square``
    is how far the rays miss each other, χ² of one degree of freedom.
    """

    target: FloatArray
    covariance: FloatArray
    sensitivity: FloatArray
    residual: FloatArray
    residual_covariance: FloatArray
    square: float


class SecondView:
    """Finds whether a pixel meets a needle, and places the target anew from the two rays."""

    def __init__(self, layout: StateLayout, pixels: Mapping[str, PixelModel]) -> None:
        self._layout = layout
        self._pixels = pixels

    def holder(self, seen: Seen, x: FloatArray, P: FloatArray, age_s: float) -> Seen | None:
        """Return another camera that pins the target, with the pixel where the filter (n,), (n, n) has it there.

        None where it takes none: the prior must be long, or bent for this pixel, and straight for the other camera.
        """
        noise = math.sqrt((seen.covariance_px2[0, 0] + seen.covariance_px2[1, 1]) / 2.0)
        own = self._pixels[seen.station].predict(x, 0.0, age_s)
        off = np.zeros_like(x)
        sigma = _longest_axis(P[self._layout.position, self._layout.position], off[self._layout.position])
        long = own is not None and sigma > _LONG_SHARE * own.depth_m
        if not long and self._bend(seen.station, own, x, off, age_s) <= _BENT_SIGMA * noise:
            return None
        best, least = None, _PINNED_SIGMA * noise
        for name, model in self._pixels.items():
            prediction = None if name == seen.station else model.predict(x, 0.0, age_s)
            if prediction is None:
                continue
            known = innovation_covariance(P, prediction.jacobian, _NOTHING)
            spread = math.sqrt((known[0, 0] + known[1, 1]) / 2.0)
            if spread < least and self._bend(name, prediction, x, off, age_s) < _STRAIGHT_SIGMA * noise:
                best, least = Seen(station=name, pixel=prediction.pixel, covariance_px2=known, row_dt_s=0.0), spread
        return best

    def place(
        self,
        views: tuple[Seen, Seen],
        rays_from_m: FloatArray,
        near_m: FloatArray,
        prior: tuple[FloatArray, FloatArray],
        age_s: float,
    ) -> Reinitialisation | None:
        """Return the target where two rays meet, or None where that is behind a camera or far off the prior.

        Parameters
        ----------
        views : the holder's, and the second camera's pixel.
        rays_from_m : where the holder's rays begin (3,).
        near_m : about where the rays meet (3,).
        prior : x (n,), P (n, n).
        """
        x, P = prior
        needle = BearingOnlyPrior(x[self._layout.target], P[self._layout.target, self._layout.target], rays_from_m)
        problem = _Meeting(self._layout, self._pixels, views, needle, x, age_s)
        if not problem.weigh(near_m, P):
            return None
        fit = least_squares(problem.residuals, near_m, jac=problem.jacobian, x_scale="jac")
        if problem.looks(fit.x) is None or needle.sigmas_to(fit.x) > _MOST_SIGMA:
            return None
        J = problem.jacobian(fit.x)
        spread = np.linalg.inv(J.T @ J)
        slope, by_errors = needle.velocity_slope(fit.x), -spread @ J.T @ problem.by_errors(fit.x)
        velocity = slope @ spread @ slope.T + needle.velocity_spread(fit.x)
        residual, covariance = problem.of_second(fit.fun)
        return Reinitialisation(
            target=np.concatenate([fit.x, needle.velocity(fit.x)]),
            covariance=np.block([[spread, spread @ slope.T], [slope @ spread, velocity]]),
            sensitivity=np.vstack([by_errors, slope @ by_errors]),
            residual=residual,
            residual_covariance=covariance,
            square=2.0 * float(fit.cost),
        )

    def _bend(self, station: str, here: PixelPrediction | None, x: FloatArray, off: FloatArray, age_s: float) -> float:
        """Return how much a step ``off`` (n,) either way bends the pixel that is ``here``, px; inf if behind."""
        model = self._pixels[station]
        before, after = model.predict(x - off, 0.0, age_s), model.predict(x + off, 0.0, age_s)
        if before is None or here is None or after is None:
            return math.inf
        u, v = before.pixel - 2.0 * here.pixel + after.pixel
        return math.hypot(u, v) / 2.0


@njit(cache=True)
def _longest_axis(P: FloatArray, axis: FloatArray) -> float:
    """Write one sigma along a covariance's (3, 3) longest axis (3,); return its length."""
    values, axes = np.linalg.eigh(P)
    sigma = math.sqrt(max(values[-1], 0.0))
    axis[:] = sigma * axes[:, -1]
    return sigma


class _Meeting:
    """The least-squares problem of one point (3,) that two pixels see; residuals in sigmas, (4,)."""

    def __init__(
        self,
        layout: StateLayout,
        pixels: Mapping[str, PixelModel],
        views: tuple[Seen, Seen],
        needle: BearingOnlyPrior,
        x: FloatArray,
        age_s: float,
    ) -> None:
        self._layout, self._pixels, self._views = layout, pixels, views
        self._needle, self._x, self._age_s = needle, x, age_s
        self._roots: list[FloatArray] = []

    def looks(self, point_m: FloatArray) -> list[PixelPrediction] | None:
        """Return both cameras' predictions of a target at a point (3,), None behind one of them."""
        state = self._x.copy()
        state[self._layout.target] = np.concatenate([point_m, self._needle.velocity(point_m)])
        found = [self._pixels[v.station].predict(state, v.row_dt_s, self._age_s) for v in self._views]
        ahead = [p for p in found if p is not None]
        return ahead if len(ahead) == len(found) else None

    def weigh(self, point_m: FloatArray, P: FloatArray) -> bool:
        """Set the noises: of the pixels, of the angles, and of where the velocity takes the target until exposure."""
        looks = self.looks(point_m)
        if looks is None:
            return False
        spread = self._needle.velocity_spread(point_m)
        for view, look in zip(self._views, looks, strict=True):
            late = look.jacobian[:, self._layout.velocity]
            R = view.covariance_px2 + late @ spread @ late.T
            angles = self._layout.angles.get(view.station)
            if angles is not None:
                R = R + look.jacobian[:, angles] @ P[angles, angles] @ look.jacobian[:, angles].T
            self._roots.append(np.asarray(np.linalg.cholesky(R), dtype=np.float64))
        return True

    def residuals(self, point_m: FloatArray) -> FloatArray:
        """Return seen − predicted in sigmas, (4,)."""
        looks = self.looks(point_m)
        if looks is None:
            return np.full(4, _BEHIND)
        off = [v.pixel - p.pixel for v, p in zip(self._views, looks, strict=True)]
        return np.concatenate([np.linalg.solve(L, each) for L, each in zip(self._roots, off, strict=True)])

    def jacobian(self, point_m: FloatArray) -> FloatArray:
        """Return ∂residuals/∂point, (4, 3); the velocity goes with the point."""
        slope = self._needle.velocity_slope(point_m)
        here, speed = self._layout.position, self._layout.velocity
        looks = self.looks(point_m)
        if looks is None:
            return np.zeros((4, 3))
        own = [p.jacobian[:, here] + p.jacobian[:, speed] @ slope for p in looks]
        return -np.vstack([np.linalg.solve(L, each) for L, each in zip(self._roots, own, strict=True)])

    def by_errors(self, point_m: FloatArray) -> FloatArray:
        """Return ∂residuals/∂(carried errors), (4, m)."""
        looks = self.looks(point_m) or []
        own = [p.jacobian[:, self._layout.constant] for p in looks]
        return -np.vstack([np.linalg.solve(L, each) for L, each in zip(self._roots, own, strict=True)])

    def of_second(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the second camera's residual (2,) in px and its covariance (2, 2)."""
        L = self._roots[1]
        return L @ residuals[2:], L @ L.T
