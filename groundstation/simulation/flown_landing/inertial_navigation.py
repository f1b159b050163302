"""Position and velocity as an autopilot has them from delayed samples and its own accelerations.

A stand-in for ArduPilot's EKF3 and PX4's EKF2, which do the same with more states: a Kalman filter lives at the time of
the newest sample, and its state is carried on to the present by the accelerations that were measured since. For each
axis, position p, velocity v and error b of the acceleration: ṗ = v, v̇ = a + b, with white noise, and b a random walk.
It takes neither a barometer nor a compass nor airspeed, refuses no sample by its size, and holds attitude for known.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialNavigationTuning:
    """Noise of the accelerations.

    ``acceleration_psd_m2_s3`` of the white part: EKF3's default of 0.35 m/s² in each step of 12 ms. ``error_m_s2``
    (right, along, up) one sigma of the slow part at the start: gravity seen through 1.5° of attitude, and an
    accelerometer's constant; it changes by as much in ``error_s``.
    """

    acceleration_psd_m2_s3: float = 0.35**2 * 0.012
    error_m_s2: tuple[float, float, float] = (0.3, 0.3, 0.15)
    error_s: float = 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehiclePosition:
    """Position and velocity (3,) of the vehicle's reference point, and their covariance (6, 6), runway frame."""

    position_runway_m: FloatArray
    velocity_runway_m_s: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionSample:
    """A sample for the filter: position and, unless it is None, velocity (3,) with one sigma of each axis (3,)."""

    t_s: float
    position_runway_m: FloatArray
    position_sigma_m: FloatArray
    velocity_runway_m_s: FloatArray | None
    velocity_sigma_m_s: FloatArray


class InertialNavigation:
    """The filter.

    Parameters
    ----------
    start_s : time of ``start``, s.
    """

    def __init__(self, start_s: float, start: VehiclePosition, tuning: InertialNavigationTuning | None = None) -> None:
        self._tuning = InertialNavigationTuning() if tuning is None else tuning
        # of each axis: position, velocity, error of the acceleration
        self._state = np.stack([start.position_runway_m, start.velocity_runway_m_s, np.zeros(3)], axis=1)
        self._covariance = np.zeros((3, 3, 3))
        for axis in range(3):
            pair = [axis, axis + 3]
            self._covariance[axis, :2, :2] = start.covariance[np.ix_(pair, pair)]
            self._covariance[axis, 2, 2] = self._tuning.error_m_s2[axis] ** 2
        self._at_s = start_s
        # measured acceleration, integrated once and twice from the start on
        self._sums: deque[tuple[float, FloatArray, FloatArray]] = deque([(start_s, np.zeros(3), np.zeros(3))])
        self.late = 0

    def accelerate(self, t_s: float, acceleration_runway_m_s2: FloatArray) -> None:
        """Take the mean measured acceleration (3,) since the last call until ``t_s``."""
        before_s, speed, way = self._sums[-1]
        step_s = t_s - before_s
        if not step_s > 0.0:
            raise InputError("InertialNavigation: time", got=f"{t_s:g} s", wanted=f"after {before_s:g} s")
        gained = step_s * acceleration_runway_m_s2
        self._sums.append((t_s, speed + gained, way + step_s * (speed + 0.5 * gained)))
        # no sample before the filter's time is taken
        while self._sums[1][0] <= self._at_s:
            self._sums.popleft()

    def take(self, sample: PositionSample) -> bool:
        """Fuse a sample at its own time; return False, and count it, if it is older than the last one."""
        if not self._at_s <= sample.t_s <= self._sums[-1][0]:
            self.late += 1
            return False
        self._state, self._covariance = self._carried(sample.t_s)
        self._at_s = sample.t_s
        self._update(0, sample.position_runway_m, sample.position_sigma_m)
        if sample.velocity_runway_m_s is not None:
            self._update(1, sample.velocity_runway_m_s, sample.velocity_sigma_m_s)
        return True

    def now(self) -> VehiclePosition:
        """Return position and velocity at the time of the last acceleration."""
        state, covariances = self._carried(self._sums[-1][0])
        covariance = np.zeros((6, 6))
        for axis in range(3):
            pair = [axis, axis + 3]
            covariance[np.ix_(pair, pair)] = covariances[axis, :2, :2]
        return VehiclePosition(
            position_runway_m=state[:, 0].copy(), velocity_runway_m_s=state[:, 1].copy(), covariance=covariance
        )

    def _carried(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Return states and covariances (3, 3, 3) at ``t_s``, after the filter's time."""
        gap_s = t_s - self._at_s
        speed, way = self._summed(self._at_s)
        speed_to, way_to = self._summed(t_s)
        F = np.array([[1.0, gap_s, 0.5 * gap_s**2], [0.0, 1.0, gap_s], [0.0, 0.0, 1.0]])
        state = self._state @ F.T
        state[:, 0] += way_to - way - gap_s * speed
        state[:, 1] += speed_to - speed
        return state, F @ self._covariance @ F.T + self._noise(gap_s)

    def _noise(self, d: float) -> FloatArray:
        """Return the covariance (3, 3, 3) that white noise and the random walk gather in ``d`` s."""
        white = np.array([[d**3 / 3.0, d**2 / 2.0, 0.0], [d**2 / 2.0, d, 0.0], [0.0, 0.0, 0.0]])
        walk = np.array(
            [
                [d**5 / 20.0, d**4 / 8.0, d**3 / 6.0],
                [d**4 / 8.0, d**3 / 3.0, d**2 / 2.0],
                [d**3 / 6.0, d**2 / 2.0, d],
            ]
        )
        psd = np.square(self._tuning.error_m_s2) / self._tuning.error_s
        return np.asarray(self._tuning.acceleration_psd_m2_s3 * white + psd[:, None, None] * walk)

    def _summed(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the accelerations' sums at a time within memory."""
        after = self._sums[-1]
        for before in reversed(self._sums):
            if before[0] <= t_s:
                break
            after = before
        share = 0.0 if after[0] <= before[0] else (t_s - before[0]) / (after[0] - before[0])
        return before[1] + share * (after[1] - before[1]), before[2] + share * (after[2] - before[2])

    def _update(self, row: int, measured: FloatArray, sigma: FloatArray) -> None:
        """Fuse positions (row 0) or velocities (row 1) of the three axes."""
        for axis in range(3):
            P = self._covariance[axis]
            S = P[row, row] + sigma[axis] ** 2
            K = P[:, row] / S
            self._state[axis] = self._state[axis] + K * (measured[axis] - self._state[axis, row])
            A = np.eye(3)
            A[:, row] -= K
            self._covariance[axis] = A @ P @ A.T + np.outer(K, K) * sigma[axis] ** 2
