"""A flight that begins when it is told to, on the host's clock."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.trajectory import Trajectory


class DelayedTrajectory:
    """A trajectory with its time zero at an instant of the host clock, which may be set during use."""

    def __init__(self, flight: Trajectory, start_s: float) -> None:
        self._flight, self.start_s = flight, start_s

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time of the trajectory, s."""
        return self._flight.span_s[0] + self.start_s, self._flight.span_s[1] + self.start_s

    def position(self, t_s: FloatArray) -> FloatArray:
        """Return positions (n, 3)."""
        return self._flight.position(np.asarray(t_s) - self.start_s)

    def velocity(self, t_s: FloatArray) -> FloatArray:
        """Return velocities (n, 3)."""
        return self._flight.velocity(np.asarray(t_s) - self.start_s)
