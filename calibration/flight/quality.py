"""Quality of a flight's calibration: one sigma of a fix along, across and up, next to the fix's own noise."""

from dataclasses import dataclass

import numpy as np

from calibration.flight.fit import FlightFit
from calibration.flight.problem import DGPS_OFFSET
from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, project_with_calibration
from groundstation.rig.rig import Rig

RANGES_M = (100.0, 200.0, 400.0)
_SHARES = (0.05, 0.35, 0.65, 0.95)
_AXES_LEAST = 1e-9
# px; no label is worse than that
_LABELLED = 3.0
# within such a share of a range, the aircraft was there
_THERE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeQuality:
    """One fix at a distance.

    Attributes
    ----------
    range_m : from the middle of the stations.
    calibration_m, noise_m : (3,) one sigma along, across and up: of the remaining calibration error, and of one
        fix by pixels and encoders.
    flown : whether the aircraft was there; otherwise it is a point beyond, in the direction of the flight.
    """

    range_m: float
    calibration_m: FloatArray
    noise_m: FloatArray
    flown: bool

    @property
    def good(self) -> bool:
        """Whether the calibration is off by no more than one fix's own noise, in every direction."""
        return bool(np.all(self.calibration_m <= self.noise_m))


def range_qualities(after: Rig, fit: FlightFit) -> list[RangeQuality]:
    """Return the quality of a fix at 100, 200 and 400 m for stations with PTUs, otherwise at the ranges flown."""
    problem = fit.problem
    if len(problem.stations) < 2:
        return []
    t = np.sort(np.concatenate([observed.t_s for observed in problem.observations.values()]))
    middle = np.mean([s.ptu_position_m for s in after.stations], axis=0)
    instants = np.quantile(t, np.linspace(0.0, 1.0, 101)) + problem.value(fit.change, DGPS_OFFSET)
    points = problem.track.at(instants)
    flown, velocity = points.position_m[points.usable], points.velocity_m_s[points.usable]
    if not len(flown):
        return []
    away = np.linalg.norm(flown - middle, axis=1)
    if any(s.fixed for s in after.stations):
        order = np.argsort(away)
        chosen = [int(order[int(share * (len(away) - 1))]) for share in _SHARES]
        ranges = [float(away[k]) for k in chosen]
    else:
        ranges = list(RANGES_M)
        chosen = [int(np.argmin(np.abs(away - r))) for r in ranges]
    found = []
    for k, range_m in zip(chosen, ranges, strict=True):
        # where there was no flight, a point beyond the nearest that was
        place = _FixPlace(
            point_m=middle + (flown[k] - middle) * (range_m / away[k]),
            velocity_m_s=velocity[k],
            middle_m=middle,
            flown=bool(abs(away[k] - range_m) < _THERE * range_m),
        )
        found.append(_quality(after, fit, place))
    return sorted((q for q in found if q is not None), key=lambda q: q.range_m)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FixPlace:
    point_m: FloatArray
    velocity_m_s: FloatArray
    middle_m: FloatArray
    flown: bool


def _quality(after: Rig, fit: FlightFit, at: _FixPlace) -> RangeQuality | None:
    point = at.point_m
    by_point, by_change, noise = [], [], []
    problem = fit.problem
    for name, station in fit.stations.items():
        rig, geometry, pan, tilt = after[name], after[name].geometry(), 0.0, 0.0
        if not rig.fixed:
            aim = aim_at(geometry, point)
            if aim is None:
                continue
            pan, tilt = aim.pan_rad, aim.tilt_rad
        seen = project_with_calibration(geometry, point, pan, tilt)
        if seen is None or not geometry.contains(seen.pixel):
            continue
        # a head that holds the aircraft turns with it: there only its own clock shows, on a tripod only the camera's
        clock = "camera_clock.offset" if rig.fixed else "ptu_clock.offset"
        columns = np.zeros((2, len(problem.names)))
        for place, short in problem.own(name):
            if short in CALIBRATION_PARAMETERS:
                columns[:, place] = seen.calibration_jacobian[:, CALIBRATION_PARAMETERS.index(short)]
            elif short == clock:
                columns[:, place] = seen.jacobian[:, :3] @ at.velocity_m_s
        by_angle = seen.jacobian[:, 3:]
        # a misfit is no noise: what does not fit makes no calibration good enough
        usual = float(np.median(problem.observations[name].sigma_px))
        pixel = usual * min(station.noise_factor, 1.0 if problem.observations[name].sigma_given else _LABELLED / usual)
        noise.append(pixel**2 * np.eye(2) + rig.angle_sigma_rad**2 * by_angle @ by_angle.T)
        by_point.append(seen.jacobian[:, :3])
        by_change.append(columns)
    if len(by_point) < 2:
        return None
    weight = [np.linalg.inv(n) for n in noise]
    information = sum(j.T @ w @ j for j, w in zip(by_point, weight, strict=True))
    fix = np.linalg.inv(np.asarray(information))
    pull = sum(j.T @ w @ c for j, w, c in zip(by_point, weight, by_change, strict=True))
    gain = fix @ np.asarray(pull)
    axes = _axes(point - at.middle_m)
    return RangeQuality(
        range_m=float(np.linalg.norm(point - at.middle_m)),
        calibration_m=np.sqrt(np.diag(axes @ gain @ fit.covariance @ gain.T @ axes.T)),
        noise_m=np.sqrt(np.diag(axes @ fix @ axes.T)),
        flown=at.flown,
    )


def _axes(towards: FloatArray) -> FloatArray:
    """Return rows (3, 3): along the ground towards the point, across to the right, up."""
    level = float(np.hypot(towards[0], towards[1]))
    along = np.array([towards[0], towards[1], 0.0]) / level if level > _AXES_LEAST else np.array([0.0, 1.0, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return np.stack([along, np.cross(along, up), up])
