"""Which airliner heads can follow, and where each has to look to meet it: by the positions that came last.

An airliner's course is a straight line through its last positions. It is in reach where the head's range, the horizon
and the Sun allow, where it is as far off as a calibration uses, and where it stays in a standing camera's picture while
pictures are taken.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.sky.adsb import AdsbReport
from calibration.sky.flight_path import runway_positions
from calibration.stars.pointing_plan import APPROACH_DEG, HeadRange
from calibration.stars.sky import ObservingSite
from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.rig.rig import Station

# haze and trees below; DO-260B's positions and the fit's own bounds of distance
LEAST_HEIGHT_DEG = 6.0
NEAREST_M, FARTHEST_M = 5_000.0, 55_000.0
# a receiver's latency is 0 to 2 s: in the middle of that
LIKELY_LATENCY_S = 1.0
# of a course: so many of the last positions' seconds, and how many there have to be
_COURSE_S, _LEAST_REPORTS, _LEAST_SPAN_S = 25.0, 4, 6.0
_STALE_S = 12.0
# an airliner may drift through so much of the picture's smaller side while pictures are taken, its latency unknown
_FIELD_SHARE = 0.35
_STEP_S = 5.0
# the Moon is put so far off the middle, a share of the picture: its place in the picture tells the lens
_MOON_ASIDE = 0.2
_FAR_M = 1e8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """An airliner's course: at Unix time ``t_s`` at ``place_m`` (3,) with ``velocity_m_s`` (3,), runway frame."""

    aircraft: str
    t_s: float
    place_m: FloatArray
    velocity_m_s: FloatArray

    def at(self, t_s: float) -> FloatArray:
        """Return where it will be, (3,), runway frame, m."""
        return np.asarray(self.place_m + (t_s - self.t_s) * self.velocity_m_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyReach:
    """What heads may look at.

    Attributes
    ----------
    stations : the heads, oriented to a few degrees.
    within : their readings. sun : (3,) the Sun's direction, runway frame; None below the horizon.
    sun_rad : how far from it an airliner has to be.
    pictures_s : how long the pictures of one stop take.
    """

    stations: tuple[Station, ...]
    within: HeadRange
    sun: FloatArray | None
    sun_rad: float
    pictures_s: float

    def reading_deg(self, station: Station, course: Course, t_s: float) -> FloatArray | None:
        """Return the readings (2,), degrees, that put an airliner at a time into the picture's middle, if it may be."""
        away = course.at(t_s) - station.ptu_position_m
        distance = float(np.linalg.norm(away))
        if not NEAREST_M < distance < FARTHEST_M or away[2] < distance * np.sin(np.radians(LEAST_HEIGHT_DEG)):
            return None
        if self.sun is not None and float(away @ self.sun) > distance * np.cos(self.sun_rad):
            return None
        across = course.velocity_m_s - away * float(course.velocity_m_s @ away) / distance**2
        field_rad = float(min(np.array(station.lens.image_size_px) / station.lens.focal_px))
        drifts_rad = float(np.linalg.norm(across)) / distance * (0.5 * self.pictures_s + LIKELY_LATENCY_S)
        if drifts_rad > _FIELD_SHARE * field_rad:
            return None
        return self._reading_deg(station, course.at(t_s))

    def moon_reading_deg(self, station: Station, moon: FloatArray, aside: tuple[int, int]) -> FloatArray | None:
        """Return the readings (2,), degrees, that put the Moon (3,) off the picture's middle, if they may be.

        ``aside`` says to which side of it, 1 or −1 each.
        """
        if moon[2] < np.sin(np.radians(LEAST_HEIGHT_DEG)):
            return None
        if self.sun is not None and float(moon @ self.sun) > np.cos(self.sun_rad):
            return None
        field_deg = np.degrees(np.array(station.lens.image_size_px) / station.lens.focal_px)
        off_deg = _MOON_ASIDE * field_deg * np.array(aside)
        return self._reading_deg(station, station.ptu_position_m + _FAR_M * moon, off_deg)

    def _reading_deg(
        self, station: Station, place_m: FloatArray, off_deg: FloatArray | None = None
    ) -> FloatArray | None:
        """Return the readings at which a place is in the middle of the picture, or so far off it, if in range."""
        aim = aim_at(station.geometry(), place_m)
        if aim is None:
            return None
        reading = np.degrees(station.ptu_axes.readings(aim.pan_rad, aim.tilt_rad, 0.0, 0.0))
        reading = reading if off_deg is None else reading + off_deg
        low = np.array([self.within.pan_deg[0], self.within.tilt_deg[0]]) + APPROACH_DEG
        high = np.array([self.within.pan_deg[1], self.within.tilt_deg[1]]) - APPROACH_DEG
        return reading if np.all((reading >= low) & (reading <= high)) else None


def courses_of(reports: Mapping[str, Sequence[AdsbReport]], now_s: float, site: ObservingSite) -> tuple[Course, ...]:
    """Return the courses of the aircraft whose positions are fresh; ``now_s`` is Unix time."""
    found = (course_of(own, now_s, site) for own in reports.values())
    return tuple(course for course in found if course is not None)


def course_of(reports: Sequence[AdsbReport], now_s: float, site: ObservingSite) -> Course | None:
    """Return the course of one aircraft; None where its positions are too few or too old."""
    if not reports:
        return None
    last_s = max(r.t_s for r in reports)
    used = [r for r in reports if r.t_s >= last_s - _COURSE_S and r.geometric == reports[-1].geometric]
    t = np.array([r.t_s for r in used])
    if now_s - last_s > _STALE_S or len(used) < _LEAST_REPORTS or np.ptp(t) < _LEAST_SPAN_S:
        return None
    middle = float(t.mean())
    place = runway_positions(used, site)
    columns = np.column_stack([np.ones(len(t)), t - middle])
    start, velocity = np.linalg.lstsq(columns, place, rcond=None)[0]
    return Course(
        aircraft=used[0].aircraft,
        t_s=middle - LIKELY_LATENCY_S,
        place_m=np.asarray(start),
        velocity_m_s=np.asarray(velocity),
    )


def seconds_in_reach(course: Course, reach: SkyReach, from_s: float, most_s: float = 120.0) -> float:
    """Return how long, from a Unix time on, all heads have an airliner in reach without a break."""
    steps = np.arange(from_s, from_s + most_s, _STEP_S)
    for k, t_s in enumerate(steps.tolist()):
        if any(reach.reading_deg(station, course, t_s) is None for station in reach.stations):
            return k * _STEP_S
    return most_s


def choose_airliner(
    courses: Iterable[Course], reach: SkyReach, from_s: float, least_s: float, followed: Iterable[str]
) -> Course | None:
    """Return the airliner that sweeps the greatest angle while it is in reach, of those not followed yet.

    ``least_s`` is how long it has to be in reach. Two followed airliners at one height tell less than one high up and
    one low down: of equal sweeps the order is that of the courses.
    """
    done = set(followed)
    best: tuple[float, Course] | None = None
    for course in courses:
        if course.aircraft in done:
            continue
        seconds = seconds_in_reach(course, reach, from_s)
        if seconds < least_s:
            continue
        ends = [course.at(t) for t in (from_s, from_s + seconds)]
        units = [end / np.linalg.norm(end) for end in ends]
        swept = float(np.arccos(np.clip(units[0] @ units[1], -1.0, 1.0)))
        if best is None or swept > best[0]:
            best = (swept, course)
    return None if best is None else best[1]
