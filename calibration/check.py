"""`groundstation calibrate check`: whether mounts have moved since the rig was calibrated (derivation, section 17)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from calibration.joint_covariance import with_covariance
from calibration.landmark_fit import LandmarkFit, inverted, solve_landmarks
from calibration.landmark_looks import LandmarkLooks, gather_looks
from calibration.landmark_problem import AXES, MOVED_SIGMA_RAD, pose_problem
from calibration.landmark_rejection import LandmarkFitError
from calibration.rig_reach import moved_by_m
from calibration.sightings import Landmark, Sighting, require_consistent
from calibration.survey import floors, kept_landmarks, require_lens, seen_landmarks
from calibration.survey_start import ONE_BEARING_RAD
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig import Rig, Station
from groundstation.rig_covariance import ParameterCovariance

# over the whole rig, all stations and axes together
FALSE_ALARM = 0.01
POWER = 0.99
# further than this is another set-up, not a knock
MOST_MOVED_RAD = float(np.radians(3.0))
# whether the base or the camera has turned is not known: of what was found so much stays uncertain
_DOUBT = 0.1
_WORST_MISFIT = 5.0
EFFECT_RANGE_M = 400.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Movement:
    """By how much one station's base has turned.

    Attributes
    ----------
    turned_rad, sigma_rad : (3,) about the base's axes x (tilt), y (roll), z (pan).
    turned_runway_rad : (3,) the same rotation, runway frame.
    statistic, threshold : chi-square of three degrees of freedom, and what it exceeds by chance too rarely.
    detectable_rad : (3,) the turn about each axis that this check finds in 99 of 100 cases.
    landmarks : names of those that were used.
    """

    station: str
    turned_rad: FloatArray
    sigma_rad: FloatArray
    turned_runway_rad: FloatArray
    statistic: float
    threshold: float
    detectable_rad: FloatArray
    landmarks: tuple[str, ...]

    @property
    def moved(self) -> bool:
        """Whether chance does not explain it."""
        return self.statistic > self.threshold


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Check:
    """What a check has found; ``corrected`` is the rig itself where nothing has moved.

    ``along_m`` is how far a point at 400 m is put wrong along the runway by what has moved, None for one station.
    """

    rig: Rig
    movements: tuple[Movement, ...]
    unseen: tuple[str, ...]
    fit: LandmarkFit
    corrected: Rig
    along_m: Mapping[str, float | None]

    @property
    def moved(self) -> tuple[Movement, ...]:
        """Return what has moved."""
        return tuple(m for m in self.movements if m.moved)


def solve_check(
    rig: Rig,
    sightings: Sequence[Sighting],
    landmarks: Mapping[str, Landmark],
    reference: Sequence[Sighting] = (),
    path: Path = Path("sightings.csv"),
    reference_path: Path = Path("reference.csv"),
    false_alarm: float = FALSE_ALARM,
) -> Check:
    """Compare today's sightings with the rig, or with a ``reference`` table that was seen when it was calibrated.

    Raises `InputError` for a table at fault, `LandmarkFitError` where landmarks are too few or contradict each other.
    """
    require_consistent(sightings, landmarks, rig.names, path)
    require_consistent(reference, landmarks, rig.names, reference_path)
    rig.require_known()
    seen = seen_landmarks([*sightings, *reference], landmarks, path)
    places = {landmark.name: k for k, landmark in enumerate(seen)}
    names = [s.name for s in rig.stations if any(k.station == s.name for k in sightings)]
    stations = {name: rig[name] for name in names}
    require_lens(stations, rig)
    today = [gather_looks(sightings, stations[name], places, today=True) for name in names]
    for looks in today:
        _require_two(looks, seen, stations[looks.station])
    then = [gather_looks(reference, station, places) for station in stations.values()]
    then = [looks for looks in then if len(looks)]
    # what the rig says of an orientation may come from these very sightings: it is found anew from them
    free = [f"{looks.station}.runway_from_base.{axis}" for looks in then for axis in AXES]
    problem = pose_problem(stations, [*today, *then], seen, free, rig.calibration_covariance(), moved=names)
    fit = solve_landmarks(problem)
    _require_fit(fit, names)
    movements = tuple(_movement(fit, stations[name], false_alarm / len(names)) for name in names)
    found = [m for m in movements if m.moved]
    return Check(
        rig=rig,
        movements=movements,
        unseen=tuple(name for name in rig.names if name not in names),
        fit=fit,
        corrected=_corrected(rig, fit, found, {looks.station for looks in then}),
        along_m={m.station: _along_m(rig, m) for m in movements},
    )


def _require_two(looks: LandmarkLooks, landmarks: Sequence[Landmark], station: Station) -> None:
    """Raise `LandmarkFitError` for landmarks in less than two directions."""
    numbers = np.unique(looks.landmark)
    towards = []
    for k in numbers:
        place = landmarks[k].place
        if place is not None:
            away = place if landmarks[k].kind == "direction" else place - station.ptu_position_m
            towards.append(away / max(float(np.linalg.norm(away)), 1e-9))
    apart = max((float(np.linalg.norm(np.cross(a, towards[0]))) for a in towards), default=0.0)
    if len(numbers) < 2 or apart < ONE_BEARING_RAD:
        got = "one landmark" if len(numbers) < 2 else f"{len(numbers)} landmarks along one bearing"
        raise LandmarkFitError(f"station {looks.station}: got {got}; wanted two or more, in different directions")


def _require_fit(fit: LandmarkFit, names: Sequence[str]) -> None:
    """Raise `LandmarkFitError` where what was seen contradicts itself."""
    for name in names:
        kept = kept_landmarks(fit, name)
        if len(kept) < 2:
            got = f"landmarks that contradict each other, {len(kept)} left"
            wanted = "the landmarks that the table names, and three or more to tell which is wrong"
            raise LandmarkFitError(f"station {name}: got {got}; wanted {wanted}")
        turned = fit.change[fit.problem.places(f"{name}.moved")]
        if float(np.linalg.norm(turned)) > MOST_MOVED_RAD:
            got = f"a mount that has turned by {np.degrees(np.linalg.norm(turned)):.1f}°"
            raise LandmarkFitError(f"station {name}: got {got}; wanted a new survey (groundstation calibrate survey)")
    if fit.raised > _WORST_MISFIT:
        got = f"sightings that fit {fit.raised:.0f} times worse than their noise, however the mounts have turned"
        raise LandmarkFitError(f"sightings: got {got}; wanted this rig's lenses and angles, and landmarks that stand")


def _movement(fit: LandmarkFit, station: Station, false_alarm: float) -> Movement:
    """Test whether one station's base has turned: what the looks alone know of the turn, all else being uncertain."""
    problem = fit.problem
    places = problem.places(f"{station.name}.moved")
    unknowns = [int(np.flatnonzero(problem.spread[k])[0]) for k in places]
    rest = [k for k in range(len(fit.unknowns)) if k not in unknowns]
    across = fit.information[np.ix_(unknowns, rest)]
    marginal = (
        fit.information[np.ix_(unknowns, unknowns)] - across @ inverted(fit.information[np.ix_(rest, rest)]) @ across.T
    )
    # what was known of the turn before, which is no evidence, is taken out again
    by_looks = (marginal - np.eye(3)) / MOVED_SIGMA_RAD**2 / fit.raised**2
    runway_from_base = matrix_from_wxyz(station.runway_from_base_wxyz)
    by_looks = runway_from_base.T @ by_looks @ runway_from_base
    turned = runway_from_base.T @ fit.change[places]
    covariance = runway_from_base.T @ fit.covariance[np.ix_(places, places)] @ runway_from_base
    threshold = float(chi2.ppf(1.0 - false_alarm, 3))
    distance = float(brentq(lambda d: ncx2.sf(threshold, 3, d) - POWER, 1e-3, 1e3))
    return Movement(
        station=station.name,
        turned_rad=turned,
        sigma_rad=np.sqrt(np.diag(covariance)),
        turned_runway_rad=fit.change[places],
        statistic=float(turned @ by_looks @ turned),
        threshold=threshold,
        detectable_rad=np.sqrt(distance / np.maximum(np.diag(by_looks), 1e-30)),
        landmarks=tuple(kept_landmarks(fit, station.name)),
    )


def _along_m(rig: Rig, movement: Movement) -> float | None:
    moved = moved_by_m(rig, {movement.station: movement.turned_runway_rad}, EFFECT_RANGE_M)
    return None if moved is None else abs(float(moved[1]))


def _corrected(rig: Rig, fit: LandmarkFit, moved: Sequence[Movement], referred: set[str]) -> Rig:
    """Return the rig with the stations that have moved as they stand today, and a covariance that has grown."""
    rig = _replaced(rig, fit, [m for m in moved if m.station not in referred])
    return _turned(rig, fit, [m for m in moved if m.station in referred])


def _turned(rig: Rig, fit: LandmarkFit, moved: Sequence[Movement]) -> Rig:
    """Return the rig turned by what was found against a reference; what the turn is uncertain by comes on top."""
    if not moved:
        return rig
    before = rig.calibration_covariance()
    turned = [f"{m.station}.runway_from_base.{axis}" for m in moved for axis in AXES]
    names = (*before.names, *(name for name in turned if name not in before.names))
    matrix = np.zeros((len(names), len(names)))
    matrix[: len(before.names), : len(before.names)] = before.matrix
    places = [names.index(name) for name in turned]
    by = [k for m in moved for k in fit.problem.places(f"{m.station}.moved")]
    doubt = np.diag([_doubt(m) for m in moved for _ in AXES])
    matrix[np.ix_(places, places)] += fit.covariance[np.ix_(by, by)] + doubt
    stations = list(rig.stations)
    for movement in moved:
        change = np.zeros(CALIBRATION_SIZE)
        change[0:3] = movement.turned_runway_rad
        stations = [s.changed(change) if s.name == movement.station else s for s in stations]
    return with_covariance(replace(rig, stations=tuple(stations)), ParameterCovariance(names=names, matrix=matrix))


def _replaced(rig: Rig, fit: LandmarkFit, moved: Sequence[Movement]) -> Rig:
    """Return the rig with stations as today's looks alone have them, within what the rig says of all but orientation."""
    if not moved:
        return rig
    problem = fit.problem
    stations = list(rig.stations)
    names: list[str] = []
    rows: list[FloatArray] = []
    doubt: list[float] = []
    for movement in moved:
        name = movement.station
        change = problem.station_change(fit.change, name, today=True)
        stations = [s.changed(change) if s.name == name else s for s in stations]
        turned = [f"{name}.runway_from_base.{axis}" for axis in AXES]
        own = [n for n in problem.names if n.startswith(f"{name}.") and not n.startswith(f"{name}.moved.")]
        for parameter in [*turned, *(n for n in own if n not in turned)]:
            row = np.zeros(len(problem.names))
            if parameter in problem.names:
                row[problem.names.index(parameter)] = 1.0
            if parameter in turned:
                row[problem.places(f"{name}.moved")[turned.index(parameter)]] = 1.0
            names.append(parameter)
            rows.append(row)
            doubt.append(_doubt(movement) if parameter in turned else 0.0)
    gather = np.array(rows)
    matrix = gather @ fit.covariance @ gather.T + np.diag(doubt) + floors(names)
    return with_covariance(
        replace(rig, stations=tuple(stations)), ParameterCovariance(names=tuple(names), matrix=matrix)
    )


def _doubt(movement: Movement) -> float:
    """Return the variance, rad², of not knowing whether the base has turned or the camera on its head."""
    return (_DOUBT * float(np.linalg.norm(movement.turned_rad))) ** 2
