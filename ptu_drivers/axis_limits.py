"""Limits of an axis after sign, zero and soft limits, and what is beyond them."""

import math

from ptu_drivers.errors import LimitError
from ptu_drivers.messages import Axis, AxisDescription
from ptu_drivers.settings import AxisSettings

# a limit that was asked for and is given back is within it, whatever rounding did on the way
_ROUNDING = 1e-9


def narrowed(
    axis: AxisSettings,
    *,
    quantum_rad: float,
    low_rad: float,
    high_rad: float,
    max_rate_rad_s: float,
    min_rate_rad_s: float = 0.0,
    limits_from: str = "unit",
    rates_from: str = "",
) -> AxisDescription:
    """Return an axis after sign, zero and soft limits; arguments are the unit's own, rad and rad/s.

    `limits_from` says who knows the limits: "unit", or "settings" where a unit cannot be asked; `rates_from` likewise.
    """
    ends = sorted((axis.angle(low_rad), axis.angle(high_rad)))
    return AxisDescription(
        quantum_rad=quantum_rad,
        low_rad=max(ends[0], axis.low_rad),
        high_rad=min(ends[1], axis.high_rad),
        low_from="settings" if axis.low_rad > ends[0] else limits_from,
        high_from="settings" if axis.high_rad < ends[1] else limits_from,
        max_rate_rad_s=min(max_rate_rad_s, axis.max_rate_rad_s),
        min_rate_rad_s=min_rate_rad_s,
        rate_from="settings" if axis.max_rate_rad_s < max_rate_rad_s else rates_from or limits_from,
    )


def check_angle(axis: Axis, said: AxisDescription, angle_rad: float) -> None:
    """Return if an axis may point there, rad. Raises LimitError; NaN is beyond every limit."""
    if not angle_rad >= said.low_rad - _ROUNDING:
        raise LimitError(axis.value, "lower limit", got=angle_rad, bound=said.low_rad, origin=said.low_from)
    if angle_rad > said.high_rad + _ROUNDING:
        raise LimitError(axis.value, "upper limit", got=angle_rad, bound=said.high_rad, origin=said.high_from)


def check_rate(axis: Axis, said: AxisDescription, rate_rad_s: float) -> None:
    """Return if an axis may turn so fast, rad/s. Raises LimitError; 0 is allowed."""
    if not abs(rate_rad_s) <= said.max_rate_rad_s * (1 + _ROUNDING):
        raise LimitError(axis.value, "maximum speed", got=rate_rad_s, bound=said.max_rate_rad_s, origin=said.rate_from)
    if 0 < abs(rate_rad_s) < said.min_rate_rad_s * (1 - _ROUNDING):
        raise LimitError(axis.value, "minimum speed", got=rate_rad_s, bound=said.min_rate_rad_s, origin="unit")


def check_room(axis: Axis, said: AxisDescription, ahead_rad: float, rate_rad_s: float) -> None:
    """Return if an axis that will soon be at `ahead_rad` has room to turn that way. Raises LimitError."""
    if (rate_rad_s > 0 and ahead_rad >= said.high_rad) or (rate_rad_s < 0 and ahead_rad <= said.low_rad):
        check_angle(axis, said, ahead_rad + math.copysign(2 * _ROUNDING, rate_rad_s))
