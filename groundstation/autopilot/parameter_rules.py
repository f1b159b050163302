"""Which parameters of a vehicle make its autopilot ignore the stream, or misuse it, by autopilot and mode.

After the parameter references of ArduPilot 4.5 to 4.7 and PX4 1.15 to 1.17. Heights: with the barometer's a test flight
was 2.7 m off, with that of the stream 0.08 m.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from groundstation.autopilot.settings import MOST_DELAY_S, AutopilotMode, AutopilotSettings
from groundstation.autopilot.vehicle_state import ARDUPILOT, PX4


class ParameterVerdict(StrEnum):
    """How bad a parameter's value is."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRule:
    """One parameter.

    Attributes
    ----------
    names : its names, the newest first; the first that the vehicle has counts.
    accepts : whether a value is good.
    recommended : a good value.
    why : what a bad one does.
    finding : how bad that is.
    """

    names: tuple[str, ...]
    accepts: Callable[[float], bool]
    recommended: float
    why: str
    finding: ParameterVerdict = ParameterVerdict.ERROR


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterFinding:
    """What is to be said of a parameter: its ``name``, ``value`` (None if the vehicle does not have it), and why."""

    finding: ParameterVerdict
    name: str
    value: float | None
    recommended: float
    why: str

    def text(self) -> str:
        """Return it in one line."""
        if self.finding is ParameterVerdict.OK:
            return f"ok       {self.name} = {self.value:g}"
        got = "not there" if self.value is None else f"{self.value:g}"
        return f"{self.finding:8} {self.name} = {got}, wanted {self.recommended:g}: {self.why}"


def parameter_rules(autopilot: int, settings: AutopilotSettings) -> tuple[ParameterRule, ...] | str:
    """Return the rules for a vehicle (MAV_AUTOPILOT) and a stream, or why it cannot take that stream at all."""
    mode = settings.mode
    if autopilot == ARDUPILOT:
        if mode is AutopilotMode.GLOBAL_POSITION:
            return "ArduPilot does not take GLOBAL_POSITION_SENSOR; use --autopilot-mode gps_input"
        return _ardupilot_gps(settings) if mode is AutopilotMode.GPS_INPUT else _ardupilot_vision(mode)
    if autopilot == PX4:
        if mode is AutopilotMode.GPS_INPUT:
            return "PX4 does not take GPS_INPUT; use --autopilot-mode global_position, or vision"
        return _px4_global(settings) if mode is AutopilotMode.GLOBAL_POSITION else _px4_vision(mode)
    return f"an autopilot of type {autopilot} (MAV_AUTOPILOT); known are 3, ArduPilot, and 12, PX4"


def check_parameters(rules: tuple[ParameterRule, ...], values: Mapping[str, float]) -> list[ParameterFinding]:
    """Return a finding for each rule, the worst first."""
    findings = []
    for rule in rules:
        name = next((n for n in rule.names if n in values), rule.names[0])
        value = values.get(name)
        finding = (
            ParameterVerdict.UNKNOWN if value is None else ParameterVerdict.OK if rule.accepts(value) else rule.finding
        )
        findings.append(
            ParameterFinding(finding=finding, name=name, value=value, recommended=rule.recommended, why=rule.why)
        )
    order = (ParameterVerdict.ERROR, ParameterVerdict.WARNING, ParameterVerdict.UNKNOWN, ParameterVerdict.OK)
    return sorted(findings, key=lambda f: order.index(f.finding))


def _is(*values: float) -> Callable[[float], bool]:
    return lambda value: value in values


def _at_most(most: float) -> Callable[[float], bool]:
    return lambda value: 0.0 <= value <= most


def _bits(wanted: int, forbidden: int = 0) -> Callable[[float], bool]:
    return lambda value: int(value) & wanted == wanted and not int(value) & forbidden


_EKF3 = (
    ParameterRule(names=("AHRS_EKF_TYPE",), accepts=_is(3), recommended=3, why="the stream is fused by EKF3 alone"),
    ParameterRule(names=("EK3_ENABLE",), accepts=_is(1), recommended=1, why="EKF3 does not run"),
    ParameterRule(
        names=("EK3_SRC1_YAW",),
        accepts=_is(1),
        recommended=1,
        why="the stream has no heading: a yaw from GPS or from vision waits for ever, or is taken for north",
    ),
)


# EKF3 remembers as long as its slowest sensor's delay; a range beacon's counts whether there is one or not
_EKF3_MEMORY = ParameterRule(
    names=("EK3_BCN_DELAY",),
    accepts=lambda value: 200.0 <= value <= 250.0,
    recommended=250,
    why="EKF3 remembers no longer than its slowest sensor's delay: what the radio holds up longer counts as newer",
    finding=ParameterVerdict.WARNING,
)


def _ardupilot_gps(settings: AutopilotSettings) -> tuple[ParameterRule, ...]:
    k = settings.gps_id + 1
    older = "GPS_TYPE" if k == 1 else f"GPS_TYPE{k}"
    delay_older = "GPS_DELAY_MS" if k == 1 else f"GPS_DELAY_MS{k}"
    most_ms = 1e3 * MOST_DELAY_S[settings.mode]
    return (
        ParameterRule(
            names=(f"GPS{k}_TYPE", older), accepts=_is(14), recommended=14, why="GPS_INPUT is ignored without a word"
        ),
        ParameterRule(
            names=(f"GPS{k}_DELAY_MS", delay_older),
            accepts=_at_most(most_ms),
            recommended=50,
            why=f"measurements older than {most_ms:g} ms are not fused",
        ),
        ParameterRule(
            names=("EK3_SRC1_POSXY",), accepts=_is(3), recommended=3, why="the position is not that of a GPS"
        ),
        ParameterRule(
            names=("EK3_SRC1_VELXY",),
            accepts=_is(3),
            recommended=3,
            why="the velocity is not used",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EK3_SRC1_POSZ", "EK3_ALT_SOURCE"),
            accepts=_is(3, 2),
            recommended=3,
            why="the height is the barometer's: metres off at the flare, where the stream's is decimetres",
        ),
        ParameterRule(
            names=("EK3_SRC1_VELZ",),
            accepts=_is(3),
            recommended=3,
            why="the sink rate is not used",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EK3_POSNE_M_NSE",),
            accepts=_at_most(0.5),
            recommended=0.1,
            why="a larger noise than that drowns the stream's sigma",
            finding=ParameterVerdict.WARNING,
        ),
        _EKF3_MEMORY,
        *_EKF3,
    )


def _ardupilot_vision(mode: AutopilotMode) -> tuple[ParameterRule, ...]:
    most_ms = 1e3 * MOST_DELAY_S[mode]
    quality = _is(0) if mode is AutopilotMode.VISION else _at_most(50)
    return (
        ParameterRule(
            names=("VISO_TYPE",), accepts=_is(1, 3), recommended=1, why="external navigation is ignored without a word"
        ),
        ParameterRule(
            names=("VISO_QUAL_MIN",),
            accepts=quality,
            recommended=0,
            why="VISION_POSITION_ESTIMATE counts as quality 0, one camera as 50: they are refused",
        ),
        ParameterRule(
            names=("VISO_DELAY_MS",),
            accepts=_at_most(most_ms),
            recommended=0,
            why=f"measurements older than {most_ms:g} ms are not fused",
        ),
        ParameterRule(
            names=("VISO_ORIENT",), accepts=_is(0), recommended=0, why="the position is turned by a camera's mount"
        ),
        ParameterRule(names=("VISO_SCALE",), accepts=_is(1), recommended=1, why="the position is multiplied by it"),
        ParameterRule(
            names=("VISO_POS_M_NSE",),
            accepts=_at_most(0.2),
            recommended=0.05,
            why="a larger noise than that drowns the stream's sigma",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EK3_SRC1_POSXY",), accepts=_is(6), recommended=6, why="the position is not external navigation's"
        ),
        ParameterRule(
            names=("EK3_SRC1_VELXY",), accepts=_is(6, 0), recommended=6, why="the velocity is another source's"
        ),
        ParameterRule(
            names=("EK3_SRC1_POSZ",),
            accepts=_is(6),
            recommended=6,
            why="the height is the barometer's: metres off at the flare, where the stream's is decimetres",
        ),
        ParameterRule(
            names=("EK3_SRC1_VELZ",), accepts=_is(6, 0), recommended=6, why="the sink rate is another source's"
        ),
        _EKF3_MEMORY,
        *_EKF3,
    )


def _px4_global(settings: AutopilotSettings) -> tuple[ParameterRule, ...]:
    most_ms = 1e3 * MOST_DELAY_S[settings.mode]
    return (
        ParameterRule(
            names=("EKF2_AGP0_ID",),
            accepts=_is(settings.sensor_id, 0),
            recommended=settings.sensor_id,
            why="the first slot is another sensor's",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EKF2_AGP0_CTRL", "EKF2_AGP_CTRL"),
            accepts=_bits(1 | 2),
            recommended=3,
            why="bit 0 fuses the position, bit 1 the height; without them they are ignored",
        ),
        ParameterRule(
            names=("EKF2_AGP0_DELAY", "EKF2_AGP_DELAY"),
            accepts=_at_most(most_ms),
            recommended=0,
            why=f"measurements older than {most_ms:g} ms are not fused",
        ),
        ParameterRule(
            names=("EKF2_AGP0_NOISE", "EKF2_AGP_NOISE"),
            accepts=_at_most(0.2),
            recommended=0.05,
            why="the noise is at least this: the default of 0.9 to 1 m drowns the stream's sigma",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EKF2_AGP0_GATE", "EKF2_AGP_GATE"),
            accepts=lambda value: value >= 3.0,
            recommended=5,
            why="a smaller gate refuses the stream after a dead-reckoned turn",
            finding=ParameterVerdict.WARNING,
        ),
    )


def _px4_vision(mode: AutopilotMode) -> tuple[ParameterRule, ...]:
    most_ms = 1e3 * MOST_DELAY_S[mode]
    wanted = 1 | 2 if mode is AutopilotMode.VISION else 1 | 2 | 4
    return (
        ParameterRule(
            names=("EKF2_EV_CTRL",),
            accepts=_bits(1 | 2, 8),
            recommended=wanted,
            why="bits 0 and 1 fuse position and height; bit 3 fuses a heading, which the stream does not have",
        ),
        ParameterRule(
            names=("EKF2_HGT_REF",),
            accepts=_is(3),
            recommended=3,
            why="the height is the barometer's or a receiver's: metres off at the flare",
        ),
        ParameterRule(
            names=("EKF2_EV_DELAY",),
            accepts=_at_most(most_ms),
            recommended=0,
            why=f"measurements older than {most_ms:g} ms are not fused",
        ),
        ParameterRule(
            names=("EKF2_EV_NOISE_MD",),
            accepts=_is(0),
            recommended=0,
            why="the stream's covariance is not used",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EKF2_EVP_NOISE",),
            accepts=_at_most(0.1),
            recommended=0.05,
            why="the noise is at least this",
            finding=ParameterVerdict.WARNING,
        ),
        ParameterRule(
            names=("EKF2_EV_QMIN",),
            accepts=_at_most(0 if mode is AutopilotMode.VISION else 50),
            recommended=0,
            why="VISION_POSITION_ESTIMATE has no quality, one camera has 50: they are refused",
        ),
        ParameterRule(
            names=("EKF2_GPS_CTRL",),
            accepts=_is(0),
            recommended=0,
            why="while GNSS is fused, vision trains a bias only, and its sigma is raised to EKF2_GPS_P_NOISE",
            finding=ParameterVerdict.WARNING,
        ),
    )
