"""Effect of a calibration's errors on a position in the air: linear, from the rig's covariance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, CalibratedProjection, project_with_calibration
from groundstation.rig.rig import PARTS, Rig, Station

RANGES_M = (100.0, 200.0, 400.0)
# an approach of three degrees to a point a little before the stations, over the middle of the runway
_GLIDE = float(np.tan(np.radians(3.0)))
_LEAST_HEIGHT_M = 1.0
_ALONG = (0.3, 1.0, 3.0)
_FARTHEST_M = 2000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """One sigma of a position at a range, by calibration alone: ``across_m``, ``along_m``, ``up_m``."""

    range_m: float
    across_m: float
    along_m: float
    up_m: float


def posed(rig: Rig) -> list[Station]:
    """Return the stations that a position can be found with."""
    return [s for s in rig.stations if set(PARTS) <= set(s.known)]


def approach_point(rig: Rig, range_m: float) -> FloatArray:
    """Return the point (3,) of an approach at a range before the stations' middle."""
    middle = np.mean([s.ptu_position_m for s in posed(rig)], axis=0)
    return np.array([middle[0], middle[1] + range_m, max(_LEAST_HEIGHT_M, _GLIDE * range_m)])


def reach_gain(rig: Rig, names: Sequence[str], point_m: FloatArray) -> FloatArray | None:
    """Return ∂point/∂parameters (3, p), ``station.parameter``; None where fewer than two stations see the point."""
    by_point, by_change = [], []
    for station in posed(rig):
        seen = _aimed(station, point_m)
        if seen is None:
            continue
        columns = np.zeros((2, len(names)))
        for k, name in enumerate(names):
            owner, _, short = name.partition(".")
            if owner == station.name and short in CALIBRATION_PARAMETERS:
                columns[:, k] = seen.calibration_jacobian[:, CALIBRATION_PARAMETERS.index(short)]
        by_point.append(seen.jacobian[:, :3])
        by_change.append(columns)
    if len(by_point) < 2:
        return None
    return np.asarray(np.linalg.pinv(np.vstack(by_point)) @ np.vstack(by_change))


def reach_at(rig: Rig, range_m: float) -> Reach | None:
    """Return one sigma at a range by the rig's whole covariance, or None for fewer than two stations."""
    known = rig.calibration_covariance()
    if not known.names or len(posed(rig)) < 2:
        return None
    gain = reach_gain(rig, known.names, approach_point(rig, range_m))
    if gain is None:
        return None
    across, along, up = np.sqrt(np.maximum(np.diag(gain @ known.matrix @ gain.T), 0.0))
    return Reach(range_m=range_m, across_m=float(across), along_m=float(along), up_m=float(up))


def relative_sigma_rad(rig: Rig, first: str, second: str, range_m: float) -> FloatArray | None:
    """Return one sigma (2,) by which two stations' bearings of one point are off against each other: pan and tilt."""
    known = rig.calibration_covariance()
    difference = np.zeros((2, len(known.names)))
    for name, sign in ((first, 1.0), (second, -1.0)):
        seen = _aimed(rig[name], approach_point(rig, range_m))
        if seen is None:
            return None
        angles = np.linalg.solve(seen.jacobian[:, 3:], seen.calibration_jacobian)
        for k, parameter in enumerate(known.names):
            owner, _, short = parameter.partition(".")
            if owner == name and short in CALIBRATION_PARAMETERS:
                difference[:, k] += sign * angles[:, CALIBRATION_PARAMETERS.index(short)]
    return np.sqrt(np.maximum(np.diag(difference @ known.matrix @ difference.T), 0.0))


def moved_by_m(rig: Rig, names: Sequence[str], change: FloatArray, range_m: float) -> FloatArray | None:
    """Return by how much (3,) a point is put wrong where parameters have changed (p,); None for a single station."""
    if len(posed(rig)) < 2:
        return None
    gain = reach_gain(rig, names, approach_point(rig, range_m))
    return None if gain is None else np.asarray(gain @ change)


def good_to_m(rig: Rig) -> list[tuple[float, float]]:
    """Return (limit, range): one sigma along the runway stays below each limit in m up to the range in m."""
    ranges = np.geomspace(20.0, _FARTHEST_M, 40)
    reached = [reach_at(rig, float(r)) for r in ranges]
    answers = []
    for limit in _ALONG:
        within = [r for r, value in zip(ranges, reached, strict=True) if value is not None and value.along_m <= limit]
        if within:
            answers.append((limit, float(f"{max(within):.2g}")))
    return answers


def _aimed(station: Station, point_m: FloatArray) -> CalibratedProjection | None:
    geometry, pan, tilt = station.geometry(), 0.0, 0.0
    if not station.fixed:
        aim = aim_at(geometry, point_m)
        if aim is None:
            return None
        pan, tilt = aim.pan_rad, aim.tilt_rad
    return project_with_calibration(geometry, point_m, pan, tilt)
