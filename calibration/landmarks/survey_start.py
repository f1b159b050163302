"""Pose of a station from landmarks, without an initial value: the start of the bundle adjustment."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.flight.problem import left_jacobian
from calibration.landmarks.angles import LandmarkObservations, stops_of
from calibration.landmarks.fit import LandmarkFit, solve_landmarks
from calibration.landmarks.problem import pose_problem
from calibration.landmarks.rejection import LandmarkFitError
from calibration.orientation import PoseGuess, bearings_in_base, find_orientation, find_position, kabsch
from calibration.sightings import Landmark
from groundstation.arrays import FloatArray, MaskArray
from groundstation.geometry.rotation import cross_matrices, matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Station

# bearings, or places, spread by less than this are one
ONE_BEARING_RAD = float(np.radians(0.2))
# of a line's length: nearer to it than this, places are on it
_ON_A_LINE = 0.005
_MOST_TRIPLES = 250
# of a table that is only judged: with a fifth of the landmarks mistaken, half of them are of right ones
_JUDGING_TRIPLES = 40
_SEED = 20240501
_FAR_M = 1e8
# largest misfit of the bearings of a valid pose: otherwise another landmark, or other angles
_MOST_MISS_RAD = float(np.radians(2.0))
# three bearings and points leave up to four poses; these many are followed to the end
_FOLLOWED = 6
_SAME_PLACE_M, _SAME_TURN_RAD = 0.05, 1e-3
# a base stands on a tripod: of two poses with an equal fit, the one that is level to this
_LEVEL = float(np.cos(np.radians(30.0)))
_AS_GOOD = 9.0
# bearings of right landmarks miss by less
_ROBUST_RAD = 1e-3
# nothing but a guard against a division by zero
_LEAST_M = 1e-9
_OFF_AXIS = float(np.cos(np.radians(80.0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenBearings:
    """One bearing (n, 3) of each stop, base frame, the landmark's number (n,), its point (n, 3); ``far`` (n,)."""

    bearings: FloatArray
    landmark: NDArray[np.int64]
    points_m: FloatArray
    far: MaskArray


def find_station(
    station: Station, observed: LandmarkObservations, landmarks: Sequence[Landmark], before: ParameterCovariance
) -> Station:
    """Return the station with an orientation, and a position if it has none, that agree with its observations.

    Raises `LandmarkFitError`, which states what is missing.
    """
    _, guesses = _guesses(station, observed, landmarks, _MOST_TRIPLES)
    best = min((g.median_rad for g in guesses), default=np.inf)
    if best > _MOST_MISS_RAD:
        got = "no pose that fits" if not guesses else f"bearings that miss by {np.degrees(best):.2g}° at best"
        wanted = "sightings of the landmarks they name, with this rig's angles and lens"
        raise LandmarkFitError(f"station {station.name}: got {got}; wanted {wanted}")
    near = [g for g in guesses if g.median_rad <= max(10.0 * best, 2e-3)]
    moved = [_moved(station, g) for g in _different(sorted(near, key=lambda g: g.median_rad))[:_FOLLOWED]]
    return _refined(moved, observed, landmarks, before)


def _guesses(
    station: Station, observed: LandmarkObservations, landmarks: Sequence[Landmark], triples: int
) -> tuple[SeenBearings, list[PoseGuess]]:
    """Return what a station saw, and poses by it: one where its place is known, else those of so many triples."""
    known = "position" in station.known
    _require_enough(station, observed, landmarks, known)
    # angles and pixels are bearings in the base's frame, independent of the rig's orientation
    seen = _seen(station, observed, landmarks)
    if not known:
        return seen, list(_poses(seen, triples))
    towards = np.where(seen.far[:, None], station.ptu_position_m + seen.points_m, seen.points_m)
    return seen, [find_orientation(seen.bearings, towards, station.ptu_position_m)]


def _require_enough(
    station: Station, observed: LandmarkObservations, landmarks: Sequence[Landmark], known: bool
) -> None:
    """Raise `LandmarkFitError` where fewer landmarks were seen than there are unknowns."""
    numbers = np.unique(observed.landmark)
    points = [k for k in numbers if landmarks[k].kind == "point"]
    name = station.name
    if known:
        if len(numbers) < 2:
            got = _count(len(numbers))
            raise LandmarkFitError(f"station {name}: got {got}; wanted two or more, in different directions")
        return
    if len(numbers) < 3 or (len(points) < 3 and not (len(points) and len(numbers) - len(points) >= 2)):
        got = _count(len(numbers)) + (f", {len(points)} of them at a known place" if len(points) < len(numbers) else "")
        wanted = 'three or more that are not in a line, or a surveyed position (known = ["position"])'
        raise LandmarkFitError(f"station {name}: got {got}; wanted {wanted}")
    places = np.array([landmarks[k].place for k in points])
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if len(points) == len(numbers) and spread[1] < _ON_A_LINE * spread[0]:
        wanted = "another one, well off that line, or a surveyed position of the station"
        raise LandmarkFitError(f"station {name}: got {_count(len(points))}, all in one line; wanted {wanted}")


def _count(n: int) -> str:
    return "one landmark" if n == 1 else f"{n or 'no'} landmarks"


def _seen(station: Station, observed: LandmarkObservations, landmarks: Sequence[Landmark]) -> SeenBearings:
    bearings = bearings_in_base(station.geometry(), observed.pixel_px, observed.angles_rad)
    stops = stops_of(observed.sightings, station)
    means, numbers = [], []
    for stop in np.unique(stops):
        own = (stops == stop) & np.isfinite(bearings).all(axis=1)
        if own.any():
            mean = np.median(bearings[own], axis=0)
            means.append(mean / np.linalg.norm(mean))
            numbers.append(int(observed.landmark[own][0]))
    if len(set(numbers)) < 2:
        wanted = "pixels of two landmarks or more that the lens model has rays for"
        raise LandmarkFitError(f"station {station.name}: got {_count(len(set(numbers)))}; wanted {wanted}")
    far = np.array([landmarks[k].kind == "direction" for k in numbers])
    points = np.array([landmarks[k].place for k in numbers]) * np.where(far, _FAR_M, 1.0)[:, None]
    found = SeenBearings(bearings=np.array(means), landmark=np.array(numbers), points_m=points, far=far)
    _require_spread(station.name, found)
    return found


def _require_spread(name: str, seen: SeenBearings) -> None:
    """Raise `LandmarkFitError` where everything was seen along one bearing."""
    middle = np.median(seen.bearings, axis=0)
    off = np.linalg.norm(np.cross(seen.bearings, middle / np.linalg.norm(middle)), axis=1)
    if float(off.max()) < ONE_BEARING_RAD and (seen.bearings @ middle > 0).all():
        got = f"landmarks all along one bearing, within {np.degrees(off.max()):.2g}°"
        raise LandmarkFitError(f"station {name}: got {got}; wanted another one, far to the side")


def bearing_misses(station: Station, observed: LandmarkObservations, landmarks: Sequence[Landmark]) -> FloatArray:
    """Return by which angle (k,), rad, each of the k landmarks that a station saw is off in the pose that fits best.

    Lenses and mounts are taken as the rig has them. Raises `LandmarkFitError` where no pose can be computed.
    """
    known = "position" in station.known
    seen, guesses = _guesses(station, observed, landmarks, _JUDGING_TRIPLES)
    if not known:
        guesses = _different(sorted(guesses, key=lambda g: g.median_rad)[: 4 * _FOLLOWED])[:_FOLLOWED]
    guesses = [guess for guess in guesses if guess.median_rad <= _MOST_MISS_RAD]
    if not guesses:
        raise LandmarkFitError(f"station {station.name}: got no pose that fits; wanted other landmarks")
    off = min((_fitted(seen, guess, known) for guess in guesses), key=lambda each: float(np.sum(np.abs(each))))
    return np.array([off[seen.landmark == k].mean() for k in np.unique(seen.landmark)])


def _fitted(seen: SeenBearings, guess: PoseGuess, known: bool) -> FloatArray:
    """Return by which angle (n,), rad, each bearing is off after a robust fit from a guess."""
    fit = BearingFit(seen=seen, guess=guess, known=known)
    start = np.zeros(3 if known else 6)
    solved = least_squares(fit.off, start, jac=fit.slope, loss="soft_l1", f_scale=_ROBUST_RAD, x_scale="jac")
    return np.asarray(np.linalg.norm(fit.off(solved.x).reshape(-1, 3), axis=1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BearingFit:
    """Bearings against a guessed pose changed by a rotation vector, runway frame, and by a shift if it is not known."""

    seen: SeenBearings
    guess: PoseGuess
    known: bool

    def _position(self, change: FloatArray) -> FloatArray:
        return self.guess.position_m if self.known else self.guess.position_m + change[3:]

    def _turned(self, change: FloatArray) -> FloatArray:
        return np.asarray(self.seen.bearings @ (rotation_from_vector(change[:3]) @ self.guess.runway_from_base).T)

    def off(self, change: FloatArray) -> FloatArray:
        """Return by how much (3n,) the unit vectors of bearings are off, runway frame, with a change (3,) or (6,)."""
        return np.asarray((self._turned(change) - _towards(self.seen, self._position(change))).ravel())

    def slope(self, change: FloatArray) -> FloatArray:
        """Return the derivatives (3n, 3) or (3n, 6) of `off`."""
        # exp([θ]×) b moves by θ × b
        by_turn = -cross_matrices(self._turned(change)) @ left_jacobian(change[:3])
        if self.known:
            return by_turn.reshape(-1, 3)
        far, away = self.seen.far[:, None, None], self.seen.points_m - self._position(change)
        length = np.maximum(np.linalg.norm(away, axis=1), _LEAST_M)[:, None]
        towards = away / length
        across = (np.eye(3) - towards[:, :, None] * towards[:, None, :]) / length[:, :, None]
        return np.concatenate([by_turn, np.where(far, 0.0, across)], axis=2).reshape(-1, 6)


def _poses(seen: SeenBearings, most: int) -> Iterator[PoseGuess]:
    """Yield poses from three bearings each, at most so many triples, or from two far directions and a point."""
    far = np.unique(seen.landmark[seen.far])
    if len(far) >= 2:
        turned = kabsch(seen.bearings[seen.far], seen.points_m[seen.far] / _FAR_M)
        near = ~seen.far
        yield _judged(seen, turned, find_position(seen.bearings[near] @ turned.T, seen.points_m[near]))
    where = {int(k): np.flatnonzero((seen.landmark == k) & ~seen.far) for k in np.unique(seen.landmark)}
    numbers = [k for k, rows in where.items() if len(rows)]
    triples = list(combinations(numbers, 3))
    generator = np.random.default_rng(_SEED)
    if len(triples) > most:
        triples = [triples[k] for k in generator.choice(len(triples), most, replace=False)]
    for triple in triples:
        rows = [int(generator.choice(where[k])) for k in triple]
        yield from _three_points(seen, rows)


def _three_points(seen: SeenBearings, rows: list[int]) -> Iterator[PoseGuess]:
    """Yield the poses from which three points appear under their bearings (OpenCV's AP3P)."""
    bearings, points = seen.bearings[rows], seen.points_m[rows]
    origin = points.mean(axis=0)
    spread = np.linalg.svd(points - origin, compute_uv=False)
    middle = bearings.sum(axis=0)
    length = float(np.linalg.norm(middle))
    if length < 1e-6 or spread[1] < _ON_A_LINE * spread[0]:
        return
    middle /= length
    side = np.cross(middle, np.eye(3)[int(np.argmin(np.abs(middle)))])
    side /= np.linalg.norm(side)
    picture_from_base = np.stack([side, np.cross(middle, side), middle])
    rays = bearings @ picture_from_base.T
    if rays[:, 2].min() < _OFF_AXIS:
        return
    plane = np.ascontiguousarray(rays[:, :2] / rays[:, 2:])
    _, turns, shifts = cv2.solveP3P(points - origin, plane, np.eye(3), None, flags=cv2.SOLVEPNP_AP3P)
    for turn, shift in zip(turns, shifts, strict=True):
        picture_from_runway = cv2.Rodrigues(turn)[0]
        position = origin - picture_from_runway.T @ shift.ravel()
        turned = picture_from_runway.T @ picture_from_base
        if np.isfinite(position).all() and np.isfinite(turned).all():
            yield _judged(seen, turned, position)


def _judged(seen: SeenBearings, runway_from_base: FloatArray, position_m: FloatArray) -> PoseGuess:
    towards = _towards(seen, position_m)
    miss = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(seen.bearings @ runway_from_base.T - towards, axis=1), 0, 1))
    return PoseGuess(runway_from_base=runway_from_base, position_m=position_m, median_rad=float(np.median(miss)))


def _towards(seen: SeenBearings, position_m: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3), runway frame, from a place (3,) to where each bearing should point."""
    towards = np.where(seen.far[:, None], seen.points_m, seen.points_m - position_m)
    return np.asarray(towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), _LEAST_M))


def _different(guesses: list[PoseGuess]) -> list[PoseGuess]:
    """Return the candidates without near copies of an earlier one."""
    kept: list[PoseGuess] = []
    for guess in guesses:
        if all(
            np.linalg.norm(guess.position_m - other.position_m) > 10.0 * _SAME_PLACE_M
            or np.linalg.norm(guess.runway_from_base - other.runway_from_base) > 10.0 * _SAME_TURN_RAD
            for other in kept
        ):
            kept.append(guess)
    return kept


def _moved(station: Station, guess: PoseGuess) -> Station:
    return replace(
        station,
        runway_from_base_wxyz=wxyz_from_matrix(guess.runway_from_base),
        ptu_position_m=guess.position_m,
    )


def _refined(
    candidates: list[Station],
    observed: LandmarkObservations,
    landmarks: Sequence[Landmark],
    before: ParameterCovariance,
) -> Station:
    """Return the candidate with the best fit to its own observations; raises `LandmarkFitError` for an equal rival."""
    found: list[tuple[float, Station]] = []
    for station in candidates:
        fit = _own_fit(station, observed, landmarks, before)
        cost = float((np.minimum(fit.length, 10.0) ** 2).sum())
        change = fit.problem.station_change(fit.change, station.name, today=False)
        # only the pose changes: the other parameters stay at their prior means
        change[3 if "position" in station.known else 6 :] = 0.0
        found.append((cost, station.changed(change)))
    found.sort(key=lambda pair: pair[0])
    best = [station for cost, station in found if cost <= found[0][0] + _AS_GOOD]
    first = best[0]
    others = [s for s in best[1:] if not _same(first, s)]
    if not others:
        return first
    level = [s for s in best if matrix_from_wxyz(s.runway_from_base_wxyz)[2, 2] > _LEVEL]
    if not level or any(not _same(level[0], s) for s in level[1:]):
        got = f"{len(others) + 1} poses that fit its {len(np.unique(observed.landmark))} landmarks alike"
        raise LandmarkFitError(f"station {first.name}: got {got}; wanted another landmark, or a surveyed position")
    return level[0]


def _same(a: Station, b: Station) -> bool:
    apart = float(np.linalg.norm(a.ptu_position_m - b.ptu_position_m))
    turned = matrix_from_wxyz(a.runway_from_base_wxyz) - matrix_from_wxyz(b.runway_from_base_wxyz)
    return apart < _SAME_PLACE_M and float(np.linalg.norm(turned)) < _SAME_TURN_RAD


def _own_fit(
    station: Station, observed: LandmarkObservations, landmarks: Sequence[Landmark], before: ParameterCovariance
) -> LandmarkFit:
    groups = ["runway_from_base", *([] if "position" in station.known else ["ptu_position"])]
    free = [f"{station.name}.{group}.{axis}" for group in groups for axis in "xyz"]
    return solve_landmarks(pose_problem({station.name: station}, [observed], landmarks, free, before))


def found_stations(
    stations: Mapping[str, Station],
    observed: Sequence[LandmarkObservations],
    landmarks: Sequence[Landmark],
    before: ParameterCovariance,
) -> dict[str, Station]:
    """Return every station with a pose, each estimated by itself."""
    return {own.station: find_station(stations[own.station], own, landmarks, before) for own in observed}
