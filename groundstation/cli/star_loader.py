"""Head angles by the stars for `live` and `check`: the calibration's code, imported where a station asks for it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from groundstation.live.live_stars import TimedAngles
    from groundstation.rig.rig import Rig
    from groundstation.session.folder import GeoOrigin
    from groundstation.session.site_air import SiteAir


def load_stars(rig: "Rig", origin: "GeoOrigin", air: "SiteAir", zero_utc_s: float) -> "Mapping[str, TimedAngles]":
    """Return `calibration.stars.star_angles.star_angles_in_operation`."""
    from calibration.stars.star_angles import star_angles_in_operation

    return star_angles_in_operation(rig, origin, air, zero_utc_s)
