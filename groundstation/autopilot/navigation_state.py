"""What is sent to an autopilot: the state of its own reference point at one time, north, east, down."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.autopilot.local_frame import GeodeticPosition


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NavigationState:
    """Position and velocity of the vehicle's reference point.

    Attributes
    ----------
    t_s : session time to which it belongs.
    position_ned_m, velocity_ned_m_s : (3,) north, east, down of the runway frame's origin.
    covariance : (6, 6) of both.
    geodetic : the same position on Earth.
    attitude_wxyz : (4,) rotation from the vehicle's body (forward, right, down) to north, east, down as the vehicle
        itself reports it; None if it does not, or no longer.
    stations : how many stations' pixels support it at present.
    """

    t_s: float
    position_ned_m: FloatArray
    velocity_ned_m_s: FloatArray
    covariance: FloatArray
    geodetic: GeodeticPosition
    attitude_wxyz: FloatArray | None
    stations: int

    def attributed_within(self, sigma_s: float) -> Self:
        """Return the state with the error in its covariance that comes of the time to which it will be attributed.

        Parameters
        ----------
        sigma_s : one sigma of that time. An error dt of it is an error v dt of the position; that of the velocity is
            small, since an aircraft that lands accelerates little.
        """
        covariance = self.covariance.copy()
        covariance[:3, :3] += sigma_s**2 * np.outer(self.velocity_ned_m_s, self.velocity_ned_m_s)
        return replace(self, covariance=covariance)

    @property
    def horizontal_sigma_m(self) -> float:
        """One sigma of the position for a receiver that takes one for north and east alike, m.

        It is the root mean square over the horizontal directions, √((σ_N² + σ_E²)/2), whatever the correlation: the
        squared error over its square, north and east together, then has the expectation 2, which such a filter's gains
        and gates suppose. Of an elongated error the longest direction exceeds it, by √2 at most.
        """
        return _rms_sigma(self.covariance[:2, :2])

    @property
    def worst_horizontal_sigma_m(self) -> float:
        """One sigma of the position along the worst horizontal direction, m."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def vertical_sigma_m(self) -> float:
        """One sigma of the height, m."""
        return float(np.sqrt(self.covariance[2, 2]))

    @property
    def speed_sigma_m_s(self) -> float:
        """One sigma of the velocity for a receiver that takes one for three axes, m/s: as of the position, over three.

        ArduPilot forms it in the same way where a receiver states a covariance (AP_GPS_DroneCAN).
        """
        return _rms_sigma(self.covariance[3:, 3:])


def _rms_sigma(covariance: FloatArray) -> float:
    """Return the root mean square, over all directions, of the sigma in a direction."""
    return float(np.sqrt(np.trace(covariance) / len(covariance)))
