"""The description of a probed FLIR unit for its users."""

from ptu_drivers.flir.probe import UnitFacts
from ptu_drivers.flir.rate_chain import lease_of
from ptu_drivers.messages import Capability, UnitDescription
from ptu_drivers.settings import UnitSettings
from ptu_drivers.transport import Transport


def describe_unit(facts: UnitFacts, line: Transport, settings: UnitSettings, limit_s: float) -> UnitDescription:
    """Return the description of a unit whose calls take `limit_s` at most, s."""
    can = {Capability.POSITION, Capability.VELOCITY, Capability.SPEED, Capability.HOMING}
    can |= {Capability.COMBINED_QUERY} if facts.combined else set()
    can |= {Capability.DEVICE_CLOCK} if facts.clock_hz else set()
    baud, asked = line.baud(), settings.baud
    kept = f"{baud}; the unit did not follow to {asked}" if asked and baud != asked else str(baud)
    return UnitDescription(
        protocol="flir",
        url=line.url,
        model=facts.model,
        firmware=facts.firmware,
        serial=facts.serial,
        pan=facts.pan.describe(settings.pan),
        tilt=facts.tilt.describe(settings.tilt),
        capabilities=frozenset(can),
        reply_timeout_s=limit_s,
        lease=lease_of(facts),
        details={**facts.details, "baud": kept if baud else "network"},
    )
