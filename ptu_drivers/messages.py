"""The records that cross the drivers' border. SI and radians; instants on the clock that the driver was given."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from ptu_drivers.health import FailureReason, UnitState
from ptu_drivers.lease import NO_LEASE, Lease


class Axis(StrEnum):
    """The two axes of a unit."""

    PAN = "pan"
    TILT = "tilt"


class AngleSource(StrEnum):
    """How the instant of an angle was found, the best first."""

    DEVICE_CLOCK = "device clock"
    """The unit stamped the angle itself; its clock was tied to ours by exchanges with short round trips."""
    LAST_BYTE_SENT = "last byte sent"
    """Query's last byte given to a serial port, plus its time on the line; held against the bounds from the echo and
    the first byte of the reply, which adapters hand over late and in batches."""
    FIRST_REPLY_BYTE = "first reply byte"
    """First byte of the reply, less its own time on the line and the unit's stated latency."""
    ROUND_TRIP = "round trip"
    """Middle of the round trip: where nothing is known of when the other side read the angle (HTTP, sync read)."""


class Capability(StrEnum):
    """Functions of a unit; absent ones raise `UnsupportedError`."""

    POSITION = "position"
    VELOCITY = "velocity"
    COMBINED_QUERY = "combined query"
    DEVICE_CLOCK = "device clock"
    HOMING = "homing"
    SPEED = "speed of moves"
    """A move to a position may name its speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleSample:
    """One axis' angle, at the instant when it was valid.

    Attributes
    ----------
    axis : of the unit.
    t_s : instant at which the angle was valid, s, on the driver's clock.
    sigma_t_s : 1 sigma of that instant, s: jitter of the unit's latency and of the line, measured or stated.
    angle_rad : angle after sign and zero of the settings, rad; pan positive counter-clockwise from above, tilt upwards.
    sigma_rad : 1 sigma of the angle as the unit reports it, rad: its quantum over sqrt(12). Motion during `sigma_t_s`
        is not included, because only the user of the sample has the rate.
    source : method by which the instant was determined.
    """

    axis: Axis
    t_s: float
    sigma_t_s: float
    angle_rad: float
    sigma_rad: float
    source: AngleSource


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Both axes, each at its own instant; not filtered, not interpolated.

    Attributes
    ----------
    pan, tilt : the angles.
    sent_s, answered_s : when its first query was sent and its last reply was complete, s.
    """

    pan: AngleSample
    tilt: AngleSample
    sent_s: float
    answered_s: float

    def axis(self, axis: Axis) -> AngleSample:
        """Return one axis' angle."""
        return self.pan if axis is Axis.PAN else self.tilt


@dataclass(frozen=True, slots=True, kw_only=True)
class NoReading:
    """No valid angle, and the reason: returned by `read` instead of a doubtful one.

    Attributes
    ----------
    reason : of the failure.
    state : of the driver's recovery.
    t_s : time of the failure, s.
    """

    reason: FailureReason
    state: UnitState
    t_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisDescription:
    """Capabilities of one axis: queried from the unit, then narrowed by the settings.

    Attributes
    ----------
    quantum_rad : smallest step that the unit reports, rad.
    low_rad, high_rad : limits, rad, after sign and zero; the narrower of unit and settings.
    low_from, high_from : origin of the limit: "unit" or "settings".
    max_rate_rad_s, min_rate_rad_s : bounds of its speed, rad/s; 0 stands still and is always allowed.
    rate_from : origin of the upper bound.
    max_acceleration_rad_s2 : rad/s², or infinity where the unit does not report it.
    """

    quantum_rad: float
    low_rad: float
    high_rad: float
    low_from: str = "unit"
    high_from: str = "unit"
    max_rate_rad_s: float
    min_rate_rad_s: float = 0.0
    rate_from: str = "unit"
    max_acceleration_rad_s2: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitDescription:
    """Description of a unit.

    Attributes
    ----------
    protocol : "flir", "pelco-d", …
    url : the line.
    model, firmware, serial : as reported, "" where they are not.
    pan, tilt : the axes.
    capabilities : its functions.
    reply_timeout_s : longest time that one exchange may take, s.
    lease : what stops motion by rate when the host falls silent.
    details : other results of the probe, as text for users.
    """

    protocol: str
    url: str
    model: str
    firmware: str
    serial: str
    pan: AxisDescription
    tilt: AxisDescription
    capabilities: frozenset[Capability]
    reply_timeout_s: float
    lease: Lease = NO_LEASE
    details: Mapping[str, str] = field(default_factory=dict)

    def axis(self, axis: Axis) -> AxisDescription:
        """Return the description of one axis."""
        return self.pan if axis is Axis.PAN else self.tilt
