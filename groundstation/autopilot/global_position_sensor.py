"""GLOBAL_POSITION_SENSOR (296) for PX4's EKF2_AGP: a global position with its sigma."""

from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.navigation_state import NavigationState

_SOURCE_VISION = 2
# EKF2_AGP*_NOISE is at least this
_LEAST_SIGMA_M = 0.01


def global_position_sensor(
    state: NavigationState, *, sent_us: int, age_us: int, sensor_id: int, target: tuple[int, int]
) -> MavlinkMessage:
    """Return the message of a state.

    Parameters
    ----------
    sent_us : when it is sent, on the link's clock.
    age_us : how old the state is by then: the message's processing time.
    sensor_id : EKF2_AGP*_ID of the vehicle.
    target : system and component that it is for.
    """
    return MavlinkMessage(
        name="GLOBAL_POSITION_SENSOR",
        fields={
            "target_system": target[0],
            "target_component": target[1],
            "id": sensor_id,
            "time_usec": sent_us,
            "processing_time": max(age_us, 0),
            "source": _SOURCE_VISION,
            "flags": 0,
            "lat": round(state.geodetic.lat_deg * 1e7),
            "lon": round(state.geodetic.lon_deg * 1e7),
            "alt_ellipsoid": state.geodetic.height_ellipsoid_m,
            "alt": state.geodetic.height_amsl_m,
            "eph": max(state.horizontal_sigma_m, _LEAST_SIGMA_M),
            "epv": max(state.vertical_sigma_m, _LEAST_SIGMA_M),
        },
    )
