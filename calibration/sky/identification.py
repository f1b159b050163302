"""Which object of which picture is which airliner, though heads and latency are known to degrees and seconds only.

Every object near a place where an airliner may be gives a difference of azimuth and height. Those of the true one agree
over a station's pictures, at the true latency: the place with the most pictures is taken, then each station's turn is
fitted, and what is near its expected place is chosen.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.sky.aircraft_mark import lift_below
from calibration.sky.day import SkyPicture
from calibration.sky.flight_path import OWN_LATENCY_S, FlightPath
from calibration.stars.sky import SkyOverSite
from groundstation.arrays import FloatArray, IntArray, MaskArray
from groundstation.rig.rig import Rig, Station

MOON = "moon"
# how well the rig's orientation has to be known, by eye and compass
MOST_OFF_DEG = 6.0
LEAST_LATENCY_S, MOST_LATENCY_S = -0.5, 2.5
_LATENCY_STEP_S = 0.1
_VOTE_RAD = float(np.radians(0.5))
# with a turn alone: a camera that sits askew on its head, aircraft that are 100 m off at 8 km
_NEAR_RAD = tuple(float(np.radians(a)) for a in (1.2, 0.8, 0.8))
_LEAST_PICTURES = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChosenObject:
    """One sighting: the picture's number, the pass's number (−1: the Moon), pixel (2,) and sigma, px."""

    picture: int
    flight: int
    pixel_px: FloatArray
    sigma_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """The result: sightings, the latency, s, and each station's turn (3,), runway frame, rad, since the rig's."""

    chosen: tuple[ChosenObject, ...]
    latency_s: float
    turn_rad: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """All k pairs of an object and an airliner: numbers, where it is seen (k, 3), at which time, pixel and sigma."""

    picture: IntArray
    flight: IntArray
    station: IntArray
    seen: FloatArray
    time_s: FloatArray
    place_m: FloatArray
    pixel_px: FloatArray
    sigma_px: FloatArray


def identify(
    pictures: Sequence[SkyPicture], flights: Sequence[FlightPath], rig: Rig, sky: SkyOverSite
) -> Identification | str:
    """Return which objects are which airliners and the Moon, or why it cannot be told."""
    pairs = _pairs(pictures, flights, rig)
    if not len(pairs.picture):
        return "no object within 6 deg of an airliner's place, nor the Moon"
    best: tuple[int, float, FloatArray] | None = None
    for latency in np.arange(LEAST_LATENCY_S, MOST_LATENCY_S + 1e-9, _LATENCY_STEP_S):
        off = _differences(pairs, _towards(pairs, flights, sky, pictures, np.full(len(flights), latency)))
        votes, centre = _vote(pairs, off, len(rig.stations))
        if best is None or votes > best[0]:
            best = (votes, float(latency), centre)
    if best is None or best[0] < _LEAST_PICTURES:
        return "no object that moves as an airliner of the receiver does"
    _, voted, centre = best
    latency = np.full(len(flights), voted)
    # seen too far clockwise: turned back counter-clockwise
    turns = np.column_stack([np.zeros((len(centre), 2)), centre[:, 0]])
    chosen: MaskArray = np.zeros(len(pairs.picture), dtype=np.bool_)
    # the first turn is the vote's: its height is taken off the differences
    lifted = centre[:, 1]
    for near in _NEAR_RAD:
        towards = _towards(pairs, flights, sky, pictures, latency)
        off = _turned_off(pairs, towards, turns)
        off[:, 1] -= lifted[pairs.station]
        chosen = _nearest(pairs, off, near)
        turns, step = _turns(pairs, towards, chosen, flights, latency, len(rig.stations))
        latency, lifted = latency + step, np.zeros(len(lifted))
    return _result(pairs, chosen, float(np.median(latency)) if len(flights) else voted, turns, rig)


def _result(pairs: _Pairs, chosen: MaskArray, latency: float, turns: FloatArray, rig: Rig) -> Identification | str:
    rows = np.flatnonzero(chosen)
    if len(rows) < _LEAST_PICTURES:
        return f"{len(rows)} pictures of airliners or the Moon; wanted {_LEAST_PICTURES} or more of each head"
    return Identification(
        chosen=tuple(
            ChosenObject(
                picture=int(pairs.picture[k]),
                flight=int(pairs.flight[k]),
                pixel_px=pairs.pixel_px[k],
                sigma_px=float(pairs.sigma_px[k]),
            )
            for k in rows
        ),
        latency_s=float(latency),
        turn_rad={name: turns[k] for k, name in enumerate(rig.names)},
    )


def _pairs(pictures: Sequence[SkyPicture], flights: Sequence[FlightPath], rig: Rig) -> _Pairs:
    rows: list[tuple[int, int, int, FloatArray, float, FloatArray, FloatArray, float]] = []
    number_of = {name: k for k, name in enumerate(rig.names)}
    wide = np.radians(MOST_OFF_DEG)
    for p, picture in enumerate(pictures):
        station = rig[picture.station]
        k = number_of[picture.station]
        looks = _looks(station, picture)
        half = np.arctan(0.5 * np.hypot(*station.lens.image_size_px) / float(station.lens.focal_px.min()))
        for f, flight in enumerate(flights):
            t = picture.utc_s - flight.middle_s
            if not flight.span_s[0] <= t <= flight.span_s[1]:
                continue
            away = flight.at(np.array([t]))[0][0] - station.ptu_position_m
            if np.arccos(np.clip(away @ looks / np.linalg.norm(away), -1.0, 1.0)) > wide + half:
                continue
            for pixel, sigma in zip(picture.seen.pixel_px, picture.seen.sigma_px, strict=True):
                rows.append((p, f, k, _seen(station, picture, pixel), t, station.ptu_position_m, pixel, float(sigma)))
        if picture.moon is not None:
            pixel = np.array(picture.moon.pixel_px)
            rows.append(
                (p, -1, k, _seen(station, picture, pixel), 0.0, station.ptu_position_m, pixel, picture.moon.sigma_px)
            )
    columns = list(zip(*rows, strict=True)) if rows else [()] * 8
    return _Pairs(
        picture=np.array(columns[0], dtype=np.int64),
        flight=np.array(columns[1], dtype=np.int64),
        station=np.array(columns[2], dtype=np.int64),
        seen=np.array(columns[3]).reshape(-1, 3),
        time_s=np.array(columns[4], dtype=np.float64),
        place_m=np.array(columns[5]).reshape(-1, 3),
        pixel_px=np.array(columns[6]).reshape(-1, 2),
        sigma_px=np.array(columns[7], dtype=np.float64),
    )


def _looks(station: Station, picture: SkyPicture) -> FloatArray:
    angles = station.ptu_axes.angles(*picture.reading_rad.tolist(), *picture.sense.tolist())
    return station.geometry().camera_pose(*angles).runway_from_camera[:, 2]


def _seen(station: Station, picture: SkyPicture, pixel: FloatArray) -> FloatArray:
    angles = station.ptu_axes.angles(*picture.reading_rad.tolist(), *picture.sense.tolist())
    return station.geometry().ray(float(pixel[0]), float(pixel[1]), *angles).direction_runway


def _towards(
    pairs: _Pairs, flights: Sequence[FlightPath], sky: SkyOverSite, pictures: Sequence[SkyPicture], latency: FloatArray
) -> FloatArray:
    """Return unit vectors (k, 3) to where each pair's object is expected; ``latency`` (f,) of each pass, s."""
    towards = np.zeros((len(pairs.picture), 3))
    for f, flight in enumerate(flights):
        own = pairs.flight == f
        away = flight.at(pairs.time_s[own] + latency[f])[0] - pairs.place_m[own]
        away = away / np.linalg.norm(away, axis=1, keepdims=True) + lift_below(away)
        towards[own] = away / np.linalg.norm(away, axis=1, keepdims=True)
    for row in np.flatnonzero(pairs.flight == -1):
        towards[row] = sky.body("moon", pictures[int(pairs.picture[row])].utc_s)
    return towards


def _differences(pairs: _Pairs, towards: FloatArray) -> FloatArray:
    """Return seen less expected azimuth and height (k, 2), rad; the azimuth clockwise."""
    return _angles(pairs.seen) - _angles(towards)


def _angles(units: FloatArray) -> FloatArray:
    return np.column_stack([np.arctan2(units[:, 0], units[:, 1]), np.arcsin(np.clip(units[:, 2], -1.0, 1.0))])


def _turned_off(pairs: _Pairs, towards: FloatArray, turns: FloatArray) -> FloatArray:
    """Return the differences (k, 2) with the stations turned, the azimuth's times the cosine of the height."""
    seen = pairs.seen + np.cross(turns[pairs.station], pairs.seen)
    off = _angles(seen / np.linalg.norm(seen, axis=1, keepdims=True)) - _angles(towards)
    off[:, 0] = (off[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
    off[:, 0] *= np.cos(np.arcsin(np.clip(towards[:, 2], -1.0, 1.0)))
    return off


def _vote(pairs: _Pairs, off: FloatArray, stations: int) -> tuple[int, FloatArray]:
    """Return how many pictures agree on one difference each station, and these (s, 2)."""
    total, centre = 0, np.zeros((stations, 2))
    off = off.copy()
    off[:, 0] = (off[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
    for s in range(stations):
        own = np.flatnonzero((pairs.station == s) & (np.abs(off) < np.radians(MOST_OFF_DEG)).all(axis=1))
        if not len(own):
            continue
        near = np.all(np.abs(off[own][:, None] - off[own][None]) < _VOTE_RAD, axis=2)
        counts = np.array([len(np.unique(pairs.picture[own[row]])) for row in near])
        best = int(np.argmax(counts))
        total += int(counts[best])
        centre[s] = np.median(off[own[near[best]]], axis=0)
    return total, centre


def _nearest(pairs: _Pairs, off: FloatArray, near: float) -> MaskArray:
    """Return which pairs (k,) are within an angle and the nearest of their picture and airliner."""
    length = np.linalg.norm(off, axis=1)
    chosen: MaskArray = np.zeros(len(length), dtype=np.bool_)
    order = np.argsort(length, kind="stable")
    taken: set[tuple[int, int]] = set()
    for row in order[length[order] < near]:
        key = (int(pairs.picture[row]), int(pairs.flight[row]))
        if key not in taken:
            taken.add(key)
            chosen[row] = True
    return chosen


def _turns(
    pairs: _Pairs,
    towards: FloatArray,
    chosen: MaskArray,
    flights: Sequence[FlightPath],
    latency: FloatArray,
    stations: int,
) -> tuple[FloatArray, FloatArray]:
    """Return each station's turn (s, 3), rad, and changes of each pass's latency (f,), s: the chosen pairs' best."""
    rows = np.flatnonzero(chosen)
    turns = 3 * stations
    if len(rows) < _LEAST_PICTURES:
        return np.zeros((stations, 3)), np.zeros(len(flights))
    jacobian = np.zeros((len(rows), 3, turns + 1 + len(flights)))
    for number, row in enumerate(rows):
        x, y, z = pairs.seen[row]
        # ω × seen = −[seen]× ω
        s = 3 * int(pairs.station[row])
        jacobian[number, :, s : s + 3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        f = int(pairs.flight[row])
        if f >= 0:
            t = np.array([pairs.time_s[row] + latency[f]])
            away = flights[f].at(t)[0][0] - pairs.place_m[row]
            moving = flights[f].at(t, derivative=1)[0][0]
            unit = away / np.linalg.norm(away)
            along = -(moving - unit * (unit @ moving)) / np.linalg.norm(away)
            jacobian[number, :, turns] = jacobian[number, :, turns + 1 + f] = along
    right = (towards[rows] - pairs.seen[rows]).ravel()
    columns = jacobian.reshape(len(right), -1)
    # turns of 5 deg, levels of 2 deg, the receiver's latency, aircraft's own: what few pictures leave open stays small
    sigma = np.array([*([0.035, 0.035, 0.1] * stations), 0.3, *([OWN_LATENCY_S] * len(flights))])
    weight, solution = np.ones(len(right)), np.zeros(len(sigma))
    for _ in range(5):
        normal = columns.T @ (weight[:, None] * columns) / 1e-5 + np.diag(sigma**-2.0)
        solution = np.asarray(np.linalg.solve(normal, columns.T @ (weight * right) / 1e-5), dtype=np.float64)
        left = np.linalg.norm((right - columns @ solution).reshape(-1, 3), axis=1)
        weight = np.repeat(1.0 / np.maximum(left / max(float(np.median(left)), 1e-5), 1.0), 3)
    return np.asarray(solution[:turns].reshape(stations, 3)), np.asarray(solution[turns] + solution[turns + 1 :])


def again(
    pictures: Sequence[SkyPicture], expected: Mapping[tuple[int, int], FloatArray], radius_px: float
) -> tuple[ChosenObject, ...]:
    """Return the objects nearest to where a fit expects them, within a radius, by picture and pass (−1: the Moon)."""
    chosen = []
    for (p, f), pixel in expected.items():
        picture = pictures[p]
        if f < 0:
            if picture.moon is not None:
                at, sigma = np.array(picture.moon.pixel_px), picture.moon.sigma_px
                if float(np.linalg.norm(at - pixel)) < radius_px:
                    chosen.append(ChosenObject(picture=p, flight=f, pixel_px=at, sigma_px=sigma))
        elif len(picture.seen):
            away = np.linalg.norm(picture.seen.pixel_px - pixel, axis=1)
            k = int(np.argmin(away))
            if away[k] < radius_px:
                sigma = float(picture.seen.sigma_px[k])
                chosen.append(ChosenObject(picture=p, flight=f, pixel_px=picture.seen.pixel_px[k], sigma_px=sigma))
    return tuple(chosen)
