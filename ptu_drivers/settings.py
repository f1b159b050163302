"""What the user decides: sign, zero, soft limits, times."""

from dataclasses import dataclass, field

from ptu_drivers.errors import ProtocolError

_SLOWEST_BAUD = 50
_FASTEST_BAUD = 10_000_000


def check_baud(where: str, baud: int) -> None:
    """Return if a serial line may have this speed, bit/s. Raises ProtocolError."""
    if not _SLOWEST_BAUD <= baud <= _FASTEST_BAUD:
        wanted = f"a serial line's speed, {_SLOWEST_BAUD} to {_FASTEST_BAUD} bit/s"
        raise ProtocolError(where, got=str(baud), wanted=wanted)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSettings:
    """How one axis is mounted and how far it may go.

    Attributes
    ----------
    sign : +1 or -1: angle = sign · (unit's angle) - zero. Manuals contradict each other; a calibration decides.
    zero_rad : what the unit shows, after the sign, where our angle is zero, rad.
    low_rad, high_rad : soft limits, rad, after sign and zero; infinite leaves it to the unit.
    max_rate_rad_s : soft limit of the speed, rad/s.
    """

    sign: int = 1
    zero_rad: float = 0.0
    low_rad: float = float("-inf")
    high_rad: float = float("inf")
    max_rate_rad_s: float = float("inf")

    def __post_init__(self) -> None:
        if self.sign not in (1, -1):
            raise ProtocolError("AxisSettings.sign", got=repr(self.sign), wanted="1 or -1")
        if not self.low_rad < self.high_rad:
            raise ProtocolError(
                "AxisSettings", got=f"low {self.low_rad}, high {self.high_rad}", wanted="low below high"
            )

    def angle(self, unit_rad: float) -> float:
        """Return our angle of the unit's, rad."""
        return self.sign * unit_rad - self.zero_rad

    def unit_angle(self, angle_rad: float) -> float:
        """Return the unit's angle of ours, rad."""
        return self.sign * (angle_rad + self.zero_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitSettings:
    """How a unit is used.

    Attributes
    ----------
    pan, tilt : the axes.
    reply_timeout_s : an exchange without an answer for so long is a timeout, s; time on the line comes on top.
    latency_s, latency_sigma_s : from a query's last bit at the unit to the first bit of its reply, s, and its spread.
        The angle is taken to be read at the start of it (the unit reads its counters when the delimiter arrives).
    watchdog_s : motion by rate is halted when no command came for so long, s; 0 turns the watchdog off.
    homing_timeout_s : how long a unit may home before it is given up, s.
    baud : speed to raise a serial line to, bit/s; 0 keeps the one it has.
    """

    pan: AxisSettings = field(default_factory=AxisSettings)
    tilt: AxisSettings = field(default_factory=AxisSettings)
    reply_timeout_s: float = 0.25
    latency_s: float = 0.005
    latency_sigma_s: float = 0.0017
    watchdog_s: float = 0.5
    homing_timeout_s: float = 60.0
    baud: int = 0

    def __post_init__(self) -> None:
        if self.baud:
            check_baud("baud", self.baud)
