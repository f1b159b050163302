"""What a vehicle's messages change in its `VehicleState`, and what is answered."""

import math
import struct
from collections.abc import Mapping

import numpy as np

from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.vehicle_attitude import VehicleAttitude
from groundstation.autopilot.vehicle_state import PX4, GnssReport, VehicleState

# MAV_AUTOPILOT_INVALID: a ground station, a camera, a companion computer
_NO_AUTOPILOT = 8
_MOST_PARAMETERS = 5000
# answers may overtake each other by less
_STARTED_AGAIN_S = 2.0
# MAV_PARAM_TYPE of whole numbers of up to 32 bits
_INTEGERS = (1, 2, 3, 4, 5, 6)


def answer_time_request(fields: Mapping[str, object], link_ns: int) -> MavlinkMessage | None:
    """Return the answer to a vehicle's TIMESYNC request, ``link_ns`` on this link's clock; None to an answer."""
    if fields.get("tc1") != 0:
        return None
    return MavlinkMessage(name="TIMESYNC", fields={"tc1": link_ns, "ts1": fields["ts1"]})


def receive(
    vehicle: VehicleState,
    name: str,
    fields: Mapping[str, object],
    source: tuple[int, int],
    received_s: float,
    *,
    link_s: float,
    target_system: int = 0,
) -> None:
    """Take one message of ``source``, system and component, into the vehicle's state.

    Parameters
    ----------
    received_s : session time; plus ``link_s`` it is the time of the link's clock, s.
    target_system : the vehicle's; 0 takes the first autopilot that is heard.
    """
    if name == "HEARTBEAT":
        _heartbeat(vehicle, fields, source, received_s, target_system)
    if source[0] != vehicle.system or vehicle.component not in (None, source[1]):
        return
    vehicle.heard_s = received_s
    if name == "ATTITUDE":
        rates = np.array([_number(fields, key) for key in ("rollspeed", "pitchspeed", "yawspeed")])
        roll, pitch, yaw = (_number(fields, key) for key in ("roll", "pitch", "yaw"))
        attitude = VehicleAttitude.from_euler(received_s, roll, pitch, yaw, rates)
        vehicle.attitude = attitude or vehicle.attitude
    elif name == "ATTITUDE_QUATERNION":
        rates = np.array([_number(fields, key) for key in ("rollspeed", "pitchspeed", "yawspeed")])
        wxyz = np.array([_number(fields, f"q{k}") for k in (1, 2, 3, 4)])
        vehicle.attitude = VehicleAttitude.from_quaternion(received_s, wxyz, rates) or vehicle.attitude
    elif name == "TIMESYNC":
        sent_ns, vehicle_ns = _number(fields, "ts1"), _number(fields, "tc1")
        if vehicle_ns > 0 and math.isfinite(sent_ns):
            _clock(vehicle, 1e-9 * vehicle_ns)
            vehicle.link_delay.answered(1e-9 * sent_ns - link_s, 1e-9 * vehicle_ns, received_s)
    elif name == "GPS_GLOBAL_ORIGIN":
        lat_deg, lon_deg = (1e-7 * _number(fields, key) for key in ("latitude", "longitude"))
        if lat_deg or lon_deg:
            vehicle.global_origin = (lat_deg, lon_deg, 1e-3 * _number(fields, "altitude"))
    elif name in ("GPS_RAW_INT", "GPS2_RAW"):
        _gnss(vehicle, int(name == "GPS2_RAW"), fields, received_s)
    elif name == "PARAM_VALUE" and len(vehicle.parameters) < _MOST_PARAMETERS:
        vehicle.parameters[str(fields.get("param_id"))] = _parameter(vehicle, fields)


def _heartbeat(
    vehicle: VehicleState,
    fields: Mapping[str, object],
    source: tuple[int, int],
    received_s: float,
    target_system: int,
) -> None:
    system, component = source
    if fields.get("autopilot") == _NO_AUTOPILOT or target_system not in (0, system):
        return
    if vehicle.system is None:
        vehicle.system = system
    if vehicle.system == system and vehicle.component is None:
        vehicle.component = component
    if (vehicle.system, vehicle.component) == source:
        vehicle.autopilot = int(_number(fields, "autopilot"))
        vehicle.heard_s = received_s


def _clock(vehicle: VehicleState, clock_s: float) -> None:
    """Note the vehicle's clock; one that has started again has no origin of its local frame any more."""
    if vehicle.clock_s is not None and clock_s < vehicle.clock_s - _STARTED_AGAIN_S:
        vehicle.global_origin = None
    vehicle.clock_s = clock_s


def _gnss(vehicle: VehicleState, receiver: int, fields: Mapping[str, object], received_s: float) -> None:
    lat_deg, lon_deg = (1e-7 * _number(fields, key) for key in ("lat", "lon"))
    fix_type = _number(fields, "fix_type")
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and (lat_deg or lon_deg) and math.isfinite(fix_type)):
        return
    vehicle.gnss[receiver] = GnssReport(
        received_s=received_s,
        source_us=int(_number(fields, "time_usec")),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_amsl_m=1e-3 * _number(fields, "alt"),
        sigma_horizontal_m=_accuracy(fields, "h_acc"),
        sigma_vertical_m=_accuracy(fields, "v_acc"),
        fix_type=int(fix_type),
    )


def _parameter(vehicle: VehicleState, fields: Mapping[str, object]) -> float:
    """Return a parameter's value; PX4 sends an integer as the float of the same 32 bits."""
    value = _number(fields, "param_value")
    if vehicle.autopilot != PX4 or fields.get("param_type") not in _INTEGERS or not math.isfinite(value):
        return value
    return float(struct.unpack("<i", struct.pack("<f", value))[0])


def _accuracy(fields: Mapping[str, object], key: str) -> float | None:
    """Return an accuracy, mm in the message, in m; None where it is zero or not there (MAVLink 1)."""
    value = 1e-3 * _number(fields, key)
    return value if math.isfinite(value) and value > 0.0 else None


def _number(fields: Mapping[str, object], key: str) -> float:
    """Return a field as a number, NaN if it is none."""
    value = fields.get(key)
    return float(value) if isinstance(value, int | float) else math.nan
