"""A position that the aircraft reports of itself, and what is stated about the error of its receiver."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.geometry.geodesy import enu_from_geodetic, runway_axes

# as far from the site as a position may be, m: further ones are of another place or damaged
MAX_EXTENT_M = 1e5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnPosition:
    """A GNSS position of the aircraft as its telemetry delivers it.

    Attributes
    ----------
    t_s : session time; what is unknown of it is in `ReceiverErrors.delay_s`.
    position_runway_m : (3,) in the runway frame.
    sigma_m : (3,) one sigma per axis, as the receiver states it.

    Raises `InputError` where a number is not finite, a sigma is not above 0, or the place is farther than 100 km.
    """

    t_s: float
    position_runway_m: FloatArray
    sigma_m: FloatArray

    def __post_init__(self) -> None:
        place, sigma = np.asarray(self.position_runway_m), np.asarray(self.sigma_m)
        if place.shape != (3,) or sigma.shape != (3,):
            raise InputError("own position", got=f"{place.shape} and {sigma.shape}", wanted="three numbers each")
        if not (math.isfinite(self.t_s) and np.all(np.abs(place) <= MAX_EXTENT_M)):
            wanted = f"a time, and metres within {MAX_EXTENT_M / 1e3:.0f} km"
            raise InputError("own position", got=f"{place.tolist()} at {self.t_s} s", wanted=wanted)
        if not (np.all(sigma > 0.0) and np.all(sigma <= MAX_EXTENT_M)):
            raise InputError("own position: sigma_m", got=str(sigma.tolist()), wanted="three numbers above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverErrors:
    """How the stated sigma of a position is made up, and what else is unknown of it.

    Attributes
    ----------
    white_share : so much of the stated sigma is new with each position; the rest of the variance lasts.
    lasting_s : for about so long, at least.
    delay_s : a position is older than its time says by a constant from the first to the second of these.
    antenna_sigma_m : one sigma per axis of the way from the target point to the antenna.
    """

    white_share: float = 0.25
    lasting_s: float = 60.0
    delay_s: tuple[float, float] = (0.0, 0.3)
    antenna_sigma_m: float = 0.3

    def __post_init__(self) -> None:
        if not 0.0 <= self.white_share <= 1.0:
            raise InputError("ReceiverErrors: white_share", got=f"{self.white_share:g}", wanted="0 … 1")
        if not (math.isfinite(self.lasting_s) and self.lasting_s > 0.0):
            raise InputError("ReceiverErrors: lasting_s", got=f"{self.lasting_s:g}", wanted="a number above 0")
        if not -10.0 <= self.delay_s[0] <= self.delay_s[1] <= 10.0:
            raise InputError(
                "ReceiverErrors: delay_s", got=str(self.delay_s), wanted="two rising numbers within ± 10 s"
            )
        if not 0.0 <= self.antenna_sigma_m <= MAX_EXTENT_M:
            raise InputError("ReceiverErrors: antenna_sigma_m", got=f"{self.antenna_sigma_m:g}", wanted="0 or more")

    @property
    def mean_delay_s(self) -> float:
        """The middle of the delays."""
        return 0.5 * (self.delay_s[0] + self.delay_s[1])

    @property
    def delay_sigma_s(self) -> float:
        """One sigma of a delay, all of them being equally likely."""
        return (self.delay_s[1] - self.delay_s[0]) / math.sqrt(12.0)


def own_position(
    t_s: float,
    place_deg_m: tuple[float, float, float],
    sigma_enu_m: tuple[float, float, float],
    *,
    origin_deg_m: tuple[float, float, float],
    y_axis_azimuth_deg: float,
) -> OwnPosition:
    """Return a position given as latitude, longitude (deg) and ellipsoid height (m), with sigmas east, north and up.

    ``origin_deg_m`` and ``y_axis_azimuth_deg`` are those of the runway frame (`GeoOrigin`). Raises `InputError` as
    `OwnPosition` does.
    """
    lat, lon, height = (np.array([value]) for value in place_deg_m)
    runway_from_enu = runway_axes(y_axis_azimuth_deg)
    place = runway_from_enu @ enu_from_geodetic(lat, lon, height, origin_deg_m)[0]
    variance = (runway_from_enu**2) @ (np.array(sigma_enu_m) ** 2)
    return OwnPosition(t_s=t_s, position_runway_m=place, sigma_m=np.sqrt(variance))
