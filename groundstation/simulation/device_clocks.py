"""Device clocks with offset and drift: stamps of a device, and the session times that its user derives from them."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.rig.rig import ClockModel

_EXACT = ClockModel()


def device_from_session(clock: ClockModel | None, t_session_s: FloatArray) -> FloatArray:
    """Return what a device's clock shows at session times (n,), s; None is the session's own clock."""
    own = _EXACT if clock is None else clock
    return np.asarray((t_session_s - own.offset_s) / (1.0 + own.drift_ppm * 1e-6))


def session_from_device(clock: ClockModel | None, t_device_s: FloatArray) -> FloatArray:
    """Return the session times (n,) of a device's stamps (n,), s."""
    own = _EXACT if clock is None else clock
    return np.asarray(t_device_s + own.offset_s + own.drift_ppm * 1e-6 * t_device_s)


def stated_times(t_s: FloatArray, true: ClockModel | None, stated: ClockModel | None) -> FloatArray:
    """Return the session times (n,), by the stated clock, of the stamps taken at true times (n,), s."""
    return session_from_device(stated, device_from_session(true, t_s))
