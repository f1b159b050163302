"""A simulated Pelco unit with absolute positions: acceleration, speed limits, quantum, echo, short replies, reset.

It uses the numbers of such units: pan clockwise from 0 to 359.99 degrees, tilt downwards, with angles above the
horizon as a turn less (or another sense, by `PelcoModel`). Written from the protocol's description, without the
driver's conversions, so that a mistake there cannot cancel itself.
"""

import math
from dataclasses import dataclass

from ptu_drivers.messages import Axis
from ptu_drivers.pelco.codec import (
    Opcode,
    PelcoDecoder,
    PelcoFraming,
    PelcoMessage,
    encode,
    encode_acknowledgement,
    with_word,
)
from ptu_drivers.simulated.axis import SimulatedAxis
from ptu_drivers.simulated.peer import SimulatedPeer

_FASTEST = 63


@dataclass(frozen=True, slots=True, kw_only=True)
class PelcoModel:
    """Properties of the simulated unit.

    Attributes
    ----------
    address, framing, baud : of its line.
    clockwise, downwards : the sense in which its numbers increase.
    tilt_deg : stops, degrees upwards.
    max_rate_deg_s, acceleration_deg_s2 : of both axes; speed byte 63 is the fastest.
    play_deg : backlash.
    acknowledges : sends the short reply to commands (Pelco-D).
    answers : replies with its position; not every unit does.
    echo : received bytes are echoed, as on two wires.
    latency_s : least and most time from a query to its reply.
    homing_s : time after power-up during which it does not reply.
    """

    address: int = 1
    framing: PelcoFraming = PelcoFraming.D
    baud: int = 9600
    clockwise: bool = True
    downwards: bool = True
    tilt_deg: tuple[float, float] = (-90.0, 90.0)
    max_rate_deg_s: float = 60.0
    acceleration_deg_s2: float = 120.0
    play_deg: float = 0.0
    acknowledges: bool = False
    answers: bool = True
    echo: bool = False
    latency_s: tuple[float, float] = (0.002, 0.008)
    homing_s: float = 10.0


class SimulatedPelco(SimulatedPeer):
    """One unit; axes count hundredths of a degree, pan counter-clockwise, tilt upwards."""

    def __init__(self, model: PelcoModel | None = None, seed: int = 0) -> None:
        self.model = model or PelcoModel()
        m = self.model
        super().__init__(baud=m.baud, latency_s=m.latency_s, echo=m.echo, seed=seed)
        self._decoder = PelcoDecoder(m.framing)
        # pan has no stops: a range of many turns
        self.axes = {
            Axis.PAN: self._axis(-3_600_000, 3_600_000),
            Axis.TILT: self._axis(round(100 * m.tilt_deg[0]), round(100 * m.tilt_deg[1])),
        }

    def _axis(self, low: int, high: int) -> SimulatedAxis:
        m = self.model
        rate = 100 * m.max_rate_deg_s
        return SimulatedAxis(
            low=low,
            high=high,
            rate=rate,
            max_rate=rate,
            acceleration=100 * m.acceleration_deg_s2,
            play=100 * m.play_deg,
        )

    def head_rad(self, axis: Axis, t_s: float) -> float:
        """Return where the head points, rad, pan in (-pi, pi]."""
        counts = self.axes[axis].head(t_s)
        if axis is Axis.PAN:
            counts = -((18000 - counts) % 36000) + 18000
        return math.radians(counts / 100)

    def speed_table(self) -> dict[int, float]:
        """Return the rate of each speed byte, deg/s."""
        return {n: self.model.max_rate_deg_s * n / _FASTEST for n in range(1, _FASTEST + 1)}

    def _lose_power(self, t_s: float, off_s: float, *, homing: bool) -> float:
        self._decoder = PelcoDecoder(self.model.framing)
        for axis in self.axes.values():
            axis.freeze(t_s)
        return t_s + off_s + (self.model.homing_s if homing else 0.0)

    def _take(self, t_s: float, byte: int) -> None:
        for message in self._decoder.feed(bytes((byte,))):
            if message.address == self.model.address:
                self._obey(message, max(t_s, self._busy_until_s))

    def _obey(self, message: PelcoMessage, t_s: float) -> None:
        m = self.model
        if message.opcode in (Opcode.QUERY_PAN, Opcode.QUERY_TILT) and message.command_1 == 0:
            if m.answers:
                pan = message.opcode == Opcode.QUERY_PAN
                word = self._pan_word(t_s) if pan else self._tilt_word(t_s)
                reply = with_word(m.address, Opcode.PAN_IS if pan else Opcode.TILT_IS, word)
                self._answer(t_s, encode(reply, m.framing))
            return
        if message.command_1 == 0:
            self._move(message, t_s)
        if m.acknowledges and m.framing is PelcoFraming.D:
            self._answer(t_s, encode_acknowledgement(message))

    def _move(self, message: PelcoMessage, t_s: float) -> None:
        pan, tilt = self.axes[Axis.PAN], self.axes[Axis.TILT]
        if message.opcode == Opcode.SET_PAN:
            goal = -message.word if self.model.clockwise else message.word
            here = pan.counter(t_s)
            # the shorter way round
            pan.move_to(t_s, here + (goal - here + 18000) % 36000 - 18000)
        elif message.opcode == Opcode.SET_TILT:
            down = message.word - 36000 if message.word > 18000 else message.word
            tilt.move_to(t_s, -down if self.model.downwards else down)
        elif message.opcode & 1 == 0:
            pan.move_at(t_s, self._rate(message, Opcode.LEFT, Opcode.RIGHT, message.data_1))
            tilt.move_at(t_s, self._rate(message, Opcode.UP, Opcode.DOWN, message.data_2))

    def _rate(self, message: PelcoMessage, up: Opcode, down: Opcode, speed: int) -> float:
        way = bool(message.opcode & up) - bool(message.opcode & down)
        return way * 100 * self.model.max_rate_deg_s * min(speed, _FASTEST) / _FASTEST

    def _pan_word(self, t_s: float) -> int:
        counts = self.axes[Axis.PAN].counter(t_s)
        return (-counts if self.model.clockwise else counts) % 36000

    def _tilt_word(self, t_s: float) -> int:
        counts = self.axes[Axis.TILT].counter(t_s)
        return (-counts if self.model.downwards else counts) % 36000
