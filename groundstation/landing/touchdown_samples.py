"""Samples of the rest of a flight, to where the wheels meet the runway: along the plan, or with constant velocity."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.landing.threshold_state import ALONG, ALONG_RATE, RIGHT, RIGHT_RATE, UP, UP_RATE
from groundstation.landing.touchdown_prior_fit import PlannedStates
from groundstation.landing_site.approach_prior import MOST_SINK_SHARE, ApproachPrior, FlareParameters, PathHold
from groundstation.landing_site.planned_approach import PlannedApproach

# the processes are exact at any step; of 0.02, 0.1 and 0.2 s the forecasts differ by less than their samples' scatter
STEP_S = 0.2
# normal numbers of each sample and step: centre line and glide path two each, speed, sink in the flare
NOISES = 6
_SLOWEST_M_S = 1.0
_LEAST_SINK_M_S = 0.05


class TouchdownSamples:
    """Where and when each of n samples touches down: ``along_m``, ``right_m`` of the nose, ``after_s``; all (n,).

    ``landed`` (n,) marks those that do within the time; the others' numbers are meaningless.
    """

    __slots__ = ("after_s", "along_m", "landed", "right_m")

    def __init__(self, count: int) -> None:
        self.along_m, self.right_m, self.after_s = np.zeros(count), np.zeros(count), np.zeros(count)
        self.landed = np.zeros(count, dtype=bool)

    def land(self, down: MaskArray, along_m: FloatArray, right_m: FloatArray, after_s: FloatArray) -> None:
        """Enter those samples that are down for the first time."""
        first = down & ~self.landed
        if np.any(first):
            self.along_m[first], self.right_m[first] = along_m[first], right_m[first]
            self.after_s[first] = after_s[first]
            self.landed |= first


@dataclass(slots=True, kw_only=True, eq=False)
class _Planned:
    """The samples on their way: positions and deviations (n,), and wheel heights."""

    along: FloatArray
    right: FloatArray
    right_rate: FloatArray
    off_path: FloatArray
    off_path_rate: FloatArray
    off_speed: FloatArray
    lost: FloatArray
    height: FloatArray
    off_sink: FloatArray
    flaring: MaskArray


def fly_planned(
    start: PlannedStates, plan: PlannedApproach, prior: ApproachPrior, noises: FloatArray
) -> TouchdownSamples:
    """Fly the plan to the end; ``noises`` (steps, `NOISES`, n) standard normal numbers, one step being `STEP_S`."""
    slope, flares = math.tan(plan.glide_path_rad), start.flares
    now = _begin(start, plan, slope)
    found = TouchdownSamples(len(start.states))
    found.land(now.height <= 0.0, now.along, now.right, np.zeros_like(now.along))
    F_line, root_line = PathHold(sigma_m=prior.lateral_sigma_m, hold_rad_s=prior.hold_rad_s).step(STEP_S)
    F_path, root_path = PathHold(sigma_m=prior.vertical_sigma_m, hold_rad_s=prior.hold_rad_s).step(STEP_S)
    speed_kept, speed_new = prior.speed_step(STEP_S)
    sink_kept, sink_new = prior.flare_step(STEP_S)
    decay = np.exp(-STEP_S / flares.time_constant_s)
    for k, noise in enumerate(noises):
        speed = np.maximum(start.speed_m_s + now.off_speed - now.lost, _SLOWEST_M_S)
        along = now.along + STEP_S * speed
        right, now.right_rate = _moved(F_line, root_line, now.right, now.right_rate, noise[0:2])
        now.off_path, now.off_path_rate = _moved(F_path, root_path, now.off_path, now.off_path_rate, noise[2:4])
        sag = (flares.touchdown_sink_m_s - now.off_sink) * flares.time_constant_s
        on_path = slope * (plan.aim_past_threshold_m - along) + now.off_path - start.below_nose_m
        height = np.where(now.flaring, (now.height + sag) * decay - sag, on_path)
        share = now.height / np.maximum(now.height - height, 1e-9)
        found.land(
            height <= 0.0,
            now.along + share * (along - now.along),
            now.right + share * (right - now.right),
            (k + share) * STEP_S,
        )
        if np.all(found.landed):
            break
        now.along, now.right, now.height = along, right, height
        now.off_speed = speed_kept * now.off_speed + speed_new * noise[4]
        now.off_sink = sink_kept * now.off_sink + sink_new * noise[5]
        now.lost = now.lost + np.where(now.flaring, STEP_S * flares.deceleration_m_s2, 0.0)
        _begin_flares(now, start, -slope * speed + now.off_path_rate)
    return found


def _begin(start: PlannedStates, plan: PlannedApproach, slope: float) -> _Planned:
    x, flares = start.states, start.flares
    height = x[:, UP] - start.below_nose_m
    return _Planned(
        along=x[:, ALONG],
        right=x[:, RIGHT],
        right_rate=x[:, RIGHT_RATE],
        off_path=x[:, UP] + slope * (x[:, ALONG] - plan.aim_past_threshold_m),
        off_path_rate=x[:, UP_RATE] + slope * x[:, ALONG_RATE],
        off_speed=x[:, ALONG_RATE] - (start.speed_m_s - start.lost_m_s),
        lost=start.lost_m_s,
        height=height,
        off_sink=x[:, UP_RATE] + height / flares.time_constant_s + flares.touchdown_sink_m_s,
        flaring=start.flaring.copy(),
    )


def _begin_flares(now: _Planned, start: PlannedStates, climb_m_s: FloatArray) -> None:
    """Begin the flare of those samples that are nearer to its height than half a step; sink is continuous."""
    flares = start.flares
    begins = ~now.flaring & (now.height + 0.5 * STEP_S * climb_m_s <= flares.height_m)
    off_sink = climb_m_s + now.height / flares.time_constant_s + flares.touchdown_sink_m_s
    now.off_sink = np.where(begins, off_sink, now.off_sink)
    now.flaring = now.flaring | begins


def _moved(
    F: FloatArray, root: FloatArray, value: FloatArray, rate: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a deviation and its rate, (n,) each, one step later."""
    new = root @ noise
    return F[0, 0] * value + F[0, 1] * rate + new[0], F[1, 0] * value + F[1, 1] * rate + new[1]


def fly_straight(
    states: FloatArray, below_nose_m: FloatArray, psd_m2_s3: tuple[float, float, float], noises: FloatArray
) -> TouchdownSamples:
    """Fly on with constant velocity and white acceleration from states (n, 6); noises as in `fly_planned`."""
    return _straight_down_to(states, below_nose_m, psd_m2_s3, noises)[0]


def fly_straight_and_flare(
    states: FloatArray,
    below_nose_m: FloatArray,
    psd_m2_s3: tuple[float, float, float],
    noises: FloatArray,
    flares: FlareParameters,
) -> TouchdownSamples:
    """Fly on as `fly_straight`, and from the flare's height on by its law, which begins with the sink that is there."""
    found, rates = _straight_down_to(states, below_nose_m + flares.height_m, psd_m2_s3, noises)
    # of those that are below it already, from where they are
    height = np.minimum(flares.height_m, np.maximum(states[:, UP] - below_nose_m, 0.0))
    sink = -rates[:, 2]
    last = np.minimum(flares.touchdown_sink_m_s, MOST_SINK_SHARE * np.maximum(sink, _LEAST_SINK_M_S))
    constant_s = height / np.maximum(sink - last, _LEAST_SINK_M_S)
    takes_s = np.where(constant_s > 0.0, constant_s * np.log1p(height / np.maximum(last * constant_s, 1e-9)), 0.0)
    # what is slowed down does not fly backwards
    speed = np.maximum(rates[:, 0], _SLOWEST_M_S)
    slowed_s = np.minimum(takes_s, speed / np.maximum(flares.deceleration_m_s2, 1e-9))
    # the white acceleration goes on; the last step's numbers are of no use to a sample that is down before
    spread = np.sqrt(np.array(psd_m2_s3)[:2, None] * takes_s**3 / 3.0) * noises[-1, :2]
    found.along_m += speed * slowed_s - 0.5 * flares.deceleration_m_s2 * slowed_s**2 + spread[0]
    found.right_m += rates[:, 1] * takes_s + spread[1]
    found.after_s += takes_s
    return found


def _straight_down_to(
    states: FloatArray, below_nose_m: FloatArray, psd_m2_s3: tuple[float, float, float], noises: FloatArray
) -> tuple[TouchdownSamples, FloatArray]:
    """Return where and when each sample is down to its height, and with which velocity, (n, 3)."""
    x = states.copy()
    x[:, UP] -= below_nose_m
    found, rates = TouchdownSamples(len(x)), x[:, ALONG_RATE:].copy()
    found.land(x[:, UP] <= 0.0, x[:, ALONG], x[:, RIGHT], np.zeros(len(x)))
    # an increment of velocity, and what of the position's is not half of it times the step
    kick, slip = np.sqrt(np.array(psd_m2_s3) * STEP_S), np.sqrt(np.array(psd_m2_s3) * STEP_S**3 / 12.0)
    for k, noise in enumerate(noises):
        gained = kick * noise[:3].T
        moved = STEP_S * (x[:, ALONG_RATE : UP_RATE + 1] + 0.5 * gained) + slip * noise[3:].T
        left = x[:, UP] + moved[:, UP]
        share = x[:, UP] / np.maximum(-moved[:, UP], 1e-9)
        at = x[:, : UP + 1] + share[:, None] * moved
        first = (left <= 0.0) & ~found.landed
        rates[first] = (x[:, ALONG_RATE:] + share[:, None] * gained)[first]
        found.land(left <= 0.0, at[:, ALONG], at[:, RIGHT], (k + share) * STEP_S)
        if np.all(found.landed):
            break
        x[:, : UP + 1] += moved
        x[:, ALONG_RATE:] += gained
    return found, rates
