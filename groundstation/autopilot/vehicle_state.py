"""What a vehicle has told of itself: attitude, clock, origin, parameters, its own GNSS position."""

from dataclasses import dataclass, field

from groundstation.autopilot.link_delay import LinkDelay
from groundstation.autopilot.vehicle_attitude import VehicleAttitude

# MAV_AUTOPILOT
ARDUPILOT, PX4 = 3, 12


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssReport:
    """The vehicle's own GNSS position (GPS_RAW_INT, GPS2_RAW), received at session time ``received_s``.

    Degrees and m above mean sea level; one sigma horizontal and vertical, None where it is not told; ``fix_type`` as in
    the message; ``source_us`` its own stamp.
    """

    received_s: float
    source_us: int
    lat_deg: float
    lon_deg: float
    height_amsl_m: float
    sigma_horizontal_m: float | None
    sigma_vertical_m: float | None
    fix_type: int


@dataclass(slots=True)
class VehicleState:
    """The newest of each kind; None before it came. Times are session time, s."""

    system: int | None = None
    # of the autopilot itself: a gimbal and a companion computer have the vehicle's system number, too
    component: int | None = None
    autopilot: int | None = None
    heard_s: float | None = None
    attitude: VehicleAttitude | None = None
    # latitude, longitude (degrees) and height above mean sea level (m) of its local frame
    global_origin: tuple[float, float, float] | None = None
    # its own clock, s since its start, when it last told it
    clock_s: float | None = None
    # of each of its receivers, by number from 0
    gnss: dict[int, GnssReport] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    link_delay: LinkDelay = field(default_factory=LinkDelay)
