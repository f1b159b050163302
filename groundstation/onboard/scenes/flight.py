"""An approach through turbulence: exact poses of the nose camera, and its sensors' measurements."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.pose import Attitude

_STEP_S = 0.005
_SETTLE_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightApproach:
    """A straight approach with gusts.

    Attributes
    ----------
    start_y_m, start_x_m : where it begins, before and next to the threshold.
    speed_m_s, slope_rad : over ground, and down.
    aim_y_m : where the path meets the ground.
    crab_rad, pitch_rad : heading off the track, and nose above the horizon.
    gust_rad : (roll, pitch, yaw) sigma of the attitude's noise, smooth over ``gust_s``.
    drift_m : (x, y, z) sigma of the position about the path, smooth over 2 s.
    rate_hz, frames : of the camera.
    """

    start_y_m: float = 400.0
    start_x_m: float = 3.0
    speed_m_s: float = 22.0
    slope_rad: float = math.radians(4.0)
    aim_y_m: float = -40.0
    crab_rad: float = math.radians(2.0)
    pitch_rad: float = math.radians(-1.0)
    gust_rad: tuple[float, float, float] = (math.radians(2.0), math.radians(1.0), math.radians(1.0))
    gust_s: float = 0.5
    drift_m: tuple[float, float, float] = (0.6, 0.3, 0.4)
    rate_hz: float = 10.0
    frames: int = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """What navigation and inertial sensors add to the truth: sigmas of a constant, and of each sample.

    Attributes
    ----------
    attitude_bias_rad, attitude_noise_rad : each of roll, pitch and yaw.
    position_bias_m, position_noise_m : (x, y, z).
    """

    attitude_bias_rad: float = math.radians(0.5)
    attitude_noise_rad: float = math.radians(0.2)
    position_bias_m: tuple[float, float, float] = (1.5, 1.5, 1.0)
    position_noise_m: tuple[float, float, float] = (0.1, 0.1, 0.1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseSeries:
    """Poses over time: ``t_s`` (n,), ``position_threshold_m`` (n, 3), ``attitude_rad`` (n, 3) roll, pitch, yaw."""

    t_s: FloatArray
    position_threshold_m: FloatArray
    attitude_rad: FloatArray

    def attitude(self, index: int) -> Attitude:
        """Return the attitude of one sample."""
        roll, pitch, yaw = (float(a) for a in self.attitude_rad[index])
        return Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


def fly(approach: StraightApproach, generator: np.random.Generator) -> PoseSeries:
    """Return the exact poses at the frames' times."""
    t = np.arange(approach.frames) / approach.rate_hz
    start_height = (approach.start_y_m - approach.aim_y_m) * math.tan(approach.slope_rad)
    along = approach.speed_m_s * t
    path = np.stack(
        [
            approach.start_x_m * (1.0 - along / (approach.start_y_m - approach.aim_y_m)),
            approach.start_y_m - along,
            start_height - along * math.tan(approach.slope_rad),
        ],
        axis=1,
    )
    position = path + smooth_noise(generator, t, approach.drift_m, 2.0)
    position[:, 2] = np.maximum(position[:, 2], 1.0)
    attitude = smooth_noise(generator, t, approach.gust_rad, approach.gust_s)
    attitude += [0.0, approach.pitch_rad, approach.crab_rad]
    return PoseSeries(t_s=t, position_threshold_m=position, attitude_rad=attitude)


def measured(flown: PoseSeries, sensors: Sensors, generator: np.random.Generator) -> PoseSeries:
    """Return the sensors' measurements at the same times."""
    count = flown.t_s.size
    attitude = flown.attitude_rad + generator.normal(0.0, sensors.attitude_bias_rad, 3)
    attitude = attitude + generator.normal(0.0, sensors.attitude_noise_rad, (count, 3))
    position = flown.position_threshold_m + generator.normal(0.0, sensors.position_bias_m)
    position = position + generator.normal(0.0, sensors.position_noise_m, (count, 3))
    return PoseSeries(t_s=flown.t_s, position_threshold_m=position, attitude_rad=attitude)


def smooth_noise(
    generator: np.random.Generator, t_s: FloatArray, sigmas: tuple[float, ...], correlation_s: float
) -> FloatArray:
    """Return noise with the given sigmas at ``t_s`` (n,), (n, len(sigmas)): white noise through two equal lags."""
    steps = int((float(t_s[-1]) + _SETTLE_S) / _STEP_S) + 2
    keep = math.exp(-_STEP_S / correlation_s)
    white = generator.normal(size=(steps, len(sigmas)))
    once = lfilter([1.0 - keep], [1.0, -keep], white, axis=0)
    twice = lfilter([1.0 - keep], [1.0, -keep], once, axis=0)
    # the variance of two equal lags on white noise of variance 1
    variance = (1.0 - keep) ** 4 * (1.0 + keep**2) / (1.0 - keep**2) ** 3
    clock = np.arange(steps) * _STEP_S - _SETTLE_S
    columns = [np.interp(t_s, clock, twice[:, k] / math.sqrt(variance) * s) for k, s in enumerate(sigmas)]
    return np.stack(columns, axis=1)
