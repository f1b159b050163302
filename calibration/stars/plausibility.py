"""What cannot be, whatever the residuals: daylight, stars below the horizon, heads on their side, impossible axes.

A wrong time or place turns the sky as a whole, and the fitted base takes that up without a residual: only what is known
of heads and of the sky contradicts it.
"""

from collections.abc import Sequence

import numpy as np

from calibration.mount.fit import MountFit
from calibration.mount.problem import AXES, PERIODIC_AXES
from calibration.stars.head_start import StarFitError
from calibration.stars.night import StarPicture
from calibration.stars.sky import SkyOverSite, utc_text
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import Station

# stars to magnitude 5 come out when the Sun is so low
BRIGHTEST_SUN_DEG = -6.0
# a pedestal levelled by eye is within this; another hour, or another place, turns it by more
MOST_OFF_LEVEL_DEG = 5.0
_LOWEST_STAR_DEG = -1.0
_PRIOR_SIGMAS = 6.0
_TIME_AND_PLACE = "t_utc_s in UTC, and the [origin] of this site"


def require_night(station: str, pictures: Sequence[StarPicture], sky: SkyOverSite) -> None:
    """Raise `StarFitError` where the Sun was up when a picture was taken, by its time and the site."""
    for picture in pictures:
        up = float(np.degrees(np.arcsin(sky.body("sun", picture.utc_s)[2])))
        if up > BRIGHTEST_SUN_DEG:
            got = f"{picture.label} of {utc_text(picture.utc_s)}, the Sun at {up:.0f} deg"
            raise StarFitError(f"station {station}: got {got}; wanted {_TIME_AND_PLACE}")


def off_level_deg(station: Station) -> float:
    """Return the angle between a base's vertical axis and the runway's, degrees."""
    base = matrix_from_wxyz(station.runway_from_base_wxyz)
    return float(np.degrees(np.arccos(np.clip(base[2, 2], -1.0, 1.0))))


def require_plausible(station: str, fit: MountFit) -> None:
    """Raise `StarFitError` where the solution cannot be a head on this site."""
    low = float(np.degrees(np.arcsin(np.clip(fit.problem.sightings.body_m[:, 2].min(), -1.0, 1.0))))
    if low < _LOWEST_STAR_DEG:
        got = f"stars {-low:.0f} deg below the horizon"
        raise StarFitError(f"station {station}: got {got}; wanted {_TIME_AND_PLACE}")
    off = off_level_deg(fit.problem.station_at(fit.change))
    if off > MOST_OFF_LEVEL_DEG:
        wanted = f"a pedestal level to {MOST_OFF_LEVEL_DEG:g} deg, {_TIME_AND_PLACE},"
        wanted += " and the signs of docs/conventions.md"
        raise StarFitError(f"station {station}: got a base {off:.1f} deg off level; wanted {wanted}")
    for name in (*AXES, *PERIODIC_AXES):
        if name in fit.problem.names:
            place = fit.problem.names.index(name)
            value, prior = float(fit.change[place]), float(fit.problem.prior_sigma[place])
            if abs(value) > _PRIOR_SIGMAS * prior:
                shown = f"{1e6 * value:.0f} ppm" if name.endswith("scale") else f"{np.degrees(value):.3f} deg"
                wanted = "angles in degrees that go on where a turn is full (360, not 0), each of its own picture"
                raise StarFitError(f"station {station}: got a {name} of {shown}; wanted {wanted}")
