"""Consider covariance: the effect of systematic corner errors, constant over a flight, on the filter's state.

A systematic error does not average out over pictures, and the filter does not estimate it. For each systematic error
one more filter runs in parallel, on poses that are displaced by a small part of it. The difference of the states,
divided by that part, is the filter's sensitivity S to the error, over its whole history; the state's covariance is
P + S Sᵀ.
"""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.onboard.pose.inertial_filter import (
    CameraMount,
    ImuSample,
    InertialConfig,
    InertialFilter,
    Navigation,
    PoseObservation,
    rotation_vector,
)

# of one sigma: small enough that all filters accept or refuse an observation together
_SHARE = 0.01


class ConsiderFilterBank:
    """Filters that run parallel to the main one, one for each of ``count`` systematic errors."""

    def __init__(self, config: InertialConfig, mount: CameraMount, count: int) -> None:
        self._perturbed = [InertialFilter(config, mount) for _ in range(count)]

    def process_imu(self, sample: ImuSample) -> None:
        """Take an inertial sample, as the main filter does."""
        for one in self._perturbed:
            one.process_imu(sample)

    def update(self, observation: PoseObservation, lasting: FloatArray) -> None:
        """Take a pose that the main filter is shown, with what one sigma of each error makes of it, (6, count)."""
        for one, error in zip(self._perturbed, _SHARE * lasting.T, strict=True):
            turned = rotation_from_vector(error[3:]) @ matrix_from_wxyz(observation.runway_from_camera_wxyz)
            one.update(
                PoseObservation(
                    t_s=observation.t_s,
                    position_m=observation.position_m + error[:3],
                    runway_from_camera_wxyz=wxyz_from_matrix(turned),
                    covariance=observation.covariance,
                    lasting=observation.lasting,
                )
            )

    def sensitivity(self, now: Navigation) -> FloatArray:
        """Return S (9, count): the body's position (m), rotation (rad) and velocity (m/s) for one sigma of each."""
        R = matrix_from_wxyz(now.runway_from_body_wxyz)
        return np.stack([_difference(one.navigation, now, R) for one in self._perturbed], axis=1) / _SHARE


def _difference(other: Navigation, now: Navigation, runway_from_body: FloatArray) -> FloatArray:
    turn = rotation_vector(matrix_from_wxyz(other.runway_from_body_wxyz) @ runway_from_body.T)
    return np.concatenate([other.position_m - now.position_m, turn, other.velocity_m_s - now.velocity_m_s])
