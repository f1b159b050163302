"""A real flight's log as a trajectory: smoothed, turned and shifted so that it lands on the runway."""

import math

import numpy as np
from scipy.interpolate import UnivariateSpline

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_positive, require_rising, require_shape
from groundstation.simulation.trajectory import SampledTrajectory

_STEP_S = 0.02
_QUINTIC = 5
MIN_SAMPLES = 50
MAX_SAMPLES = 50_000
_MIN_APPROACH_SPEED_M_S = 1.0


def trajectory_from_log(
    t_s: FloatArray,
    position_enu_m: FloatArray,
    *,
    touchdown_s: float,
    before_s: float = 40.0,
    after_s: float = 0.0,
    touchdown_y_m: float = 60.0,
    touchdown_z_m: float = 0.3,
    sigma_m: float = 0.03,
    heading_s: float = 5.0,
) -> SampledTrajectory:
    """Return the landing of a log as a trajectory in the runway frame; time 0 is ``before_s`` before touchdown.

    The samples are smoothed by a quintic spline of the given noise, turned about the vertical so that the last
    ``heading_s`` before touchdown lead along −y, and shifted so that the aircraft touches down at
    (0, ``touchdown_y_m``, ``touchdown_z_m``).

    Parameters
    ----------
    t_s : (n,) rising, the log's own clock.
    position_enu_m : (n, 3) east, north, up of any near-by origin.
    touchdown_s : when it lands, in the log's clock.
    sigma_m : noise of one sample, per axis: what the spline may leave unexplained.
    """
    require_rising("trajectory_from_log: t_s", t_s)
    require_shape("trajectory_from_log: position_enu_m", position_enu_m, (t_s.size, 3))
    require_positive("trajectory_from_log: before_s", before_s)
    require_positive("trajectory_from_log: sigma_m", sigma_m)
    require(
        0 < heading_s <= before_s, "trajectory_from_log: heading_s", got=heading_s, wanted="above 0, up to before_s"
    )
    # a second more on either side: a spline is worst at its ends
    first_s, last_s = touchdown_s - before_s, touchdown_s + after_s
    chosen = (t_s >= first_s - 1.0) & (t_s <= last_s + 1.0)
    count = int(chosen.sum())
    there = f"{count} samples from {first_s:g} to {last_s:g} s of a log from {t_s[0]:g} to {t_s[-1]:g} s"
    covered = t_s[0] <= first_s and last_s <= t_s[-1] and MIN_SAMPLES <= count <= MAX_SAMPLES
    require(covered, "trajectory_from_log", got=there, wanted=f"{MIN_SAMPLES} to {MAX_SAMPLES} samples that cover it")
    local = t_s[chosen] - first_s
    splines = [
        UnivariateSpline(local, position_enu_m[chosen, axis], w=np.full(count, 1.0 / sigma_m), k=_QUINTIC, s=count)
        for axis in range(3)
    ]
    times = np.append(np.arange(0.0, before_s + after_s - 0.5 * _STEP_S, _STEP_S), before_s + after_s)
    position = np.column_stack([spline(times) for spline in splines])
    velocity = np.column_stack([spline.derivative()(times) for spline in splines])
    at_start, at_end = (np.array([s(moment) for s in splines]) for moment in (before_s - heading_s, before_s))
    runway_from_enu = _turn(at_end - at_start, heading_s)
    place = np.array([0.0, touchdown_y_m, touchdown_z_m])
    return SampledTrajectory(
        t_s=times,
        position_m=(position - at_end) @ runway_from_enu.T + place,
        velocity_m_s=velocity @ runway_from_enu.T,
    )


def _turn(travelled_enu_m: FloatArray, over_s: float) -> FloatArray:
    """Return the turn about the vertical (3, 3) that puts a horizontal displacement (3,) along −y."""
    east, north = travelled_enu_m[:2]
    speed = math.hypot(east, north) / over_s
    wanted = f"at least {_MIN_APPROACH_SPEED_M_S:g} m/s over ground before touchdown"
    require(speed >= _MIN_APPROACH_SPEED_M_S, "trajectory_from_log: touchdown_s", got=f"{speed:.3g} m/s", wanted=wanted)
    angle = -math.pi / 2 - math.atan2(north, east)
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
