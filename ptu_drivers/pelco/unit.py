"""Pan-tilt units that speak Pelco-D or Pelco-P with absolute positions (4B, 4D, 51, 53, 59, 5B)."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ptu_drivers.axis_limits import narrowed
from ptu_drivers.errors import ProtocolError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason, HealthCounter
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.lease import MOVES_ONLY, NO_LEASE
from ptu_drivers.line_lock import PreemptibleLine
from ptu_drivers.messages import AngleSample, AngleSource, Axis, Capability, Reading, UnitDescription
from ptu_drivers.pelco.codec import Opcode, PelcoFraming, PelcoMessage, with_word
from ptu_drivers.pelco.exchange import PelcoExchange, PelcoReply
from ptu_drivers.plausibility import AngleVerdict, Plausibility, Point
from ptu_drivers.polled_unit import PolledUnit
from ptu_drivers.protocol_options import parse_options
from ptu_drivers.settings import UnitSettings, check_baud
from ptu_drivers.transport import SerialTransport, Transport

_HALF_TURN_DEG = 180.0
_PROBES = 4
# a reply that takes longer than the latency and this number of its sigmas was delayed
_ORDINARY = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PelcoOptions:
    """Properties that a Pelco unit cannot report and that differ between manuals.

    Attributes
    ----------
    address : 1 to 255; Pelco-P sends one less.
    baud : of the line, bit/s.
    pan_sign : -1 where the unit's pan increases clockwise (to the right), as for most; +1 otherwise.
    tilt_sign : -1 where the unit's tilt increases downwards, so that numbers above half a turn mean up; +1 otherwise.
    tilt_wrap : "turn" where a negative tilt is sent as a turn less, "word" where it is a 16-bit two's complement.
    counts_per_degree : 100 in the standard.
    pan_low_deg, pan_high_deg, tilt_low_deg, tilt_high_deg : the unit's range, after pan_sign and tilt_sign.
    max_rate_deg_s, max_acceleration_deg_s2 : upper bounds for any unit; an angle that implies more is refused.
    speeds_deg_s : speed byte (1 to 63) -> measured rate, deg/s. Without it the unit cannot turn at a rate, because the
        speed bytes are not rates.
    acknowledges : the unit acknowledges commands with the short reply of four bytes (Pelco-D only).
    late_s : time after a query beyond which no reply arrives.
    gap_s : pause between two commands without a reply.
    """

    address: int = 1
    baud: int = 9600
    pan_sign: int = -1
    tilt_sign: int = -1
    tilt_wrap: str = "turn"
    counts_per_degree: float = 100.0
    pan_low_deg: float = -179.99
    pan_high_deg: float = 179.99
    tilt_low_deg: float = -90.0
    tilt_high_deg: float = 90.0
    max_rate_deg_s: float = 200.0
    max_acceleration_deg_s2: float = 800.0
    speeds_deg_s: Mapping[int, float] = field(default_factory=dict)
    acknowledges: bool = False
    late_s: float = 0.6
    gap_s: float = 0.01

    def __post_init__(self) -> None:
        check_baud("Pelco option baud", self.baud)
        for name, good, wanted in (
            ("address", 1 <= self.address <= 255, "1 to 255"),
            ("pan_sign", self.pan_sign in (1, -1), "1 or -1"),
            ("tilt_sign", self.tilt_sign in (1, -1), "1 or -1"),
            ("tilt_wrap", self.tilt_wrap in ("turn", "word"), "'turn' or 'word'"),
            ("counts_per_degree", 0 < self.counts_per_degree <= 65535 / 360, "above 0, at most 182"),
            ("pan_low_deg", -_HALF_TURN_DEG <= self.pan_low_deg < self.pan_high_deg, "at least -180, below high"),
            ("pan_high_deg", self.pan_high_deg <= _HALF_TURN_DEG, "at most 180"),
            ("tilt_low_deg", -_HALF_TURN_DEG <= self.tilt_low_deg < self.tilt_high_deg, "at least -180, below high"),
            ("tilt_high_deg", self.tilt_high_deg < _HALF_TURN_DEG, "below 180"),
            ("max_rate_deg_s", self.max_rate_deg_s > 0, "above 0"),
            ("max_acceleration_deg_s2", self.max_acceleration_deg_s2 > 0, "above 0"),
            ("speeds_deg_s", all(1 <= k <= 63 and v > 0 for k, v in self.speeds_deg_s.items()), "1 to 63: deg/s"),
        ):
            if not good:
                raise ProtocolError(f"Pelco option {name}", got=repr(getattr(self, name)), wanted=wanted)

    @property
    def turn(self) -> int:
        """Counts of a whole turn."""
        return round(360 * self.counts_per_degree)

    def word(self, axis: Axis, unit_rad: float) -> int:
        """Return the number that commands an angle, rad, pan counter-clockwise, tilt upwards."""
        sign = self.pan_sign if axis is Axis.PAN else self.tilt_sign
        counts = round(sign * math.degrees(unit_rad) * self.counts_per_degree)
        return counts & 0xFFFF if self._is_signed(axis) else counts % self.turn

    def unit_angle(self, axis: Axis, word: int) -> float | None:
        """Return the angle of a number that the unit sent, rad in (-pi, pi], or None where it is no angle."""
        sign = self.pan_sign if axis is Axis.PAN else self.tilt_sign
        half = self.turn / 2
        if self._is_signed(axis):
            counts = float(word - 0x10000 if word > 0x7FFF else word)
            if abs(counts) > half:
                return None
        elif word >= self.turn:
            return None
        else:
            counts = float(word - self.turn if word > half else word)
        return sign * math.radians(counts / self.counts_per_degree)

    def _is_signed(self, axis: Axis) -> bool:
        return axis is Axis.TILT and self.tilt_wrap == "word"


class PelcoUnit(PolledUnit):
    """A Pelco unit, probed; made by `open_pelco_d`, `open_pelco_p` or `connect_pelco`."""

    def __init__(
        self,
        line: PreemptibleLine,
        exchange: PelcoExchange,
        settings: UnitSettings,
        options: PelcoOptions,
        description: UnitDescription,
        *,
        watch: bool,
    ) -> None:
        health = HealthCounter(failures=exchange.failures)
        super().__init__(line, settings, description, health, watch=watch)
        self._exchange = exchange
        self._options = options
        self._gates = {
            axis: Plausibility(
                quantum=description.axis(axis).quantum_rad,
                max_rate=math.radians(options.max_rate_deg_s),
                max_acceleration=math.radians(options.max_acceleration_deg_s2),
            )
            for axis in Axis
        }
        self._unwrapped: dict[Axis, float] = {}

    def _query(self) -> Reading:
        until_s = self._answer_by_s()
        sent_s = self._line.now()
        samples = {axis: self._query_axis(axis, until_s) for axis in self._exchange.barrier()}
        return Reading(pan=samples[Axis.PAN], tilt=samples[Axis.TILT], sent_s=sent_s, answered_s=self._line.now())

    def _query_axis(self, axis: Axis, until_s: float) -> AngleSample:
        """Query once, and again where the angle is inconsistent with the last ones.

        The checksum has 8 bits: of two wrong bytes, one pair in 256 passes it.
        """
        gate = self._gates[axis]
        point = self._point(axis, until_s)
        if gate.judge(point) is not AngleVerdict.PLAUSIBLE:
            again = self._point(axis, until_s)
            if not gate.confirms(point, again):
                gate.forget()
                raise ExchangeFailed(FailureReason.TOO_FAST, f"{axis.value} {math.degrees(point.angle):.2f} deg")
            gate.accept(point)
            point = again
        gate.accept(point)
        self._unwrapped[axis] = point.angle
        turns = round(point.angle / (2 * math.pi)) if axis is Axis.PAN else 0
        return AngleSample(
            axis=axis,
            t_s=point.t_s,
            sigma_t_s=point.sigma_t_s,
            angle_rad=self._axis(axis).angle(point.angle - 2 * math.pi * turns),
            sigma_rad=self._description.axis(axis).quantum_rad / math.sqrt(12),
            source=AngleSource.FIRST_REPLY_BYTE,
        )

    def _point(self, axis: Axis, until_s: float) -> Point:
        answer = self._exchange.query(axis, until_s)
        self._health.exchanges = self._exchange.sent
        unit_rad = self._options.unit_angle(axis, answer.word)
        if unit_rad is None:
            raise ExchangeFailed(FailureReason.OUT_OF_RANGE, f"{axis.value} {answer.word}")
        if axis is Axis.PAN and axis in self._unwrapped:
            # the turn that is nearest to where it was, so that crossing the seam is no jump
            unit_rad += 2 * math.pi * round((self._unwrapped[axis] - unit_rad) / (2 * math.pi))
        t_s, sigma_t_s = self._instant(answer)
        return Point(t_s=t_s, sigma_t_s=sigma_t_s, angle=unit_rad)

    def _instant(self, answer: PelcoReply) -> tuple[float, float]:
        """Return when the angle was valid, and 1 sigma, s.

        The unit reads its angle between the end of the query and the start of the reply. With an ordinary delay
        that is its latency before the reply; with a longer one the instant is unknown within the whole interval.
        """
        latency_s, spread_s = self._settings.latency_s, self._settings.latency_sigma_s
        delay_s = answer.first_bit_s - answer.asked_s
        if delay_s > latency_s + _ORDINARY * spread_s:
            return answer.asked_s + delay_s / 2, max(spread_s, delay_s / math.sqrt(12))
        return max(answer.asked_s, answer.first_bit_s - latency_s), spread_s

    def _resynchronise(self) -> None:
        for gate in self._gates.values():
            gate.forget()
        self._exchange.wait_until_idle(self._answer_by_s())

    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        opcodes = {Axis.PAN: Opcode.SET_PAN, Axis.TILT: Opcode.SET_TILT}
        for axis, unit_rad in targets.items():
            self._send(with_word(self._options.address, opcodes[axis], self._options.word(axis, unit_rad)))
        self._check_answer()

    def _send_rates(self, rates: dict[Axis, float]) -> None:
        pan, tilt = self._speed(rates[Axis.PAN]), self._speed(rates[Axis.TILT])
        opcode = 0
        if pan:
            # right is where the unit's own number grows on a unit of the usual sense
            opcode |= Opcode.LEFT if rates[Axis.PAN] > 0 else Opcode.RIGHT
        if tilt:
            opcode |= Opcode.UP if rates[Axis.TILT] > 0 else Opcode.DOWN
        self._send(PelcoMessage(address=self._options.address, opcode=opcode, data_1=pan, data_2=tilt))
        self._check_answer()

    def _send_halt(self) -> None:
        stop = PelcoMessage(address=self._options.address, opcode=Opcode.STOP)
        # a stop has no reply: it is sent before and after a query that has one, so that a lost byte affects one of them
        self._send(stop)
        try:
            self._check_answer()
        finally:
            self._send(stop)

    def _send(self, message: PelcoMessage) -> None:
        if self._options.acknowledges:
            self._exchange.send_and_wait(message, self._until_s)
        else:
            self._exchange.send(message)
            self._line.wait(self._pause_s())

    def _check_answer(self) -> None:
        """Query the position, to verify that the unit replies; commands have no reply."""
        self._exchange.query(self._exchange.barrier()[0], self._answer_by_s())
        self._health.exchanges = self._exchange.sent

    def _pause_s(self) -> float:
        """Return the duration of a command that has no reply, s."""
        return 8 * self._exchange.line.character_s() + self._options.gap_s

    def _answer_by_s(self) -> float:
        """Return when to stop waiting for a reply, so that stops before and after it are in the call's time."""
        return self._until_s - 2 * self._pause_s()

    def _speed(self, rate_rad_s: float) -> int:
        """Return the speed byte whose measured rate is nearest; 0 for a rate of 0."""
        if rate_rad_s == 0:
            return 0
        wanted_deg_s = abs(math.degrees(rate_rad_s))
        table = self._options.speeds_deg_s
        return min(table, key=lambda speed: abs(table[speed] - wanted_deg_s))


def connect_pelco(
    line: Transport, settings: UnitSettings, options: PelcoOptions, framing: PelcoFraming, *, watch: bool = True
) -> PelcoUnit:
    """Probe the unit on a line that is open, and return it ready; arguments as `open_pelco_d`."""
    if options.acknowledges and framing is PelcoFraming.P:
        raise ProtocolError("Pelco option acknowledges", got="it with Pelco-P", wanted="Pelco-D")
    shared = PreemptibleLine(line)
    exchange = PelcoExchange(
        line=shared,
        address=options.address,
        framing=framing,
        reply_timeout_s=settings.reply_timeout_s,
        late_s=options.late_s,
    )
    unit = PelcoUnit(shared, exchange, settings, options, _description(line, settings, options, framing), watch=watch)
    reasons = []
    for _ in range(_PROBES):
        got = unit.read()
        if isinstance(got, Reading):
            return unit
        reasons.append(got.reason.value)
    unit.close()
    raise ProtocolError(
        line.url,
        got=f"{' and '.join(dict.fromkeys(reasons))} after a question for the position (51, 53) to address "
        f"{options.address} at {line.baud()} bit/s",
        wanted="answers 59 and 5B; not every Pelco unit tells its position",
    )


def open_pelco_d(
    url: str, settings: UnitSettings, clock: Callable[[], float] = time.monotonic, **options: Any
) -> PanTiltUnit:
    """Open a Pelco-D unit; `options` are the fields of `PelcoOptions`."""
    return _open(url, settings, clock, options, PelcoFraming.D)


def open_pelco_p(
    url: str, settings: UnitSettings, clock: Callable[[], float] = time.monotonic, **options: Any
) -> PanTiltUnit:
    """Open a Pelco-P unit; `options` are the fields of `PelcoOptions`."""
    return _open(url, settings, clock, options, PelcoFraming.P)


def _open(
    url: str, settings: UnitSettings, clock: Callable[[], float], options: Mapping[str, Any], framing: PelcoFraming
) -> PelcoUnit:
    chosen = parse_options(PelcoOptions, "Pelco", options)
    if settings.baud:
        chosen = replace(chosen, baud=settings.baud)
    line = SerialTransport(url, chosen.baud, clock)
    return connect_pelco(line, settings, chosen, framing)


def _description(
    line: Transport, settings: UnitSettings, options: PelcoOptions, framing: PelcoFraming
) -> UnitDescription:
    quantum_rad = math.radians(1 / options.counts_per_degree)
    table_deg_s = options.speeds_deg_s.values()
    capabilities = {Capability.POSITION, *((Capability.VELOCITY,) if table_deg_s else ())}
    axes = {
        axis: narrowed(
            settings.pan if axis is Axis.PAN else settings.tilt,
            quantum_rad=quantum_rad,
            low_rad=math.radians(low_deg),
            high_rad=math.radians(high_deg),
            max_rate_rad_s=math.radians(max(table_deg_s, default=options.max_rate_deg_s)),
            min_rate_rad_s=math.radians(min(table_deg_s, default=0.0)),
            limits_from="settings",
        )
        for axis, low_deg, high_deg in (
            (Axis.PAN, options.pan_low_deg, options.pan_high_deg),
            (Axis.TILT, options.tilt_low_deg, options.tilt_high_deg),
        )
    }
    # each axis twice, silence after each reply, and an outstanding halt with its pauses
    line_s = 100 * line.character_s() + 0.01 + 5 * options.gap_s
    return UnitDescription(
        protocol=f"pelco-{framing.value}",
        url=line.url,
        model="",
        firmware="",
        serial="",
        pan=axes[Axis.PAN],
        tilt=axes[Axis.TILT],
        capabilities=frozenset(capabilities),
        reply_timeout_s=settings.reply_timeout_s + line_s,
        lease=NO_LEASE if table_deg_s else MOVES_ONLY,
        details={"address": str(options.address), "baud": str(line.baud())},
    )
