"""Attitude of an aircraft on a trajectory: heading along the track, constant incidence, coordinated turns.

A trajectory is of the nose alone. Heading is the track's (no crab), bank is that of a coordinated turn,
tan(bank) = lateral acceleration / g; on its wheels the aircraft is level.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import cross
from groundstation.simulation.trajectory import Trajectory

GRAVITY_M_S2 = 9.81
_STEP_S = 0.15
_MAX_BANK_RAD = math.radians(35.0)
_INCIDENCE_RAD = math.radians(4.0)
_SLOW_M_S = 0.5
# above its wheels' rest by so much, it flies
_FLYING_M = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftPose:
    """Pose of an aircraft: its nose (3,) in m, runway frame, and ``runway_from_body`` (3, 3).

    The body frame is x forward, y right, z down; ``velocity_runway_m_s`` (3,) is the nose's.
    """

    position_runway_m: FloatArray
    velocity_runway_m_s: FloatArray
    runway_from_body: FloatArray


def pose_at(trajectory: Trajectory, t_s: float, rest_height_m: float) -> AircraftPose:
    """Return the pose at a true session time, s; ``rest_height_m`` is the nose's on the ground."""
    times = np.array([t_s - _STEP_S, t_s, t_s + _STEP_S])
    position = trajectory.position(times)[1]
    velocities = trajectory.velocity(times)
    velocity = velocities[1]
    share = float(np.clip((position[2] - rest_height_m) / _FLYING_M, 0.0, 1.0))
    flying = share * share * (3.0 - 2.0 * share)
    level = math.hypot(velocity[0], velocity[1])
    if level < _SLOW_M_S:
        heading = np.array([0.0, -1.0])
        climb = 0.0
    else:
        heading = velocity[:2] / level
        climb = math.atan2(velocity[2], level)
    acceleration = (velocities[2] - velocities[0]) / (2.0 * _STEP_S)
    # to the right of the heading
    lateral = acceleration[0] * heading[1] - acceleration[1] * heading[0]
    bank = flying * float(np.clip(math.atan2(lateral, GRAVITY_M_S2), -_MAX_BANK_RAD, _MAX_BANK_RAD))
    pitch = flying * (climb + _INCIDENCE_RAD)
    return AircraftPose(
        position_runway_m=position,
        velocity_runway_m_s=velocity,
        runway_from_body=runway_from_body(heading, pitch, bank),
    )


def runway_from_body(heading: FloatArray, pitch_rad: float, bank_rad: float) -> FloatArray:
    """Return the rotation (3, 3) of a body: unit heading (2,) in the runway plane, pitch nose up, bank right."""
    cp, sp, cb, sb = math.cos(pitch_rad), math.sin(pitch_rad), math.cos(bank_rad), math.sin(bank_rad)
    forward = np.array([cp * heading[0], cp * heading[1], sp])
    right_level = np.array([heading[1], -heading[0], 0.0])
    down_level = cross(forward, right_level)
    right = cb * right_level + sb * down_level
    return np.column_stack([forward, right, cross(forward, right)])
