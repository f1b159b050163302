"""`groundstation calibrate survey`: poses of all stations together, from landmarks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.flight.parameters import (
    FLOOR_POSITION_M,
    FLOOR_ROTATION_RAD,
    KNOWN_FOCAL_SHARE,
    KNOWN_POSITION_M,
    KNOWN_ROTATION_RAD,
)
from calibration.joint_covariance import with_covariance
from calibration.landmarks.angles import LandmarkObservations, gather_observations
from calibration.landmarks.fit import LandmarkFit, solve_landmarks
from calibration.landmarks.problem import AXES, pose_problem
from calibration.landmarks.rejection import LandmarkFitError
from calibration.landmarks.survey_start import found_stations
from calibration.sightings import Landmark, LandmarkSighting, require_consistent
from groundstation.arrays import FloatArray
from groundstation.errors import InputError, UsageError
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import PARTS, Rig, Station

FREE_WORDS = ("position", "boresight", "focal")
# largest uncertainty of a valid pose
_WORST_ROTATION_RAD = float(np.radians(0.5))
_WORST_POSITION_M = 1.0
_WORST_MISFIT = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """The result: the fit, the rig with it, and notes for the user."""

    before: Rig
    rig: Rig
    fit: LandmarkFit
    notes: tuple[str, ...]


def survey_words(text: str) -> tuple[str, ...]:
    """Return the words of --free; raises `InputError` for an unknown one."""
    words = tuple(word.strip() for word in text.split(",") if word.strip())
    for word in words:
        if word not in FREE_WORDS:
            raise UsageError("--free", got=repr(word), wanted="some of " + ", ".join(FREE_WORDS))
    return words


def solve_survey(
    rig: Rig,
    sightings: Sequence[LandmarkSighting],
    landmarks: Mapping[str, Landmark],
    words: Sequence[str] = (),
    path: Path = Path("sightings.csv"),
    heading_sigma_rad: float | None = None,
) -> Survey:
    """Estimate the orientation of each station with sightings, and its position within the rig's covariance.

    With ``heading_sigma_rad`` the heads stand as the rig has them, as after a calibration by stars: its orientations
    with their covariance count as much as the sightings, but for a heading of that sigma which all stations share,
    between true north and the frame of the landmarks.

    Raises `InputError` for a faulty table, `LandmarkFitError` where the landmarks are insufficient; both in one line.
    """
    require_consistent(sightings, landmarks, rig.names, path)
    seen = seen_landmarks(sightings, landmarks, path)
    names = [s.name for s in rig.stations if any(k.station == s.name for k in sightings)]
    stations = {name: rig[name] for name in names}
    require_lens(stations, rig)
    places = {landmark.name: k for k, landmark in enumerate(seen)}
    observed = [gather_observations(sightings, stations[name], places) for name in names]
    before = prior_covariance(rig, names, words)
    started = found_stations(stations, observed, seen, before)
    oriented: tuple[str, ...] = ()
    if heading_sigma_rad is not None:
        rig.require_known(("orientation",))
        before = with_orientations(rig, names, before, heading_sigma_rad)
        oriented = tuple(before.names)
        # the covariance is about the rig's own orientations
        started = {n: replace(s, runway_from_base_wxyz=rig[n].runway_from_base_wxyz) for n, s in started.items()}
    free = [
        f"{name}.{group}.{axis}"
        for name in names
        for group, part in (("runway_from_base", "orientation"), ("ptu_position", "position"))
        for axis in AXES
        if part == "orientation" or part not in stations[name].known
        if f"{name}.{group}.{axis}" not in oriented
    ]
    fit = solve_landmarks(pose_problem(started, observed, seen, free, before))
    require_determined(fit, stations)
    found = _solved(rig, started, fit)
    unseen = [s.name for s in rig.stations if s.name not in names]
    notes = [f"{name}: no sighting; stays as the rig has it" for name in unseen]
    notes += _exchanged(found, names)
    if fit.raised > 1.0:
        notes.append(f"residuals are {fit.raised:.1f} times what their noise allows: all sigmas are raised by that")
    return Survey(before=rig, rig=found, fit=fit, notes=tuple(notes))


def _exchanged(rig: Rig, names: Sequence[str]) -> list[str]:
    """Return a doubt where a station that is called left was found to the right of one that is called right."""
    if not {"left", "right"} <= set(names):
        return []
    left, right = (float(rig[name].ptu_position_m[0]) for name in ("left", "right"))
    if left <= right:
        return []
    return [
        f"doubtful: left is at x = {left:.1f} m, to the right of right at {right:.1f} m, as seen along +y,"
        " towards the approaching aircraft: are the stations exchanged in the sightings?"
    ]


def seen_landmarks(
    sightings: Sequence[LandmarkSighting], landmarks: Mapping[str, Landmark], path: Path
) -> tuple[Landmark, ...]:
    """Return the landmarks that were seen; raises `InputError` for one without a place."""
    for sighting in sightings:
        if landmarks[sighting.landmark].place is None:
            where = f"{path.name}: line {sighting.line}"
            got = f"landmark {sighting.landmark!r}, whose place the table of landmarks leaves empty"
            raise InputError(where, got=got, wanted="x_m, y_m, z_m of it")
    names = {s.landmark for s in sightings}
    return tuple(landmark for name, landmark in landmarks.items() if name in names)


def require_lens(stations: Mapping[str, Station], rig: Rig) -> None:
    """Raise `InputError` where a station that was used has no lens."""
    for name, station in stations.items():
        if "lens" not in station.known:
            wanted = "its lens (groundstation calibrate intrinsics)"
            raise InputError(f"{rig.path or 'rig'}: station {name}", got="no focal_px", wanted=wanted)


def prior_covariance(rig: Rig, names: Sequence[str], words: Sequence[str]) -> ParameterCovariance:
    """Return the rig's joint covariance of stations, with parameters that are freed though known."""
    known = rig.calibration_covariance()
    keep = []
    for k, name in enumerate(known.names):
        owner, _, short = name.partition(".")
        # clocks, shutters and the DGPS, which a flight has found: landmarks do not show them
        if short not in CALIBRATION_PARAMETERS:
            continue
        unknown = "position" not in rig[owner].known and short.startswith("ptu_position")
        if owner in names and not unknown and not short.startswith("runway_from_base"):
            keep.append(k)
    found = [known.names[k] for k in keep]
    matrix = known.matrix[np.ix_(keep, keep)]
    more: dict[str, float] = {}
    for name in names:
        station = rig[name]
        if "position" in words and "position" in station.known:
            more.update({f"{name}.ptu_position.{axis}": KNOWN_POSITION_M for axis in AXES})
        if "boresight" in words:
            more.update({f"{name}.head_from_camera.{axis}": KNOWN_ROTATION_RAD for axis in AXES})
        if "focal" in words:
            more.update({f"{name}.focal.{a}": KNOWN_FOCAL_SHARE * float(station.lens.focal_px[0]) for a in "xy"})
    more = {name: sigma for name, sigma in more.items() if name not in found}
    n, m = len(found), len(more)
    joint = np.zeros((n + m, n + m))
    joint[:n, :n] = matrix
    joint[n:, n:] = np.diag(np.square(list(more.values())))
    return ParameterCovariance(names=(*found, *more), matrix=joint)


def with_orientations(
    rig: Rig, names: Sequence[str], before: ParameterCovariance, heading_sigma_rad: float
) -> ParameterCovariance:
    """Return a prior with the stations' orientations as the rig states them, and a heading that all share.

    An orientation of which the rig states no covariance is as certain as a mount that settles.
    """
    known = rig.calibration_covariance()
    bases = [f"{name}.runway_from_base.{axis}" for name in names for axis in AXES]
    every = [*before.names, *bases]
    matrix = np.zeros((len(every), len(every)))
    stated = [k for k, name in enumerate(every) if name in known.names]
    rows = [known.names.index(every[k]) for k in stated]
    matrix[np.ix_(stated, stated)] = known.matrix[np.ix_(rows, rows)]
    n = len(before.names)
    matrix[:n, :n] = before.matrix
    matrix += floors(every) * np.array([name in bases for name in every])
    heading = np.array([name.endswith("runway_from_base.z") for name in every], dtype=np.float64)
    matrix += heading_sigma_rad**2 * np.outer(heading, heading)
    return ParameterCovariance(names=tuple(every), matrix=matrix)


def station_observations(fit: LandmarkFit, name: str) -> list[tuple[LandmarkObservations, NDArray[np.int64]]]:
    """Return a station's observations with the numbers (n,) of their rows in the fit."""
    start, found = 0, []
    for observed in fit.problem.observations:
        if observed.station == name:
            found.append((observed, np.arange(start, start + len(observed), dtype=np.int64)))
        start += len(observed)
    return found


def inlier_landmarks(fit: LandmarkFit, name: str) -> list[str]:
    """Return the names of the landmarks that one station saw and that fit."""
    numbers = {
        int(k)
        for observed, rows in station_observations(fit, name)
        for k, kept in zip(observed.landmark, fit.kept[rows], strict=True)
        if kept
    }
    return [fit.problem.landmarks[k].name for k in sorted(numbers)]


def require_most_kept(fit: LandmarkFit, name: str) -> None:
    """Raise `LandmarkFitError` where more landmarks of a station do not fit than mistakes are likely."""
    seen = {s.landmark for observed, _ in station_observations(fit, name) for s in observed.sightings}
    out = sorted(seen - set(inlier_landmarks(fit, name)))
    if len(out) > max(1, len(seen) // 4):
        got = f"{len(out)} of {len(seen)} landmarks that contradict each other ({', '.join(out[:8])})"
        wanted = "right coordinates, and a lens, a camera's mount (--free boresight) and angles that are right"
        raise LandmarkFitError(f"station {name}: got {got}; wanted {wanted}")


def require_determined(fit: LandmarkFit, stations: Mapping[str, Station]) -> None:
    """Raise `LandmarkFitError` where a pose is not determined, or sightings contradict each other."""
    for name, station in stations.items():
        kept = inlier_landmarks(fit, name)
        require_most_kept(fit, name)
        least = 2 if "position" in station.known else 3
        if len(kept) < least:
            left = ", ".join(fit.rejected_landmarks) or "single sightings"
            got = f"landmarks that contradict each other: {len(kept)} left without {left}"
            raise LandmarkFitError(f"station {name}: got {got}; wanted right coordinates, and more landmarks to tell")
        groups = [("runway_from_base", _WORST_ROTATION_RAD), ("ptu_position", _WORST_POSITION_M)]
        for group, worst in groups:
            own = [f"{name}.{group}.{axis}" for axis in AXES]
            if not set(own) <= set(fit.problem.names):
                continue
            sigma = float(np.sqrt(np.linalg.eigvalsh(_apart_from_boresight(fit, name, own))[-1]))
            if sigma > worst:
                text = f"± {np.degrees(sigma):.2g}°" if group == "runway_from_base" else f"± {sigma:.2g} m"
                part = "orientation" if group == "runway_from_base" else "position"
                got = f"an {part} of {text}" if part == "orientation" else f"a {part} of {text}"
                wanted = "landmarks in more directions and at other distances"
                wanted += "" if "position" in station.known else ", or a surveyed position of the station"
                raise LandmarkFitError(f"station {name}: got {got} from {', '.join(kept)}; wanted {wanted}")
    if fit.raised > _WORST_MISFIT:
        got = f"sightings that fit {fit.raised:.0f} times worse than their noise"
        raise LandmarkFitError(f"sightings: got {got}; wanted this rig's lenses, angles and landmarks")


def _apart_from_boresight(fit: LandmarkFit, station: str, names: Sequence[str]) -> FloatArray:
    """Return the covariance of parameters with the boresight fixed: base and boresight may be equivalent."""
    held = [fit.problem.names[k] for k in fit.problem.places(f"{station}.head_from_camera")]
    block = fit.block(names)
    if not held:
        return block
    joint = fit.block([*names, *held])
    n = len(names)
    across = joint[:n, n:]
    return np.asarray(block - across @ np.linalg.pinv(joint[n:, n:], hermitian=True) @ across.T)


def _solved(rig: Rig, started: Mapping[str, Station], fit: LandmarkFit) -> Rig:
    """Return the rig with every pose that was found and the joint covariance, not below the floors."""
    stations = []
    for station in rig.stations:
        if station.name not in started:
            stations.append(station)
            continue
        change = fit.problem.station_change(fit.change, station.name, today=False)
        known = tuple(p for p in PARTS if p in (*station.known, "position", "orientation"))
        stations.append(replace(started[station.name].changed(change), known=known))
    names = [name for name in fit.problem.names if not name.startswith("landmark ")]
    return with_covariance(
        replace(rig, stations=tuple(stations)),
        ParameterCovariance(names=tuple(names), matrix=fit.block(names) + floors(names)),
    )


def floors(names: Sequence[str]) -> FloatArray:
    """Return the least covariance (n, n): a mount settles and gears play, which one survey does not show."""
    least = {"runway_from_base": FLOOR_ROTATION_RAD, "ptu_position": FLOOR_POSITION_M}
    return np.diag([least.get(name.split(".")[1], 0.0) ** 2 for name in names])
