"""Pictures of airliners for a calibration by day: heads turned ahead of each, and standing while it passes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calibration.sky.adsb import AdsbReport
from calibration.sky.airliner_choice import Course, SkyReach, choose_airliner, course_of, courses_of
from calibration.stars.pointing_plan import Pointing, ways_of
from calibration.stars.sky import SkyOverSite
from groundstation.arrays import FloatArray
from groundstation.cli.standing_heads import StandingHeads, StandingPlace
from groundstation.cli.star_recorder import PictureFolder, TurningCamera, turn_from_side
from groundstation.errors import GroundstationError
from groundstation.live.keep_out_unit import KeepOutError
from ptu_drivers.errors import LimitError

# an airliner is followed only where so many stops of each head are likely
_LEAST_STOPS = 4
# with each head's last stop, how long the next takes is learnt; at first, besides the way itself
_FIRST_OVERHEAD_S, _LEAST_OVERHEAD_S = 1.5, 0.5
# while no airliner is in reach
_MOON_EACH_S, _MOON_STOPS = 600.0, 4
# the Sun turns by 0.02° in half of this; its direction takes 10 ms of a core, and airliners are looked for each second
_SUN_EACH_S = 10.0
_LOOK_EACH_S = 1.0
_TELL_EACH_S = 30.0
_MOST_FAILURES = 3
# angles of the mean, as at night; several pictures a stop leave no time for more
_READINGS = 8
_PICTURE_S = 0.5


class AirlinerPositions(Protocol):
    """A receiver, as `groundstation.cli.adsb_receiver.AdsbReceiver` is one."""

    def newest(self) -> Mapping[str, Sequence[AdsbReport]]:
        """Return the positions of the last minutes by aircraft, in order of time."""
        ...

    def ended(self) -> str:
        """Return why no more will come; "" while they do."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderClock:
    """Unix time, and waiting for so many seconds."""

    now: Callable[[], float]
    wait: Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class AirlinerOrders:
    """How many airliners are followed, with how many stops of each head, and pictures at each; how long at most, s."""

    airliners: int = 5
    stops: int = 12
    pictures: int = 3
    rate_rad_s: float = float(np.radians(5.0))
    most_s: float = 3600.0

    @property
    def pictures_s(self) -> float:
        """About how long the pictures of a stop take."""
        return _PICTURE_S * self.pictures


class AirlinerRecorder:
    """Follows airliners with heads that take turns, and keeps their pictures.

    Parameters
    ----------
    heads : opened, in the order of ``reach.stations``.
    reach : what they may look at; the Sun's direction is taken from ``sky``.
    places : how each head stands, by its name.
    """

    def __init__(
        self,
        heads: Sequence[TurningCamera],
        reach: SkyReach,
        orders: AirlinerOrders,
        receiver: AirlinerPositions,
        sky: SkyOverSite,
        folder: PictureFolder,
        clock: RecorderClock,
        tell: Callable[[str], None],
        places: Mapping[str, StandingPlace],
    ) -> None:
        self._heads = tuple(zip(heads, reach.stations, strict=True))
        self._reach, self._orders, self._receiver, self._sky = reach, orders, receiver, sky
        self._folder, self._clock, self._tell = folder, clock, tell
        self._overhead_s = dict.fromkeys((head.name for head in heads), _FIRST_OVERHEAD_S)
        self._stops = dict.fromkeys((head.name for head in heads), 0)
        self._standing = StandingHeads(self._heads, reach.within, places, sky, clock.now, tell)
        self._failures = self._ways = 0
        self.refused = 0
        """How many ways of heads were closed."""
        self.refusal = ""
        """Why the last of them was."""

    def run(self) -> tuple[str, ...]:
        """Follow airliners until there are enough, the time is over, or no positions come; returns which were.

        The heads stand then where they were: see `leave`.
        """
        followed = self._followed()
        if self.refused:
            self._tell(f"{self.refused} of {self._ways} ways were refused, the last: {self.refusal}")
        return followed

    def leave(self) -> None:
        """Park the heads, or turn them clear of the Sun; tells where each is left."""
        self._standing.leave()

    def _followed(self) -> tuple[str, ...]:
        end_s, told_s, moon_s = self._clock.now() + self._orders.most_s, -np.inf, -np.inf
        least = min(_LEAST_STOPS, self._orders.stops)
        followed: dict[str, int] = {}
        while sum(n >= least for n in followed.values()) < self._orders.airliners:
            self._standing.turn_clear()
            now = self._clock.now()
            reason = self._receiver.ended()
            if now >= end_s or reason:
                self._tell(reason or f"{self._orders.most_s / 60.0:.0f} minutes are over")
                break
            courses = courses_of(self._receiver.newest(), now, self._sky.site)
            least_s = least * len(self._heads) * self._stop_s()
            course = choose_airliner(courses, self._reach_at(now), now + self._stop_s(), least_s, followed)
            if course is None:
                if now - moon_s > _MOON_EACH_S:
                    moon_s = now
                    self._look_at_moon()
                    continue
                if now - told_s > _TELL_EACH_S:
                    told_s = now
                    self._tell(f"{len(courses)} aircraft with a course, none in reach for {least_s:.0f} s")
                self._clock.wait(_LOOK_EACH_S)
                continue
            followed[course.aircraft] = self._follow(course.aircraft)
            self._tell(f"airliner {course.aircraft}: {followed[course.aircraft]} stops of each head")
        return tuple(name for name, stops in followed.items() if stops >= least)

    def _stop_s(self) -> float:
        """Return about how long one stop of one head takes."""
        return max(self._overhead_s.values()) + self._reach.pictures_s

    def _reach_at(self, now_s: float) -> SkyReach:
        sun = self._sky.body("sun", round(now_s / _SUN_EACH_S) * _SUN_EACH_S)
        return replace(self._reach, sun=sun if sun[2] > 0.0 else None)

    def _follow(self, aircraft: str) -> int:
        """Follow one airliner with all heads in turn, until it is out of reach or ways to it are closed.

        Returns at how many stops each head took pictures at least.
        """
        taken = dict.fromkeys((head.name for head, _ in self._heads), 0)
        failed = dict(taken)
        for _ in range(self._orders.stops):
            for head, _ in self._heads:
                took = self._stop(head, aircraft)
                if took is None:
                    return min(taken.values())
                taken[head.name] += took
                failed[head.name] = 0 if took else failed[head.name] + 1
                if failed[head.name] == _MOST_FAILURES:
                    self._tell(f"airliner {aircraft}: let go: {head.name} took no picture at {_MOST_FAILURES} stops")
                    return min(taken.values())
        return min(taken.values())

    def _stop(self, head: TurningCamera, aircraft: str) -> bool | None:
        """Turn a head ahead of an airliner; returns whether it took pictures, None where that is out of reach."""
        begin_s = self._clock.now()
        course = course_of(self._receiver.newest().get(aircraft, ()), begin_s, self._sky.site)
        if course is None:
            return None
        meeting = self._meeting(head, course, begin_s)
        if meeting is None:
            return None
        pointing = self._pointing(head, meeting.reading_deg)
        early_s = self._take(head, pointing, meeting.middle_s, f"airliner {aircraft}")
        if early_s is not None:
            # later than planned: the next is planned so
            self._overhead_s[head.name] = max(_LEAST_OVERHEAD_S, self._overhead_s[head.name] - 0.5 * early_s)
        return early_s is not None

    def _look_at_moon(self) -> None:
        """Take pictures of the Moon with each head from all sides, where it may look there."""
        for number in range(_MOON_STOPS):
            aside = ways_of(number)
            for head, station in self._heads:
                now = self._clock.now()
                reading = self._reach_at(now).moon_reading_deg(station, self._sky.body("moon", now), aside)
                if reading is not None:
                    self._take(head, self._pointing(head, reading), now, "the Moon")

    def _pointing(self, head: TurningCamera, reading_deg: FloatArray) -> Pointing:
        """Return a pointing that is come to from another side than the head's last."""
        pan_from, tilt_from = ways_of(self._stops[head.name])
        self._stops[head.name] += 1
        pan, tilt = (round(float(angle), 3) for angle in reading_deg)
        return Pointing(pan_deg=pan, tilt_deg=tilt, pan_from=pan_from, tilt_from=tilt_from)

    def _take(self, head: TurningCamera, pointing: Pointing, middle_s: float, what: str) -> float | None:
        """Turn a head and take the pictures of a stop about a time; returns how early it was, None where it failed."""
        self._ways += 1
        try:
            turn_from_side(head, pointing, self._tell)
            early_s = middle_s - 0.5 * self._reach.pictures_s - self._clock.now()
            if early_s > 0.0:
                self._clock.wait(early_s)
            for taken in head.pictures(self._orders.pictures, _READINGS):
                self._folder.add(head.name, pointing, taken, _READINGS)
        except GroundstationError as fault:
            if isinstance(fault.__cause__, KeepOutError | LimitError):
                self.refused, self.refusal = self.refused + 1, str(fault)
            else:
                self._failures += 1
            if self._failures >= _MOST_FAILURES:
                raise
            self._tell(f"{head.name}: no picture: {fault}")
            return None
        self._failures = 0
        at = f"pan {pointing.pan_deg:.1f}, tilt {pointing.tilt_deg:.1f}"
        self._tell(f"{head.name}: {what}, {at}: {self._orders.pictures} pictures")
        return early_s

    def _meeting(self, head: TurningCamera, course: Course, begin_s: float) -> "_Meeting | None":
        """Return where and when a head meets an airliner; None where it may not look there."""
        station = next(one for own, one in self._heads if own is head)
        here, reach = head.angles(), self._reach_at(begin_s)
        overhead_s = self._overhead_s[head.name]
        lead_s = overhead_s + 0.5 * reach.pictures_s
        reading = reach.reading_deg(station, course, begin_s + lead_s)
        for _ in range(2):
            if reading is None:
                return None
            way_rad = float(np.abs(np.radians(reading) - here).max())
            lead_s = overhead_s + way_rad / self._orders.rate_rad_s + 0.5 * reach.pictures_s
            reading = reach.reading_deg(station, course, begin_s + lead_s)
        return None if reading is None else _Meeting(reading_deg=reading, middle_s=begin_s + lead_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Meeting:
    """Where a head looks, readings (2,) in degrees, and the time of the middle of its pictures."""

    reading_deg: FloatArray
    middle_s: float
