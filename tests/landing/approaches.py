"""A site, and estimates on its approach, for the tests of this folder."""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.landing_site.approach_prior import WheelPosition
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Kinematics

GLIDE_RAD = math.radians(3.5)
SPEED_M_S = 20.0
WHEELS = WheelPosition(below_nose_m=0.4)
SITE = LandingSite(
    runway=LandingRunway(threshold_m=(1.0, 160.0, 0.5), direction_rad=math.radians(10.0)),
    approach=PlannedApproach(glide_path_rad=GLIDE_RAD, aim_past_threshold_m=30.0, speed_m_s=SPEED_M_S),
)
# sigmas of position and velocity as a filter has them at 200 m
SIGMAS = np.array([0.05, 0.6, 0.05, 0.1, 0.5, 0.2])


def estimate(
    coordinates_m: FloatArray, rates_m_s: FloatArray, site: LandingSite = SITE, sigmas: FloatArray = SIGMAS
) -> Kinematics:
    """Return an estimate at coordinates and rates (3,) of the threshold, with sigmas (6,) in the runway frame."""
    return Kinematics(
        position_runway_m=site.runway.runway_position(coordinates_m),
        velocity_runway_m_s=np.asarray(rates_m_s @ site.runway.axes()),
        covariance=np.diag(sigmas**2),
    )
