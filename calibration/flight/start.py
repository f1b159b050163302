"""Initial values of the solver: poses that the rig does not give, and clock offsets within their priors."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.flight.fit import MIN_OBSERVATIONS, FlightFitError
from calibration.flight.parameters import DGPS_CLOCK_S
from calibration.flight.problem import DGPS_OFFSET, FlightProblem, StationObservations, angles_at
from calibration.orientation import PoseGuess, bearings_in_base, find_orientation, find_pose, find_position
from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, wxyz_from_matrix
from groundstation.rig.rig import Station

_MOST_BEARINGS = 300
_SCAN_SIGMAS = 3.0
_SCAN_STEPS = 41
# directions, or places, spread less than this across their line are a line
_LEAST_SPREAD_RAD = 2e-4
_LEAST_PLACE_SPREAD = 0.005
# largest misfit of the bearings of a valid pose
_MOST_MISS_RAD = float(np.radians(5.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StartingPoint:
    """A problem whose stations all have a pose, and the change (p,) to start from."""

    problem: FlightProblem
    change: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Started:
    station: Station
    offset_s: float


def find_start(problem: FlightProblem) -> StartingPoint:
    """Estimate a pose for each station that lacks one, and the clocks with it.

    Raises `FlightFitError` where the observations do not give a pose.
    """
    stations, offsets = dict(problem.stations), {}
    for name, station in problem.stations.items():
        if {"orientation", "position"} <= set(station.known):
            continue
        started = _start(problem, station, problem.observations[name])
        stations[name] = started.station
        offsets[name] = started.offset_s
    change = np.zeros(len(problem.names))
    in_common = []
    for name, offset in offsets.items():
        own = f"{name}.camera_clock.offset"
        if own in problem.names:
            change[problem.names.index(own)] = offset
        else:
            in_common.append(offset)
    if in_common and DGPS_OFFSET in problem.names:
        change[problem.names.index(DGPS_OFFSET)] = float(np.median(in_common))
    return StartingPoint(problem=replace(problem, stations=stations), change=change)


def _start(problem: FlightProblem, station: Station, observed: StationObservations) -> _Started:
    """Scan the clock's offset; at each, the pose without an initial value."""
    name = station.name
    if len(observed) < MIN_OBSERVATIONS:
        raise FlightFitError(f"station {name}: got {len(observed)} pixels; wanted at least {MIN_OBSERVATIONS}")
    chosen = np.unique(np.linspace(0, len(observed) - 1, _MOST_BEARINGS).astype(np.int64))
    t, pixels = observed.t_s[chosen], observed.pixel_px[chosen]
    # a camera's own clock moves its exposures past the readings, the log's does not
    by_camera = f"{name}.camera_clock.offset" in problem.names
    angles = angles_at(observed, t)
    bearings = bearings_in_base(station.geometry(), pixels, angles.angles_rad)
    best: PoseGuess | None = None
    best_s = 0.0
    for offset in _offsets(problem, name):
        if by_camera and not station.fixed:
            angles = angles_at(observed, t + offset)
            bearings = bearings_in_base(station.geometry(), pixels, angles.angles_rad)
        track = problem.track.at(t + offset)
        usable = angles.usable & track.usable & np.isfinite(bearings).all(axis=1)
        if usable.sum() < MIN_OBSERVATIONS:
            continue
        points = track.nose_m(problem.antenna_in_body_m)[usable]
        guess = _pose(station, bearings[usable], points)
        if guess is not None and (best is None or guess.median_rad < best.median_rad):
            best, best_s = guess, offset
    if best is None:
        raise FlightFitError(
            f"station {name}: got no pose that fits; wanted at least {MIN_OBSERVATIONS} pixels with reference and "
            "angles, of a flight that is not all in one line or one place"
        )
    if best.median_rad > _MOST_MISS_RAD:
        got = f"bearings that miss the aircraft by {np.degrees(best.median_rad):.1f}° at best"
        raise FlightFitError(f"station {name}: got {got}; wanted pixels and DGPS of the same flight, and its clocks")
    moved = replace(
        station,
        runway_from_base_wxyz=wxyz_from_matrix(best.runway_from_base),
        ptu_position_m=best.position_m,
    )
    return _Started(station=moved, offset_s=best_s)


def _offsets(problem: FlightProblem, name: str) -> FloatArray:
    """Return the clock offsets to try, s."""
    own = f"{name}.camera_clock.offset"
    sigma = float(problem.prior_sigma[problem.names.index(own)]) if own in problem.names else 0.0
    if DGPS_OFFSET in problem.names:
        sigma = float(np.hypot(sigma, DGPS_CLOCK_S))
    if not sigma:
        return np.zeros(1)
    return np.linspace(-_SCAN_SIGMAS * sigma, _SCAN_SIGMAS * sigma, _SCAN_STEPS)


def _pose(station: Station, bearings: FloatArray, points_m: FloatArray) -> PoseGuess | None:
    """Return the pose that is missing, or None where the points cannot give one."""
    centred = points_m - points_m.mean(axis=0)
    if "position" not in station.known:
        spread = np.linalg.svd(centred, compute_uv=False)
        if spread[1] < _LEAST_PLACE_SPREAD * spread[0] or spread[0] == 0.0:
            return None
        if "orientation" in station.known:
            rotation = matrix_from_wxyz(station.runway_from_base_wxyz)
            place = find_position(bearings @ rotation.T, points_m)
            towards = points_m - place
            towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
            miss = np.linalg.norm(bearings @ rotation.T - towards, axis=1)
            return PoseGuess(runway_from_base=rotation, position_m=place, median_rad=float(np.median(miss)))
        return find_pose(bearings, points_m)
    spread = np.linalg.svd(bearings - bearings.mean(axis=0), compute_uv=False) / np.sqrt(len(bearings))
    if spread[0] < _LEAST_SPREAD_RAD:
        return None
    return find_orientation(bearings, points_m, station.ptu_position_m)
