"""A way point of a flight along a given path: time and position of the nose, and the aircraft's attitude."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from groundstation.simulation.parameter_checks import require, require_finite

# a cubic curve with free ends needs these
LEAST_WAY_POINTS = 4
_ANGLES = ("yaw_rad", "pitch_rad", "bank_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class WayPoint:
    """Position of the nose at a time; runway frame.

    Attributes
    ----------
    t_s : from the flight's beginning.
    x_m, y_m, z_m : of the nose.
    yaw_rad : of the body, clockwise from +y as seen from above; None follows the track, with the flight's crab.
    pitch_rad : nose up; None follows the path's slope, with the flight's incidence.
    bank_rad : right wing down; None is that of a coordinated turn.
    """

    t_s: float
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float | None = None
    pitch_rad: float | None = None
    bank_rad: float | None = None

    def __post_init__(self) -> None:
        for name in ("t_s", "x_m", "y_m", "z_m", *_ANGLES):
            value = getattr(self, name)
            if value is not None:
                require_finite(f"WayPoint: {name}", value)


def check_way_points(points: Sequence[WayPoint], duration_s: float) -> None:
    """Raise `ScenarioError` unless way points lead from 0 to ``duration_s``, and all or none have each angle."""
    where, count = "FlightSpec: way_points", len(points)
    require(count >= LEAST_WAY_POINTS, where, got=count, wanted=f"at least {LEAST_WAY_POINTS} of a path")
    for before, after in itertools.pairwise(points):
        wanted = f"later than {before.t_s:g}"
        require(after.t_s > before.t_s, f"{where}: t_s", got=f"{after.t_s:g}", wanted=wanted)
    first, last = points[0].t_s, points[-1].t_s
    whole = first <= 0.0 and last >= duration_s
    wanted = f"times from 0 or before to duration_s = {duration_s:g} or later"
    require(whole, f"{where}: t_s", got=f"{first:g} to {last:g}", wanted=wanted)
    for name in _ANGLES:
        given = sum(getattr(point, name) is not None for point in points)
        shown = f"{where}: {name.replace('_rad', '_deg')}"
        require(given in (0, count), shown, got=f"{given} of {count}", wanted="one at each way point, or none")
    still = math.dist((points[0].x_m, points[0].y_m), (points[-1].x_m, points[-1].y_m)) == 0.0
    named = points[0].yaw_rad is not None
    require(
        named or not still, f"{where}: yaw_deg", got="none", wanted="one at each way point of a path that leads back"
    )
