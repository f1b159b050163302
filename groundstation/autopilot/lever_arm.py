"""From the nose, which the cameras see, to the point of the vehicle that its autopilot takes a position for.

With the vehicle's own attitude the arm is turned by it. Without one the track's direction stands for the nose's: the
aircraft may crab, bank and pitch, and what that moves the point by enters the covariance.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.vehicle_attitude import VehicleAttitude
from groundstation.geometry.rotation import rotation_y, rotation_z

# One sigma of roll, pitch and yaw against the track's direction while the vehicle does not report them: a bank of a
# coordinated correction, the range of angles of attack of a slow approach, and a crab of 15° at 1.5 sigma (a cross
# wind of a quarter of the airspeed). Stated, not measured.
_UNKNOWN_SIGMA_RAD = np.radians([12.0, 6.0, 10.0])
# one sigma of an attitude that the vehicle reports, with what its telemetry is late: 20 ms at 60 °/s of roll, and 2°
_REPORTED_SIGMA_RAD = np.radians([2.5, 2.0, 2.5])
# below this speed a track has no direction
_SLOW_M_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovedState:
    """Position, velocity and covariance (6, 6) of a point of the vehicle, north, east, down."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    covariance: FloatArray


def moved_to_reference(state: MovedState, arm_body_m: FloatArray, attitude: VehicleAttitude | None) -> MovedState:
    """Return the state of the point at ``arm_body_m`` (3,) from the nose: forward, right, down.

    ``attitude`` at the time of the state; None if it is not known.
    """
    if not np.any(arm_body_m):
        return state
    if attitude is None:
        return _along_track(state, arm_body_m)
    moved = _moved(state, arm_body_m, attitude.ned_from_body, _REPORTED_SIGMA_RAD)
    turned = attitude.ned_from_body @ np.cross(attitude.rates_rad_s, arm_body_m)
    return MovedState(
        position_m=moved.position_m, velocity_m_s=moved.velocity_m_s + turned, covariance=moved.covariance
    )


def _along_track(state: MovedState, arm_body_m: FloatArray) -> MovedState:
    north, east, down = state.velocity_m_s
    speed = float(np.hypot(north, east))
    if speed < _SLOW_M_S:
        # any heading: the arm's length in each direction
        covariance = state.covariance.copy()
        covariance[:3, :3] += np.eye(3) * float(arm_body_m @ arm_body_m)
        return MovedState(position_m=state.position_m, velocity_m_s=state.velocity_m_s, covariance=covariance)
    body = rotation_z(float(np.arctan2(east, north))) @ rotation_y(float(np.arctan2(-down, speed)))
    return _moved(state, arm_body_m, body, _UNKNOWN_SIGMA_RAD)


def _moved(state: MovedState, arm_m: FloatArray, ned_from_body: FloatArray, sigma_rad: FloatArray) -> MovedState:
    x, y, z = arm_m
    # a small turn of the body about its own axes moves the point by the turn's cross product with the arm
    by_turn = ned_from_body @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    covariance = state.covariance.copy()
    covariance[:3, :3] += by_turn @ np.diag(np.asarray(sigma_rad) ** 2) @ by_turn.T
    return MovedState(
        position_m=state.position_m + ned_from_body @ arm_m, velocity_m_s=state.velocity_m_s, covariance=covariance
    )
