"""When the stream's estimate has jumped: the reset counter of the external vision messages."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.navigation_state import NavigationState

# chi-square with 3 degrees of freedom, 1e-6: of 40 messages a second for an hour none is a jump by chance
_JUMP = 30.7
# what an aircraft accelerates by between two messages, one sigma per axis
_ACCELERATION_M_S2 = 5.0
_COUNTER_BITS = 0xFF


class ResetDetector:
    """Counts the resets of a stream: a track that was lost and found again, or one that was restarted elsewhere."""

    def __init__(self) -> None:
        self.resets = 0
        self._lost = False
        self._last: NavigationState | None = None

    def lost(self) -> None:
        """Note that the track was lost: the next state is of another one."""
        self._lost = True

    def counter_of(self, state: NavigationState) -> int:
        """Return the reset counter, 0 to 255, that a state is sent with."""
        if self._last is not None and (self._lost or _jumped(self._last, state)):
            self.resets += 1
        self._lost, self._last = False, state
        return self.resets & _COUNTER_BITS


def _jumped(last: NavigationState, state: NavigationState) -> bool:
    dt_s = state.t_s - last.t_s
    moved: FloatArray = state.position_ned_m - last.position_ned_m - dt_s * last.velocity_ned_m_s
    onward = np.hstack([np.eye(3), dt_s * np.eye(3)])
    covariance = onward @ last.covariance @ onward.T + state.covariance[:3, :3]
    covariance += np.eye(3) * (0.5 * _ACCELERATION_M_S2 * dt_s**2) ** 2
    return bool(moved @ np.linalg.solve(covariance, moved) > _JUMP)
