"""Rates of a station's head, as the filter has them."""

import math
from typing import NamedTuple


class HeadRates(NamedTuple):
    """Rates of a head's axes, rad/s, and one sigma of either.

    ``with_angles_rad2_s`` is the covariance of each axis' rate with its angle, rad²/s.
    """

    pan_rad_s: float
    tilt_rad_s: float
    sigma_rad_s: float
    with_angles_rad2_s: tuple[float, float] = (0.0, 0.0)

    def angle_variances_rad2(self, angle_sigma_rad: float, delay_s: float) -> tuple[float, float]:
        """Return the variances of pan and tilt, rad², so long after the time of the angles with that sigma.

        The covariance with the filter's angles counts for others too, as far as their sigma allows it.
        """
        most = angle_sigma_rad * self.sigma_rad_s
        own = angle_sigma_rad**2 + (delay_s * self.sigma_rad_s) ** 2
        pan, tilt = (
            own + 2.0 * delay_s * math.copysign(min(abs(shared), most), shared) for shared in self.with_angles_rad2_s
        )
        return max(pan, 0.0), max(tilt, 0.0)
