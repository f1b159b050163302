"""A calibration by stars against the truth of a drawn night: errors of directions, NEES of parameters."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.mount.covariance import BASE, BORESIGHT
from calibration.stars.calibrate import NightCalibration
from calibration.stars.operating_range import work_readings
from calibration.stars.simulated.night_draw import DrawnNight
from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import Station

_DISTORTION = ("k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NightScore:
    """Errors of one night.

    Attributes
    ----------
    relative_deg, common_deg : (n, 2) errors of pan and tilt of the first station less the second, and of their mean,
        at each pair of angles of operation.
    nees : of each station's parameters, over their number.
    """

    relative_deg: FloatArray
    common_deg: FloatArray
    nees: tuple[float, ...]


def score_night(found: NightCalibration, night: DrawnNight) -> NightScore:
    """Compare a calibration of two stations with the truth."""
    errors = [direction_errors_deg(found.rig[s.name], s) for s in night.true_rig.stations]
    return NightScore(
        relative_deg=errors[0] - errors[1],
        common_deg=0.5 * (errors[0] + errors[1]),
        nees=tuple(_nees(found, k, night) for k in range(len(found.joint.nights))),
    )


def direction_errors_deg(found: Station, true: Station) -> FloatArray:
    """Return the errors (n, 2) of pan and tilt of the picture's middle, degrees, over the angles of operation."""
    rows = []
    for reading in work_readings(true):
        a, b = (_direction(station, reading) for station in (found, true))
        pan = float(np.arctan2(b[0], b[1]) - np.arctan2(a[0], a[1]))
        # behind the head the angle jumps
        rows.append([(pan + np.pi) % (2.0 * np.pi) - np.pi, np.arcsin(a[2]) - np.arcsin(b[2])])
    return np.degrees(rows)


def _direction(station: Station, reading_rad: FloatArray) -> FloatArray:
    u, v = (0.5 * (np.array(station.lens.image_size_px) - 1.0)).tolist()
    angles = station.ptu_axes.angles(float(reading_rad[0]), float(reading_rad[1]), 0.0, 0.0)
    return station.geometry().ray(u, v, *angles).direction_runway


def _nees(found: NightCalibration, k: int, night: DrawnNight) -> float:
    fit, change = found.joint.nights[k].fit, found.joint.change[k]
    station, true = fit.problem.station_at(change), night.true_rig[found.joint.nights[k].before.name]
    error = np.array(
        [
            float(c) - (night.clock_s if name.endswith("clock") else night.refraction)
            if name.startswith("mark ")
            else parameter_error(name, station, true)
            for name, c in zip(fit.problem.names, change, strict=True)
        ]
    )
    return float(error @ np.linalg.solve(found.joint.of(k), error)) / len(error)


def parameter_error(name: str, found: Station, true: Station) -> float:
    """Return the error of one parameter of a station, its value estimated less the true one."""
    group, _, part = name.partition(".")
    if name in (*BASE, *BORESIGHT):
        turned = matrix_from_wxyz(getattr(found, f"{group}_wxyz")) @ matrix_from_wxyz(getattr(true, f"{group}_wxyz")).T
        return float(Rotation.from_matrix(turned).as_rotvec()["xyz".index(part)])
    if group in ("focal", "principal_point"):
        place = "xy".index(part)
        return float(getattr(found.lens, f"{group}_px")[place] - getattr(true.lens, f"{group}_px")[place])
    if group == "distortion":
        place = _DISTORTION.index(part)
        return float(found.lens.distortion[place] - true.lens.distortion[place])
    key = name if name.endswith("scale") else f"{name}_rad"
    return float(getattr(found.ptu_axes, key) - getattr(true.ptu_axes, key))
