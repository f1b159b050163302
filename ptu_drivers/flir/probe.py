"""The description of a FLIR unit: every figure is queried, none assumed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ptu_drivers.axis_limits import narrowed
from ptu_drivers.errors import ProtocolError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import integer, integers, only_number
from ptu_drivers.flir.line import Exchanged, FlirLine
from ptu_drivers.messages import Axis, AxisDescription
from ptu_drivers.settings import AxisSettings

LETTER = {Axis.PAN: "P", Axis.TILT: "T"}
D_SERIES_PACE_S = 0.1
_ARCSEC = math.radians(1.0 / 3600.0)
_TRIES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisFacts:
    """One axis as reported by the unit, in counts.

    Attributes
    ----------
    arcsec : arc seconds per count. low, high : limits.
    min_rate, max_rate : bounds of the speed, counts/s. rate : the set speed.
    acceleration : counts/s², infinite if the unit does not report it.
    """

    arcsec: float
    low: int
    high: int
    min_rate: int
    max_rate: int
    rate: int
    acceleration: float

    @property
    def quantum_rad(self) -> float:
        """Return one count, rad."""
        return self.arcsec * _ARCSEC

    def describe(self, settings: AxisSettings) -> AxisDescription:
        """Return the axis after sign, zero and soft limits."""
        step_rad = self.quantum_rad
        reported = narrowed(
            settings,
            quantum_rad=step_rad,
            low_rad=self.low * step_rad,
            high_rad=self.high * step_rad,
            max_rate_rad_s=self.max_rate * step_rad,
            min_rate_rad_s=self.min_rate * step_rad,
            max_acceleration_rad_s2=self.acceleration * step_rad,
        )
        if not reported.low_rad < reported.high_rad:
            raise ProtocolError("soft limits", got="none of the unit's range", wanted="some of it")
        return reported


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitFacts:
    """Results of the probe.

    Attributes
    ----------
    model, firmware, serial : texts. pan, tilt : the axes.
    pace_s : least time between commands, s.
    combined : it supports `B`. clock_hz : its counter's frequency, where `BT` and `CNF` are consistent, otherwise 0.
    clock_field : index of the counter in `BT`.
    details : text for users.
    """

    model: str
    firmware: str
    serial: str
    pan: AxisFacts
    tilt: AxisFacts
    pace_s: float
    combined: bool
    clock_hz: float
    clock_field: int = 0
    details: Mapping[str, str] = field(default_factory=dict)

    def axis(self, axis: Axis) -> AxisFacts:
        """Return the facts of one axis."""
        return self.pan if axis is Axis.PAN else self.tilt


def require_ok(line: FlirLine, command: str) -> Exchanged:
    """Query until there is a reply, with a new start after each failure.

    Raises
    ------
    ExchangeFailed : none after a few attempts.
    """
    for _ in range(_TRIES - 1):
        try:
            return line.query(command)
        except ExchangeFailed:
            try:
                line.resynchronise(line.transport.now() + line.longest_s())
            except ExchangeFailed:
                continue
    return line.query(command)


def set_up(line: FlirLine) -> None:
    """Set echo, terse replies and independent control, and read back the settings where possible.

    Raises
    ------
    ExchangeFailed, ProtocolError : the unit does not do it.
    """
    for command in ("EE", "FT", "CI"):
        reported = require_ok(line, command).answer
        if not reported.ok:
            raise ProtocolError(command, got=reported.text or "an error", wanted="*")
    # each reply shows that the echo is on; this one shows that replies are terse
    integer(require_ok(line, "PP").answer.text)


def probe(line: FlirLine) -> UnitFacts:
    """Query the unit's properties; it must be set up.

    Raises
    ------
    ExchangeFailed : no reply. ProtocolError : a reply without a mandatory figure.
    """
    details: dict[str, str] = {}

    def text(command: str) -> str:
        reported = require_ok(line, command).answer
        if reported.ok and reported.text:
            details[command] = reported.text
            return reported.text
        return ""

    firmware, model, serial = text("V"), text("VM"), text("VS")
    # only the E series has VM; D-series units take ten commands a second
    pace = 0.0 if model else D_SERIES_PACE_S
    line.pace_s = pace
    pan, tilt = _axis(line, "P"), _axis(line, "T")
    text("O")
    combined = _supports_combined(line)
    clock_hz, clock_field = _device_clock(line)
    return UnitFacts(
        model=model,
        firmware=firmware,
        serial=serial,
        pan=pan,
        tilt=tilt,
        pace_s=pace,
        combined=combined,
        clock_hz=clock_hz,
        clock_field=clock_field,
        details=details,
    )


def _axis(line: FlirLine, letter: str) -> AxisFacts:
    def number(what: str) -> float:
        for last in (False, False, True):
            reported = require_ok(line, letter + what).answer
            try:
                return only_number(reported.text if reported.ok else "an error: " + reported.text)
            except ProtocolError:
                # another line may have run into this one
                if last:
                    raise
        raise AssertionError

    acceleration = require_ok(line, letter + "A").answer
    facts = AxisFacts(
        arcsec=number("R"),
        low=round(number("N")),
        high=round(number("X")),
        min_rate=round(number("L")),
        max_rate=round(number("U")),
        rate=round(number("S")),
        acceleration=only_number(acceleration.text) if acceleration.ok else math.inf,
    )
    if not (facts.arcsec > 0 and facts.low < facts.high and facts.max_rate > 0):
        raise ProtocolError(f"{letter}R {letter}N {letter}X {letter}U", got=str(facts), wanted="a unit that was homed")
    return facts


def _supports_combined(line: FlirLine) -> bool:
    """Return whether `B` replies with positions first, equal to those of `PP` and `TP` at rest."""
    reported = require_ok(line, "B").answer
    if not reported.ok:
        return False
    try:
        four = integers(reported.text, 4)
    except ProtocolError:
        return False
    pan, tilt = (integer(require_ok(line, c).answer.text) for c in ("PP", "TP"))
    return abs(four[0] - pan) <= 1 and abs(four[1] - tilt) <= 1


def _device_clock(line: FlirLine) -> tuple[float, int]:
    """Return the counter's frequency and its index in `BT`; 0 where the test does not determine it.

    No source shows the order of `BT`: the positions must be those of `PP` and `TP`, and one number must run as fast
    as `CNF` states.
    """
    if not require_ok(line, "BT").answer.ok or not (reported := require_ok(line, "CNF").answer).ok:
        return 0.0, 0
    try:
        hz = only_number(reported.text)
        first = require_ok(line, "BT")
        line.transport.wait(0.2)
        second = require_ok(line, "BT")
        before, after = integers(first.answer.text, 5), integers(second.answer.text, 5)
        pan, tilt = (integer(require_ok(line, c).answer.text) for c in ("PP", "TP"))
    except ProtocolError:
        return 0.0, 0
    if len(before) != len(after) or hz <= 0 or abs(after[0] - pan) > 1 or abs(after[1] - tilt) > 1:
        return 0.0, 0
    shortest = second.earliest_s - first.latest_s
    longest = second.latest_s - first.earliest_s
    for place in range(4, len(after)):
        ran = (after[place] - before[place]) / hz
        if 0.99 * shortest <= ran <= 1.01 * longest:
            return hz, place
    return 0.0, 0
