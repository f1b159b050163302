"""Measurement model of a camera: the pixel of the target with its Jacobian over the state.

Pixel: the pinhole chain of docs/conventions.md. ∂pixel/∂angle is not zero; through it encoder noise is shared between
pixel and angles, as in the paper's Equation 5. With a rolling shutter the row is exposed some time after the stamp, and
with a clock error the whole picture is: δ later the target is at p + δ·v and the PTU at its angle + δ·rate. A clock
error enters as the time does, and ∂z/∂δ is the speed of the pixel. A readout time longer by ρ makes a row later by its
share of the picture's height from the middle row times ρ.

The angles of a PTU are states in the PTU's own clock: its readings show them as they are, and a clock that is late by ε
enters where a pixel depends on them, as angle − ε·rate. (If ε entered at the reading, each reading would multiply it by
a rate that is estimated from the noisy readings, and the filter would estimate ε from noise.)
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.estimation.state_model import StateLayout
from groundstation.geometry import kernels
from groundstation.geometry.calibration import parameter_indices, perturbed_packed
from groundstation.geometry.calibration_kernel import CALIBRATION_SIZE, project_calibration
from groundstation.geometry.station import StationGeometry
from groundstation.rig.covariance import READOUT

IndexArray = NDArray[np.int64]
_NO_STATE = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelPrediction:
    """Predicted pixel (2,) with its Jacobian H (2, n) over the state, px per state unit."""

    pixel: FloatArray
    jacobian: FloatArray
    depth_m: float


class PixelModel:
    """Pixel of the target in the camera of one station."""

    def __init__(self, layout: StateLayout, geometry: StationGeometry) -> None:
        self._geometry = geometry
        self._size = layout.size
        self._rows = geometry.image_size_px[1]
        name = geometry.name
        own = {p.removeprefix(f"{name}."): k for p, k in layout.parameters.items() if p.startswith(f"{name}.")}
        calibration = {p: k for p, k in own.items() if "_clock." not in p and p != READOUT}
        self._readout = own.get(READOUT, _NO_STATE)
        self._columns = np.array(parameter_indices(list(calibration)), np.int64)
        self._places = np.array(list(calibration.values()), np.int64)
        angles, rates = layout.angles.get(name), layout.rates.get(name)
        self._places_of_motion = np.array(
            [
                layout.position.start,
                layout.velocity.start,
                _NO_STATE if angles is None else angles.start,
                _NO_STATE if rates is None else rates.start,
                own.get("camera_clock.offset", _NO_STATE),
                own.get("camera_clock.drift", _NO_STATE),
                own.get("ptu_clock.offset", _NO_STATE),
                own.get("ptu_clock.drift", _NO_STATE),
            ],
            np.int64,
        )

    def predict(self, state: FloatArray, row_dt_s: float = 0.0, age_s: float = 0.0) -> PixelPrediction | None:
        """Return the pixel of the state (n,), or None if the target is behind the camera.

        ``row_dt_s`` is the exposure of the row after the stamp, ``age_s`` the time over which clocks have drifted.
        """
        packed = self._geometry.packed
        if self._columns.size:
            change = np.zeros(CALIBRATION_SIZE)
            change[self._columns] = state[self._places]
            if change.any():
                packed = perturbed_packed(packed, change)
        pixel, H = np.empty(2), np.zeros((2, self._size))
        depth = self._at(packed, state, row_dt_s, age_s, pixel, H)
        if self._readout != _NO_STATE and depth >= kernels.MIN_DEPTH_M:
            # which row the target is on follows from the pixel itself
            share, longer = (pixel[1] + 0.5) / self._rows - 0.5, float(state[self._readout])
            if longer != 0.0:
                by_row = H[1] / self._rows
                H = np.zeros_like(H)
                depth = self._at(packed, state, row_dt_s + share * longer, age_s, pixel, H)
                H += longer * np.outer(self._speed(state, H), by_row)
            H[:, self._readout] = share * self._speed(state, H)
        return None if depth < kernels.MIN_DEPTH_M else PixelPrediction(pixel=pixel, jacobian=H, depth_m=depth)

    def _at(
        self, packed: FloatArray, state: FloatArray, dt_s: float, age_s: float, pixel: FloatArray, H: FloatArray
    ) -> float:
        """Fill pixel (2,) and H (2, n), zero before, for an exposure ``dt_s`` after the stamp; return the depth, m."""
        return float(
            _predict_pixel(packed, state, self._places_of_motion, self._columns, self._places, dt_s, age_s, pixel, H)
        )

    def _speed(self, state: FloatArray, H: FloatArray) -> FloatArray:
        """Return the speed of the pixel (2,) in px/s, its derivative by the time of exposure."""
        position, velocity, angles, rates = self._places_of_motion[:4]
        speed = H[:, position : position + 3] @ state[velocity : velocity + 3]
        if angles != _NO_STATE:
            speed = speed + H[:, angles : angles + 2] @ state[rates : rates + 2]
        return np.asarray(speed)


@njit(cache=True)
def _predict_pixel(
    packed: FloatArray,
    x: FloatArray,
    where: IndexArray,
    columns: IndexArray,
    places: IndexArray,
    row_dt_s: float,
    age_s: float,
    pixel: FloatArray,
    H: FloatArray,
) -> float:
    """Fill the pixel (2,) and H (2, n), zero before; return the depth in m."""
    at, speed, angles, rates, offset, drift, ptu_offset, ptu_drift = where
    dt = row_dt_s
    if offset >= 0:
        dt += x[offset]
    if drift >= 0:
        dt += age_s * x[drift]
    head_dt = dt
    if ptu_offset >= 0:
        head_dt -= x[ptu_offset]
    if ptu_drift >= 0:
        head_dt -= age_s * x[ptu_drift]
    point = x[at : at + 3] + dt * x[speed : speed + 3]
    pan, tilt = 0.0, 0.0
    if angles >= 0:
        pan, tilt = x[angles] + head_dt * x[rates], x[angles + 1] + head_dt * x[rates + 1]
    jacobian, calibration = np.empty((2, 5)), np.empty((2, CALIBRATION_SIZE))
    if columns.size == 0:
        depth = kernels.project(packed, point, pan, tilt, pixel, jacobian)
    else:
        depth = project_calibration(packed, point, pan, tilt, pixel, jacobian, calibration)
    if depth < kernels.MIN_DEPTH_M:
        return depth
    for row in range(2):
        along, turning = 0.0, 0.0
        for k in range(3):
            H[row, at + k] = jacobian[row, k]
            H[row, speed + k] = dt * jacobian[row, k]
            along += jacobian[row, k] * x[speed + k]
        if angles >= 0:
            for k in range(2):
                H[row, angles + k] = jacobian[row, 3 + k]
                H[row, rates + k] = head_dt * jacobian[row, 3 + k]
                turning += jacobian[row, 3 + k] * x[rates + k]
        if offset >= 0:
            H[row, offset] = along + turning
        if drift >= 0:
            H[row, drift] = age_s * (along + turning)
        if ptu_offset >= 0:
            H[row, ptu_offset] = -turning
        if ptu_drift >= 0:
            H[row, ptu_drift] = -age_s * turning
        for k in range(columns.size):
            H[row, places[k]] = calibration[row, columns[k]]
    return depth
