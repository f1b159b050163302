"""Update with the target's pixel: gating, out-of-view weight, iterated linearisation and second-order clock noise."""

from collections.abc import Mapping

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import CalibrationUse, EstimationConfig, OutOfViewWeighting
from groundstation.estimation.kalman_kernels import LinearMeasurement, correlated_part, innovation_covariance
from groundstation.estimation.linearisation import Linearised, PixelLinearisation
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.out_of_view_weight import paper_weight, probability_in_view
from groundstation.estimation.range_initialisation import RangeInitialiser
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.measurements import TargetPixel
from groundstation.estimation.updates.pixel_model import PixelPrediction
from groundstation.estimation.updates.update import LinearCorrection, PredictedState, Update
from groundstation.geometry.chi_square import chi_square_quantile
from groundstation.geometry.mahalanobis import mahalanobis_squared
from groundstation.geometry.rotation import cross
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation

_NO_NOISE = np.zeros((2, 2))
# no iteration of the update if the prediction is no more uncertain than this many sigmas of the pixel noise
_SETTLED_SIGMA = 2.0
# a re-initialisation of the range is tested if the prediction is more uncertain by this factor
_VAGUE_SIGMA = 2.0
_LEAST_PROBABILITY = 1e-6


class PixelUpdate:
    """Update with pixels of all cameras.

    Parameters
    ----------
    layout, config : of the filter.
    stations : geometry of every station by name.
    linearisation : of the cameras' pixel models.
    motion : motion model of steady flight, for the offset of the clocks.
    """

    def __init__(
        self,
        layout: StateLayout,
        config: EstimationConfig,
        stations: Mapping[str, StationGeometry],
        linearisation: PixelLinearisation,
        motion: MotionModel,
    ) -> None:
        self._layout, self._config, self._stations = layout, config, stations
        self._linearisation, self._motion = linearisation, motion
        self._pixels = linearisation.pixels
        self._range_initialiser = RangeInitialiser(layout, self._pixels, stations, config.gate_probability)
        self._gate = float(chi_square_quantile(config.gate_probability, 2))
        self._learns_clocks = config.calibration is CalibrationUse.ESTIMATE

    def __call__(self, state: PredictedState, measured: TargetPixel) -> Update | None:
        """Return the update, None if the target is behind the camera.

        A pixel near and beyond the image border is weighted (`OutOfViewWeighting`), one beyond the chi-square gate is
        rejected, and one of a second camera may re-initialise the range.
        """
        prediction = self._pixels[measured.station].predict(state.x, measured.row_dt_s, state.age_s)
        if prediction is None:
            return None
        in_view, R = innovation_covariance(state.P, prediction.jacobian, _NO_NOISE), measured.covariance_px2
        if in_view[0, 0] + in_view[1, 1] > _VAGUE_SIGMA**2 * (R[0, 0] + R[1, 1]):
            reset = self._range_initialiser(state, measured)
            if reset is not None:
                return reset
        pixel, H, R = self._without_correlated_error(state.x, measured, prediction)
        residual = pixel - prediction.pixel
        S = innovation_covariance(state.P, H, R)
        nis = mahalanobis_squared(residual, S)
        accepted = nis <= self._gate
        innovation = Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)
        if not accepted:
            return Update(innovation)
        alone = state.alone == measured.station
        size = self._stations[measured.station].image_size_px
        linear = LinearMeasurement(residual, H, R)
        if self._config.out_of_view is OutOfViewWeighting.PAPER:
            weight = paper_weight(prediction.pixel, size, self._config.paper_border_sigma_px)
            weighted, gain_share = LinearMeasurement(weight * residual, H, R), 1.0
        else:
            inside = max(probability_in_view(prediction.pixel, in_view, size), _LEAST_PROBABILITY)
            by_gain = self._config.out_of_view is OutOfViewWeighting.GAIN
            gain_share = inside if by_gain else 1.0
            weighted = linear if by_gain else LinearMeasurement(residual, H, R / inside)
            if not alone:
                weighted = self._iterated(state, measured, pixel, weighted, in_view)
        linear = self._with_clock_noise(state, measured.station, weighted)
        return Update(
            innovation,
            LinearCorrection(
                measurement=linear,
                gain_share=gain_share,
                estimated=state.estimated,
                ray=_ray(prediction.jacobian[:, self._layout.position]) if alone else None,
            ),
        )

    def _without_correlated_error(
        self, x: FloatArray, measured: TargetPixel, prediction: PixelPrediction
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return pixel (2,), Jacobian (2, n) and noise (2, 2) with the correlated error as states of the filter."""
        pixel, H, R, share = measured.pixel, prediction.jacobian, measured.covariance_px2, measured.correlated_share
        offset = self._layout.offsets.get(measured.station)
        if offset is None or share <= 0.0:
            return pixel, H, R
        pixel, H = pixel.copy(), H.copy()
        correlated_part(H, x, R, offset.start, share, pixel)
        return pixel, H, (1.0 - share) * R

    def _iterated(
        self,
        state: PredictedState,
        measured: TargetPixel,
        pixel: FloatArray,
        linear: LinearMeasurement,
        in_view: FloatArray,
    ) -> LinearMeasurement:
        """Return the measurement linearised at the updated state, where the prediction is uncertain."""
        R = linear.R
        if in_view[0, 0] <= _SETTLED_SIGMA**2 * R[0, 0] and in_view[1, 1] <= _SETTLED_SIGMA**2 * R[1, 1]:
            return linear
        first = Linearised(jacobian=linear.H, residual=linear.residual)
        prior, times = (state.x, state.P, state.estimated), (measured.row_dt_s, state.age_s)
        found = self._linearisation.iterated(measured.station, pixel, first, prior, R, times)
        return LinearMeasurement(found.residual, found.jacobian, R)

    def _with_clock_noise(self, state: PredictedState, station: str, linear: LinearMeasurement) -> LinearMeasurement:
        """Return the measurement with the noise of the second-order effect of clock errors."""
        if not self._linearisation.carries_clock(station):
            return linear
        _, H, R = linear
        R = R + self._linearisation.speed_noise(station, H, state.P, state.age_s)
        if self._learns_clocks:
            R += self._linearisation.passage_noise(station, H, (state.x, state.P), state.age_s, self._motion)
        return LinearMeasurement(linear.residual, H, R)


def _ray(jacobian: FloatArray) -> FloatArray:
    """Return the unit vector (3,) along which a pixel with the Jacobian (2, 3) by the position does not move.

    The pixels of one camera, each linearised at another estimate, would seem to measure the range (the extended Kalman
    filter's inconsistency with bearings only). While a camera is alone, its pixels therefore do not correct it.
    """
    along = cross(jacobian[0], jacobian[1])
    return np.asarray(along / np.linalg.norm(along))
