"""Which parameters of a vehicle make its autopilot ignore or misuse the stream: one table for all autopilots and modes.

After the parameter references of ArduPilot 4.5 to 4.7 and PX4 1.15 to 1.17. Heights: with the barometer's a test flight
was 2.7 m off, with that of the stream 0.08 m.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

from groundstation.autopilot.settings import MOST_DELAY_S, AutopilotMode, AutopilotSettings
from groundstation.autopilot.vehicle_delay import delay_parameters
from groundstation.autopilot.vehicle_state import ARDUPILOT, PX4


class ParameterVerdict(StrEnum):
    """How bad a parameter's value is."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class OneOf:
    """Good are these values."""

    values: tuple[float, ...]

    def __call__(self, value: float) -> bool:
        """Return whether a value is good."""
        return value in self.values


@dataclass(frozen=True, slots=True, kw_only=True)
class WithinBounds:
    """Good is what lies between two bounds, which belong to it."""

    least: float = 0.0
    most: float

    def __call__(self, value: float) -> bool:
        """Return whether a value is good."""
        return self.least <= value <= self.most


@dataclass(frozen=True, slots=True, kw_only=True)
class BitsSet:
    """Good is a bit mask with all of ``wanted`` and none of ``forbidden``."""

    wanted: int
    forbidden: int = 0

    def __call__(self, value: float) -> bool:
        """Return whether a value is good."""
        return int(value) & self.wanted == self.wanted and not int(value) & self.forbidden


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRule:
    """One parameter.

    Attributes
    ----------
    autopilot, modes : for which it is.
    names : its names, the newest first; the first that the vehicle has counts.
    accepts : which values are good.
    recommended : a good value.
    why : what a bad one does.
    finding : how bad that is.
    preferred : of the values accepted, those that cost nothing; another one is a warning, ``why_preferred``.
    otherwise_numbered : of a name under which the same choice has another number, the good one.
    """

    autopilot: int
    modes: tuple[AutopilotMode, ...]
    names: tuple[str, ...]
    accepts: OneOf | WithinBounds | BitsSet
    recommended: float
    why: str
    finding: ParameterVerdict = ParameterVerdict.ERROR
    preferred: WithinBounds | None = None
    why_preferred: str = ""
    otherwise_numbered: Mapping[str, float] = field(default_factory=dict)

    def judge(self, name: str, value: float | None) -> "ParameterFinding":
        """Return the finding for the parameter ``name``; a value of None is one that the vehicle does not have."""
        finding, why = self.finding, self.why
        recommended = self.otherwise_numbered.get(name, self.recommended)
        accepts = OneOf(values=(recommended,)) if name in self.otherwise_numbered else self.accepts
        if value is None:
            finding = ParameterVerdict.UNKNOWN
        elif accepts(value):
            finding = ParameterVerdict.OK
            if self.preferred is not None and not self.preferred(value):
                finding, why = ParameterVerdict.WARNING, self.why_preferred
        return ParameterFinding(finding=finding, name=name, value=value, recommended=recommended, why=why)


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
    if autopilot not in (ARDUPILOT, PX4):
        return f"an autopilot of type {autopilot} (MAV_AUTOPILOT); known are 3, ArduPilot, and 12, PX4"
    if (autopilot, mode) in _NOT_TAKEN:
        return _NOT_TAKEN[autopilot, mode]
    return tuple(_of_stream(rule, settings) for rule in TABLE if rule.autopilot == autopilot and mode in rule.modes)


def check_parameters(rules: tuple[ParameterRule, ...], values: Mapping[str, float]) -> list[ParameterFinding]:
    """Return a finding for each rule, the worst first."""
    findings = []
    for rule in rules:
        name = next((n for n in rule.names if n in values), rule.names[0])
        findings.append(rule.judge(name, values.get(name)))
    order = (ParameterVerdict.ERROR, ParameterVerdict.WARNING, ParameterVerdict.UNKNOWN, ParameterVerdict.OK)
    return sorted(findings, key=lambda f: order.index(f.finding))


def _of_stream(rule: ParameterRule, settings: AutopilotSettings) -> ParameterRule:
    """Return a rule with what the stream's settings put into it: which receiver, which sensor."""
    k = settings.gps_id + 1
    numbered = {"GPS1_TYPE": (f"GPS{k}_TYPE", f"GPS_TYPE{k}"), "GPS1_DELAY_MS": delay_parameters(settings)}
    if k > 1 and rule.names[0] in numbered:
        return replace(rule, names=numbered[rule.names[0]])
    if rule.names[0] == "EKF2_AGP0_ID":
        sensor = settings.sensor_id
        return replace(rule, accepts=OneOf(values=(sensor, 0)), recommended=sensor)
    return rule


_NOT_TAKEN = {
    (ARDUPILOT, AutopilotMode.GLOBAL_POSITION): (
        "ArduPilot does not take GLOBAL_POSITION_SENSOR; use --autopilot-mode gps_input"
    ),
    (PX4, AutopilotMode.GPS_INPUT): "PX4 does not take GPS_INPUT; use --autopilot-mode global_position, or vision",
}
_GPS = (AutopilotMode.GPS_INPUT,)
_GLOBAL = (AutopilotMode.GLOBAL_POSITION,)
_VISION, _ODOMETRY = (AutopilotMode.VISION,), (AutopilotMode.ODOMETRY,)
_EXTERNAL = _VISION + _ODOMETRY
_OLD = {mode: f"measurements older than {1e3 * most_s:g} ms are not fused" for mode, most_s in MOST_DELAY_S.items()}
_MOST_MS = {mode: WithinBounds(most=1e3 * most_s) for mode, most_s in MOST_DELAY_S.items()}
# over a radio of 30 to 200 ms 25, 50 and 75 ms had 1.17, 1.13 and 1.10 times the filter's error, 0 had 1.20; of the
# messages 0.7, 1 and 1.4 % were older than EKF2's memory (eight landings, benchmarks/autopilot_stream.py)
_PAST_MS = WithinBounds(least=25, most=100)
_PREDICTED = (
    "with less the state has to be predicted by the radio's delay, with more late messages are older than EKF2's memory"
)
_DROWNS = "a larger noise than that drowns the stream's sigma"
_BAROMETER = "the height is the barometer's or another's: metres off at the flare, where the stream's is decimetres"
_NO_QUALITY = "VISION_POSITION_ESTIMATE has no quality, one camera has 50: they are refused"
_EV_CTRL = "bits 0 and 1 fuse position and height; bit 3 fuses a heading, which the stream does not have"
_QUALITY = "VISION_POSITION_ESTIMATE counts as quality 0, one camera as 50: they are refused"
_W = ParameterVerdict.WARNING


def _rule(
    autopilot: int,
    modes: tuple[AutopilotMode, ...],
    names: tuple[str, ...],
    accepts: OneOf | WithinBounds | BitsSet,
    recommended: float,
    why: str,
    finding: ParameterVerdict = ParameterVerdict.ERROR,
    preferred: WithinBounds | None = None,
    otherwise_numbered: Mapping[str, float] | None = None,
) -> ParameterRule:
    """Return a row of the table."""
    return ParameterRule(
        autopilot=autopilot,
        modes=modes,
        names=names,
        accepts=accepts,
        recommended=recommended,
        why=why,
        finding=finding,
        preferred=preferred,
        why_preferred=_PREDICTED,
        otherwise_numbered=otherwise_numbered or {},
    )


# in the order in which findings of one kind are told; a range beacon's delay counts whether there is one or not
TABLE: tuple[ParameterRule, ...] = (
    _rule(ARDUPILOT, _GPS, ("GPS1_TYPE", "GPS_TYPE"), OneOf(values=(14,)), 14, "GPS_INPUT is ignored without a word"),
    _rule(
        ARDUPILOT,
        _GPS,
        ("GPS1_DELAY_MS", "GPS_DELAY_MS"),
        _MOST_MS[AutopilotMode.GPS_INPUT],
        50,
        _OLD[AutopilotMode.GPS_INPUT],
    ),
    _rule(ARDUPILOT, _GPS, ("EK3_SRC1_POSXY",), OneOf(values=(3,)), 3, "the position is not that of a GPS"),
    _rule(ARDUPILOT, _GPS, ("EK3_SRC1_VELXY",), OneOf(values=(3,)), 3, "the velocity is not used", _W),
    _rule(
        ARDUPILOT,
        _GPS,
        ("EK3_SRC1_POSZ", "EK3_ALT_SOURCE"),
        OneOf(values=(3,)),
        3,
        _BAROMETER,
        otherwise_numbered={"EK3_ALT_SOURCE": 2},
    ),
    _rule(ARDUPILOT, _GPS, ("EK3_SRC1_VELZ",), OneOf(values=(3,)), 3, "the sink rate is not used", _W),
    _rule(ARDUPILOT, _GPS, ("EK3_POSNE_M_NSE",), WithinBounds(most=0.5), 0.1, _DROWNS, _W),
    _rule(
        ARDUPILOT, _EXTERNAL, ("VISO_TYPE",), OneOf(values=(1, 3)), 1, "external navigation is ignored without a word"
    ),
    _rule(ARDUPILOT, _VISION, ("VISO_QUAL_MIN",), OneOf(values=(0,)), 0, _QUALITY),
    _rule(ARDUPILOT, _ODOMETRY, ("VISO_QUAL_MIN",), WithinBounds(most=50), 0, _QUALITY),
    _rule(ARDUPILOT, _EXTERNAL, ("VISO_DELAY_MS",), _MOST_MS[AutopilotMode.VISION], 0, _OLD[AutopilotMode.VISION]),
    _rule(ARDUPILOT, _EXTERNAL, ("VISO_ORIENT",), OneOf(values=(0,)), 0, "the position is turned by a camera's mount"),
    _rule(ARDUPILOT, _EXTERNAL, ("VISO_SCALE",), OneOf(values=(1,)), 1, "the position is multiplied by it"),
    _rule(ARDUPILOT, _EXTERNAL, ("VISO_POS_M_NSE",), WithinBounds(most=0.2), 0.05, _DROWNS, _W),
    _rule(
        ARDUPILOT, _EXTERNAL, ("EK3_SRC1_POSXY",), OneOf(values=(6,)), 6, "the position is not external navigation's"
    ),
    _rule(ARDUPILOT, _EXTERNAL, ("EK3_SRC1_VELXY",), OneOf(values=(6, 0)), 6, "the velocity is another source's"),
    _rule(ARDUPILOT, _EXTERNAL, ("EK3_SRC1_POSZ",), OneOf(values=(6,)), 6, _BAROMETER),
    _rule(ARDUPILOT, _EXTERNAL, ("EK3_SRC1_VELZ",), OneOf(values=(6, 0)), 6, "the sink rate is another source's"),
    _rule(
        ARDUPILOT,
        _GPS + _EXTERNAL,
        ("EK3_BCN_DELAY",),
        WithinBounds(least=200, most=250),
        250,
        "EKF3 remembers no longer than its slowest sensor's delay: what the radio holds up longer counts as newer",
        _W,
    ),
    _rule(ARDUPILOT, _GPS + _EXTERNAL, ("AHRS_EKF_TYPE",), OneOf(values=(3,)), 3, "the stream is fused by EKF3 alone"),
    _rule(ARDUPILOT, _GPS + _EXTERNAL, ("EK3_ENABLE",), OneOf(values=(1,)), 1, "EKF3 does not run"),
    _rule(
        ARDUPILOT,
        _GPS + _EXTERNAL,
        ("EK3_SRC1_YAW",),
        OneOf(values=(1,)),
        1,
        "the stream has no heading: a yaw from GPS or from vision waits for ever, or is taken for north",
    ),
    _rule(PX4, _GLOBAL, ("EKF2_AGP0_ID",), OneOf(values=(1, 0)), 1, "the first slot is another sensor's", _W),
    _rule(
        PX4,
        _GLOBAL,
        ("EKF2_AGP0_CTRL", "EKF2_AGP_CTRL"),
        BitsSet(wanted=1 | 2),
        3,
        "bit 0 fuses the position, bit 1 the height; without them they are ignored",
    ),
    _rule(
        PX4,
        _GLOBAL,
        ("EKF2_AGP0_DELAY", "EKF2_AGP_DELAY"),
        _MOST_MS[AutopilotMode.GLOBAL_POSITION],
        50,
        _OLD[AutopilotMode.GLOBAL_POSITION],
        preferred=_PAST_MS,
    ),
    _rule(
        PX4,
        _GLOBAL,
        ("EKF2_AGP0_NOISE", "EKF2_AGP_NOISE"),
        WithinBounds(most=0.2),
        0.05,
        "the noise is at least this: the default of 0.9 to 1 m drowns the stream's sigma",
        _W,
    ),
    _rule(
        PX4,
        _GLOBAL,
        ("EKF2_AGP0_GATE", "EKF2_AGP_GATE"),
        WithinBounds(least=3.0, most=math.inf),
        5,
        "a smaller gate refuses the stream after a dead-reckoned turn",
        _W,
    ),
    _rule(PX4, _VISION, ("EKF2_EV_CTRL",), BitsSet(wanted=1 | 2, forbidden=8), 3, _EV_CTRL),
    _rule(PX4, _ODOMETRY, ("EKF2_EV_CTRL",), BitsSet(wanted=1 | 2, forbidden=8), 7, _EV_CTRL),
    _rule(
        PX4,
        _EXTERNAL,
        ("EKF2_HGT_REF",),
        OneOf(values=(3,)),
        3,
        "the height is the barometer's or a receiver's: metres off at the flare",
    ),
    _rule(
        PX4,
        _EXTERNAL,
        ("EKF2_EV_DELAY",),
        _MOST_MS[AutopilotMode.VISION],
        50,
        _OLD[AutopilotMode.VISION],
        preferred=_PAST_MS,
    ),
    _rule(PX4, _EXTERNAL, ("EKF2_EV_NOISE_MD",), OneOf(values=(0,)), 0, "the stream's covariance is not used", _W),
    _rule(PX4, _EXTERNAL, ("EKF2_EVP_NOISE",), WithinBounds(most=0.1), 0.05, "the noise is at least this", _W),
    _rule(PX4, _VISION, ("EKF2_EV_QMIN",), WithinBounds(most=0), 0, _NO_QUALITY),
    _rule(PX4, _ODOMETRY, ("EKF2_EV_QMIN",), WithinBounds(most=50), 0, _NO_QUALITY),
    _rule(
        PX4,
        _EXTERNAL,
        ("EKF2_GPS_CTRL",),
        OneOf(values=(0,)),
        0,
        "while GNSS is fused, vision trains a bias only, and its sigma is raised to EKF2_GPS_P_NOISE",
        _W,
    ),
)
