"""Relative direction of two calibrated cameras: base and boresight together, then lens and position with them."""

from dataclasses import dataclass

import numpy as np

from calibration.flight.fit import FlightFit
from groundstation.geometry.aim import aim_at
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.rig import Rig, Station

# parameters that rotate the optical axis, and those that move its pixel
ROTATIONS = ("runway_from_base", "head_from_camera")
_LENS = ("focal", "principal_point", "distortion")
GROUPS = {
    "base and boresight": ROTATIONS,
    "and lens": (*ROTATIONS, *_LENS),
    "and position": (*ROTATIONS, *_LENS, "ptu_position"),
}
_STEP = 1e-6
_LENS_STEP = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointingErrors:
    """Pointing errors of the cameras, and their covariance.

    ``error`` (p, 4) rad at each of p points: pan of the first less that of the second (times the cosine of tilt), the
    same of tilt, and each one's own tilt; ``covariance`` (p, 4, 4).
    """

    error: np.ndarray
    covariance: np.ndarray

    def together(self) -> float:
        """Return eᵀC⁻¹e of relative pan and tilt at the middle one of the points."""
        k = len(self.error) // 2
        off = self.error[k, :2]
        return float(off @ np.linalg.solve(self.covariance[k, :2, :2], off))


def pointing_errors(fit: FlightFit, rig: Rig, error: np.ndarray, points_m: np.ndarray) -> dict[str, PointingErrors]:
    """Return, by group of parameters, the pointing error of a rig's first two cameras at points (p, 3).

    ``error`` (q,) is that of the fit's parameters, small enough for first derivatives.
    """
    names = fit.problem.names
    found = {}
    for label, groups in GROUPS.items():
        rows = []
        for point in points_m:
            first, second = (_by_parameters(rig[name], point, names, groups) for name in rig.names[:2])
            rows.append(np.vstack([first - second, first[1], second[1]]))
        by = np.array(rows)
        found[label] = PointingErrors(error=by @ error, covariance=by @ fit.covariance @ np.swapaxes(by, 1, 2))
    return found


def _by_parameters(station: Station, point: np.ndarray, names: tuple[str, ...], groups: tuple[str, ...]) -> np.ndarray:
    """Return ∂(pan, tilt) (2, q) of the observed direction, at a point's distance, in the pixel of the point."""
    aim = aim_at(station.geometry(), point)
    if aim is None:
        raise ValueError(f"got a point {point} that {station.name} cannot look at")
    u, v = station.lens.principal_point_px

    origin = station.geometry().ray(float(u), float(v), aim.pan_rad, aim.tilt_rad).origin_runway_m
    away_m = float(np.linalg.norm(point - origin))

    def bearing(change: np.ndarray) -> np.ndarray:
        ray = station.changed(change).geometry().ray(float(u), float(v), aim.pan_rad, aim.tilt_rad)
        x, y, z = (ray.origin_runway_m - origin) / away_m + ray.direction_runway
        return np.array([np.arctan2(-x, y) * np.hypot(x, y), np.arctan2(z, np.hypot(x, y))])

    by = np.zeros((2, len(names)))
    for k, name in enumerate(names):
        owner, _, short = name.partition(".")
        group = short.partition(".")[0]
        if owner == station.name and group in groups:
            step = np.zeros(len(CALIBRATION_PARAMETERS))
            size = _STEP if group in ROTATIONS else _LENS_STEP
            step[CALIBRATION_PARAMETERS.index(short)] = size
            by[:, k] = (bearing(step) - bearing(-step)) / (2.0 * size)
    return by
