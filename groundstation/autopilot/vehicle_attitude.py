"""The vehicle's attitude as it reports it (ATTITUDE, ATTITUDE_QUATERNION), with the time at which it came."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, rotation_x, rotation_y, rotation_z

# an older attitude says nothing of an aircraft in a turn
_OLD_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleAttitude:
    """Attitude and rates of turn; ``received_s`` is session time.

    ``ned_from_body`` (3, 3), body axes forward, right, down; ``rates_rad_s`` (3,) about them.
    """

    received_s: float
    ned_from_body: FloatArray
    rates_rad_s: FloatArray

    @staticmethod
    def from_euler(
        received_s: float, roll_rad: float, pitch_rad: float, yaw_rad: float, rates: FloatArray
    ) -> "VehicleAttitude | None":
        """Return the attitude of the message's angles (rotation yaw, pitch, roll); None if one is not finite."""
        if not all(math.isfinite(v) for v in (roll_rad, pitch_rad, yaw_rad)):
            return None
        matrix = rotation_z(yaw_rad) @ rotation_y(pitch_rad) @ rotation_x(roll_rad)
        return VehicleAttitude(received_s=received_s, ned_from_body=matrix, rates_rad_s=_finite(rates))

    @staticmethod
    def from_quaternion(received_s: float, wxyz: FloatArray, rates: FloatArray) -> "VehicleAttitude | None":
        """Return the attitude of the message's quaternion (4,); None if it is none."""
        norm = float(np.linalg.norm(wxyz))
        if not 0.9 < norm < 1.1:
            return None
        return VehicleAttitude(
            received_s=received_s, ned_from_body=matrix_from_wxyz(wxyz / norm), rates_rad_s=_finite(rates)
        )

    def at(self, t_s: float) -> "VehicleAttitude | None":
        """Return the attitude at a session time, turned on by its rates; None if it is too old for that."""
        age_s = t_s - self.received_s
        if abs(age_s) > _OLD_S:
            return None
        turned = self.ned_from_body @ rotation_from_vector(self.rates_rad_s * age_s)
        return VehicleAttitude(received_s=t_s, ned_from_body=turned, rates_rad_s=self.rates_rad_s)


def _finite(rates: FloatArray) -> FloatArray:
    """Return rates (3,), zero where one is not known."""
    return np.asarray(np.where(np.isfinite(rates), rates, 0.0), dtype=np.float64)
