"""One station's PTU: how it is reached and set, and opened; probed then, and standing still.

The process that reads the PTUs begins with this and little else, so that it is there soon.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from groundstation.errors import GroundstationError
from groundstation.live.keep_out_unit import KeepOutUnit
from groundstation.pointing.keep_out import KeepOut, Sector
from ptu_drivers.errors import PtuError
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.open import open_ptu
from ptu_drivers.settings import AxisSettings, UnitSettings

# Commands come every 0.03 s. Where they end (the pipeline is stopped), a unit is to stand within a second: its watchdog
# looks every 0.1 s, the line takes its time, and half a second is left for braking.
_WATCHDOG_S = 0.35


class DeviceError(GroundstationError):
    """A device of the station file cannot be used; one line with its name and the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadDevice:
    """One station's PTU.

    Attributes
    ----------
    url, protocol, options : as `ptu_drivers.open_ptu` takes them.
    signs, zeros_rad : of pan and tilt.
    lows_rad, highs_rad : soft limits of pan and tilt; infinite where the unit's own hold.
    rates_rad_s : soft limits of the speeds.
    baud : to raise the line to; 0 keeps it. latency_s : of the unit; None is the driver's default.
    poll_s : asked no more often.
    park_rad : where it is left, pan and tilt.
    sectors : of its angles, closed to it.
    keep_out : all that its lens is kept out of, at times of the host's monotonic clock; None before it is known where
        the station stands.
    """

    url: str
    protocol: str = "flir"
    options: dict[str, Any] = field(default_factory=dict)
    signs: tuple[int, int] = (1, 1)
    zeros_rad: tuple[float, float] = (0.0, 0.0)
    lows_rad: tuple[float, float] = (-math.inf, -math.inf)
    highs_rad: tuple[float, float] = (math.inf, math.inf)
    rates_rad_s: tuple[float, float] = (math.inf, math.inf)
    baud: int = 0
    latency_s: float | None = None
    poll_s: float = 0.01
    park_rad: tuple[float, float] = (0.0, 0.0)
    sectors: tuple[Sector, ...] = ()
    keep_out: KeepOut | None = None


def head_settings(head: HeadDevice) -> UnitSettings:
    """Return a head's settings as its driver takes them."""
    pan, tilt = (
        AxisSettings(
            sign=head.signs[k],
            zero_rad=head.zeros_rad[k],
            low_rad=head.lows_rad[k],
            high_rad=head.highs_rad[k],
            max_rate_rad_s=head.rates_rad_s[k],
        )
        for k in range(2)
    )
    settings = UnitSettings(pan=pan, tilt=tilt, baud=head.baud, watchdog_s=_WATCHDOG_S)
    return settings if head.latency_s is None else replace(settings, latency_s=head.latency_s)


def open_head(name: str, head: HeadDevice, clock: Callable[[], float]) -> PanTiltUnit:
    """Open and probe one PTU, and keep its lens out of what is closed to it; raises `DeviceError`."""
    settings = head_settings(head)
    try:
        unit = open_ptu(head.url, head.protocol, settings, clock=clock, **head.options)
        if head.keep_out is None or head.keep_out.is_empty:
            return unit
        return KeepOutUnit(unit, head.keep_out, clock, lease_s=settings.watchdog_s)
    except PtuError as fault:
        raise DeviceError(f"{name}: PTU: {fault}") from fault
    except TypeError as fault:
        raise DeviceError(f"{name}: PTU: ptu_options: {fault}") from fault
