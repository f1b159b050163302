"""Uncertainty of the direction of a calibrated camera, at the angles of operation."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.mount.covariance import BASE, BORESIGHT
from calibration.mount.fit import MountFit
from calibration.mount.problem import Mark, MarkKind, MountProblem, MountSightings
from groundstation.arrays import FloatArray

# worse than this is no calibration: 2.6 m along the runway at 400 m
USABLE_DEG = 0.01
_WORK_PAN_DEG, _WORK_TILT_DEG = (-30.0, 0.0, 30.0), (0.0, 7.5, 15.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingSigma:
    """One sigma of the camera's direction from its base, at the angles of operation: across, up and roll, degrees."""

    pan_deg: float
    tilt_deg: float
    roll_deg: float

    @property
    def worst_deg(self) -> float:
        """The larger of pan and tilt."""
        return max(self.pan_deg, self.tilt_deg)


def pointing_sigma(fit: MountFit, sightings_only: bool = False) -> PointingSigma:
    """Return the uncertainty of the direction of a mark in the middle of the picture, given true readings.

    Root mean square over pan −30 to 30° and tilt 0 to 15°; fixed parameters count with their assumed sigmas.
    ``sightings_only`` leaves out fixed lever arms and axes, which no number of such sightings would improve.
    """
    covariance = _given_held(fit) if sightings_only else fit.joint_covariance
    problem = replace(fit.problem, names=fit.joint_names, prior_sigma=np.zeros(len(fit.joint_names)))
    at = np.concatenate([fit.change, np.zeros(len(fit.joint_names) - len(fit.change))])
    station = problem.station_at(at)
    readings = np.radians([(pan, tilt) for pan in _WORK_PAN_DEG for tilt in _WORK_TILT_DEG])
    centre, focal = station.lens.principal_point_px, station.lens.focal_px
    side = np.array([0.25 * station.lens.image_size_px[0], 0.0])
    derivative = {}
    for offset in (0.0, 1.0):
        pixel = centre + offset * side
        geometry = station.geometry()
        marks = []
        for k, (pan, tilt) in enumerate(readings):
            angles = station.ptu_axes.angles(float(pan), float(tilt), 0.0, 0.0)
            unit = geometry.ray(float(pixel[0]), float(pixel[1]), *angles).direction_runway
            marks.append(
                Mark(
                    name=f"#{k}", kind=MarkKind.DIRECTION, place_m=unit, sigma=np.zeros(3), runway_from_board=np.eye(3)
                )
            )
        n = len(readings)
        seen = MountSightings(
            reading_rad=readings,
            sense=np.zeros((n, 2)),
            pixel_px=np.tile(pixel, (n, 1)),
            sigma_px=np.ones(n),
            pointing=np.arange(n),
            mark=np.arange(n),
            body_m=np.zeros((n, 3)),
            label=("",) * n,
        )
        derivative[offset] = _predicted(problem, seen, tuple(marks), at)
    roll = (derivative[1.0][:, 1] - derivative[0.0][:, 1]) / side[0]

    def sigma(by: FloatArray) -> float:
        variance = np.einsum("ni,ij,nj->n", by, covariance, by)
        return float(np.degrees(np.sqrt(np.mean(np.maximum(variance, 0.0)))))

    return PointingSigma(
        pan_deg=sigma(derivative[0.0][:, 0] / focal[0]),
        tilt_deg=sigma(derivative[0.0][:, 1] / focal[1]),
        roll_deg=sigma(roll),
    )


def _predicted(problem: MountProblem, seen: MountSightings, marks: tuple[Mark, ...], at: FloatArray) -> FloatArray:
    return replace(problem, sightings=seen, marks=marks).predict(at).jacobian


def _given_held(fit: MountFit) -> FloatArray:
    """Return the joint covariance if fixed parameters, except rotations, had exactly their assumed values."""
    whole = fit.joint_covariance
    given = [k for k, n in enumerate(fit.joint_names) if n in fit.held and n not in (*BORESIGHT, *BASE)]
    if not given:
        return whole
    across = whole[:, given]
    return np.asarray(whole - across @ np.linalg.solve(whole[np.ix_(given, given)], across.T))
