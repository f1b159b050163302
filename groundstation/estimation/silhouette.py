"""Measurement model of the silhouette width, which with the span gives the range from a single camera.

w = span · f / depth · aspect, in logarithms, since its error is a share of it. The wings are taken as level and across
the flight; aspect = |c · ŵ| with the camera's axis of columns c and the wings' direction ŵ = (v_y, −v_x, 0)/|v_xy|. The
span's own error is a state of the filter: one number for all frames, which no number of frames averages away. It has
in it what a detector gets wrong of the width, some pixels that last for seconds (a wing's tip that is not seen, a blur
that is) and change as the silhouette grows: so much may it walk.

∂depth/∂(pan, tilt) is left out: off the axis it is at most a tenth per radian, and angles are known to 1e-4 rad.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.measurement import LinearPrediction
from groundstation.estimation.parameters import LOG_SPAN
from groundstation.estimation.state import StateLayout
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.geometry.station import StationGeometry

# slower, it has no direction of flight; more oblique, fuselage and tail are as wide as the wings
_MIN_SPEED_M_S = 3.0
_MIN_ASPECT = 0.7
# of 12 px silhouettes 1.6 px are missing, of 20 px ones 0.8 too many: seconds apart
_LASTING_PX, _LASTING_S = 2.0, 5.0
_LONGEST_S = 1.0


def lasting_variance(width_px: float, since_s: float) -> float:
    """Return how much the variance of the span's logarithm has grown ``since_s`` after the width before this one."""
    return (_LASTING_PX / width_px) ** 2 * min(max(since_s, 0.0), _LONGEST_S) / _LASTING_S


class WidthModel:
    """One station's camera: how wide the target looks."""

    def __init__(self, layout: StateLayout, geometry: StationGeometry) -> None:
        self._geometry = geometry
        self._layout = layout
        self._span = layout.parameters.get(LOG_SPAN)

    def predict(self, state: FloatArray, span_m: float, pan_rad: float, tilt_rad: float) -> LinearPrediction | None:
        """Return log(width in px) (1,) of the state (n,) for an assumed span, with H (1, n).

        None if no span is carried, or the target is behind the camera, slow, or seen too obliquely.
        """
        if self._span is None:
            return None
        pose = self._geometry.camera_pose(pan_rad, tilt_rad)
        slope = np.zeros(6)
        log_share = _log_width(pose.runway_from_camera, pose.position_runway_m, state[self._layout.target], slope)
        if np.isnan(log_share):
            return None
        H = np.zeros((1, self._layout.size))
        H[0, self._layout.target] = slope
        H[0, self._span] = 1.0
        value = log_share + np.log(span_m * self._geometry.lens.focal_px[0]) + state[self._span]
        return LinearPrediction(value=np.array([value]), jacobian=H)


@njit(cache=True)
def _log_width(runway_from_camera: FloatArray, centre: FloatArray, x: FloatArray, slope: FloatArray) -> float:
    """Return log(aspect/depth) of position and velocity ``x`` (6,), NaN where it has none; fill ``slope`` (6,)."""
    depth = 0.0
    for k in range(3):
        depth += runway_from_camera[k, 2] * (x[k] - centre[k])
    speed = np.hypot(x[3], x[4])
    if depth < MIN_DEPTH_M or speed < _MIN_SPEED_M_S:
        return np.nan
    across, along = runway_from_camera[0, 0], runway_from_camera[1, 0]
    aspect = (across * x[4] - along * x[3]) / speed
    if abs(aspect) < _MIN_ASPECT:
        return np.nan
    for k in range(3):
        slope[k] = -runway_from_camera[k, 2] / depth
    slope[3] = -along / (speed * aspect) - x[3] / speed**2
    slope[4] = across / (speed * aspect) - x[4] / speed**2
    return float(np.log(abs(aspect) / depth))
