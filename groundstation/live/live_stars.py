"""Head angles by the stars in operation: what the station file asks for, and in how many of the frames."""

import math
from collections.abc import Callable, Mapping
from typing import Protocol

from groundstation.errors import ConfigError, InputError
from groundstation.live.station_file import StationFile
from groundstation.rig.rig import Rig
from groundstation.session.folder import GeoOrigin
from groundstation.session.site_air import SiteAir
from groundstation.tracking.registered_heads import AnglesFromPicture, RegisteredHeads

# of a processor, for each head
_SHARE = 0.1


class TimedAngles(AnglesFromPicture, Protocol):
    """Angles from the stars, with what a frame takes of a processor."""

    @property
    def seconds(self) -> float:
        """What a frame takes."""
        ...


# of a rig, where its runway frame lies on Earth, the air there, and the Unix time of session time 0: by station
StarLoader = Callable[[Rig, GeoOrigin, SiteAir, float], Mapping[str, TimedAngles]]


def registered_heads(file: StationFile, rig: Rig, load_stars: StarLoader | None, zero_utc_s: float) -> RegisteredHeads:
    """Return what takes angles from pictures in operation: the panorama and the stars of the station file, if any.

    Raises `ConfigError` for a panorama as `StationFile.registered_heads`, and for stars that nothing loads or that have
    no patterns for the lens; `MissingExtraError` without the extra `stars`.
    """
    if not file.stars or file.origin is None:
        return file.registered_heads(rig)
    where = f"{file.path}: stars"
    if load_stars is None:
        raise ConfigError(where, got="true", wanted="false: this program takes no angles from stars")
    try:
        stars = load_stars(rig, file.origin, file.air, zero_utc_s)
    except InputError as fault:
        # it does not know which key asks for it
        raise ConfigError(f"{where}: {fault.where}", got=fault.got, wanted=fault.wanted) from fault
    return file.registered_heads(rig, stars, frames_apart([one.seconds for one in stars.values()], file.rate_hz))


def frames_apart(seconds: list[float], rate_hz: float) -> int:
    """Return every how many frames stars are looked for, so that they take a tenth of a processor for each head."""
    return max(1, math.ceil(max(seconds, default=0.0) * rate_hz / _SHARE))
