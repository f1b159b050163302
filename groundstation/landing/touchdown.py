"""Where and when the wheels will meet the runway, with a region that holds the point with 95 % probability.

The estimate with its covariance is carried on by samples of the stated prior (`approach_prior`): along the plan, or,
without one or far off it, with constant velocity and white acceleration. The samples' mean and covariance give an
ellipse; it is made so large that it holds 95 % of the samples, whatever the shape of their distribution. The samples'
normal numbers are drawn once, so that the same estimate always gives the same forecast. The runway is taken as level at
the threshold's height.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.landing.threshold_state import ALONG, ALONG_RATE, UP, UP_RATE, ThresholdState, threshold_state
from groundstation.landing.touchdown_prior_fit import fit_plan
from groundstation.landing.touchdown_samples import (
    NOISES,
    STEP_S,
    TouchdownSamples,
    fly_planned,
    fly_straight,
    fly_straight_and_flare,
)
from groundstation.landing_site.approach_prior import ApproachPrior, WheelPosition, covariance_root
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.messages import Kinematics

PROBABILITY = 0.95
# a touchdown further ahead is not foretold; samples are flown a while longer
HORIZON_S, _FLOWN_S = 15.0, 24.0
_SEED = 20
# chance that an aircraft that flies the plan counts as off it, and the constraints of `touchdown_prior_fit`
_OFF_PLAN, _CONSTRAINTS = 1e-4, 5
# of a point on the runway, m, so that the ellipse of certain states has an area
_LEAST_SIGMA_M = 0.01


class TouchdownBasis(StrEnum):
    """What the forecast supposes of the flight that is left."""

    PLAN = "plan"
    CONSTANT_VELOCITY = "constant velocity"


class NoTouchdown(StrEnum):
    """Why no touchdown is foretold."""

    TOO_EARLY = "further ahead than is foretold"
    NOT_DESCENDING = "not every likely flight meets the runway"
    ON_GROUND = "on the ground"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchdownForecast:
    """A touchdown foretold.

    Attributes
    ----------
    made_at_s : session time of the estimate.
    t_s, sigma_t_s : session time of the touchdown and one sigma.
    point_m : (2,) of the wheels on the runway: past the threshold, and right of the centre line.
    covariance_m2 : (2, 2) of the point.
    radius : the region of `PROBABILITY` is where the point's normalised distance from ``point_m`` is at most this.
    on_runway : probability that the point is past the threshold, between the edges and, where known, before the end.
    basis : what is supposed.
    """

    made_at_s: float
    t_s: float
    sigma_t_s: float
    point_m: FloatArray
    covariance_m2: FloatArray
    radius: float
    on_runway: float
    basis: TouchdownBasis

    def contains(self, point_m: FloatArray) -> bool:
        """Return whether a point (2,) is within the ellipse."""
        off = point_m - self.point_m
        return float(off @ np.linalg.solve(self.covariance_m2, off)) <= self.radius**2

    def outline_m(self, count: int = 48) -> FloatArray:
        """Return points (count, 2) around the ellipse, along and right, m."""
        angle = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
        circle = self.radius * np.stack([np.cos(angle), np.sin(angle)])
        return np.asarray(self.point_m + (covariance_root(self.covariance_m2) @ circle).T)

    @property
    def half_axes_m(self) -> tuple[float, float]:
        """Half of the ellipse's extent along and across the landing direction, m."""
        along, right = self.radius * np.sqrt(np.diag(self.covariance_m2))
        return float(along), float(right)


class TouchdownPredictor:
    """Foretells touchdowns at one site.

    Parameters
    ----------
    site : runway and plan.
    wheels : where they are from the target point; None for the site's.
    prior : of the flights; None for the site's.
    samples : number of flights that a forecast rests upon.
    """

    def __init__(
        self,
        site: LandingSite,
        wheels: WheelPosition | None = None,
        prior: ApproachPrior | None = None,
        samples: int = 600,
    ) -> None:
        self._site = site
        self._wheels = site.wheels if wheels is None else wheels
        self._prior = site.prior if prior is None else prior
        generator = np.random.default_rng(_SEED)
        half = (samples + 1) // 2
        steps = round(_FLOWN_S / STEP_S)
        # each number and its opposite: means of linear functions are exact
        first, rest = generator.normal(size=(half, 10)), generator.normal(size=(steps, NOISES, half))
        self._normals = np.concatenate([first, -first])
        self._noises = np.concatenate([rest, -rest], axis=2)

    def forecast(self, t_s: float, kinematics: Kinematics) -> TouchdownForecast | NoTouchdown:
        """Return the touchdown foretold from an estimate, or why there is none.

        Raises `InputError` where a number of the estimate is not finite.
        """
        state = threshold_state(self._site.runway, t_s, kinematics)
        if float(state.mean[UP]) <= self._wheels.below_nose_m:
            return NoTouchdown.ON_GROUND
        if self._site.approach is not None:
            found = self._along_plan(state, self._site.approach)
            if found is not None:
                return found
        return self._straight(state)

    def _along_plan(self, state: ThresholdState, plan: PlannedApproach) -> TouchdownForecast | NoTouchdown | None:
        """Return the forecast by the plan; None if the aircraft does not fly it."""
        speed = float(state.mean[ALONG_RATE])
        aim_m = plan.aim_past_threshold_m - self._wheels.below_nose_m / math.tan(plan.glide_path_rad)
        if speed <= 0.0:
            return None
        if aim_m - float(state.mean[ALONG]) > HORIZON_S * speed:
            return NoTouchdown.TOO_EARLY
        start = fit_plan(state, plan, self._prior, self._wheels, self._normals)
        if start.misfit > chi_square_limit(_OFF_PLAN, _CONSTRAINTS):
            return None
        flown = fly_planned(start, plan, self._prior, self._noises)
        return self._summary(state.t_s, flown, start.weights, TouchdownBasis.PLAN)

    def _straight(self, state: ThresholdState) -> TouchdownForecast | NoTouchdown:
        height, sink = float(state.mean[UP]) - self._wheels.below_nose_m, -float(state.mean[UP_RATE])
        if sink <= 0.0:
            return NoTouchdown.NOT_DESCENDING
        if height > HORIZON_S * sink:
            return NoTouchdown.TOO_EARLY
        states = state.mean + self._normals[:, :6] @ covariance_root(state.covariance).T
        below = self._wheels.below_nose_m + self._wheels.below_nose_sigma_m * self._normals[:, 9]
        flown = self._flown_free(states, below, sink)
        weights = np.full(len(states), 1.0 / len(states))
        return self._summary(state.t_s, flown, weights, TouchdownBasis.CONSTANT_VELOCITY)

    def _flown_free(self, states: FloatArray, below_nose_m: FloatArray, sink_m_s: float) -> TouchdownSamples:
        """Return samples without a plan: of each half, numbers and opposites, the first ones flare."""
        half = len(states) // 2
        share, psd = self._prior.free_flare_share, self._prior.free_psd_m2_s3
        flaring = np.tile(np.arange(half) < round(share * half), 2)
        found = TouchdownSamples(len(states))
        for chosen in (flaring, ~flaring):
            if not np.any(chosen):
                continue
            own, below, noises = states[chosen], below_nose_m[chosen], self._noises[:, :, chosen]
            if chosen is flaring:
                flares = self._prior.flares(self._normals[chosen, 6:9], sink_m_s)
                flown = fly_straight_and_flare(own, below, psd, noises, flares)
            else:
                flown = fly_straight(own, below, psd, noises)
            found.along_m[chosen], found.right_m[chosen] = flown.along_m, flown.right_m
            found.after_s[chosen], found.landed[chosen] = flown.after_s, flown.landed
        return found

    def _summary(
        self, t_s: float, flown: TouchdownSamples, weights: FloatArray, basis: TouchdownBasis
    ) -> TouchdownForecast | NoTouchdown:
        landing = np.where(flown.landed, weights, 0.0)
        share = float(landing.sum())
        # of the others nothing is known; they are outside of any region
        if share < 0.5 * (1.0 + PROBABILITY):
            return NoTouchdown.NOT_DESCENDING
        landing /= share
        points = np.column_stack([flown.along_m - self._wheels.behind_nose_m, flown.right_m])
        mean = landing @ points
        off = points - mean
        covariance = (off * landing[:, None]).T @ off + _LEAST_SIGMA_M**2 * np.eye(2)
        after_s = float(landing @ flown.after_s)
        distance = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off.T).T)
        return TouchdownForecast(
            made_at_s=t_s,
            t_s=t_s + after_s,
            sigma_t_s=math.sqrt(max(float(landing @ (flown.after_s - after_s) ** 2), 0.0)),
            point_m=np.asarray(mean),
            covariance_m2=np.asarray(covariance),
            radius=math.sqrt(_weighted_quantile(distance, landing, min(PROBABILITY / share, 1.0))),
            on_runway=share * float(landing[self._on_runway(points)].sum()),
            basis=basis,
        )

    def _on_runway(self, points_m: FloatArray) -> FloatArray:
        runway = self._site.runway
        end_m = math.inf if runway.length_m is None else runway.length_m
        along, right = points_m[:, ALONG], points_m[:, 1]
        return np.asarray((along >= 0.0) & (along <= end_m) & (np.abs(right) <= 0.5 * runway.width_m))


def _weighted_quantile(values: FloatArray, weights: FloatArray, share: float) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) - 0.5 * weights[order]
    return float(np.interp(share, reached, values[order]))
