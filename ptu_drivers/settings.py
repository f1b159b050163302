"""Settings by the user: sign, zero, soft limits, times."""

from dataclasses import dataclass, field

from ptu_drivers.errors import ProtocolError

SLOWEST_BAUD = 50
_FASTEST_BAUD = 10_000_000


def check_baud(where: str, baud: int) -> None:
    """Return if a serial line may have this speed, bit/s. Raises ProtocolError."""
    if not SLOWEST_BAUD <= baud <= _FASTEST_BAUD:
        wanted = f"a serial line's speed, {SLOWEST_BAUD} to {_FASTEST_BAUD} bit/s"
        raise ProtocolError(where, got=str(baud), wanted=wanted)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSettings:
    """Mounting and limits of one axis.

    Attributes
    ----------
    sign : +1 or -1: angle = sign · (unit's angle) - zero. Manuals contradict each other; a calibration decides.
    zero_rad : the unit's angle, after the sign, at the zero of the driver's angle, rad.
    low_rad, high_rad : soft limits, rad, after sign and zero; infinite leaves the unit's own.
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
        """Return the driver's angle for the unit's, rad."""
        return self.sign * unit_rad - self.zero_rad

    def unit_angle(self, angle_rad: float) -> float:
        """Return the unit's angle for the driver's, rad."""
        return self.sign * (angle_rad + self.zero_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitSettings:
    """Use of a unit.

    Attributes
    ----------
    pan, tilt : the axes.
    reply_timeout_s : time without a reply that is a timeout, s, in addition to the time on the line.
    latency_s, latency_sigma_s : from a query's last bit at the unit to the first bit of its reply, s, and its spread.
        The angle is assumed to be read at its start (the unit reads its counters when the delimiter arrives).
    watchdog_s : motion by rate is halted after this time without a command, s; 0 turns the watchdog off.
    homing_timeout_s : limit of the duration of homing, s.
    baud : speed to raise a serial line to, bit/s; 0 keeps the present one.
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
