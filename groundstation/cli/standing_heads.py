"""Heads that stand by day: turned away before the Sun comes to their lenses, and left where it will not soon."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from calibration.stars.pointing_plan import HeadRange
from calibration.stars.sky import SkyOverSite
from groundstation.arrays import FloatArray
from groundstation.cli.star_recorder import TurningCamera
from groundstation.errors import GroundstationError
from groundstation.rig.rig import Station

# the Sun moves a degree in four minutes: a head may stand for so long until it is looked at again
_LEAD_S = 300.0
# a place to stand at is clear for so long, if there is one; so many are tried
_STANDS_S, _STEP_S = 3600.0, 600.0
_MOST_TRIED = 6
# after a turn that failed
_AGAIN_S = 30.0
# a head that is left is left for the day
_DAY_S = 12.0 * 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingPlace:
    """How far one head's lens is kept from the Sun, rad, 0 for not at all; and its place to park at (2,), rad."""

    sun_rad: float
    park_rad: tuple[float, float]


class StandingHeads:
    """Keeps heads that stand off the Sun.

    Parameters
    ----------
    heads : opened, each with its calibrated station.
    within : the readings between which they are turned.
    places : by name of the head.
    now : Unix time.
    """

    def __init__(
        self,
        heads: Sequence[tuple[TurningCamera, Station]],
        within: HeadRange,
        places: Mapping[str, StandingPlace],
        sky: SkyOverSite,
        now: Callable[[], float],
        tell: Callable[[str], None],
    ) -> None:
        self._heads, self._within, self._places = heads, within, places
        self._sky, self._now, self._tell = sky, now, tell
        self._failed_s = {head.name: -math.inf for head, _ in heads}

    def turn_clear(self) -> None:
        """Turn each head away that the Sun will soon come to; what fails is told, and tried again later."""
        for head, station in self._heads:
            now = self._now()
            if self._places[head.name].sun_rad == 0.0 or now - self._failed_s[head.name] < _AGAIN_S:
                continue
            try:
                here = head.angles()
                if self._clearance(station, here, (now, now + _LEAD_S)) > 0.0:
                    continue
                at = self._turned_away(head, station, now)
            except GroundstationError as fault:
                at = None
                self._tell(f"{head.name}: {fault}")
            if at is None:
                self._failed_s[head.name] = now
                self._tell(f"{head.name}: the Sun comes to its lens, and it was not turned away: cover it")
            else:
                self._tell(f"{head.name}: turned away from the Sun, to {_words(at)}")

    def leave(self) -> None:
        """Park the heads, or turn them clear where that is closed; tells where each stands, and when the Sun comes."""
        for head, station in self._heads:
            place = self._places[head.name]
            try:
                try:
                    head.turn_to(*place.park_rad)
                except GroundstationError as fault:
                    self._tell(f"{head.name}: not parked: {fault}")
                    now = self._now()
                    if place.sun_rad > 0.0 and self._clearance(station, head.angles(), (now, now + _LEAD_S)) <= 0.0:
                        self._turned_away(head, station, now)
                at = head.angles()
            except GroundstationError as fault:
                self._tell(f"{head.name}: {fault}")
                continue
            self._tell(f"{head.name}: left at {_words(at)}{self._sun_words(station, at)}")

    def _turned_away(self, head: TurningCamera, station: Station, now_s: float) -> FloatArray | None:
        """Turn a head to where the Sun will be farthest off; returns where it stands, None where no way was open."""
        times = np.arange(now_s, now_s + _STANDS_S + 1.0, _STEP_S).tolist()
        (low, high), (down, up) = np.radians(self._within.pan_deg), np.radians(self._within.tilt_deg)
        places = [np.array([pan, tilt]) for pan in np.linspace(low, high, 5) for tilt in np.linspace(down, up, 3)]
        places.sort(key=lambda place: -self._clearance(station, place, times))
        for place in places[:_MOST_TRIED]:
            try:
                # by one axis after the other a way may be open that both together have not
                head.turn_to(float(place[0]), float(head.angles()[1]))
                head.turn_to(float(place[0]), float(place[1]))
            except GroundstationError:
                if self._clearance(station, head.angles(), (now_s, now_s + _LEAD_S)) <= 0.0:
                    continue
            return head.angles()
        return None

    def _clearance(self, station: Station, reading_rad: FloatArray, times_s: Sequence[float]) -> float:
        """Return how far outside of the cone about the Sun a lens is at readings (2,), the least of some times, rad."""
        pan, tilt = station.ptu_axes.angles(float(reading_rad[0]), float(reading_rad[1]), 0.0, 0.0)
        towards = station.geometry().camera_pose(pan, tilt).runway_from_camera[:, 2]
        least = math.inf
        for t_s in times_s:
            sun = self._sky.body("sun", t_s)
            if sun[2] > 0.0:
                off = math.acos(float(np.clip(towards @ sun, -1.0, 1.0)))
                least = min(least, off - self._places[station.name].sun_rad)
        return least

    def _sun_words(self, station: Station, reading_rad: FloatArray) -> str:
        """Return when the Sun comes to a lens that is left at readings (2,); "" for not within the day."""
        if self._places[station.name].sun_rad == 0.0:
            return ""
        now = self._now()
        for t_s in np.arange(now, now + _DAY_S, _STEP_S).tolist():
            if self._clearance(station, reading_rad, (t_s,)) <= 0.0:
                return f"; the Sun comes to its lens at {datetime.fromtimestamp(t_s, UTC):%H:%M} UTC: cover it"
        return ""


def _words(reading_rad: FloatArray) -> str:
    pan, tilt = np.degrees(reading_rad).tolist()
    return f"pan {pan:.1f}, tilt {tilt:.1f}"
