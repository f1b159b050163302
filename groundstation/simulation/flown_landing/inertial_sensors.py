"""What an autopilot knows by its own sensors: attitude, rates and acceleration by its IMU, and airspeed, with errors.

An attitude is off by a constant of the flight, as magnetometer and alignment leave it, and by one that comes and goes.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import rotation_from_vector
from groundstation.simulation.flown_landing.scaled_aircraft import AircraftMotion

_GRAVITY_NED = np.array([0.0, 0.0, 9.81])


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialSensorErrors:
    """One sigma of each error; what a small autopilot's MEMS sensors have. Stated, not measured.

    Attributes
    ----------
    attitude_rad : roll and pitch, constant during a flight; ``yaw_rad`` likewise.
    wander_rad, wander_s : of each, added to it: first-order Gauss-Markov with that correlation time.
    rate_bias_rad_s, rate_noise_rad_s : of the gyroscopes, the latter in each sample.
    force_bias_m_s2, force_psd_m2_s3 : of the accelerometers: a constant, and white noise by its power spectral density.
    airspeed_bias_m_s, airspeed_noise_m_s : a constant, and first-order Gauss-Markov noise of 0.2 s.
    """

    attitude_rad: float = math.radians(1.0)
    yaw_rad: float = math.radians(3.0)
    wander_rad: float = math.radians(0.3)
    wander_s: float = 10.0
    rate_bias_rad_s: float = math.radians(0.2)
    rate_noise_rad_s: float = math.radians(0.3)
    force_bias_m_s2: float = 0.1
    force_psd_m2_s3: float = 1e-4
    airspeed_bias_m_s: float = 0.3
    airspeed_noise_m_s: float = 0.3
    airspeed_noise_s: float = 0.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensedMotion:
    """What the sensors tell: see `AircraftMotion`; ``acceleration_ned_m_s2`` (3,) without gravity."""

    ned_from_body: FloatArray
    rates_rad_s: FloatArray
    acceleration_ned_m_s2: FloatArray
    airspeed_m_s: float


class InertialSensors:
    """Sensors of one flight; their errors do not depend on the motion.

    Parameters
    ----------
    step_s : between samples.
    """

    def __init__(self, generator: np.random.Generator, errors: InertialSensorErrors, step_s: float) -> None:
        self._random, self._errors = generator, errors
        e = errors
        self._constant = generator.normal(size=3) * np.array([e.attitude_rad, e.attitude_rad, e.yaw_rad])
        self._wander = generator.normal(size=3) * e.wander_rad
        self._rate_bias = generator.normal(size=3) * e.rate_bias_rad_s
        self._force_bias = generator.normal(size=3) * e.force_bias_m_s2
        self._force_sigma = math.sqrt(e.force_psd_m2_s3 / step_s)
        self._airspeed_bias = float(generator.normal()) * e.airspeed_bias_m_s
        self._airspeed_off = float(generator.normal()) * e.airspeed_noise_m_s
        self._kept = math.exp(-step_s / e.wander_s)
        self._airspeed_kept = math.exp(-step_s / e.airspeed_noise_s)

    def sense(self, motion: AircraftMotion) -> SensedMotion:
        """Return what is sensed of the motion after a step."""
        e = self._errors
        normal = self._random.normal(size=10)
        self._wander = self._kept * self._wander + math.sqrt(1.0 - self._kept**2) * e.wander_rad * normal[:3]
        kept = self._airspeed_kept
        self._airspeed_off = kept * self._airspeed_off + math.sqrt(1.0 - kept**2) * e.airspeed_noise_m_s * normal[9]
        ned_from_body = motion.ned_from_body @ rotation_from_vector(self._constant + self._wander)
        force = motion.specific_force_m_s2 + self._force_bias + self._force_sigma * normal[6:9]
        return SensedMotion(
            ned_from_body=ned_from_body,
            rates_rad_s=motion.rates_rad_s + self._rate_bias + e.rate_noise_rad_s * normal[3:6],
            acceleration_ned_m_s2=ned_from_body @ force + _GRAVITY_NED,
            airspeed_m_s=motion.airspeed_m_s + self._airspeed_bias + self._airspeed_off,
        )
