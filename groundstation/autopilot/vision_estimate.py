"""VISION_POSITION_ESTIMATE (102), VISION_SPEED_ESTIMATE (103) and ODOMETRY (331): the external vision interfaces.

No attitude is observed. The vision messages' angles are zero with the variance of no knowledge; ODOMETRY holds the
attitude that the vehicle reported, or NaN.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.message import MavlinkMessage, upper_triangle
from groundstation.autopilot.navigation_state import NavigationState
from groundstation.geometry.rotation import matrix_from_wxyz

# ArduPilot takes no other pair, and without a word
FRAME_LOCAL_FRD, FRAME_BODY_FRD = 20, 12
_ESTIMATOR_VISION = 2
# of an angle of which nothing is known: uniform over a turn
_UNKNOWN_ANGLE_RAD2 = math.pi**2 / 3.0
# a variance of zero means none: 1 cm, 1 cm/s
_LEAST_M2 = 1e-4


def vision_estimates(state: NavigationState, *, stamp_us: int, reset_counter: int) -> tuple[MavlinkMessage, ...]:
    """Return position and speed of a state, north, east, down of the global origin that the vehicle was given."""
    position = [float(v) for v in state.position_ned_m]
    velocity = [float(v) for v in state.velocity_ned_m_s]
    return (
        MavlinkMessage(
            name="VISION_POSITION_ESTIMATE",
            fields={
                "usec": stamp_us,
                "x": position[0],
                "y": position[1],
                "z": position[2],
                "roll": 0.0,
                "pitch": 0.0,
                "yaw": 0.0,
                "covariance": _pose_covariance(state),
                "reset_counter": reset_counter,
            },
        ),
        MavlinkMessage(
            name="VISION_SPEED_ESTIMATE",
            fields={
                "usec": stamp_us,
                "x": velocity[0],
                "y": velocity[1],
                "z": velocity[2],
                "covariance": _floored(state.covariance[3:, 3:]).ravel().tolist(),
                "reset_counter": reset_counter,
            },
        ),
    )


def odometry(state: NavigationState, *, stamp_us: int, reset_counter: int, quality: int) -> MavlinkMessage:
    """Return the whole state in one message.

    The velocity is in body axes, by the vehicle's own attitude; without one it is NaN, as the attitude is.
    ``quality`` from 1 to 100.
    """
    turned, attitude = np.full(3, math.nan), [math.nan] * 4
    velocity_covariance = [math.nan] * 21
    if state.attitude_wxyz is not None:
        body_from_ned = matrix_from_wxyz(state.attitude_wxyz).T
        turned = body_from_ned @ state.velocity_ned_m_s
        attitude = [float(v) for v in state.attitude_wxyz]
        velocity_covariance = _with_unknown_angles(body_from_ned @ state.covariance[3:, 3:] @ body_from_ned.T)
    position = [float(v) for v in state.position_ned_m]
    return MavlinkMessage(
        name="ODOMETRY",
        fields={
            "time_usec": stamp_us,
            "frame_id": FRAME_LOCAL_FRD,
            "child_frame_id": FRAME_BODY_FRD,
            "x": position[0],
            "y": position[1],
            "z": position[2],
            "q": attitude,
            "vx": float(turned[0]),
            "vy": float(turned[1]),
            "vz": float(turned[2]),
            "rollspeed": math.nan,
            "pitchspeed": math.nan,
            "yawspeed": math.nan,
            "pose_covariance": _pose_covariance(state),
            "velocity_covariance": velocity_covariance,
            "reset_counter": reset_counter,
            "estimator_type": _ESTIMATOR_VISION,
            "quality": quality,
        },
    )


def global_origin(
    lat_deg: float, lon_deg: float, height_amsl_m: float, *, system: int, stamp_us: int
) -> MavlinkMessage:
    """Return SET_GPS_GLOBAL_ORIGIN (48): where the local frame of the vision messages begins."""
    return MavlinkMessage(
        name="SET_GPS_GLOBAL_ORIGIN",
        fields={
            "target_system": system,
            "latitude": round(lat_deg * 1e7),
            "longitude": round(lon_deg * 1e7),
            "altitude": round(height_amsl_m * 1e3),
            "time_usec": stamp_us,
        },
    )


def _pose_covariance(state: NavigationState) -> list[float]:
    return _with_unknown_angles(state.covariance[:3, :3])


def _with_unknown_angles(covariance: FloatArray) -> list[float]:
    """Return the 21 numbers of a covariance (3, 3) and of three angles, or rates, that are not known."""
    whole = np.diag([0.0] * 3 + [_UNKNOWN_ANGLE_RAD2] * 3)
    whole[:3, :3] = _floored(covariance)
    return upper_triangle(whole.tolist())


def _floored(covariance: FloatArray) -> FloatArray:
    return covariance + np.diag(np.maximum(_LEAST_M2 - np.diag(covariance), 0.0))
