"""What a vehicle's answers to TIMESYNC, or their absence, mean for the times to which it attributes positions."""

from dataclasses import dataclass

from groundstation.autopilot.parameter_rules import ParameterVerdict
from groundstation.autopilot.settings import AutopilotSettings
from groundstation.autopilot.vehicle_state import PX4, VehicleState

# PX4 sets its clock by TIMESYNC over links that are as fast as that, and else takes a message for as old as its arrival
_PX4_ROUND_TRIP_S = 0.01
# what is said of delays is said at this speed
_SPEED_M_S = 25.0
# of fewer answers the sigma is mostly what is assumed of a radio (`LinkDelay`); chosen, ten times what that counts for
_LEAST_ANSWERS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFinding:
    """How bad it is, and why."""

    finding: ParameterVerdict
    why: str

    def text(self) -> str:
        """Return it in one line."""
        return f"{self.finding:8} TIMESYNC: {self.why}"


def clock_finding(settings: AutopilotSettings, vehicle: VehicleState) -> ClockFinding:
    """Return what is to be said of a vehicle that has been asked for its time."""
    trip_s = vehicle.link_delay.least_round_trip_s
    px4 = vehicle.autopilot == PX4
    if trip_s is None:
        return _silent(settings, px4)
    words = f"round trips from {1e3 * trip_s:.0f} ms on"
    if px4 and trip_s >= _PX4_ROUND_TRIP_S:
        why = (
            f"{words}; PX4 sets its clock below {1e3 * _PX4_ROUND_TRIP_S:.0f} ms only, and takes each position for as "
            f"old as its arrival: what the delay varies by stays ({_variation_words(vehicle)})"
        )
        return ClockFinding(finding=ParameterVerdict.WARNING, why=why)
    return ClockFinding(finding=ParameterVerdict.OK, why=words)


def _variation_words(vehicle: VehicleState) -> str:
    """Return by how much the delay varies, if it has been seen often enough; else what a variation costs."""
    if vehicle.link_delay.answers < _LEAST_ANSWERS:
        return f"{_SPEED_M_S * 0.01:.2f} m for each 10 ms at {_SPEED_M_S:g} m/s"
    sigma_s = vehicle.link_delay.one_way_sigma_s
    return f"{1e3 * sigma_s:.0f} ms, {_SPEED_M_S * sigma_s:.1f} m at {_SPEED_M_S:g} m/s, one sigma"


def _silent(settings: AutopilotSettings, px4: bool) -> ClockFinding:
    stated_s = settings.link_delay_s
    if stated_s is None:
        # ArduPilot takes each message to be as fast as the fastest
        whose = "all of it" if px4 else "that of the fastest message"
        why = (
            "no answer; the radio's delay counts as 0 unless link_delay_s states it, and positions are late by "
            f"{whose}: {_SPEED_M_S * 0.1:.1f} m for 100 ms at {_SPEED_M_S:g} m/s"
        )
    else:
        why = f"no answer; the radio's delay is what link_delay_s states, {1e3 * stated_s:.0f} ms, all the time"
    if px4:
        why += "; PX4 takes each position for as old as its arrival, whatever the delay varies by"
    return ClockFinding(finding=ParameterVerdict.WARNING, why=why)
