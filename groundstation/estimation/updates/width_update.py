"""Update with the silhouette width, which with the span gives the range from a single camera.

w = span · f / depth · aspect, in logarithms, since the error of a width is relative. The wings are taken as level and
perpendicular to the flight; aspect = |c · ŵ| with the column axis c of the camera and the direction of the wings
ŵ = (v_y, −v_x, 0)/|v_xy|. The error of the span is a state of the filter: it is common to all frames, so that no number
of frames averages it out. It includes the error of the detector's width, some pixels that last for seconds (a wing tip
that is not detected, blur) and change as the silhouette grows; its random walk is as large.

∂depth/∂(pan, tilt) is neglected: off the axis it is at most a tenth per radian, and angles are known to 1e-4 rad.
"""

import math
from collections.abc import Mapping

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.kalman_kernels import LinearMeasurement, innovation_covariance
from groundstation.estimation.parameters import LOG_SPAN, ParameterPrior
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.measurements import SilhouetteWidth
from groundstation.estimation.updates.update import (
    LinearCorrection,
    LinearPrediction,
    PredictedState,
    Update,
    VarianceInflation,
)
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation

# a slower target has no direction of flight; at a more oblique aspect, fuselage and tail are as wide as the wings
_MIN_SPEED_M_S = 3.0
_MIN_ASPECT = 0.7
# of 12 px silhouettes 1.6 px are missing, of 20 px ones 0.8 too many: seconds apart
_LASTING_PX, _LASTING_S = 2.0, 5.0
_LONGEST_S = 1.0


class WidthModel:
    """Width of the target in the camera of one station."""

    def __init__(self, layout: StateLayout, geometry: StationGeometry) -> None:
        self._geometry = geometry
        self._layout = layout
        self._span = layout.parameters.get(LOG_SPAN)

    def predict(self, state: FloatArray, span_m: float, pan_rad: float, tilt_rad: float) -> LinearPrediction | None:
        """Return log(width in px) (1,) of the state (n,) for an assumed span, with H (1, n).

        None if the span is no state, or the target is behind the camera, slow, or seen too obliquely.
        """
        if self._span is None:
            return None
        pose = self._geometry.camera_pose(pan_rad, tilt_rad)
        position, velocity = self._layout.position, self._layout.velocity
        H = np.zeros((1, self._layout.size))
        centre = pose.position_runway_m
        log_share = _log_width(
            pose.runway_from_camera, centre, state[position], state[velocity], H[0, position], H[0, velocity]
        )
        if np.isnan(log_share):
            return None
        H[0, self._span] = 1.0
        value = log_share + np.log(span_m * self._geometry.lens.focal_px[0]) + state[self._span]
        return LinearPrediction(value=np.array([value]), jacobian=H)


class WidthUpdate:
    """Update with silhouette widths of all cameras."""

    def __init__(
        self,
        layout: StateLayout,
        stations: Mapping[str, StationGeometry],
        config: EstimationConfig,
        prior: ParameterPrior,
    ) -> None:
        self._layout = layout
        self._models = {name: WidthModel(layout, geometry) for name, geometry in stations.items()}
        self._R = np.array([[config.width_sigma_log**2]])
        self._gate = float(chi_square_quantile(config.gate_probability, 1))
        self._span_only = np.zeros(layout.size, np.bool_)
        self._span = layout.parameters.get(LOG_SPAN)
        if self._span is not None:
            self._span_only[self._span] = True
        # a span without process noise is not inflated
        self._span_walks = LOG_SPAN in prior.names and prior.walk_psd[prior.names.index(LOG_SPAN)] > 0.0

    def predict(self, state: PredictedState, width: SilhouetteWidth) -> LinearPrediction | None:
        """Return the predicted logarithm of a width, None where the width gives no information."""
        if width.width_px <= 0.0:
            return None
        angles = self._layout.pan_tilt(state.x, width.station)
        return self._models[width.station].predict(state.x, width.span_m, *angles)

    def span_inflation(self, width_px: float, since_s: float) -> VarianceInflation | None:
        """Return the growth of the variance of the span's logarithm ``since_s`` after the previous width.

        It is faster for smaller silhouettes.
        """
        if self._span is None or not self._span_walks or since_s <= 0.0:
            return None
        growth = (_LASTING_PX / width_px) ** 2 * min(since_s, _LONGEST_S) / _LASTING_S
        return VarianceInflation(part=slice(self._span, self._span + 1), variances=np.array([growth]))

    def __call__(self, state: PredictedState, width: SilhouetteWidth, expected: LinearPrediction) -> Update:
        """Return the update: of range and span by a camera ``alone``, otherwise of the span only."""
        residual = np.array([math.log(width.width_px)]) - expected.value
        S = innovation_covariance(state.P, expected.jacobian, self._R)
        nis = float(residual[0] ** 2 / S[0, 0])
        innovation = Innovation(residual=residual, covariance=S, nis=nis, dof=1, accepted=nis <= self._gate)
        if not innovation.accepted:
            return Update(innovation)
        measurement = LinearMeasurement(residual, expected.jacobian, self._R)
        estimated = None if width.alone else self._span_only
        return Update(innovation, LinearCorrection(measurement=measurement, updates_weights=False, estimated=estimated))


@njit(cache=True)
def _log_width(
    runway_from_camera: FloatArray,
    centre: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    by_position: FloatArray,
    by_velocity: FloatArray,
) -> float:
    """Return log(aspect/depth), NaN where it is not defined; write its derivatives by position and velocity, (3,)."""
    depth = 0.0
    for k in range(3):
        depth += runway_from_camera[k, 2] * (position[k] - centre[k])
    speed = np.hypot(velocity[0], velocity[1])
    if depth < MIN_DEPTH_M or speed < _MIN_SPEED_M_S:
        return np.nan
    across, along = runway_from_camera[0, 0], runway_from_camera[1, 0]
    aspect = (across * velocity[1] - along * velocity[0]) / speed
    if abs(aspect) < _MIN_ASPECT:
        return np.nan
    for k in range(3):
        by_position[k] = -runway_from_camera[k, 2] / depth
    by_velocity[0] = -along / (speed * aspect) - velocity[0] / speed**2
    by_velocity[1] = across / (speed * aspect) - velocity[1] / speed**2
    return float(np.log(abs(aspect) / depth))
