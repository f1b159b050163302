"""The target's state conditioned on the plan: samples of it, and of the flare, with their weights.

The filter's estimate x̂ with covariance P counts as a measurement of the state; the prior of `approach_prior` gives five
linear functions c(x) of it that are normal about 0 with variances R. On the glide path these are the deviations from
centre line and glide path with their rates, and that of the speed; in the flare the last three are replaced by height,
sink and speed against the flare's law. Conditioned on c the state is normal, with the gain P Hᵀ (H P Hᵀ + R)⁻¹, and the
normal density of c(x̂) with covariance H P Hᵀ + R is the likelihood of the flare's parameters: they weigh the samples.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.landing.threshold_state import ALONG, ALONG_RATE, RIGHT, RIGHT_RATE, UP, UP_RATE, ThresholdState
from groundstation.landing_site.approach_prior import (
    ApproachPrior,
    FlareParameters,
    PathHold,
    WheelPosition,
    covariance_root,
)
from groundstation.landing_site.planned_approach import PlannedApproach

# functions of the state that the prior knows: places in c(x)
OFF_LINE, OFF_LINE_RATE, OFF_PATH, OFF_PATH_RATE, OFF_SPEED = range(5)
# an aircraft is supposed to fly at least as fast, m/s; without a planned speed its sigma about the present one
_SLOWEST_M_S, _UNPLANNED_SPEED_M_S = 2.0, 100.0
# what the law of a flare leaves of the path's spread near the ground at least, m
_LEAST_PATH_SIGMA_M = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedStates:
    """n samples of state and flare, given the estimate.

    Attributes
    ----------
    states : (n, 6) as `ThresholdState.mean`.
    weights : (n,), 1 in all.
    flares, flaring : the flares, and (n,) which have begun.
    speed_m_s : (n,) to which ground speed returns before any flare's loss.
    lost_m_s : (n,) that loss so far.
    below_nose_m : (n,) of the wheels.
    misfit : least cᵀ(H P Hᵀ + R)⁻¹c of any sample, χ² with 5 degrees of freedom if the plan is flown.
    """

    states: FloatArray
    weights: FloatArray
    flares: FlareParameters
    flaring: MaskArray
    speed_m_s: FloatArray
    lost_m_s: FloatArray
    below_nose_m: FloatArray
    misfit: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Constraints:
    """c (n, 5) at the estimate, H (n, 5, 6) and R (n, 5), the variances."""

    c: FloatArray
    H: FloatArray
    R: FloatArray


def fit_plan(
    state: ThresholdState, plan: PlannedApproach, prior: ApproachPrior, wheels: WheelPosition, normals: FloatArray
) -> PlannedStates:
    """Return samples of the state and the flare for standard normal numbers (n, 10)."""
    slope = math.tan(plan.glide_path_rad)
    planned = plan.speed_m_s
    speed = max(float(state.mean[ALONG_RATE]) if planned is None else planned, _SLOWEST_M_S)
    flares = prior.flares(normals[:, 6:9], slope * speed)
    below = np.maximum(wheels.below_nose_m + wheels.below_nose_sigma_m * normals[:, 9], 0.0)
    height = float(state.mean[UP]) - below
    flaring = height <= flares.height_m
    elapsed = np.where(flaring, _elapsed_s(flares, height), 0.0)
    lost = np.minimum(flares.deceleration_m_s2 * elapsed, 0.5 * speed)
    found = _glide_constraints(state, plan, prior, slope, speed)
    if np.any(flaring):
        # a few samples with a high flare share one array with those on the path
        found = _with_flares(found, state, plan, prior, flares, below, flaring, elapsed, lost, speed)
    if planned is None:
        found.R[:, OFF_SPEED] = _UNPLANNED_SPEED_M_S**2
    states, logs, squares = _conditioned(state, found, normals[:, :6])
    weights = np.broadcast_to(np.exp(logs - logs.max()), height.shape)
    spent = states[:, ALONG_RATE] + lost if planned is None else np.full(height.shape, speed)
    return PlannedStates(
        states=states,
        weights=np.asarray(weights / weights.sum()),
        flares=flares,
        flaring=flaring,
        speed_m_s=spent,
        lost_m_s=lost,
        below_nose_m=below,
        misfit=float(squares.min()),
    )


def _elapsed_s(flares: FlareParameters, height_m: FloatArray) -> FloatArray:
    """Return how long the flare's law takes from its beginning to a height of the wheels, (n,) s."""
    sag = flares.touchdown_sink_m_s * flares.time_constant_s
    left = np.maximum(height_m, 0.0) + sag
    return np.asarray(flares.time_constant_s * np.log(np.maximum((flares.height_m + sag) / left, 1.0)))


def _glide_constraints(
    state: ThresholdState, plan: PlannedApproach, prior: ApproachPrior, slope: float, speed_m_s: float
) -> _Constraints:
    H = np.zeros((1, 5, 6))
    H[0, OFF_LINE, RIGHT] = H[0, OFF_LINE_RATE, RIGHT_RATE] = 1.0
    H[0, OFF_PATH, [UP, ALONG]] = H[0, OFF_PATH_RATE, [UP_RATE, ALONG_RATE]] = 1.0, slope
    H[0, OFF_SPEED, ALONG_RATE] = 1.0
    c = H @ state.mean - np.array([0.0, 0.0, slope * plan.aim_past_threshold_m, 0.0, speed_m_s])
    lateral = np.diag(PathHold(sigma_m=prior.lateral_sigma_m, hold_rad_s=prior.hold_rad_s).stationary)
    vertical = np.diag(PathHold(sigma_m=prior.vertical_sigma_m, hold_rad_s=prior.hold_rad_s).stationary)
    return _Constraints(c=c, H=H, R=np.concatenate([lateral, vertical, [prior.speed_sigma_m_s**2]])[None])


def _with_flares(
    glide: _Constraints,
    state: ThresholdState,
    plan: PlannedApproach,
    prior: ApproachPrior,
    flares: FlareParameters,
    below_m: FloatArray,
    flaring: MaskArray,
    elapsed_s: FloatArray,
    lost_m_s: FloatArray,
    speed_m_s: float,
) -> _Constraints:
    """Return the constraints with those samples' replaced whose flare has begun."""
    n, tau, sink = flaring.size, flares.time_constant_s, flares.touchdown_sink_m_s
    c, H, R = np.repeat(glide.c, n, axis=0), np.repeat(glide.H, n, axis=0), np.repeat(glide.R, n, axis=0)
    glide_slope = math.tan(plan.glide_path_rad)
    height = np.maximum(float(state.mean[UP]) - below_m, 0.0)
    law_sink = height / tau + sink
    slope = law_sink / speed_m_s
    # where along the runway the law has the wheels at this height
    begins = plan.aim_past_threshold_m - (flares.height_m + below_m) / glide_slope
    there = begins + (speed_m_s - 0.5 * lost_m_s) * elapsed_s
    off = slope * (float(state.mean[ALONG]) - there)
    path_sigma = np.maximum(prior.vertical_sigma_m * slope / glide_slope, _LEAST_PATH_SIGMA_M)
    values = (off, float(state.mean[UP_RATE]) + law_sink, float(state.mean[ALONG_RATE]) - (speed_m_s - lost_m_s))
    for place, value in zip((OFF_PATH, OFF_PATH_RATE, OFF_SPEED), values, strict=True):
        c[flaring, place] = value[flaring]
    H[flaring, OFF_PATH, ALONG] = slope[flaring]
    H[flaring, OFF_PATH_RATE, ALONG_RATE] = 0.0
    H[flaring, OFF_PATH_RATE, UP] = 1.0 / tau[flaring]
    R[flaring, OFF_PATH] = path_sigma[flaring] ** 2
    R[flaring, OFF_PATH_RATE] = prior.flare_sink_sigma_m_s**2
    return _Constraints(c=c, H=H, R=R)


def _conditioned(
    state: ThresholdState, given: _Constraints, normals: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return states (n, 6), log-likelihoods (n or 1,) and squared misfits (n or 1,) of the constraints."""
    c, H = given.c, given.H
    cross = state.covariance @ np.swapaxes(H, -1, -2)
    S = H @ cross
    S[:, range(5), range(5)] += given.R
    solved = np.linalg.solve(S, np.concatenate([c[:, :, None], np.swapaxes(cross, -1, -2)], axis=2))
    mean = state.mean - (cross @ solved[:, :, :1])[:, :, 0]
    root = covariance_root(state.covariance - cross @ solved[:, :, 1:])
    squares = np.einsum("ni,ni->n", c, solved[:, :, 0])
    logs = -0.5 * (squares + np.linalg.slogdet(S)[1])
    states = mean + (root @ normals[:, :, None])[:, :, 0]
    return np.asarray(states), np.asarray(logs), squares
