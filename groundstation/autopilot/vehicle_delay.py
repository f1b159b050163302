"""What a vehicle's parameters say of the age of measurements: the delay that it assumes, and how much it remembers."""

from groundstation.autopilot.settings import MOST_DELAY_S, AutopilotMode, AutopilotSettings
from groundstation.autopilot.vehicle_state import ARDUPILOT, VehicleState

# by mode, the parameters of ArduPilot and of PX4 that state the delay, ms, the newest name first
_DELAY_PARAMETERS = {
    AutopilotMode.GPS_INPUT: ("GPS1_DELAY_MS", "GPS_DELAY_MS"),
    AutopilotMode.GLOBAL_POSITION: ("EKF2_AGP0_DELAY", "EKF2_AGP_DELAY"),
    AutopilotMode.VISION: ("VISO_DELAY_MS", "EKF2_EV_DELAY"),
    AutopilotMode.ODOMETRY: ("VISO_DELAY_MS", "EKF2_EV_DELAY"),
}
# EKF3 remembers as long as the longest delay of its sensors, whether there are such sensors or not; a compass has 60 ms
EKF3_MEMORY_PARAMETERS = ("EK3_HGT_DELAY", "EK3_FLOW_DELAY", "EK3_BCN_DELAY")
_COMPASS_S = 0.06


def delay_parameters(settings: AutopilotSettings) -> tuple[str, ...]:
    """Return the names of the parameters that state the delay of a stream's measurements: of its own receiver."""
    if settings.mode is AutopilotMode.GPS_INPUT and settings.gps_id > 0:
        number = settings.gps_id + 1
        return (f"GPS{number}_DELAY_MS", f"GPS_DELAY_MS{number}")
    return _DELAY_PARAMETERS[settings.mode]


def asked_parameters(settings: AutopilotSettings, vehicle: VehicleState) -> tuple[str, ...]:
    """Return the names of the parameters that a stream wants to know of a vehicle."""
    return delay_parameters(settings) + (EKF3_MEMORY_PARAMETERS if vehicle.autopilot == ARDUPILOT else ())


def assumed_delay_s(settings: AutopilotSettings, vehicle: VehicleState) -> float:
    """Return how long before its arrival the vehicle takes a measurement to be, s."""
    if settings.delay_s is not None:
        return settings.delay_s
    for name in delay_parameters(settings):
        if name in vehicle.parameters:
            delay_s = 1e-3 * vehicle.parameters[name]
            # ArduPilot: zero leaves it to the receiver's driver
            zero = settings.mode is AutopilotMode.GPS_INPUT and delay_s == 0.0
            return settings.assumed_delay_s if zero else delay_s
    return settings.assumed_delay_s


def ekf3_memory_s(settings: AutopilotSettings, vehicle: VehicleState) -> float:
    """Return how old a measurement may be when ArduPilot's filter takes it, s; an older one counts as of that age."""
    told = [1e-3 * vehicle.parameters[name] for name in EKF3_MEMORY_PARAMETERS if name in vehicle.parameters]
    longest_s = max(_COMPASS_S, assumed_delay_s(settings, vehicle), *told)
    return min(longest_s, MOST_DELAY_S[AutopilotMode.GPS_INPUT])
