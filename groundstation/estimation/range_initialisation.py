"""Initialisation of the range when a second camera detects a target that one camera has tracked alone.

The pixels of one camera determine the target across the camera's ray. Along the ray the covariance grows by the motion
model to tens of metres within seconds; since each pixel was linearised about the mean at its time, that covariance is
too short and slightly off the ray. A plain update with the second camera's pixel would treat the difference as
information. The bearing in the first camera and its rate are well observed. They are kept: the new position is the
intersection of the two rays and the new velocity follows from `BearingOnlyPrior` at that point.
docs/derivation.md, section 5.
"""

import math
from collections.abc import Mapping

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from groundstation.arrays import FloatArray
from groundstation.estimation.bearing_only_prior import BearingOnlyPrior
from groundstation.estimation.kalman_kernels import innovation_covariance
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.triangulation import midpoint
from groundstation.estimation.updates.measurements import TargetPixel
from groundstation.estimation.updates.pixel_model import PixelModel, PixelPrediction
from groundstation.estimation.updates.update import PredictedState, TargetReset, Update
from groundstation.estimation.variance_check import sigma_of
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.geometry.station import LensError, StationGeometry
from groundstation.messages import Innovation

# re-initialisation applies where one sigma along the ray bends the pixel by more sigmas of its noise, or exceeds this
# share of the depth, …
_BENT_SIGMA, _LONG_SHARE = 1.0, 0.1
# … and another camera observes the target with a bend and a spread below these many sigmas of noise
_STRAIGHT_SIGMA, _PINNED_SIGMA = 1.0, 10.0
# an intersection further from the prior than this many sigmas of its distance is not the same target
_MOST_SIGMA = 6.0
_BEHIND = 1e3  # residual where a trial point is behind a camera, sigmas
_NO_NOISE = np.zeros((2, 2))


class RangeInitialiser:
    """Detects when a pixel needs a re-initialisation, and computes the target from the two rays.

    Parameters
    ----------
    layout : of the state.
    pixels, stations : pixel model and geometry of each station.
    gate_probability : share of correct pairs of rays that pass the gate of their miss distance.
    """

    def __init__(
        self,
        layout: StateLayout,
        pixels: Mapping[str, PixelModel],
        stations: Mapping[str, StationGeometry],
        gate_probability: float,
    ) -> None:
        self._layout, self._pixels, self._stations = layout, pixels, stations
        self._gate = float(chi_square_quantile(gate_probability, 1))

    def __call__(self, state: PredictedState, pixel: TargetPixel) -> Update | None:
        """Return the target at the intersection of the two rays, None where no re-initialisation applies.

        The squared miss distance of the rays is χ² with one degree of freedom: two of the pixel's own define the point.
        """
        tracked = self._tracking_camera(state, pixel)
        if tracked is None:
            return None
        try:
            rays = [
                self._stations[p.station].ray(p.pixel[0], p.pixel[1], *self._layout.pan_tilt(state.x, p.station))
                for p in (tracked, pixel)
            ]
        except LensError:
            return None
        near = midpoint(rays)
        if near is None:
            return None
        update = self._intersection((tracked, pixel), rays[0].origin_runway_m, near[0], state)
        return None if update is None or update.innovation.nis > self._gate else update

    def _tracking_camera(self, state: PredictedState, seen: TargetPixel) -> TargetPixel | None:
        """Return the camera that has tracked the target so far, with the predicted pixel and its covariance.

        None where no re-initialisation is needed: the prior has to be long, or non-linear for this pixel, and linear
        for the other camera.
        """
        x, P, age_s = state.x, state.P, state.age_s
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
            known = innovation_covariance(P, prediction.jacobian, _NO_NOISE)
            spread = sigma_of((known[0, 0] + known[1, 1]) / 2.0, f"predicted pixel of {name}")
            # the pixels of a camera that is alone have left the range as it was: it lies along that camera's ray
            straight = name == state.alone or self._bend(name, prediction, x, off, age_s) < _STRAIGHT_SIGMA * noise
            if spread < least and straight:
                best, least = TargetPixel(station=name, pixel=prediction.pixel, covariance_px2=known), spread
        return best

    def _intersection(
        self,
        pixels: tuple[TargetPixel, TargetPixel],
        rays_from_m: FloatArray,
        near_m: FloatArray,
        state: PredictedState,
    ) -> Update | None:
        """Return the target at the intersection of two rays; None if it is behind a camera or far from the prior.

        Parameters
        ----------
        pixels : of the tracking camera, and of the second camera.
        rays_from_m : origin of the tracking camera's rays (3,).
        near_m : approximate intersection of the rays (3,).
        """
        x, P = state.x, state.P
        target = self._layout.target
        bearing_prior = BearingOnlyPrior(x[target], P[target, target], rays_from_m)
        problem = _RayIntersection(self._layout, self._pixels, pixels, bearing_prior, state)
        if not problem.set_noise(near_m, P):
            return None
        fit = least_squares(problem.residuals, near_m, jac=problem.jacobian, x_scale="jac")
        if problem.predictions(fit.x) is None or bearing_prior.sigmas_to(fit.x) > _MOST_SIGMA:
            return None
        J = problem.jacobian(fit.x)
        spread = np.linalg.inv(J.T @ J)
        slope, by_errors = bearing_prior.velocity_slope(fit.x), -spread @ J.T @ problem.by_errors(fit.x)
        velocity = slope @ spread @ slope.T + bearing_prior.velocity_spread(fit.x)
        residual, R = problem.of_second(fit.fun)
        reset = TargetReset(
            target=np.concatenate([fit.x, bearing_prior.velocity(fit.x)]),
            covariance=np.block([[spread, spread @ slope.T], [slope @ spread, velocity]]),
            correlated=target,
            sensitivity=np.vstack([by_errors, slope @ by_errors]),
        )
        nis = 2.0 * float(fit.cost)
        return Update(Innovation(residual=residual, covariance=R, nis=nis, dof=1, accepted=True), reset)

    def _bend(self, station: str, here: PixelPrediction | None, x: FloatArray, off: FloatArray, age_s: float) -> float:
        """Return the second difference of the pixel ``here`` for steps ±``off`` (n,), px; inf if behind the camera."""
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


class _RayIntersection:
    """The least-squares problem of one point (3,) observed by two pixels; residuals in sigmas, (4,)."""

    def __init__(
        self,
        layout: StateLayout,
        pixels: Mapping[str, PixelModel],
        views: tuple[TargetPixel, TargetPixel],
        prior: BearingOnlyPrior,
        state: PredictedState,
    ) -> None:
        self._layout, self._pixels, self._views = layout, pixels, views
        self._prior, self._x, self._age_s = prior, state.x, state.age_s
        self._roots: list[FloatArray] = []

    def predictions(self, point_m: FloatArray) -> list[PixelPrediction] | None:
        """Return both cameras' predictions of a target at a point (3,), None behind one of them."""
        state = self._x.copy()
        state[self._layout.target] = np.concatenate([point_m, self._prior.velocity(point_m)])
        found = [self._pixels[v.station].predict(state, v.row_dt_s, self._age_s) for v in self._views]
        ahead = [p for p in found if p is not None]
        return ahead if len(ahead) == len(found) else None

    def set_noise(self, point_m: FloatArray, P: FloatArray) -> bool:
        """Set the noise of each pixel: of the detection, of the angles and of the motion until the exposure."""
        predictions = self.predictions(point_m)
        if predictions is None:
            return False
        spread = self._prior.velocity_spread(point_m)
        for view, prediction in zip(self._views, predictions, strict=True):
            late = prediction.jacobian[:, self._layout.velocity]
            R = view.covariance_px2 + late @ spread @ late.T
            angles = self._layout.angles.get(view.station)
            if angles is not None:
                R = R + prediction.jacobian[:, angles] @ P[angles, angles] @ prediction.jacobian[:, angles].T
            self._roots.append(np.asarray(np.linalg.cholesky(R), dtype=np.float64))
        return True

    def residuals(self, point_m: FloatArray) -> FloatArray:
        """Return measured − predicted in sigmas, (4,)."""
        predictions = self.predictions(point_m)
        if predictions is None:
            return np.full(4, _BEHIND)
        off = [v.pixel - p.pixel for v, p in zip(self._views, predictions, strict=True)]
        return np.concatenate([np.linalg.solve(L, each) for L, each in zip(self._roots, off, strict=True)])

    def jacobian(self, point_m: FloatArray) -> FloatArray:
        """Return ∂residuals/∂point, (4, 3); the velocity depends on the point."""
        slope = self._prior.velocity_slope(point_m)
        here, speed = self._layout.position, self._layout.velocity
        predictions = self.predictions(point_m)
        if predictions is None:
            return np.zeros((4, 3))
        own = [p.jacobian[:, here] + p.jacobian[:, speed] @ slope for p in predictions]
        return -np.vstack([np.linalg.solve(L, each) for L, each in zip(self._roots, own, strict=True)])

    def by_errors(self, point_m: FloatArray) -> FloatArray:
        """Return ∂residuals/∂(carried errors), (4, m)."""
        predictions = self.predictions(point_m) or []
        own = [p.jacobian[:, self._layout.constant] for p in predictions]
        return -np.vstack([np.linalg.solve(L, each) for L, each in zip(self._roots, own, strict=True)])

    def of_second(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the second camera's residual (2,) in px and its covariance (2, 2)."""
        L = self._roots[1]
        return L @ residuals[2:], L @ L.T
