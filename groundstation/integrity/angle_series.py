"""Readings of one head over time in a compact form, with linear interpolation."""

from array import array

import numpy as np

from groundstation.arrays import FloatArray

# readings closer together add nothing to an interpolation over tenths of a second
_APART_S = 0.04
# a gap between readings that is not bridged
_MAX_GAP_S = 0.5


class AngleSeries:
    """Pan and tilt of one head in order of time; 0.4 kB a second of flight, and none of less than 40 ms apart."""

    def __init__(self) -> None:
        self._t_s, self._pan_rad, self._tilt_rad = array("d"), array("f"), array("f")
        self._unwrapped = np.empty((2, 0))

    def __len__(self) -> int:
        """Return the number of readings kept."""
        return len(self._t_s)

    def add(self, t_s: float, pan_rad: float, tilt_rad: float) -> None:
        """Add a reading; one that is not newer than the last is passed over."""
        if not self._t_s or t_s - self._t_s[-1] >= _APART_S - 1e-6:
            self._t_s.append(t_s)
            self._pan_rad.append(pan_rad)
            self._tilt_rad.append(tilt_rad)

    def at(self, t_s: FloatArray) -> FloatArray:
        """Return pan and tilt (n, 2) rad at times (n,) s; not a number outside of the readings and in gaps of them."""
        result = np.full((len(t_s), 2), np.nan)
        if len(self._t_s) < 2:
            return result
        times = np.frombuffer(self._t_s)
        after = np.clip(np.searchsorted(times, t_s), 1, len(times) - 1)
        known = (times[0] <= t_s) & (t_s <= times[-1]) & (times[after] - times[after - 1] <= _MAX_GAP_S)
        if self._unwrapped.shape[1] != len(times):
            angles = np.array([np.frombuffer(each, np.float32) for each in (self._pan_rad, self._tilt_rad)], np.float64)
            self._unwrapped = np.unwrap(angles)
        for column, unwrapped in enumerate(self._unwrapped):
            result[known, column] = np.interp(t_s[known], times, unwrapped)
        return result
