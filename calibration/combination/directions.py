"""Where a station looks over the angles of operation, and how that depends on its calibration."""

from collections.abc import Sequence

import numpy as np

from calibration.stars.operating_range import work_readings
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import Station

# of the picture's width, from its middle: the second shows a turn about the axis
_ASIDE = (0.0, 0.25)
_ROTATIONS = {"runway_from_base": "runway_from_base_wxyz", "head_from_camera": "head_from_camera_wxyz"}
_STEPS = {"focal": 0.1, "principal_point": 0.1}
_STEP = 1e-5


def readings_of(station: Station) -> FloatArray:
    """Return the readings (n, 2), rad, at which directions are compared; of a fixed station one."""
    return np.zeros((1, 2)) if station.fixed else work_readings(station)


def directions(station: Station, readings: FloatArray) -> FloatArray:
    """Return unit vectors (2 n, 3), runway frame, of two pixels at n readings, those of the picture's middle first."""
    w, h = station.lens.image_size_px
    geometry = station.geometry()
    angles = [station.ptu_axes.angles(float(pan), float(tilt), 0.0, 0.0) for pan, tilt in readings]
    return np.array(
        [
            geometry.ray(0.5 * (w - 1.0) + part * w, 0.5 * (h - 1.0), *pair).direction_runway
            for part in _ASIDE
            for pair in angles
        ]
    )


def direction_jacobian(station: Station, readings: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the derivatives (6 n, k) of the directions by k parameters of the calibration."""
    columns = []
    for name in names:
        step = np.zeros(len(CALIBRATION_PARAMETERS))
        size = _STEPS.get(name.partition(".")[0], _STEP)
        step[CALIBRATION_PARAMETERS.index(name)] = size
        after, before = (directions(station.changed(sign * step), readings) for sign in (1.0, -1.0))
        columns.append((after - before).ravel() / (2.0 * size))
    return np.array(columns).T.reshape(6 * len(readings), len(names))


def difference(station: Station, reference: Station, name: str) -> float:
    """Return the change of a parameter from the reference to another station."""
    group, _, part = name.partition(".")
    if group in _ROTATIONS:
        here, there = (matrix_from_wxyz(getattr(s, _ROTATIONS[group])) for s in (station, reference))
        turn = here @ there.T
        sines = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        sine, cosine = float(np.linalg.norm(sines)), 0.5 * (float(np.trace(turn)) - 1.0)
        angle = float(np.arctan2(sine, cosine))
        return float(sines["xyz".index(part)]) * (angle / sine if sine > 1e-9 else 1.0)
    return _value(station, group, part) - _value(reference, group, part)


def _value(station: Station, group: str, part: str) -> float:
    vectors = {
        "ptu_position": station.ptu_position_m,
        "camera_in_head": station.camera_in_head_m,
        "focal": station.lens.focal_px,
        "principal_point": station.lens.principal_point_px,
    }
    if group == "distortion":
        return float(station.lens.distortion[("k1", "k2", "p1", "p2", "k3").index(part)])
    return float(vectors[group]["xyz".index(part)])


def across_and_up(jacobian: FloatArray, station: Station, readings: FloatArray) -> FloatArray:
    """Return the derivatives (n, 2, k) of the middle's direction across (to the left) and up, rad."""
    n = len(readings)
    towards = directions(station, readings)[:n]
    across = np.cross(np.array([0.0, 0.0, 1.0]), towards)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(towards, across)
    of_middle = jacobian.reshape(2, n, 3, -1)[0]
    return np.stack([np.einsum("ni,nik->nk", axes, of_middle) for axes in (across, up)], axis=1)
