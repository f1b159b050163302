"""Two Dynamixel servos as a pan-tilt unit, for laboratory rigs: Protocol 2.0, X series."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ptu_drivers.axis_limits import narrowed
from ptu_drivers.dynamixel import table
from ptu_drivers.dynamixel.bus import DynamixelBus, Status
from ptu_drivers.dynamixel.table import OperatingMode
from ptu_drivers.errors import ProtocolError, PtuError, RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason, HealthCounter
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.lease import LEASE_S, Lease, LeaseKind
from ptu_drivers.line_lock import PreemptibleLine
from ptu_drivers.messages import AngleSample, AngleSource, Axis, Capability, Reading, UnitDescription
from ptu_drivers.polled_unit import PolledUnit
from ptu_drivers.protocol_options import parse_options
from ptu_drivers.settings import UnitSettings, check_baud
from ptu_drivers.tick_clock import TickClock
from ptu_drivers.transport import SerialTransport, Transport

_PROBES = 6
_TIME_BASED = 0x04
_ENCODER_BIT = 3
# a halt without a query commands the last known positions of the servos, if they are this fresh, s
_FRESH_S = 0.3
# a servo that its watchdog stops does so without a ramp; 1 tick of the watchdog, and the rotor
_STOPPING_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamixelOptions:
    """How the servos are wired.

    Attributes
    ----------
    pan_id, tilt_id : identifiers, 0 to 252.
    baud : of the bus, bit/s.
    torque_off : let go of the shafts when closed; a head that is not balanced then sinks.
    """

    pan_id: int = 1
    tilt_id: int = 2
    baud: int = 57600
    torque_off: bool = True

    def __post_init__(self) -> None:
        check_baud("Dynamixel option baud", self.baud)
        for name in ("pan_id", "tilt_id"):
            if not 0 <= getattr(self, name) <= 252:
                raise ProtocolError(f"Dynamixel option {name}", got=str(getattr(self, name)), wanted="0 to 252")
        if self.pan_id == self.tilt_id:
            raise ProtocolError("Dynamixel options", got=f"{self.pan_id} for pan and tilt", wanted="two identifiers")


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """One servo's replies to the probe; limits in steps, rate in units of its register."""

    identifier: int
    model: table.Model
    firmware: int
    low: int
    high: int
    max_rate: int

    def angle(self, position: int) -> float:
        """Return the angle of a position, rad from the model's middle."""
        return (position - self.model.zero) * 2 * math.pi / self.model.steps

    def position(self, angle_rad: float) -> int:
        """Return the position of an angle."""
        return self.model.zero + round(angle_rad * self.model.steps / (2 * math.pi))


class DynamixelUnit(PolledUnit):
    """Two servos, probed; made by `open_dynamixel` or `connect_dynamixel`."""

    def __init__(
        self,
        line: PreemptibleLine,
        bus: DynamixelBus,
        settings: UnitSettings,
        options: DynamixelOptions,
        servos: dict[Axis, Servo],
        description: UnitDescription,
        *,
        watch: bool,
    ) -> None:
        super().__init__(line, settings, description, HealthCounter(), watch=watch)
        self._bus = bus
        self._options = options
        self._servos = servos
        self._clocks = {axis: TickClock(tick_s=table.TICK_S, ticks=table.TICKS) for axis in Axis}
        self._order = list(Axis)
        self._mode: OperatingMode | None = None
        """What the servos are known to follow, with torque; None where they have to be set up again."""

    def _try_again(self) -> None:
        super()._try_again()
        self._bus.finish_by(self._until_s)

    def _query(self) -> Reading:
        sent_s = self._line.now()
        # the first to reply does so at once, which bounds its clock closely: they alternate
        self._order.reverse()
        states = self._bus.states(tuple(self._servos[axis].identifier for axis in self._order))
        self._health.exchanges = self._bus.sent
        faults: list[ExchangeFailed] = []
        samples: dict[Axis, AngleSample] = {}
        for axis, state in zip(self._order, states, strict=True):
            try:
                samples[axis] = self._sample(axis, state)
            except ExchangeFailed as fault:
                faults.append(fault)
        if any(clock.restarted for clock in self._clocks.values()) and self._mode is not None:
            # torque is off after a restart, which the tick shows
            self._mode = None
            self._health.restarts += 1
        if faults:
            raise faults[0]
        return Reading(pan=samples[Axis.PAN], tilt=samples[Axis.TILT], sent_s=sent_s, answered_s=self._line.now())

    def _sample(self, axis: Axis, state: Status) -> AngleSample:
        servo = self._servos[axis]
        tick = table.number(state.data[:2])
        t_s, sigma_t_s = self._clocks[axis].instant(tick, state.asked_s, state.first_bit_s)
        position = table.number(state.data[12:16], signed=True)
        if state.alert and self._bus.read(servo.identifier, table.HARDWARE_ERROR) >> _ENCODER_BIT & 1:
            raise ExchangeFailed(FailureReason.REFUSED, f"{axis.value}: the servo reports an error of its encoder")
        step_rad = self._description.axis(axis).quantum_rad
        return AngleSample(
            axis=axis,
            t_s=t_s,
            sigma_t_s=sigma_t_s,
            angle_rad=self._axis(axis).angle(servo.angle(position)),
            sigma_rad=step_rad / math.sqrt(12),
            source=AngleSource.DEVICE_CLOCK,
        )

    def _resynchronise(self) -> None:
        self._bus.drain()
        # a servo replies in order: after its reply to a ping no older one is outstanding
        for servo in self._servos.values():
            self._bus.ping(servo.identifier)

    def _set_up(self) -> None:
        """Modes and torque are set before the next motion."""
        self._mode = None

    def _follow(self, mode: OperatingMode) -> None:
        """Make both servos follow positions or rates, with torque; raises ExchangeFailed, RefusedError, LineError."""
        if self._mode is mode:
            return
        self._mode = None
        lease_s = self._description.lease.renewed_s if mode is OperatingMode.VELOCITY else 0.0
        watchdog = math.ceil(lease_s / table.WATCHDOG_S)
        for axis, servo in self._servos.items():
            n = servo.identifier
            errors = table.hardware_errors(self._bus.read(n, table.HARDWARE_ERROR))
            if errors:
                raise RefusedError(f"torque of {axis.value}", reported=f"hardware error: {errors}")
            # 0 also clears a watchdog that has stopped the servo and closed its goals
            self._bus.write(n, table.BUS_WATCHDOG, 0)
            if self._bus.read(n, table.OPERATING_MODE) != mode:
                self._bus.write(n, table.TORQUE_ENABLE, 0)
                self._bus.write(n, table.OPERATING_MODE, mode)
            self._bus.write(n, table.TORQUE_ENABLE, 1)
            if mode is OperatingMode.VELOCITY:
                self._bus.write(n, table.GOAL_VELOCITY, 0)
            self._bus.write(n, table.BUS_WATCHDOG, watchdog)
        self._mode = mode

    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        self._follow(OperatingMode.POSITION)
        for axis, unit_rad in targets.items():
            n = self._servos[axis].identifier
            if rate_rad_s is not None:
                self._bus.write(n, table.PROFILE_VELOCITY, max(1, round(abs(rate_rad_s) / table.RATE_RAD_S)))
            self._bus.write(n, table.GOAL_POSITION, self._servos[axis].position(unit_rad))
        self._health.exchanges = self._bus.sent

    def _send_rates(self, rates: dict[Axis, float]) -> None:
        try:
            self._follow(OperatingMode.VELOCITY)
            self._set_rates(rates)
        except RefusedError:
            # the servo's own watchdog closed its goals, or it was restarted: set it up once more
            self._mode = None
            self._follow(OperatingMode.VELOCITY)
            self._set_rates(rates)

    def _set_rates(self, rates: dict[Axis, float]) -> None:
        for axis, rate in rates.items():
            self._bus.write(self._servos[axis].identifier, table.GOAL_VELOCITY, round(rate / table.RATE_RAD_S))
        self._health.exchanges = self._bus.sent

    def _send_halt(self) -> None:
        self._halt_unasked()
        self._bus.drain()
        for servo in self._servos.values():
            n = servo.identifier
            try:
                if self._bus.read(n, table.OPERATING_MODE) == OperatingMode.VELOCITY:
                    self._bus.write(n, table.GOAL_VELOCITY, 0)
                else:
                    here = self._bus.read(n, table.PRESENT_POSITION)
                    self._bus.write(n, table.GOAL_POSITION, min(max(here, servo.low), servo.high))
            except RefusedError:
                # goals that are closed belong to a servo that its watchdog has stopped; no torque is sure to end it
                self._mode = None
                self._bus.write(n, table.TORQUE_ENABLE, 0)

    def _halt_unasked(self) -> None:
        """Stop both without a query, which works without a reply; each mode follows one of the orders."""
        self._bus.sync_write(table.GOAL_VELOCITY, {servo.identifier: 0 for servo in self._servos.values()})
        last = self._last
        if self._mode is not OperatingMode.VELOCITY and last is not None:
            if self._line.now() - max(last.pan.t_s, last.tilt.t_s) > _FRESH_S:
                return
            here = {}
            for axis, servo in self._servos.items():
                position = servo.position(self._axis(axis).unit_angle(last.axis(axis).angle_rad))
                here[servo.identifier] = min(max(position, servo.low), servo.high)
            self._bus.sync_write(table.GOAL_POSITION, here)

    def _release(self) -> None:
        if self._options.torque_off:
            for servo in self._servos.values():
                self._bus.write(servo.identifier, table.TORQUE_ENABLE, 0)


def connect_dynamixel(
    line: Transport, settings: UnitSettings, options: DynamixelOptions, *, watch: bool = True
) -> DynamixelUnit:
    """Probe two servos on a line that is open, and return them ready; arguments as `open_dynamixel`."""
    shared = PreemptibleLine(line)
    bus = DynamixelBus(shared, settings.reply_timeout_s)
    servos = {}
    for axis, identifier in ((Axis.PAN, options.pan_id), (Axis.TILT, options.tilt_id)):
        try:
            bus.drain()
            servos[axis] = _probe(bus, identifier, line.url)
        except PtuError:
            line.close()
            raise
        except ExchangeFailed as fault:
            line.close()
            raise ProtocolError(
                line.url,
                got=f"{fault} from servo {identifier} at {line.baud()} bit/s",
                wanted=f"the {axis.value} servo, which speaks Dynamixel Protocol 2.0",
            ) from fault
    unit = DynamixelUnit(shared, bus, settings, options, servos, _description(line, settings, servos), watch=watch)
    reason = ""
    for _ in range(_PROBES):
        # the first reply of all only initialises the servos' clocks
        got = unit.read()
        if isinstance(got, Reading):
            return unit
        reason = got.reason.value
    unit.close()
    raise ProtocolError(line.url, got=reason, wanted="positions of both servos")


def open_dynamixel(
    url: str, settings: UnitSettings, clock: Callable[[], float] = time.monotonic, **options: Any
) -> PanTiltUnit:
    """Open two servos on one bus; `options` are the fields of `DynamixelOptions`."""
    chosen = parse_options(DynamixelOptions, "Dynamixel", options)
    line = SerialTransport(url, settings.baud or chosen.baud, clock)
    return connect_dynamixel(line, settings, chosen)


def _probe(bus: DynamixelBus, identifier: int, url: str) -> Servo:
    number = bus.ping(identifier)
    if number not in table.MODELS:
        raise ProtocolError(
            url, got=f"model number {number} of servo {identifier}", wanted="a model of the X series, or MX with 2.0"
        )
    if bus.read(identifier, table.DRIVE_MODE) & _TIME_BASED:
        raise ProtocolError(
            f"servo {identifier}", got="a time-based profile", wanted="a velocity-based one: bit 2 of drive mode 0"
        )
    bus.write(identifier, table.STATUS_RETURN, 2)
    return Servo(
        identifier=identifier,
        model=table.MODELS[number],
        firmware=bus.read(identifier, table.FIRMWARE),
        low=bus.read(identifier, table.MIN_POSITION),
        high=bus.read(identifier, table.MAX_POSITION),
        max_rate=bus.read(identifier, table.VELOCITY_LIMIT),
    )


def _description(line: Transport, settings: UnitSettings, servos: dict[Axis, Servo]) -> UnitDescription:
    axes = {
        axis: narrowed(
            settings.pan if axis is Axis.PAN else settings.tilt,
            quantum_rad=2 * math.pi / servo.model.steps,
            low_rad=servo.angle(servo.low),
            high_rad=servo.angle(servo.high),
            max_rate_rad_s=servo.max_rate * table.RATE_RAD_S,
            min_rate_rad_s=table.RATE_RAD_S,
        )
        for axis, servo in servos.items()
    }
    lease_s = min(LEASE_S, settings.watchdog_s or LEASE_S)
    pan, tilt = servos[Axis.PAN], servos[Axis.TILT]
    same = pan.model == tilt.model
    return UnitDescription(
        protocol="dynamixel",
        url=line.url,
        model=pan.model.name if same else f"{pan.model.name} and {tilt.model.name}",
        firmware=str(pan.firmware) if pan.firmware == tilt.firmware else f"{pan.firmware} and {tilt.firmware}",
        serial="",
        pan=axes[Axis.PAN],
        tilt=axes[Axis.TILT],
        capabilities=frozenset(
            (
                Capability.POSITION,
                Capability.VELOCITY,
                Capability.SPEED,
                Capability.COMBINED_QUERY,
                Capability.DEVICE_CLOCK,
            )
        ),
        # an exchange that fails ends a command, so that one timeout is the most; changing the mode takes 14 exchanges
        reply_timeout_s=settings.reply_timeout_s + 14 * (28 * line.character_s() + 0.002),
        lease=Lease(kind=LeaseKind.UNIT_WATCHDOG, renewed_s=lease_s, stop_s=lease_s + _STOPPING_S),
        details={"identifiers": f"{pan.identifier} and {tilt.identifier}", "baud": str(line.baud())},
    )
