"""Asks a vehicle for its parameters and states which of them make it ignore or misuse the stream."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from groundstation.autopilot.clock_finding import ClockFinding, clock_finding
from groundstation.autopilot.link_url import parse_link_url
from groundstation.autopilot.mavlink_link import MavlinkLink
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.parameter_rules import (
    ParameterFinding,
    ParameterVerdict,
    check_parameters,
    parameter_rules,
)
from groundstation.autopilot.received import receive
from groundstation.autopilot.settings import AutopilotSettings
from groundstation.autopilot.signing_key import read_signing_key
from groundstation.autopilot.stream import HEARTBEAT
from groundstation.autopilot.vehicle_state import ARDUPILOT, PX4, VehicleState
from groundstation.errors import InputError

_NAMES = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
_ASK_EVERY_S, _ASKED_TIMES = 0.5, 6
# requests of the time, and how long their answers may take
_CLOCK_ASKED_TIMES, _CLOCK_EVERY_S = 5, 0.3
_WAIT_S = 0.01
# of PX4's parameters, those that are integers
_INTEGERS_OF_PX4 = ("_CTRL", "_ID", "HGT_REF", "NOISE_MD", "QMIN", "_MODE")


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleCheck:
    """Result of a check: the vehicle in words, the findings, the worst first, and the parameter file recommended."""

    vehicle: str
    findings: tuple[ParameterFinding, ...]
    clock: ClockFinding
    parameter_file: str

    @property
    def whole(self) -> bool:
        """Whether nothing found makes the vehicle ignore or misuse the stream."""
        return not any(f.finding is ParameterVerdict.ERROR for f in self.findings)


def check_vehicle(
    settings: AutopilotSettings,
    wait_s: float,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> VehicleCheck:
    """Ask the vehicle of a link; waits up to ``wait_s`` for it to be heard.

    Raises `InputError` where none is heard or where it cannot take the stream, `ConfigError` for a link that cannot be
    opened, `MissingExtraError` without pymavlink.
    """
    start_s = clock()
    key = None if settings.signing_key is None else read_signing_key(settings.signing_key)
    link = MavlinkLink(
        parse_link_url(settings.url),
        (settings.system_id, settings.component_id),
        lambda: clock() - start_s,
        lambda: round(1e9 * clock()),
        key,
    )
    try:
        vehicle = VehicleState()
        _converse(link, vehicle, settings, wait_s, clock, sleep, [HEARTBEAT], lambda: vehicle.system is not None)
        if vehicle.system is None or vehicle.autopilot is None:
            raise InputError(settings.url, got=f"no vehicle's heartbeat in {wait_s:g} s", wanted="one that answers")
        rules = parameter_rules(vehicle.autopilot, settings)
        if isinstance(rules, str):
            raise InputError(f"vehicle {vehicle.system}", got=rules, wanted="a mode that it takes")
        names = [name for rule in rules for name in rule.names]
        system = vehicle.system
        for _ in range(_ASKED_TIMES):
            asked = [_request(system, name) for name in names if name not in vehicle.parameters]
            _converse(
                link,
                vehicle,
                settings,
                _ASK_EVERY_S,
                clock,
                sleep,
                asked,
                lambda: all(any(n in vehicle.parameters for n in rule.names) for rule in rules),
            )
        _ask_time(link, vehicle, settings, clock, sleep, start_s)
    finally:
        link.close()
    findings = tuple(check_parameters(rules, vehicle.parameters))
    words = f"{_NAMES[vehicle.autopilot]}, system {vehicle.system}"
    return VehicleCheck(
        vehicle=words,
        findings=findings,
        clock=clock_finding(settings, vehicle),
        parameter_file=_parameter_file(vehicle.autopilot, vehicle.system, findings),
    )


def _converse(
    link: MavlinkLink,
    vehicle: VehicleState,
    settings: AutopilotSettings,
    for_s: float,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
    messages: list[MavlinkMessage],
    done: Callable[[], bool],
) -> None:
    """Send messages one by one and take what comes, until ``done`` or for so long."""
    end_s, waiting = clock() + for_s, list(messages)
    while clock() < end_s and not done():
        link.send([waiting.pop(0)] if waiting else [])
        for message in link.received():
            receive(
                vehicle,
                message.name,
                message.fields,
                message.source,
                message.received_s,
                link_s=0.0,
                target_system=settings.target_system,
            )
        sleep(_WAIT_S)


def _ask_time(
    link: MavlinkLink,
    vehicle: VehicleState,
    settings: AutopilotSettings,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
    start_s: float,
) -> None:
    """Ask for the vehicle's time, one request after the other; the answers are in its link's delay."""
    for _ in range(_CLOCK_ASKED_TIMES):
        request = MavlinkMessage(name="TIMESYNC", fields={"tc1": 0, "ts1": round(1e9 * (clock() - start_s))})
        answers = vehicle.link_delay.answers + 1
        _converse(
            link,
            vehicle,
            settings,
            _CLOCK_EVERY_S,
            clock,
            sleep,
            [request],
            lambda answers=answers: vehicle.link_delay.answers >= answers,  # type: ignore[misc]
        )


def _request(system: int, name: str) -> MavlinkMessage:
    return MavlinkMessage(
        name="PARAM_REQUEST_READ",
        fields={"target_system": system, "target_component": 1, "param_id": name.encode(), "param_index": -1},
    )


def _parameter_file(autopilot: int, system: int, findings: tuple[ParameterFinding, ...]) -> str:
    """Return the values recommended, in the ground stations' format for the autopilot."""
    wanted = sorted((f.name, f.value if f.finding is ParameterVerdict.OK else f.recommended) for f in findings)
    if autopilot == ARDUPILOT:
        return "".join(f"{name},{value:g}\n" for name, value in wanted)
    # QGroundControl: system, component, name, value, MAV_PARAM_TYPE
    lines = ["# Vehicle-Id Component-Id Name Value Type\n"]
    for name, value in wanted:
        kind = 6 if name.endswith(_INTEGERS_OF_PX4) else 9
        lines.append(f"{system}\t1\t{name}\t{value:g}\t{kind}\n")
    return "".join(lines)
