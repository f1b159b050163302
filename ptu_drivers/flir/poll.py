"""Position of both axes: queried by the unit's best query, stamped, and accepted only if plausible."""

from dataclasses import dataclass
from enum import StrEnum

from ptu_drivers.angle_timestamps import DeviceClock, Instant, Latency, query_instant
from ptu_drivers.errors import ProtocolError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import FlirReply, integer, integers
from ptu_drivers.flir.line import Exchanged, FlirLine
from ptu_drivers.flir.probe import UnitFacts
from ptu_drivers.flir.unit_conversion import Converter
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import AngleSample, Axis, Reading
from ptu_drivers.plausibility import AngleVerdict, Plausibility, Point
from ptu_drivers.settings import UnitSettings

_SQRT12 = 12.0**0.5
# beyond its limits by this share of the range an axis may have been left (limits off), not more
_OVER = 0.02


class Query(StrEnum):
    """How the angles are asked."""

    PAIR = "pair"
    COMBINED = "combined"
    DEVICE_CLOCK = "device clock"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Raw:
    """Both positions in counts, each with its instant."""

    counts: dict[Axis, int]
    instants: dict[Axis, Instant]
    begun_s: float
    done_s: float

    def point(self, axis: Axis) -> Point:
        at = self.instants[axis]
        return Point(t_s=at.t_s, sigma_t_s=at.sigma_s, angle=float(self.counts[axis]))


class Poller:
    """Readings of one unit."""

    def __init__(self, line: FlirLine, facts: UnitFacts, converter: Converter, settings: UnitSettings) -> None:
        self.query = best_query(facts)
        self.type_ahead = True
        self._line = line
        self._facts = facts
        self._converter = converter
        self._latency = Latency(
            unit_s=settings.latency_s,
            unit_sigma_s=settings.latency_sigma_s,
            send_sigma_s=line.transport.send_sigma_s(),
        )
        self._clock = DeviceClock(facts.clock_hz) if facts.clock_hz else None
        self._gates = {
            axis: Plausibility(quantum=1.0, max_rate=a.max_rate, max_acceleration=a.acceleration)
            for axis, a in ((Axis.PAN, facts.pan), (Axis.TILT, facts.tilt))
        }

    def forget(self) -> None:
        """Begin without a past."""
        for gate in self._gates.values():
            gate.forget()
        if self._clock is not None:
            self._clock = DeviceClock(self._facts.clock_hz)

    def poll(self, deadline_s: float) -> Reading:
        """Return a reading.

        Raises
        ------
        ExchangeFailed : no plausible one. LineError.
        """
        raw = self._query(deadline_s)
        verdicts = {axis: self._gates[axis].judge(raw.point(axis)) for axis in Axis}
        if AngleVerdict.IMPOSSIBLE in verdicts.values():
            self.forget()
            raise ExchangeFailed(FailureReason.TOO_FAST, str(raw.counts))
        if AngleVerdict.CONFIRM in verdicts.values():
            raw = self._confirmed(raw, deadline_s)
        for axis in Axis:
            self._gates[axis].accept(raw.point(axis))
        return self._reading(raw)

    def _confirmed(self, first: _Raw, deadline_s: float) -> _Raw:
        """Query again, and return the newest if all are consistent; twice without a previous reading."""
        second = self._query(deadline_s)
        self._compare(first, second)
        if all(gate.has_past for gate in self._gates.values()):
            return second
        for axis in Axis:
            self._gates[axis].accept(first.point(axis))
        third = self._query(deadline_s)
        self._compare(second, third)
        return third

    def _compare(self, one: _Raw, other: _Raw) -> None:
        for axis in Axis:
            if not self._gates[axis].confirms(one.point(axis), other.point(axis)):
                self.forget()
                raise ExchangeFailed(FailureReason.UNCONFIRMED, f"{one.counts[axis]}, then {other.counts[axis]}")

    def _query(self, deadline_s: float) -> _Raw:
        line = self._line
        if self.query is Query.PAIR:
            if self.type_ahead:
                both = line.query_pair("PP", "TP", deadline_s=deadline_s)
            else:
                both = (line.query("PP", deadline_s=deadline_s), line.query("TP", deadline_s=deadline_s))
            counts = {axis: self._integer(e.answer) for axis, e in zip(Axis, both, strict=True)}
            instants = {axis: self._instant(e) for axis, e in zip(Axis, both, strict=True)}
            begun_s, done_s = both[0].begun_s, both[1].done_s
        else:
            asked = line.query("B" if self.query is Query.COMBINED else "BT", deadline_s=deadline_s)
            numbers = self._integers(asked.answer)
            counts = {Axis.PAN: numbers[0], Axis.TILT: numbers[1]}
            instants = dict.fromkeys(Axis, self._instant(asked, numbers))
            begun_s, done_s = asked.begun_s, asked.done_s
        for axis in Axis:
            facts = self._facts.axis(axis)
            over = _OVER * (facts.high - facts.low)
            if not facts.low - over <= counts[axis] <= facts.high + over:
                raise ExchangeFailed(FailureReason.OUT_OF_RANGE, f"{axis} {counts[axis]}")
        return _Raw(counts=counts, instants=instants, begun_s=begun_s, done_s=done_s)

    def _instant(self, asked: Exchanged, numbers: tuple[int, ...] = ()) -> Instant:
        if self._clock is not None and self.query is Query.DEVICE_CLOCK:
            count = numbers[self._facts.clock_field]
            if self._clock.ran_backwards(count):
                # restarted, or misread: the recovery finds out
                self.forget()
                raise ExchangeFailed(FailureReason.GARBAGE, f"counter {count}")
            return self._clock.instant(count, asked.earliest_s, asked.latest_s)
        return query_instant(
            earliest_s=asked.earliest_s,
            sent_s=asked.sent_s,
            latest_s=asked.latest_s,
            first_bit_s=asked.mark_s - self._line.transport.character_s(),
            latency=self._latency,
        )

    def _integer(self, answer: FlirReply) -> int:
        _refuse(answer)
        try:
            return integer(answer.text)
        except ProtocolError as fault:
            raise ExchangeFailed(FailureReason.GARBAGE, fault.got) from fault

    def _integers(self, answer: FlirReply) -> tuple[int, ...]:
        _refuse(answer)
        try:
            return integers(answer.text, 4 if self.query is Query.COMBINED else 5)
        except ProtocolError as fault:
            raise ExchangeFailed(FailureReason.GARBAGE, fault.got) from fault

    def _reading(self, raw: _Raw) -> Reading:
        samples = {}
        for axis in Axis:
            at = raw.instants[axis]
            samples[axis] = AngleSample(
                axis=axis,
                t_s=at.t_s,
                sigma_t_s=at.sigma_s,
                angle_rad=self._converter.angle(axis, raw.counts[axis]),
                sigma_rad=self._facts.axis(axis).quantum_rad / _SQRT12,
                source=at.source,
            )
        return Reading(pan=samples[Axis.PAN], tilt=samples[Axis.TILT], sent_s=raw.begun_s, answered_s=raw.done_s)


def best_query(facts: UnitFacts) -> Query:
    """Return the best query that the unit supports."""
    if facts.clock_hz:
        return Query.DEVICE_CLOCK
    return Query.COMBINED if facts.combined else Query.PAIR


def _refuse(answer: FlirReply) -> None:
    if not answer.ok:
        raise ExchangeFailed(FailureReason.REFUSED, answer.text)
