"""Limits of an axis after sign, zero and soft limits, and the check of a command against them."""

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
    max_acceleration_rad_s2: float = math.inf,
    limits_from: str = "unit",
    rates_from: str = "",
) -> AxisDescription:
    """Return an axis after sign, zero and soft limits; arguments are the unit's own, rad, rad/s and rad/s².

    `limits_from` is the origin of the limits: "unit", or "settings" where a unit cannot be queried; so is `rates_from`.
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
        max_acceleration_rad_s2=max_acceleration_rad_s2,
        rate_from="settings" if axis.max_rate_rad_s < max_rate_rad_s else rates_from or limits_from,
    )


def check_angle(axis: Axis, reported: AxisDescription, angle_rad: float) -> None:
    """Return if an axis may point there, rad. Raises LimitError; NaN is beyond every limit."""
    if not angle_rad >= reported.low_rad - _ROUNDING:
        raise LimitError(axis.value, "lower limit", got=angle_rad, bound=reported.low_rad, origin=reported.low_from)
    if angle_rad > reported.high_rad + _ROUNDING:
        raise LimitError(axis.value, "upper limit", got=angle_rad, bound=reported.high_rad, origin=reported.high_from)


def check_rate(axis: Axis, reported: AxisDescription, rate_rad_s: float) -> None:
    """Return if an axis may turn so fast, rad/s. Raises LimitError; 0 is allowed."""
    if not abs(rate_rad_s) <= reported.max_rate_rad_s * (1 + _ROUNDING):
        raise LimitError(
            axis.value, "maximum speed", got=rate_rad_s, bound=reported.max_rate_rad_s, origin=reported.rate_from
        )
    if 0 < abs(rate_rad_s) < reported.min_rate_rad_s * (1 - _ROUNDING):
        raise LimitError(axis.value, "minimum speed", got=rate_rad_s, bound=reported.min_rate_rad_s, origin="unit")


def check_speed(axis: Axis, reported: AxisDescription, rate_rad_s: float) -> None:
    """Return if a move to a position may have this speed, rad/s. Raises LimitError; at 0 it would never arrive."""
    check_rate(axis, reported, rate_rad_s)
    if rate_rad_s == 0 and reported.min_rate_rad_s > 0:
        raise LimitError(axis.value, "minimum speed", got=0.0, bound=reported.min_rate_rad_s, origin="unit")


def check_room(axis: Axis, reported: AxisDescription, ahead_rad: float, rate_rad_s: float) -> None:
    """Return if an axis that will soon be at `ahead_rad` has room to turn that way. Raises LimitError."""
    if (rate_rad_s > 0 and ahead_rad >= reported.high_rad) or (rate_rad_s < 0 and ahead_rad <= reported.low_rad):
        check_angle(axis, reported, ahead_rad + math.copysign(2 * _ROUNDING, rate_rad_s))
