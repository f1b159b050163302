"""A halted unit counts as standing when its readings say so, not when the halt was sent."""

import math

from groundstation.live.standing_check import StandingCheck
from ptu_drivers.messages import AngleSample, AngleSource, Axis, Reading


def reading(t_s: float, pan_deg: float) -> Reading:
    pan, tilt = (
        AngleSample(
            axis=axis,
            t_s=t_s,
            sigma_t_s=0.001,
            angle_rad=math.radians(angle),
            sigma_rad=1e-4,
            source=next(iter(AngleSource)),
        )
        for axis, angle in ((Axis.PAN, pan_deg), (Axis.TILT, 3.0))
    )
    return Reading(pan=pan, tilt=tilt, sent_s=t_s - 0.01, answered_s=t_s + 0.01)


def test_it_stands_once_two_readings_are_the_same() -> None:
    check = StandingCheck()
    assert not check.is_awaited(0.0)
    check.begin(1.0)
    for k, pan_deg in enumerate((0.0, 1.8, 3.1, 3.6, 3.7)):
        check.take(reading(1.0 + 0.05 * k, pan_deg))
        assert check.is_awaited(1.0 + 0.05 * k)
    # the same reading once more is no evidence
    check.take(reading(1.2, 3.7))
    assert check.is_awaited(1.2)
    check.take(reading(1.25, 3.71))
    assert not check.is_awaited(1.25)


def test_a_unit_without_angles_is_waited_for_two_seconds() -> None:
    check = StandingCheck()
    check.begin(5.0)
    assert check.is_awaited(6.9)
    assert not check.is_awaited(7.1)
