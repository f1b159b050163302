"""Stations that stand so far apart that they never see one aircraft together: a rig that is not in metres."""

import itertools
import math

from groundstation.errors import RigError
from groundstation.rig.rig import Rig, Station

# the longest runways; stations of one landing stand at its threshold
FAR_APART_M = 4000.0
# an aircraft that is narrower in a picture has no outline
_LEAST_WIDTH_PX = 4.0


def require_one_sight(rig: Rig, span_m: float | None) -> None:
    """Raise `RigError` if an aircraft of that span is too narrow in one of two pictures wherever it is.

    Without a span nothing is known of that. It is wide enough in both only where the two ranges at which it is so add
    up to the stations' distance or more.
    """
    pairs = list(itertools.combinations(rig.stations, 2))
    if span_m is None or not pairs or any(not _too_far(a, b, span_m) for a, b in pairs):
        return
    nearest_m = min(_distance_m(a, b) for a, b in pairs)
    raise RigError(
        rig.path,
        got=f"stations that are {nearest_m:.0f} m apart: is the rig in metres?",
        wanted=f"two in whose pictures an aircraft of {span_m:g} m is {_LEAST_WIDTH_PX:g} px wide or wider at once",
    )


def _distance_m(a: Station, b: Station) -> float:
    return math.dist(a.ptu_position_m, b.ptu_position_m)


def _too_far(a: Station, b: Station, span_m: float) -> bool:
    seen_m = sum(float(max(station.lens.focal_px)) for station in (a, b)) * span_m / _LEAST_WIDTH_PX
    return _distance_m(a, b) > max(FAR_APART_M, seen_m)
