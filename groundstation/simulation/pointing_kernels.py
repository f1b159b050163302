"""Compiled loops of the simulator: many projections, many aims, and a servo loop with its limits.

A station is the packed array of `groundstation.geometry.station`; angles are (pan, tilt) in rad.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.geometry.kernels import MIN_DEPTH_M, project, turned_back
from groundstation.geometry.station_layout import (
    CX,
    CY,
    PTU_POSITION,
    RUNWAY_FROM_BASE,
)

_AIM_STEPS = 12
_AIM_TOLERANCE_RAD = 1e-13


@njit(cache=True)
def project_many(
    s: FloatArray, points: FloatArray, angles: FloatArray, pixels: FloatArray, by_angle: FloatArray
) -> FloatArray:
    """Project points (n, 3) at angles (n, 2); fill pixels (n, 2) and ∂pixel/∂angle (n, 2, 2); return depths (n,).

    What is not in front of the camera keeps what stood in the two arrays.
    """
    depths = np.empty(len(points))
    jacobian = np.empty((2, 5))
    for k in range(len(points)):
        depths[k] = project(s, points[k], angles[k, 0], angles[k, 1], pixels[k], jacobian)
        if depths[k] >= MIN_DEPTH_M:
            by_angle[k] = jacobian[:, 3:]
    return depths


@njit(cache=True)
def aim_many(s: FloatArray, points: FloatArray) -> FloatArray:
    """Return the angles (n, 2) that put points (n, 3) on the optical axis, lever arm and boresight included.

    Newton's method from the bearing at the axes' crossing; where it leaves the picture, that bearing stays.
    """
    angles = np.empty((len(points), 2))
    pixel = np.empty(2)
    jacobian = np.empty((2, 5))
    for k in range(len(points)):
        d0, d1, d2 = (
            points[k, 0] - s[PTU_POSITION],
            points[k, 1] - s[PTU_POSITION + 1],
            points[k, 2] - s[PTU_POSITION + 2],
        )
        b0, b1, b2 = turned_back(s, RUNWAY_FROM_BASE, d0, d1, d2)
        pan, tilt = -np.arctan2(b0, b1), np.arctan2(b2, np.hypot(b0, b1))
        angles[k, 0], angles[k, 1] = pan, tilt
        for _ in range(_AIM_STEPS):
            depth = project(s, points[k], pan, tilt, pixel, jacobian)
            a, b, c, d = jacobian[0, 3], jacobian[0, 4], jacobian[1, 3], jacobian[1, 4]
            determinant = a * d - b * c
            if depth < MIN_DEPTH_M or determinant == 0.0:
                break
            eu, ev = pixel[0] - s[CX], pixel[1] - s[CY]
            step_pan, step_tilt = (d * eu - b * ev) / determinant, (a * ev - c * eu) / determinant
            # far from the axis Newton's step may overshoot
            longest = max(abs(step_pan), abs(step_tilt))
            share = min(1.0, 0.5 / longest) if longest > 0.0 else 1.0
            pan -= share * step_pan
            tilt -= share * step_tilt
            if longest < _AIM_TOLERANCE_RAD:
                break
            # no axis turns further than this to centre a target; the last good aim stays
            if abs(tilt) < 0.5 * np.pi:
                angles[k, 0], angles[k, 1] = pan, tilt
    return angles


@njit(cache=True)
def simulate_axis(
    command: FloatArray,
    dt: float,
    gains: FloatArray,
    max_rate: float,
    max_acceleration: float,
    angle: FloatArray,
    rate: FloatArray,
) -> None:
    """Drive one axis after its commands (n,) rad, ``dt`` s apart; fill angle (n,) and rate (n,) from their first.

    ``gains`` is (1/τ,) of a first-order loop with demanded rate, or (ω², 2ζω) of a second-order one with
    demanded acceleration. Acceleration is constant within a step, so rate and acceleration never exceed
    their limits, not even between the samples.
    """
    for k in range(len(command) - 1):
        error = command[k] - angle[k]
        if len(gains) == 1:
            demand = min(max(gains[0] * error, -max_rate), max_rate)
            acceleration = (demand - rate[k]) / dt
        else:
            acceleration = gains[0] * error - gains[1] * rate[k]
        acceleration = min(max(acceleration, -max_acceleration), max_acceleration)
        rate[k + 1] = min(max(rate[k] + acceleration * dt, -max_rate), max_rate)
        angle[k + 1] = angle[k] + 0.5 * dt * (rate[k] + rate[k + 1])


@njit(cache=True)
def apply_backlash(motor: FloatArray, gap: float, head: FloatArray) -> None:
    """Drag the head (n,) along behind the motor (n,), within ± half the gap; ``head[0]`` is given."""
    for k in range(1, len(motor)):
        head[k] = min(max(head[k - 1], motor[k] - 0.5 * gap), motor[k] + 0.5 * gap)
