"""GPS_INPUT (232) for ArduPilot's ``GPS1_TYPE = 14``: the estimate in a receiver's place."""

from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.navigation_state import NavigationState
from groundstation.session.logs.gps_time import WEEK_S, TimeScale, civil_from_unix, gps_from_civil

_WEEK_MS = round(1e3 * WEEK_S)
# A rollover of the ten-bit week. A computer that has not been told the date counts from 1970: weeks below 0 the message
# cannot hold, and 0 ArduPilot does not take. It wants differences of times alone, so that they are an era later
_ERA_WEEKS = 1024
_FIX_3D = 3
# number of satellites not known: there are none. ArduPilot's checks want six
_NO_SATELLITES = 255
# accuracy over dilution of precision, as receivers count it: the user range error of one sigma
_RANGE_ERROR_M = 1.0
_LEAST_DOP = 0.5
# an accuracy of zero is taken for none
_LEAST_SIGMA_M, _LEAST_SIGMA_M_S = 0.01, 0.01


def gps_week(unix_s: float) -> tuple[int, int]:
    """Return the GPS week and the milliseconds into it of a Unix time, s."""
    gps_s = gps_from_civil(*civil_from_unix(unix_s), TimeScale.UTC)
    return divmod(round(1e3 * gps_s), _WEEK_MS)


def gps_input(state: NavigationState, *, stamp_us: int, unix_s: float, gps_id: int) -> MavlinkMessage:
    """Return the message of a state.

    Parameters
    ----------
    stamp_us : its time on the link's clock.
    unix_s : its Unix time: ArduPilot takes the jitter of the radio out of it, a constant offset does not matter.
    gps_id : which of the vehicle's receivers it stands for, from 0.
    """
    week, week_ms = gps_week(unix_s)
    week += 0 if week > 0 else _ERA_WEEKS
    horizontal = max(state.horizontal_sigma_m, _LEAST_SIGMA_M)
    vertical = max(state.vertical_sigma_m, _LEAST_SIGMA_M)
    north, east, down = (float(v) for v in state.velocity_ned_m_s)
    return MavlinkMessage(
        name="GPS_INPUT",
        fields={
            "time_usec": stamp_us,
            "gps_id": gps_id,
            "ignore_flags": 0,
            "time_week_ms": week_ms,
            "time_week": week,
            "fix_type": _FIX_3D,
            "lat": round(state.geodetic.lat_deg * 1e7),
            "lon": round(state.geodetic.lon_deg * 1e7),
            "alt": state.geodetic.height_amsl_m,
            "hdop": max(horizontal / _RANGE_ERROR_M, _LEAST_DOP),
            "vdop": max(vertical / _RANGE_ERROR_M, _LEAST_DOP),
            "vn": north,
            "ve": east,
            "vd": down,
            "speed_accuracy": max(state.speed_sigma_m_s, _LEAST_SIGMA_M_S),
            "horiz_accuracy": horizontal,
            "vert_accuracy": vertical,
            "satellites_visible": _NO_SATELLITES,
            # the course of the track is no heading: 0 is unknown
            "yaw": 0,
        },
    )
