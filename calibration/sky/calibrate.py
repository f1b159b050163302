"""The whole job of `groundstation calibrate sky`: a day's pictures and a receiver's lines in, a better rig out."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.joint_covariance import with_covariance
from calibration.mount.problem import Mark, MarkKind, MountProblem, MountSightings
from calibration.sky.adsb import AdsbReport
from calibration.sky.aircraft_mark import LATENCY, AircraftMark, aircraft_mark
from calibration.sky.day import SkyPicture, require_same_time
from calibration.sky.flight_path import FlightPath, fit_path
from calibration.sky.identification import (
    LEAST_LATENCY_S,
    MOON,
    MOST_LATENCY_S,
    ChosenObject,
    Identification,
    again,
    identify,
)
from calibration.sky.sky_fit import LEAST_PICTURES, joint_problem, sky_priors, solve_sky
from calibration.stars.calibrate import NightCalibration
from calibration.stars.head_start import StarFitError
from calibration.stars.identified_stars import SkyUncertainty
from calibration.stars.joint_night import JointNight, rig_covariance
from calibration.stars.sky import ObservingSite, SkyOverSite
from calibration.stars.station_night import with_change
from groundstation.arrays import FloatArray
from groundstation.errors import RigError
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_z, wxyz_from_matrix
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station

LATENCY_SIGMA_S = 2.0
# farther off, an airliner is a dot in haze; nearer, its silhouette is no point
_NEAREST_M, _FARTHEST_M = 2_000.0, 60_000.0
_LONGEST_PASS_S = 240.0
# of what a fit expects: the first has wrong objects among its own
_RADII_PX = (60.0, 20.0)
_LOWEST = float(np.sin(np.radians(3.0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyCalibration:
    """The result.

    Attributes
    ----------
    night : joint solution, rig, site and times, as of a calibration by stars.
    flights : the airliners' passes; ``pictures`` how many of each, by station's name; ``moon`` those of the Moon.
    taken : how many pictures each station has, by its name.
    latency_s, latency_sigma_s : by how much the receiver's stamps are late; None without airliners.
    passed_over : airliners whose positions tell too little, with the reason.
    """

    night: NightCalibration
    flights: tuple[FlightPath, ...]
    pictures: tuple[Mapping[str, int], ...]
    moon: Mapping[str, int]
    taken: Mapping[str, int]
    latency_s: float | None
    latency_sigma_s: float | None
    passed_over: tuple[str, ...]


def calibrate_sky(
    rig: Rig,
    pictures: Sequence[SkyPicture],
    reports: dict[str, tuple[AdsbReport, ...]],
    site: ObservingSite,
    uncertain: SkyUncertainty,
) -> SkyCalibration:
    """Calibrate all stations that have pictures; raises `StarFitError`, `RigError` and `InputError`."""
    if not pictures:
        raise StarFitError("got no picture; wanted some of airliners or the Moon from each station")
    names = tuple(n for n in rig.names if any(p.station == n for p in pictures))
    for name in names:
        if rig[name].fixed:
            raise RigError(f"station {name}", got="a station without PTU", wanted="one that turns")
    if reports:
        require_same_time(pictures, reports)
    sky = SkyOverSite(site)
    seen_rig = replace(rig, stations=tuple(rig[name] for name in names))
    flights, passed_over = passes(pictures, reports, site)
    found = identify(pictures, flights, seen_rig, sky)
    if isinstance(found, str):
        wanted = "pictures of airliners with their ADS-B positions, or of the Moon, and a rig oriented to 5 deg"
        raise StarFitError(f"got {found}; wanted {wanted}")
    airliners = [
        aircraft_mark(pass_name(k, f), f, LATENCY_SIGMA_S, uncertain.refraction) for k, f in enumerate(flights)
    ]
    marks: tuple[Mark, ...] = (*airliners, _moon_mark(sky, uncertain))
    solved = _solved(rig, names, pictures, marks, found, sky)
    after = {night.before.name: with_change(night, c) for night, c in zip(solved.nights, solved.change, strict=True)}
    covariance = rig_covariance(solved)
    night = NightCalibration(
        joint=solved,
        rig=with_covariance(
            replace(rig, stations=tuple(after.get(s.name, s) for s in rig.stations)),
            ParameterCovariance(names=covariance.names, matrix=covariance.matrix),
        ),
        without=tuple(n for n in rig.names if n not in names),
        site=site,
        span_utc_s=(pictures[0].utc_s, pictures[-1].utc_s),
    )
    return _result(night, flights, passed_over, Counter(p.station for p in pictures))


def _solved(
    rig: Rig,
    names: Sequence[str],
    pictures: Sequence[SkyPicture],
    marks: tuple[Mark, ...],
    found: Identification,
    sky: SkyOverSite,
) -> JointNight:
    """Return the joint solution; what is where one fit expects it is taken into the next."""
    stations = [rig[name] for name in names]
    heads = [_put_where_found(station, found) for station in stations]
    stated = {name: rig.station_covariance(name).sigmas for name in names}
    values = {LATENCY: found.latency_s}
    chosen = found.chosen

    def solve() -> JointNight:
        joint = joint_problem([_problem(head, stated[head.name], pictures, chosen, marks, sky) for head in heads])
        return solve_sky(joint, np.array([values.get(name, 0.0) for name in joint.names]), stations)

    solved = solve()
    for radius in _RADII_PX:
        for own, columns in zip(solved.change, solved.columns, strict=True):
            values.update({solved.names[c]: float(v) for c, v in zip(columns, own, strict=True)})
        chosen = again(pictures, _expected(solved, pictures, marks, sky), radius)
        solved = solve()
    return solved


def _put_where_found(station: Station, found: Identification) -> Station:
    """Return the station with its base turned to where its objects were found."""
    # its heading: what it is off level is the fit's to find, from level
    turned = rotation_z(float(found.turn_rad[station.name][2])) @ matrix_from_wxyz(station.runway_from_base_wxyz)
    return replace(station, runway_from_base_wxyz=wxyz_from_matrix(turned))


def _expected(
    solved: JointNight, pictures: Sequence[SkyPicture], marks: tuple[Mark, ...], sky: SkyOverSite
) -> dict[tuple[int, int], FloatArray]:
    """Return the pixels of what should be in the pictures, by picture and pass (−1: the Moon)."""
    expected: dict[tuple[int, int], FloatArray] = {}
    for night, change in zip(solved.nights, solved.change, strict=True):
        problem, station = night.fit.problem, night.before
        every = [
            ChosenObject(picture=p, flight=f, pixel_px=np.zeros(2), sigma_px=1.0)
            for p, picture in enumerate(pictures)
            if picture.station == station.name
            for f in _in_the_sky(picture, marks)
        ]
        if not every:
            continue
        there = replace(problem, sightings=_sightings(every, pictures, marks, sky)).predict(change)
        inside = np.all((there.pixel_px >= 0.0) & (there.pixel_px < station.lens.image_size_px), axis=1)
        for row in np.flatnonzero(inside & there.usable):
            expected[every[row].picture, every[row].flight] = there.pixel_px[row]
    return expected


def _in_the_sky(picture: SkyPicture, marks: tuple[Mark, ...]) -> list[int]:
    """Return the passes during which a picture was taken, and −1 where it shows the Moon."""
    flights = [m.path for m in marks if isinstance(m, AircraftMark)]
    own = [f for f, path in enumerate(flights) if path.span_s[0] <= picture.utc_s - path.middle_s <= path.span_s[1]]
    return own if picture.moon is None else [*own, -1]


def _result(
    night: NightCalibration, flights: tuple[FlightPath, ...], passed_over: tuple[str, ...], taken: Mapping[str, int]
) -> SkyCalibration:
    joint = night.joint
    counts: list[dict[str, int]] = [{} for _ in range(len(flights) + 1)]
    for one in joint.nights:
        seen = one.fit.problem.sightings
        for f, count in enumerate(counts):
            count[one.before.name] = int(np.count_nonzero(one.fit.kept & (seen.mark == f)))
    timed = LATENCY in joint.names
    place = [one.fit.problem.names.index(LATENCY) for one in joint.nights[:1] if timed]
    return SkyCalibration(
        night=night,
        flights=flights,
        pictures=tuple(counts[:-1]),
        moon=counts[-1],
        taken=taken,
        latency_s=float(joint.change[0][place[0]]) if timed else None,
        latency_sigma_s=joint.sigma(LATENCY) if timed else None,
        passed_over=passed_over,
    )


def passes(
    pictures: Sequence[SkyPicture], reports: dict[str, tuple[AdsbReport, ...]], site: ObservingSite
) -> tuple[tuple[FlightPath, ...], tuple[str, ...]]:
    """Return the paths of airliners that were in the sky while pictures were taken, and those passed over, why."""
    times = np.array([p.utc_s for p in pictures])
    found: list[FlightPath] = []
    passed_over = []
    for name, own in sorted(reports.items()):
        first, last = own[0].t_s - LEAST_LATENCY_S, own[-1].t_s - MOST_LATENCY_S
        inside = times[(times >= first) & (times <= last)]
        if not len(inside):
            continue
        for begin, end in _runs(inside):
            path = fit_path(own, begin + LEAST_LATENCY_S, end + MOST_LATENCY_S, site)
            if isinstance(path, str):
                passed_over.append(f"{name}: {path}")
            elif _is_near(path):
                found.append(path)
    return tuple(found), tuple(passed_over)


def _runs(times: FloatArray) -> list[tuple[float, float]]:
    """Return first and last of runs of pictures, none longer than a pass."""
    runs: list[tuple[float, float]] = []
    for t in times.tolist():
        if runs and t - runs[-1][0] <= _LONGEST_PASS_S:
            runs[-1] = (runs[-1][0], t)
        else:
            runs.append((t, t))
    return runs


def _is_near(path: FlightPath) -> bool:
    place = path.at(np.linspace(*path.span_s, 9))[0]
    away = np.linalg.norm(place, axis=1)
    return bool(np.any((away > _NEAREST_M) & (away < _FARTHEST_M) & (place[:, 2] > _LOWEST * away)))


def pass_name(number: int, path: FlightPath) -> str:
    """Return the name of a pass's mark."""
    return f"{path.aircraft}-{number}"


def _moon_mark(sky: SkyOverSite, uncertain: SkyUncertainty) -> Mark:
    return Mark(
        name="sky",
        kind=MarkKind.SKY,
        place_m=sky.pole(),
        sigma=np.array([uncertain.clock_s, uncertain.refraction, 0.0]),
        runway_from_board=np.eye(3),
    )


def _problem(
    station: Station,
    stated: Mapping[str, float],
    pictures: Sequence[SkyPicture],
    chosen: Sequence[ChosenObject],
    marks: tuple[Mark, ...],
    sky: SkyOverSite,
) -> MountProblem:
    """Return one station's problem; raises `StarFitError` where it has too few pictures."""
    own = [one for one in chosen if pictures[one.picture].station == station.name]
    if len(own) < LEAST_PICTURES:
        got = f"{len(own)} pictures of an airliner or the Moon"
        raise StarFitError(f"station {station.name}: got {got}; wanted {LEAST_PICTURES} or more, better 40")
    own.sort(key=lambda one: pictures[one.picture].utc_s)
    seen = _sightings(own, pictures, marks, sky)
    names = sky_priors(station, stated, [mark for k, mark in enumerate(marks) if np.any(seen.mark == k)])
    return MountProblem(
        station=station,
        sightings=seen,
        marks=marks,
        names=tuple(names),
        prior_sigma=np.array(list(names.values())),
    )


def _sightings(
    own: Sequence[ChosenObject], pictures: Sequence[SkyPicture], marks: tuple[Mark, ...], sky: SkyOverSite
) -> MountSightings:
    rows = [pictures[one.picture] for one in own]
    flight = np.array([one.flight if one.flight >= 0 else len(marks) - 1 for one in own], dtype=np.int64)
    body = np.zeros((len(own), 3))
    for k, picture in enumerate(rows):
        mark = marks[int(flight[k])]
        if isinstance(mark, AircraftMark):
            body[k, 0] = picture.utc_s - mark.path.middle_s
        else:
            body[k] = sky.body("moon", picture.utc_s)
    named = [MOON if one.flight < 0 else marks[one.flight].name for one in own]
    return MountSightings(
        reading_rad=np.array([p.reading_rad for p in rows]),
        sense=np.array([p.sense for p in rows]),
        pixel_px=np.array([one.pixel_px for one in own]),
        sigma_px=np.array([one.sigma_px for one in own]),
        pointing=np.arange(len(own)),
        mark=flight,
        body_m=body,
        label=tuple(f"{p.label}: {name}" for p, name in zip(rows, named, strict=True)),
        readings=np.array([p.readings for p in rows], dtype=np.float64),
    )
