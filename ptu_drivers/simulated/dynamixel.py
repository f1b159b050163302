"""Two simulated Dynamixel servos of the X series on one bus: control table, status packets, motion, bus watchdog."""

import math
from dataclasses import dataclass

from ptu_drivers.dynamixel import table
from ptu_drivers.dynamixel.codec import BROADCAST, Instruction, Packet, PacketDecoder, ServoError, encode
from ptu_drivers.dynamixel.table import OperatingMode, Register
from ptu_drivers.messages import Axis
from ptu_drivers.simulated.axis import SimulatedAxis
from ptu_drivers.simulated.peer import SimulatedPeer

_SIZE = 147
_KEPT = 64  # addresses below are in EEPROM: kept without power, and closed while the torque is on
_WRITABLE = frozenset(
    address
    for register in (
        *(Register(9, 1), Register(10, 1), Register(11, 1), Register(44, 4), Register(48, 4), Register(52, 4)),
        *(Register(64, 1), Register(65, 1), Register(68, 1), Register(98, 1), Register(104, 4), Register(108, 4)),
        *(Register(112, 4), Register(116, 4)),
    )
    for address in range(register.address, register.address + register.size)
)
_GOALS = frozenset(range(100, 120))


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoModel:
    """What kind of servos are simulated.

    Attributes
    ----------
    model : model number.
    limits_deg : of the position register about its middle.
    velocity_limit : in units of the register. acceleration_deg_s2 : of the motor.
    """

    model: int = 1020
    limits_deg: tuple[float, float] = (-90.0, 90.0)
    velocity_limit: int = 44
    acceleration_deg_s2: float = 600.0


class SimulatedServo:
    """One servo: registers, and an axis that counts steps about the middle."""

    def __init__(self, identifier: int, model: ServoModel) -> None:
        self.identifier = identifier
        self.model = model
        steps = 4096 / 360
        self.axis = SimulatedAxis(
            low=-2048,
            high=2047,
            rate=self._rate(model.velocity_limit),
            max_rate=self._rate(model.velocity_limit),
            acceleration=model.acceleration_deg_s2 * steps,
        )
        self.powered_s = 0.0
        self.heard_s = 0.0
        self.registers = bytearray(_SIZE)
        low, high = (2048 + round(end * steps) for end in model.limits_deg)
        for register, value in (
            (table.MODEL_NUMBER, model.model),
            (table.FIRMWARE, 46),
            (Register(7, 1), identifier),
            (table.RETURN_DELAY, 250),
            (table.OPERATING_MODE, OperatingMode.POSITION),
            (table.VELOCITY_LIMIT, model.velocity_limit),
            (table.MAX_POSITION, high),
            (table.MIN_POSITION, low),
        ):
            self.put(register, value)
        self.power_up(0.0)

    def _rate(self, velocity: int) -> float:
        """Return steps/s."""
        return velocity * table.RATE_RAD_S * 4096 / (2 * math.pi)

    def put(self, register: Register, value: int) -> None:
        """Set a register from inside."""
        data = value.to_bytes(register.size, "little", signed=value < 0)
        self.registers[register.address : register.address + register.size] = data

    def get(self, register: Register) -> int:
        """Return a register's number."""
        data = self.registers[register.address : register.address + register.size]
        return table.number(bytes(data), signed=register.signed)

    def power_up(self, t_s: float) -> None:
        """Take the values that stand in RAM after power-up: torque off, tick from 0."""
        self.registers[_KEPT:] = bytes(_SIZE - _KEPT)
        self.put(table.STATUS_RETURN, 2)
        self.powered_s = t_s

    def refresh(self, t_s: float) -> None:
        """Write the measured values into the registers."""
        self.put(table.REALTIME_TICK, math.floor((t_s - self.powered_s) / table.TICK_S) % table.TICKS)
        self.put(table.PRESENT_POSITION, 2048 + self.axis.counter(t_s))
        self.put(table.PRESENT_VELOCITY, round(self.axis.speed(t_s) / self._rate(1)))
        self.put(Register(122, 1), int(self.axis.speed(t_s) != 0))

    def write(self, t_s: float, address: int, data: bytes) -> ServoError:
        """Set registers from outside."""
        touched = range(address, address + len(data))
        if not data or not _WRITABLE.issuperset(touched):
            return ServoError.ACCESS
        if self.get(table.TORQUE_ENABLE) and touched.start < _KEPT:
            return ServoError.ACCESS
        if self.get(table.BUS_WATCHDOG) < 0 and not _GOALS.isdisjoint(touched):
            # the e-Manual's example of the bus watchdog, step 6: a range error
            return ServoError.DATA_RANGE
        if (error := self._out_of_range(address, data)) is not ServoError.NONE:
            return error
        before = self.get(table.TORQUE_ENABLE)
        self.registers[touched.start : touched.stop] = data
        self._follow(t_s, touched, before)
        return ServoError.NONE

    def trip(self, t_s: float) -> None:
        """The bus watchdog: stop, and close the goals."""
        self.axis.halt(t_s)
        self.put(table.BUS_WATCHDOG, -1)

    def _out_of_range(self, address: int, data: bytes) -> ServoError:
        signed = table.number(data, signed=True)
        if address == table.GOAL_POSITION.address and len(data) == 4:
            inside = self.get(table.MIN_POSITION) <= signed <= self.get(table.MAX_POSITION)
            return ServoError.NONE if inside else ServoError.DATA_RANGE
        if address == table.GOAL_VELOCITY.address and len(data) == 4:
            return ServoError.NONE if abs(signed) <= self.get(table.VELOCITY_LIMIT) else ServoError.DATA_RANGE
        if address == table.OPERATING_MODE.address and data[0] not in (0, 1, 3, 4, 5, 16):
            return ServoError.DATA_RANGE
        return ServoError.NONE

    def _follow(self, t_s: float, touched: range, torque_before: int) -> None:
        torque = self.get(table.TORQUE_ENABLE)
        if torque and not torque_before:
            # the goals begin where the servo is
            self.refresh(t_s)
            self.put(table.GOAL_POSITION, self.get(table.PRESENT_POSITION))
            self.put(table.GOAL_VELOCITY, 0)
        if torque_before and not torque:
            self.axis.halt(t_s)
        if not torque:
            return
        mode = self.get(table.OPERATING_MODE)
        if mode == OperatingMode.POSITION and table.GOAL_POSITION.address in touched:
            rate = self.get(table.PROFILE_VELOCITY) or self.get(table.VELOCITY_LIMIT)
            rate = min(rate, self.get(table.VELOCITY_LIMIT))
            self.axis.move_to(t_s, self.get(table.GOAL_POSITION) - 2048, self._rate(rate))
        if mode == OperatingMode.VELOCITY and table.GOAL_VELOCITY.address in touched:
            self.axis.move_at(t_s, self._rate(self.get(table.GOAL_VELOCITY)))


class SimulatedDynamixel(SimulatedPeer):
    """Both servos and their bus; the first is pan, the second tilt."""

    def __init__(
        self,
        model: ServoModel | None = None,
        *,
        identifiers: tuple[int, int] = (1, 2),
        baud: int = 57600,
        echo: bool = False,
        latency_s: tuple[float, float] = (0.0, 0.0003),
        seed: int = 0,
    ) -> None:
        super().__init__(baud=baud, latency_s=latency_s, echo=echo, seed=seed)
        self.servos = {i: SimulatedServo(i, model or ServoModel()) for i in identifiers}
        self._by_axis = dict(zip(Axis, identifiers, strict=True))
        self._decoder = PacketDecoder()

    def servo(self, axis: Axis) -> SimulatedServo:
        """Return the servo of an axis."""
        return self.servos[self._by_axis[axis]]

    def head_rad(self, axis: Axis, t_s: float) -> float:
        """Return where the head points, rad from the middle of the position register."""
        return self.servo(axis).axis.head(t_s) * 2 * math.pi / 4096

    def _lose_power(self, t_s: float, off_s: float, *, homing: bool) -> float:
        self._decoder = PacketDecoder()
        for servo in self.servos.values():
            servo.axis.freeze(t_s)
            servo.power_up(t_s + off_s)
        return t_s + off_s

    def send(self, until_s: float) -> list[tuple[float, int, int]]:
        """Let time pass, for the watchdogs, and return the sent bytes."""
        self._watch(until_s)
        return super().send(until_s)

    def _take(self, t_s: float, byte: int) -> None:
        for packet in self._decoder.feed(bytes((byte,))):
            if packet.instruction != Instruction.STATUS:
                self._watch(t_s)
                for servo in self.servos.values():
                    if packet.identifier in (servo.identifier, BROADCAST):
                        servo.heard_s = t_s
                self._obey(packet, t_s)

    def _watch(self, t_s: float) -> None:
        for servo in self.servos.values():
            limit = servo.get(table.BUS_WATCHDOG)
            if limit > 0 and servo.get(table.TORQUE_ENABLE) and t_s - servo.heard_s > limit * table.WATCHDOG_S:
                servo.trip(servo.heard_s + limit * table.WATCHDOG_S)

    def _obey(self, packet: Packet, t_s: float) -> None:
        p = packet.parameters
        addressed = [s for i, s in self.servos.items() if packet.identifier in (i, BROADCAST)]
        if packet.instruction == Instruction.PING:
            for servo in addressed:
                self._status(servo, t_s, read=(0, 2), tail=bytes(servo.registers[6:7]))
        elif packet.instruction == Instruction.READ and len(p) == 4 and packet.identifier != BROADCAST:
            for servo in addressed:
                self._status(servo, t_s, read=(_word(p), _word(p[2:])))
        elif packet.instruction == Instruction.WRITE and len(p) > 2:
            for servo in addressed:
                error = servo.write(t_s, _word(p), p[2:])
                if packet.identifier != BROADCAST and servo.get(table.STATUS_RETURN) == 2:
                    self._status(servo, t_s, error=error)
        elif packet.instruction == Instruction.SYNC_READ and len(p) > 4:
            for identifier in p[4:]:
                if identifier in self.servos:
                    self._status(self.servos[identifier], t_s, read=(_word(p), _word(p[2:])))
        elif packet.instruction == Instruction.SYNC_WRITE and len(p) > 4:
            size = _word(p[2:])
            for begin in range(4, len(p) - size, size + 1):
                if p[begin] in self.servos:
                    self.servos[p[begin]].write(t_s, _word(p), p[begin + 1 : begin + 1 + size])
        else:
            for servo in addressed:
                if packet.identifier != BROADCAST:
                    self._status(servo, t_s, error=ServoError.INSTRUCTION)

    def _status(
        self,
        servo: SimulatedServo,
        t_s: float,
        *,
        read: tuple[int, int] | None = None,
        error: ServoError = ServoError.NONE,
        tail: bytes = b"",
    ) -> None:
        """Reply after the servo's return delay, and after earlier replies; measured when it is composed."""
        composed_s = max(t_s, self._busy_until_s) + servo.get(table.RETURN_DELAY) * table.RETURN_DELAY_S
        data = b""
        if read is not None:
            if read[0] + read[1] > _SIZE:
                error = ServoError.DATA_RANGE
            else:
                servo.refresh(composed_s)
                data = bytes(servo.registers[read[0] : read[0] + read[1]])
        alert = ServoError.ALERT if servo.get(table.HARDWARE_ERROR) else 0
        status = encode(
            Packet(
                identifier=servo.identifier,
                instruction=Instruction.STATUS,
                parameters=bytes((error | alert,)) + data + tail,
            )
        )
        self._busy_until_s = self._answer(composed_s, status) + len(status) * self.character_s()


def _word(data: bytes) -> int:
    return data[0] | data[1] << 8
