"""One head's night: pictures solved, wrong solutions left out, stars identified, lens, mount and axes fitted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

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
WORDS = ("mount", "scale", "lean", "backlash", "periodic", "lens")
# of a star that is expected: encoder and fit together, sigmas
_RADIUS_SIGMAS = 5.0
_LEAST_RADIUS_PX, _MOST_RADIUS_PX = 3.0, 30.0
_ROUNDS = 2
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
    """

    before: Station
    fit: MountFit
    pictures: tuple[IdentifiedPicture, ...]
    unused: tuple[str, ...]
    wrongly_solved: int


def night_priors(station: Station, marks: Sequence[Mark], words: Sequence[str]) -> dict[str, float]:
    """Return names and prior sigmas of the parameters that ``words`` (of `WORDS`) leave open, and those of the sky."""
    chosen: dict[str, float] = {}
    if "mount" in words:
        chosen.update(dict.fromkeys(BORESIGHT, PRIOR_BORESIGHT_RAD))
        chosen.update(dict.fromkeys(BASE, PRIOR_BASE_RAD))
    if "scale" in words:
        chosen.update({"pan_scale": PRIOR_SCALE, "tilt_scale": PRIOR_SCALE})
    if "lean" in words:
        chosen["lean"] = PRIOR_LEAN_RAD
    if "backlash" in words:
        chosen.update({"pan_backlash": PRIOR_BACKLASH_RAD, "tilt_backlash": PRIOR_BACKLASH_RAD})
    if "periodic" in words:
        chosen.update(dict.fromkeys(PERIODIC_AXES, PRIOR_PERIODIC_RAD))
    if "lens" in words:
        focal = PRIOR_FOCAL_SHARE * float(station.lens.focal_px.mean())
        centre = PRIOR_PRINCIPAL_POINT_SHARE * station.lens.image_size_px[0]
        chosen.update({f"focal.{axis}": focal for axis in "xy"})
        chosen.update({f"principal_point.{axis}": centre for axis in "xy"})
        chosen.update({f"distortion.{name}": sigma for name, sigma in PRIOR_DISTORTION.items()})
    for mark in marks:
        chosen.update({name: float(s) for name, s in zip(mark.names, mark.sigma[:2], strict=True) if s > 0.0})
    return chosen


def fit_station(
    station: Station,
    pictures: Sequence[StarPicture],
    solver: StarSolver,
    sky: SkyOverSite,
    uncertain: SkyUncertainty,
    words: Sequence[str] = WORDS,
    progress: Callable[[], None] = lambda: None,
) -> StationNight:
    """Calibrate one head by its pictures; raises `StarFitError` where they do not determine it."""
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
        first = next(iter(reasons.items()), None)
        raise StarFitError(f"{fault}" + (f"; {first[0]}: {first[1]}" if first is not None else "")) from fault
    found = [by_solver(p, s, sky) for (p, s), agrees in zip(solved, start.agrees, strict=True) if agrees]
    fit = _fit(start.station, found, sky, uncertain, words)
    for _ in range(_ROUNDS):
        progress()
        at = fit.problem.station_at(fit.change)
        radius = _radius_px(at, fit)
        before = {one.picture.label: one for one in found}
        again = [by_station(p, at, solver, sky, radius, before.get(p.label)) for p in pictures]
        found = [one for one in again if one is not None]
        fit = _fit(start.station, found, sky, uncertain, words)
    if fit.noise_factor > _WORST_NOISE_FACTOR:
        got = f"stars that fit to {fit.rms_px:.1f} px only"
        wanted = "a camera that is fixed to its head, and the angles and times at which the pictures were taken"
        raise StarFitError(f"station {station.name}: got {got}; wanted {wanted}")
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
    )


def _fit(
    start: Station,
    found: Sequence[IdentifiedPicture],
    sky: SkyOverSite,
    uncertain: SkyUncertainty,
    words: Sequence[str],
) -> MountFit:
    if not found:
        raise StarFitError(f"station {start.name}: got no picture whose stars agree; wanted three or more")
    seen, marks = sightings_of(found, sky, uncertain)
    chosen = night_priors(start, marks, words)
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
    return replace(station, ptu_axes=axes, known=ordered)
