"""One head's night: pictures solved, wrong solutions left out, stars identified, lens, mount and axes fitted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from calibration.landmarks.angles import reading_variances
from calibration.mount.covariance import BASE, BORESIGHT
from calibration.mount.fit import MountFit, MountFitError, solve_mount
from calibration.mount.problem import PERIODIC_AXES, Mark, MountProblem
from calibration.stars.head_start import StarFitError, head_start
from calibration.stars.identified_stars import (
    IdentifiedPicture,
    SkyUncertainty,
    by_solver,
    by_station,
    sightings_of,
)
from calibration.stars.night import StarPicture
from calibration.stars.plausibility import require_night, require_plausible
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_solver import SolvedPicture, StarSolver
from groundstation.rig.rig import Station

# one sigma a priori: what a maker and a mount by eye leave open. A night says more of each, or leaves it so
PRIOR_BORESIGHT_RAD = float(np.radians(3.0))
PRIOR_BASE_RAD = float(np.radians(20.0))
PRIOR_SCALE = 0.01
PRIOR_LEAN_RAD = float(np.radians(0.3))
PRIOR_BACKLASH_RAD = float(np.radians(0.1))
PRIOR_PERIODIC_RAD = float(np.radians(0.02))
PRIOR_FOCAL_SHARE = 0.05
PRIOR_PRINCIPAL_POINT_SHARE = 0.03
PRIOR_DISTORTION = {"k1": 0.3, "k2": 1.0, "p1": 0.003, "p2": 0.003}
# of a star that is expected: encoder and fit together, sigmas
_RADIUS_SIGMAS = 5.0
_LEAST_RADIUS_PX, _MOST_RADIUS_PX = 3.0, 30.0
_ROUNDS = 2
# a night in fifty is called noisier than the rig says though it is not
_CHANCE = 0.98
# residuals of so many sigmas are no noise
_WORST_NOISE_FACTOR = 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationNight:
    """One station's result.

    Attributes
    ----------
    before : as the rig has it. fit : of this station alone, its problem starting from the solved pictures.
    pictures : those used, with their stars.
    unused : the other pictures, each with the reason.
    wrongly_solved : how many pictures the solver had an attitude for that the angles exclude.
    reading_factor : by how much readings repeat worse than the rig says; the sigmas are those with that.
    """

    before: Station
    fit: MountFit
    pictures: tuple[IdentifiedPicture, ...]
    unused: tuple[str, ...]
    wrongly_solved: int
    reading_factor: float


def night_priors(station: Station, marks: Sequence[Mark]) -> dict[str, float]:
    """Return names and prior sigmas of the parameters that a night finds, and those of the sky."""
    focal = PRIOR_FOCAL_SHARE * float(station.lens.focal_px.mean())
    centre = PRIOR_PRINCIPAL_POINT_SHARE * station.lens.image_size_px[0]
    chosen: dict[str, float] = {
        **dict.fromkeys(BORESIGHT, PRIOR_BORESIGHT_RAD),
        **dict.fromkeys(BASE, PRIOR_BASE_RAD),
        "pan_scale": PRIOR_SCALE,
        "tilt_scale": PRIOR_SCALE,
        "lean": PRIOR_LEAN_RAD,
        "pan_backlash": PRIOR_BACKLASH_RAD,
        "tilt_backlash": PRIOR_BACKLASH_RAD,
        **dict.fromkeys(PERIODIC_AXES, PRIOR_PERIODIC_RAD),
        **{f"focal.{axis}": focal for axis in "xy"},
        **{f"principal_point.{axis}": centre for axis in "xy"},
        **{f"distortion.{name}": sigma for name, sigma in PRIOR_DISTORTION.items()},
    }
    for mark in marks:
        chosen.update({name: float(s) for name, s in zip(mark.names, mark.sigma[:2], strict=True) if s > 0.0})
    return chosen


def fit_station(
    station: Station,
    pictures: Sequence[StarPicture],
    solver: StarSolver,
    sky: SkyOverSite,
    uncertain: SkyUncertainty,
    progress: Callable[[], None] = lambda: None,
) -> StationNight:
    """Calibrate one head by its pictures; raises `StarFitError` where they do not determine it."""
    require_night(station.name, pictures, sky)
    solved: list[tuple[StarPicture, SolvedPicture]] = []
    reasons: dict[str, str] = {}
    for picture in pictures:
        progress()
        one = solver.solve(picture.seen)
        if isinstance(one, str):
            reasons[picture.label] = one
        else:
            solved.append((picture, one))
    attitudes = [sky.icrs_from_runway(p.utc_s).T @ s.camera_from_icrs.T for p, s in solved]
    try:
        start = head_start(station, [p for p, _ in solved], attitudes)
    except StarFitError as fault:
        first = next(iter(reasons.items()), None) if len(solved) < len(reasons) else None
        raise StarFitError(f"{fault}" + (f"; {first[0]}: {first[1]}" if first is not None else "")) from fault
    found = [by_solver(p, s, sky) for (p, s), agrees in zip(solved, start.agrees, strict=True) if agrees]
    fit = _fit(start.station, found, sky, uncertain)
    for _ in range(_ROUNDS):
        progress()
        at = fit.problem.station_at(fit.change)
        radius = _radius_px(at, fit)
        before = {one.picture.label: one for one in found}
        again = [by_station(p, at, solver, sky, radius, before.get(p.label)) for p in pictures]
        found = [one for one in again if one is not None]
        fit = _fit(start.station, found, sky, uncertain)
    # readings that repeat worse than the rig says: all of a picture's stars share that, and hide it among their number
    reading = reading_factor(fit)
    if reading > 1.0:
        worse = replace(start.station, ptu_sigma_rad=reading * start.station.angle_sigma_rad)
        fit = _fit(worse, [_read_once(one) for one in found], sky, uncertain)
    if fit.noise_factor > _WORST_NOISE_FACTOR:
        got = f"stars that fit to {fit.rms_px:.1f} px only"
        wanted = "a camera that is fixed to its head, and the angles and times at which the pictures were taken"
        raise StarFitError(f"station {station.name}: got {got}; wanted {wanted}")
    require_plausible(station.name, fit)
    used = {one.picture.label for one in found}
    return StationNight(
        before=station,
        fit=fit,
        pictures=tuple(found),
        unused=tuple(
            f"{p.label}: {reasons.get(p.label, 'its stars are not where the others say')}"
            for p in pictures
            if p.label not in used
        ),
        wrongly_solved=int(np.count_nonzero(~start.agrees)),
        reading_factor=reading,
    )


def reading_factor(fit: MountFit) -> float:
    """Return by how much readings repeat worse than the rig says; 1 where chance explains what they do.

    From what the stars of each picture have in common, two angles a picture, against the variance that readings and
    stars give it, less what the mount's parameters have taken up.
    """
    seen = fit.problem.sightings
    sought = fit.problem.predict(fit.change)
    lasting, fleeting = reading_variances(fit.problem.station)
    total, count = 0.0, 0
    for number in np.unique(seen.pointing[fit.kept]):
        rows = np.flatnonzero(fit.kept & (seen.pointing == number))
        by_angle = sought.by_angle[rows].reshape(-1, 2)
        weight = np.repeat(seen.sigma_px[rows] ** -2.0, 2)
        known = by_angle.T @ (weight[:, None] * by_angle)
        angle = np.linalg.solve(known, by_angle.T @ (weight * fit.residual_px[rows].ravel()))
        share = 1.0 if seen.readings is None else float(seen.readings[rows[0]])
        covariance = np.linalg.inv(known) * fit.noise_factor**2 + (lasting + fleeting / share) * np.eye(2)
        total += float(angle @ np.linalg.solve(covariance, angle))
        count += 2
    sigma = np.sqrt(np.diag(fit.covariance))
    taken = sum(
        1.0 - min(1.0, float(s / p)) ** 2
        for n, s, p in zip(fit.problem.names, sigma, fit.problem.prior_sigma, strict=True)
        if not n.startswith(("focal", "principal_point", "distortion", "mark "))
    )
    freedom = max(count - taken, 1.0)
    if total <= float(chi2.ppf(_CHANCE, freedom)):
        return 1.0
    return float(np.sqrt(total / freedom))


def _read_once(one: IdentifiedPicture) -> IdentifiedPicture:
    """Return a picture whose angles' error does not average out."""
    return replace(one, picture=replace(one.picture, readings=1))


def _fit(
    start: Station,
    found: Sequence[IdentifiedPicture],
    sky: SkyOverSite,
    uncertain: SkyUncertainty,
) -> MountFit:
    if not found:
        raise StarFitError(f"station {start.name}: got no picture whose stars agree; wanted three or more")
    seen, marks = sightings_of(found, sky, uncertain)
    chosen = night_priors(start, marks)
    problem = MountProblem(
        station=start,
        sightings=seen,
        marks=marks,
        names=tuple(chosen),
        prior_sigma=np.array(list(chosen.values())),
    )
    try:
        return solve_mount(problem, np.zeros(len(chosen)), hold=False)
    except MountFitError as fault:
        raise StarFitError(str(fault)) from fault


def _radius_px(station: Station, fit: MountFit) -> float:
    """Return within how many pixels of its expected place a star is looked for."""
    encoder_px = station.angle_sigma_rad * float(station.lens.focal_px.max())
    radius = _RADIUS_SIGMAS * float(np.hypot(encoder_px, fit.rms_px))
    return float(np.clip(radius, _LEAST_RADIUS_PX, _MOST_RADIUS_PX))


def undetermined(night: StationNight, share: float = 0.5) -> tuple[str, ...]:
    """Return the parameters that this night tells less of than was known before: sigma over ``share`` of the prior."""
    problem = night.fit.problem
    sigma = np.sqrt(np.diag(night.fit.covariance))
    over = sigma > share * problem.prior_sigma
    return tuple(n for n, bad in zip(problem.names, over, strict=True) if bad and not n.startswith("mark "))


def with_change(night: StationNight, change: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Station:
    """Return the station of a night with a change (p,) of its problem's parameters; no backlash below zero."""
    station = night.fit.problem.station_at(change)
    axes = station.ptu_axes
    axes = replace(
        axes,
        pan_backlash_rad=max(axes.pan_backlash_rad, 0.0),
        tilt_backlash_rad=max(axes.tilt_backlash_rad, 0.0),
    )
    known = tuple(dict.fromkeys((*night.before.known, "orientation", "lens")))
    ordered = tuple(part for part in ("position", "orientation", "lens") if part in known)
    # what the encoder is said to be stays the rig's
    sigma = night.before.ptu_sigma_rad
    return replace(station, ptu_axes=axes, known=ordered, ptu_sigma_rad=sigma)
