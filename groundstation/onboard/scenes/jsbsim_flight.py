"""An approach flown by JSBSim through wind and turbulence, over a rendered airfield.

Attitude and velocity, sample by sample, are the flight; positions and inertial samples are made from them, so that they
fit each other exactly.
"""

import numpy as np

from groundstation.geometry.rotation import rotation_x, rotation_y, rotation_z
from groundstation.onboard.pose.simulated_approach import RUNWAY_FROM_LEVEL_BODY, ApproachSetup, motion_of
from groundstation.onboard.scenes.nose_flight import AIM_M, NoseFlight
from groundstation.onboard.scenes.sequences import Sequence
from groundstation.simulation.jsbsim_model import fly_by_jsbsim

_END_M = 45.0


def jsbsim_nose_flight(sequence: Sequence, setup: ApproachSetup, wind_m_s: float = 4.0) -> NoseFlight:
    """Return a flight in turbulence drawn from the sequence's seed; it ends 45 m before the threshold.

    Parameters
    ----------
    wind_m_s : across, from the right.

    Raises `NoFlightModelError` where JSBSim is not installed.
    """
    n, glide = round(setup.duration_s * setup.imu_hz), float(np.radians(setup.glide_deg))
    flown = fly_by_jsbsim(
        seed=sequence.seed, samples=n, rate_hz=float(setup.imu_hz), glide_rad=glide, wind_m_s=wind_m_s
    )
    north, east, down = flown.velocity_m_s.T
    # on approach y is back along the landing direction and x to its left
    velocity = np.stack([-east, -north, -down], axis=1)
    turns = [rotation_z(y) @ rotation_y(p) @ rotation_x(r) for r, p, y in flown.attitude_rad]
    # the runway lies where the flight leads
    track = velocity.sum(axis=0)
    level = rotation_z(float(np.arctan2(-track[0], -track[1])))
    velocity = velocity @ level.T
    runway_from_body = level @ RUNWAY_FROM_LEVEL_BODY @ np.array(turns)
    acceleration = np.diff(velocity, axis=0, append=velocity[-1:]) * setup.imu_hz
    moved = velocity.sum(axis=0) / setup.imu_hz
    start = np.array([-moved[0], _END_M - moved[1], (_END_M + AIM_M) * np.tan(glide) - moved[2]])
    t = np.asarray(np.arange(n) / setup.imu_hz, dtype=np.float64)
    rng = np.random.default_rng([sequence.seed, 78])
    motion = motion_of(setup, t, start, velocity[0], acceleration, runway_from_body, rng)
    return NoseFlight(sequence=sequence, setup=setup, motion=motion)
