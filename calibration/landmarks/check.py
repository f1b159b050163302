"""`groundstation calibrate check`: whether mounts have moved since (docs/derivation.md, section 17)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.stats import ncx2

from calibration.information import inverse_with_floor
from calibration.landmarks.angles import LandmarkObservations, gather_observations
from calibration.landmarks.check_correction import Turn, corrected_rig
from calibration.landmarks.fit import LandmarkFit, solve_landmarks
from calibration.landmarks.problem import AXES, MOVED_SIGMA_RAD, pose_problem
from calibration.landmarks.rejection import LandmarkFitError
from calibration.landmarks.survey import inlier_landmarks, require_lens, require_most_kept, seen_landmarks
from calibration.landmarks.survey_start import ONE_BEARING_RAD
from calibration.rig_reach import moved_by_m
from calibration.robust_fit import OUTLIER_SIGMA
from calibration.sightings import Landmark, LandmarkSighting, require_consistent
from groundstation.arrays import FloatArray
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import Rig, Station

# over the whole rig, all stations and axes together
FALSE_ALARM = 0.01
POWER = 0.99
# further than this is another set-up, not a knock
MOST_MOVED_RAD = float(np.radians(3.0))
# chi-square by which a slipped camera must fit better than a rotated base
_CLEARLY = 15.0
_WORST_MISFIT = 5.0
EFFECT_RANGE_M = 400.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationMovement:
    """Movement of one station's base, or of its camera on the head.

    Attributes
    ----------
    group : of the rotation that has changed, ``runway_from_base`` or ``head_from_camera``.
    turned_rad, sigma_rad : (3,) about the axes x (tilt), y (roll), z (pan) of the base, or of the head.
    change_rad : (3,) the same rotation in the frame of the group, runway or head.
    statistic, threshold : chi-square of three degrees of freedom, and its limit by the false alarm rate.
    detectable_rad : (3,) the rotation about each axis that this check detects in 99 of 100 cases.
    landmarks : names of the used ones.
    """

    station: str
    group: str
    turned_rad: FloatArray
    sigma_rad: FloatArray
    change_rad: FloatArray
    statistic: float
    threshold: float
    detectable_rad: FloatArray
    landmarks: tuple[str, ...]

    @property
    def moved(self) -> bool:
        """Whether chance does not explain it."""
        return self.statistic > self.threshold

    @property
    def names(self) -> tuple[str, ...]:
        """Names ``station.parameter`` of the rotation that has changed."""
        return tuple(f"{self.station}.{self.group}.{axis}" for axis in AXES)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Check:
    """The result of a check; ``corrected`` is the rig itself where nothing has moved.

    ``along_m`` is the resulting error along the runway of a point at 400 m, None for one station.
    """

    rig: Rig
    movements: tuple[StationMovement, ...]
    unseen: tuple[str, ...]
    fit: LandmarkFit
    corrected: Rig
    along_m: Mapping[str, float | None]

    @property
    def moved(self) -> tuple[StationMovement, ...]:
        """Return the stations that have moved."""
        return tuple(m for m in self.movements if m.moved)


def solve_check(
    rig: Rig,
    sightings: Sequence[LandmarkSighting],
    landmarks: Mapping[str, Landmark],
    reference: Sequence[LandmarkSighting] = (),
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
    today = [gather_observations(sightings, stations[name], places, today=True) for name in names]
    for observed in today:
        _require_two(observed, seen, stations[observed.station])
    then = [gather_observations(reference, station, places) for station in stations.values()]
    then = [observed for observed in then if len(observed)]
    # the rig's orientation may come from these very sightings: it is estimated from them again
    free = [f"{observed.station}.runway_from_base.{axis}" for observed in then for axis in AXES]
    before = rig.calibration_covariance()

    def solve(slipped: frozenset[str]) -> LandmarkFit:
        problem = pose_problem(stations, [*today, *then], seen, free, before, moved=names, slipped=slipped)
        return solve_landmarks(problem)

    fit = _best(solve, [s.name for s in stations.values() if not s.fixed])
    _require_fit(fit, names)
    movements = tuple(_movement(fit, stations[name], false_alarm / len(names)) for name in names)
    found = [m for m in movements if m.moved]
    return Check(
        rig=rig,
        movements=movements,
        unseen=tuple(name for name in rig.names if name not in names),
        fit=fit,
        corrected=corrected_rig(
            rig,
            fit,
            [Turn(station=m.station, names=m.names, change_rad=m.change_rad) for m in found],
            {observed.station for observed in then},
        ),
        along_m={m.station: _along_m(rig, m) for m in movements},
    )


def _best(solve: Callable[[frozenset[str]], LandmarkFit], turning: Sequence[str]) -> LandmarkFit:
    """Return the fit with bases that have turned; where that does not fit, with cameras slipped that explain it better.

    Raises `LandmarkFitError` where neither fits.
    """
    slipped: frozenset[str] = frozenset()
    best: LandmarkFit | None = None
    fault: LandmarkFitError | None = None
    try:
        best = solve(slipped)
    except LandmarkFitError as error:
        fault = error
    if best is not None and best.raised == 1.0 and best.kept.all():
        return best
    for name in turning:
        try:
            other = solve(slipped | {name})
        except LandmarkFitError:
            continue
        if best is None or _cost(other) < _cost(best) - _CLEARLY:
            best, slipped = other, slipped | {name}
    if best is None:
        raise fault or LandmarkFitError("sightings: got none that fits; wanted the landmarks that the table names")
    return best


def _cost(fit: LandmarkFit) -> float:
    """Return the sum of squares in sigmas; each omission counts as much as a sighting just within the limit."""
    known = fit.unknowns[fit.problem.known]
    return float((np.minimum(fit.length, OUTLIER_SIGMA) ** 2).sum() + known @ known)


def _require_two(observed: LandmarkObservations, landmarks: Sequence[Landmark], station: Station) -> None:
    """Raise `LandmarkFitError` for landmarks in less than two directions."""
    numbers = np.unique(observed.landmark)
    towards = []
    for k in numbers:
        place = landmarks[k].place
        if place is not None:
            away = place if landmarks[k].kind == "direction" else place - station.ptu_position_m
            towards.append(away / max(float(np.linalg.norm(away)), 1e-9))
    apart = max((float(np.linalg.norm(np.cross(a, towards[0]))) for a in towards), default=0.0)
    if len(numbers) < 2 or apart < ONE_BEARING_RAD:
        got = "one landmark" if len(numbers) < 2 else f"{len(numbers)} landmarks along one bearing"
        raise LandmarkFitError(f"station {observed.station}: got {got}; wanted two or more, in different directions")


def _require_fit(fit: LandmarkFit, names: Sequence[str]) -> None:
    """Raise `LandmarkFitError` where the observations contradict each other."""
    for name in names:
        require_most_kept(fit, name)
        kept = inlier_landmarks(fit, name)
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


def _movement(fit: LandmarkFit, station: Station, false_alarm: float) -> StationMovement:
    """Test whether one station has turned: the information of the observations alone, all else being uncertain."""
    problem = fit.problem
    places = problem.places(f"{station.name}.moved")
    unknowns = [int(np.flatnonzero(problem.spread[k])[0]) for k in places]
    rest = [k for k in range(len(fit.unknowns)) if k not in unknowns]
    across = fit.information[np.ix_(unknowns, rest)]
    marginal = (
        fit.information[np.ix_(unknowns, unknowns)]
        - across @ inverse_with_floor(fit.information[np.ix_(rest, rest)]) @ across.T
    )
    # the prior on the turn, which is no evidence, is removed again
    information = (marginal - np.eye(3)) / MOVED_SIGMA_RAD**2 / fit.raised**2
    slipped = station.name in problem.slipped
    # the base's own axes; the head's are those of its group already
    own = np.eye(3) if slipped else matrix_from_wxyz(station.runway_from_base_wxyz)
    information = own.T @ information @ own
    turned = own.T @ fit.change[places]
    covariance = own.T @ fit.covariance[np.ix_(places, places)] @ own
    threshold = float(chi_square_quantile(1.0 - false_alarm, 3))
    distance = float(brentq(lambda d: ncx2.sf(threshold, 3, d) - POWER, 1e-3, 1e3))
    return StationMovement(
        station=station.name,
        group="head_from_camera" if slipped else "runway_from_base",
        turned_rad=turned,
        sigma_rad=np.sqrt(np.diag(covariance)),
        change_rad=fit.change[places],
        statistic=float(turned @ information @ turned),
        threshold=threshold,
        detectable_rad=np.sqrt(distance / np.maximum(np.diag(information), 1e-30)),
        landmarks=tuple(inlier_landmarks(fit, station.name)),
    )


def _along_m(rig: Rig, movement: StationMovement) -> float | None:
    moved = moved_by_m(rig, movement.names, movement.change_rad, EFFECT_RANGE_M)
    return None if moved is None else abs(float(moved[1]))
