"""The measurement models: a camera's pixel and a PTU's encoder angles, with their Jacobians over the state.

Pixel: the pinhole chain of docs/conventions.md. ∂pixel/∂angle is not zero; through it encoder noise is
shared between pixel and angles, as the paper's Equation 5 has it. With a rolling shutter the row is exposed
``row_dt_s`` after the stamp, and target and PTU have moved on by then.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.state import StateLayout
from groundstation.geometry.station import StationGeometry


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelPrediction:
    """Predicted pixel (2,) with its Jacobian H (2, n) over the state, px per state unit."""

    pixel: FloatArray
    jacobian: FloatArray
    depth_m: float


def predict_pixel(
    layout: StateLayout, station: StationGeometry, state: FloatArray, row_dt_s: float = 0.0
) -> PixelPrediction | None:
    """Return where the state (n,) puts the target in a station's image, or None if it is behind the camera."""
    point = state[layout.position]
    pan = tilt = 0.0
    angles = layout.angles.get(station.name)
    if row_dt_s:
        point = point + row_dt_s * state[layout.velocity]
    if angles is not None:
        pan, tilt = state[angles]
        if row_dt_s:
            rates = state[layout.rates[station.name]]
            pan, tilt = pan + row_dt_s * rates[0], tilt + row_dt_s * rates[1]
    projection = station.project(point, pan, tilt)
    if projection is None:
        return None
    H = np.zeros((2, layout.size))
    H[:, layout.position] = projection.jacobian[:, :3]
    if angles is not None:
        H[:, angles] = projection.jacobian[:, 3:]
    if row_dt_s:
        H[:, layout.velocity] = row_dt_s * projection.jacobian[:, :3]
        if angles is not None:
            H[:, layout.rates[station.name]] = row_dt_s * projection.jacobian[:, 3:]
    return PixelPrediction(pixel=projection.pixel, jacobian=H, depth_m=projection.depth_m)


def encoder_jacobian(layout: StateLayout, station: str, ahead_s: float) -> FloatArray:
    """Return H (2, n) of a PTU reading taken ``ahead_s`` after the state's time: angle + ahead · rate."""
    H = np.zeros((2, layout.size))
    angles, rates = layout.angles[station], layout.rates[station]
    H[0, angles.start] = H[1, angles.start + 1] = 1.0
    H[0, rates.start] = H[1, rates.start + 1] = ahead_s
    return H
