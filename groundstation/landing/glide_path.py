"""Deviation from the planned glide path and from the centre line, with the values of needles and lights.

The point is the target point, the nose; the plan is the nose's path. Full scale of the glide-path needle is 0.24 of
the glide angle, as that of an ILS (ICAO Annex 10, volume I, 3.1.5: half of it at 0.12), but never less than the
vertical alert limit: near the aim point an ILS's needle gets sensitive without end. Full scale of the centre-line
needle is 2° to the side as seen from the aim point, but never less than to the runway's edge. The lights are those of
a PAPI (ICAO Annex 14, volume I, 5.3.5).
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.landing.threshold_state import (
    ALONG,
    ALONG_RATE,
    RIGHT,
    RIGHT_RATE,
    UP,
    UP_RATE,
    LinearValue,
    ThresholdState,
    threshold_state,
)
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.messages import Kinematics

GLIDE_FULL_SCALE_SHARE = 0.24
CENTRE_LINE_FULL_SCALE_RAD = math.radians(2.0)
# of a PAPI's four units, off the glide angle
PAPI_RAD = tuple(math.radians(minutes / 60.0) for minutes in (-30.0, -10.0, 10.0, 30.0))
# nearer to the aim point the angle to it says nothing
_NEAREST_M = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GlidePathDeviation:
    """Deviation above the planned path; the plan has one.

    Attributes
    ----------
    above : m above the path, negative below it.
    angle : rad, the same as seen from the aim point; None within 5 m of it and past it.
    full_scale_m : deviation at which the needle is at its end.
    needle : −1 … 1, where the path is as seen from the aircraft: positive above it, fly up.
    papi_white : of four lights those seen white; None as for ``angle``.
    """

    above: LinearValue
    angle: LinearValue | None
    full_scale_m: float
    needle: float
    papi_white: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachDeviations:
    """The aircraft against the runway and the plan at one time, each value with one sigma.

    Attributes
    ----------
    t_s : session time.
    to_threshold : m before the threshold along the landing direction, negative past it.
    height : m of the nose above the threshold.
    right : m right of the centre line, as the pilot sees it.
    right_rate : m/s, the same.
    sink_rate : m/s downwards.
    ground_speed : m/s along the landing direction.
    centre_line_full_scale_m : deviation at which that needle is at its end.
    centre_line_needle : −1 … 1, where the centre line is as seen from the aircraft: positive to the right, fly right.
    glide_path : None without a planned approach.
    """

    t_s: float
    to_threshold: LinearValue
    height: LinearValue
    right: LinearValue
    right_rate: LinearValue
    sink_rate: LinearValue
    ground_speed: LinearValue
    centre_line_full_scale_m: float
    centre_line_needle: float
    glide_path: GlidePathDeviation | None


def approach_deviations(site: LandingSite, t_s: float, kinematics: Kinematics) -> ApproachDeviations:
    """Return the deviations of an estimate. Raises `InputError` where a number of it is not finite."""
    state = threshold_state(site.runway, t_s, kinematics)
    right = state.component(RIGHT)
    aim_m = 0.0 if site.approach is None else site.approach.aim_past_threshold_m
    ahead_m = max(aim_m - float(state.mean[ALONG]), 0.0)
    full_scale_m = max(0.5 * site.runway.width_m, math.tan(CENTRE_LINE_FULL_SCALE_RAD) * ahead_m)
    return ApproachDeviations(
        t_s=t_s,
        to_threshold=state.component(ALONG, -1.0),
        height=state.component(UP),
        right=right,
        right_rate=state.component(RIGHT_RATE),
        sink_rate=state.component(UP_RATE, -1.0),
        ground_speed=state.component(ALONG_RATE),
        centre_line_full_scale_m=full_scale_m,
        centre_line_needle=_needle(right.value, full_scale_m),
        glide_path=None if site.approach is None else _glide_path(site, site.approach, state, ahead_m),
    )


def _glide_path(site: LandingSite, plan: PlannedApproach, state: ThresholdState, ahead_m: float) -> GlidePathDeviation:
    slope = math.tan(plan.glide_path_rad)
    above = state.value(_unit(UP) + slope * _unit(ALONG))
    above = LinearValue(above.value - slope * plan.aim_past_threshold_m, above.sigma)
    scale_rad = GLIDE_FULL_SCALE_SHARE * plan.glide_path_rad
    distance_m = math.hypot(ahead_m, float(state.mean[UP]))
    full_scale_m = max(site.alert_limits.vertical_m, math.tan(scale_rad) * distance_m)
    angle = None if ahead_m < _NEAREST_M else _angle(plan, state, ahead_m)
    white = None if angle is None else sum(angle.value > edge for edge in PAPI_RAD)
    return GlidePathDeviation(
        above=above,
        angle=angle,
        full_scale_m=full_scale_m,
        needle=_needle(above.value, full_scale_m),
        papi_white=white,
    )


def _angle(plan: PlannedApproach, state: ThresholdState, ahead_m: float) -> LinearValue:
    """Return the angle of elevation from the aim point, less the glide angle."""
    height = float(state.mean[UP])
    squared = ahead_m**2 + height**2
    # of atan(height / ahead): ahead falls as the aircraft goes along
    sigma = state.value((ahead_m * _unit(UP) + height * _unit(ALONG)) / squared).sigma
    return LinearValue(math.atan2(height, ahead_m) - plan.glide_path_rad, sigma)


def _needle(deviation_m: float, full_scale_m: float) -> float:
    return -min(max(deviation_m / full_scale_m, -1.0), 1.0) + 0.0


def _unit(place: int) -> FloatArray:
    return np.asarray(np.eye(6)[place], dtype=np.float64)
