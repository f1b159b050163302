"""Device clocks with offset and drift: stamps of a device, and the session times that its user derives from them."""

from groundstation.arrays import FloatArray
from groundstation.rig.rig import EQUAL_CLOCKS, ClockModel


def device_from_session(clock: ClockModel | None, t_session_s: FloatArray) -> FloatArray:
    """Return what a device's clock shows at session times (n,), s; None is the session's own clock."""
    return (clock or EQUAL_CLOCKS).device_from_session(t_session_s)


def session_from_device(clock: ClockModel | None, t_device_s: FloatArray) -> FloatArray:
    """Return the session times (n,) of a device's stamps (n,), s."""
    return (clock or EQUAL_CLOCKS).session_from_device(t_device_s)


def stated_times(t_s: FloatArray, true: ClockModel | None, stated: ClockModel | None) -> FloatArray:
    """Return the session times (n,), by the stated clock, of the stamps taken at true times (n,), s."""
    return session_from_device(stated, device_from_session(true, t_s))
