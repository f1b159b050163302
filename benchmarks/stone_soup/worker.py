"""Run Stone Soup's extended Kalman filter over the measurements that come in on standard input, pickled.

Started by filter_study.py in a separate virtual environment. The request is a dict: "mean" (n,), "covariance" (n, n),
"angle_columns" (the first place of each station's pan and tilt), "stations" (packed), "psd" (one of each pair of value
and slope), "pairs" (places of values and slopes), "noise" (pixel and angle variances), "steps": a list of
(dt, [(kind, station number, two numbers)]), "repeats". The answer: states (k, n) after each step, median s per step.
"""

import pickle
import sys
import time
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import TimeVariantModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import LinearGaussianTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater


class Pairs(LinearGaussianTransitionModel, TimeVariantModel):
    """Constant velocity driven by white acceleration, each pair of value and slope with its own PSD."""

    values: np.ndarray = Property(doc="places of the values")
    slopes: np.ndarray = Property(doc="places of their slopes")
    psd: np.ndarray = Property(doc="of each pair")
    size: int = Property(doc="of the state")

    @property
    def ndim_state(self) -> int:
        """Size of the state."""
        return self.size

    def matrix(self, time_interval: timedelta, **_: object) -> np.ndarray:
        """Return F."""
        F = np.eye(self.size)
        F[self.values, self.slopes] = time_interval.total_seconds()
        return F

    def covar(self, time_interval: timedelta, **_: object) -> CovarianceMatrix:
        """Return Q."""
        dt = time_interval.total_seconds()
        Q = np.zeros((self.size, self.size))
        Q[self.values, self.values] = self.psd * dt**3 / 3
        Q[self.values, self.slopes] = Q[self.slopes, self.values] = self.psd * dt**2 / 2
        Q[self.slopes, self.slopes] = self.psd * dt
        return CovarianceMatrix(Q)


class Pinhole(NonLinearGaussianMeasurement):
    """A station's pixel without distortion: position in 0 … 2, pan and tilt from ``angle`` on."""

    station: np.ndarray = Property(doc="34 numbers: rotation, position, rotation, lever arm, lens")
    angle: int = Property(doc="place of pan; tilt follows")

    @property
    def ndim_meas(self) -> int:
        """Two: u and v."""
        return 2

    def _both(self, state: Any) -> tuple[np.ndarray, np.ndarray]:
        x = np.asarray(state.state_vector, dtype=float).ravel()
        p = self.station
        base = p[0:9].reshape(3, 3).T @ (x[0:3] - p[9:12])
        pan, tilt = x[self.angle], x[self.angle + 1]
        c, s = np.cos(pan), np.sin(pan)
        unpan = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
        c, s = np.cos(tilt), np.sin(tilt)
        untilt = np.array([[1.0, 0, 0], [0, c, s], [0, -s, c]])
        g = unpan @ base
        h = untilt @ g
        camera_from_head = p[12:21].reshape(3, 3).T
        X = camera_from_head @ (h - p[21:24])
        by = np.zeros((3, self.ndim_state))
        by[:, 0:3] = camera_from_head @ untilt @ unpan @ p[0:9].reshape(3, 3).T
        by[:, self.angle] = camera_from_head @ untilt @ np.array([g[1], -g[0], 0.0])
        by[:, self.angle + 1] = camera_from_head @ np.array([0.0, h[2], -h[1]])
        f, c0 = p[24:26], p[26:28]
        pixel = f * X[:2] / X[2] + c0
        H = f[:, None] * (by[:2] / X[2] - np.outer(X[:2], by[2]) / X[2] ** 2)
        return pixel, H

    def function(self, state: object, noise: object = False, **_: object) -> StateVector:
        """Return the pixel."""
        return StateVector(self._both(state)[0])

    def jacobian(self, state: object, **_: object) -> np.ndarray:
        """Return its derivative by the state."""
        return self._both(state)[1]

    def rvs(self, *_: object, **__: object) -> None:
        """Nothing is drawn here."""
        raise NotImplementedError


def main() -> None:
    request = pickle.load(sys.stdin.buffer)
    n = request["mean"].size
    predictor = KalmanPredictor(Pairs(values=request["values"], slopes=request["slopes"], psd=request["psd"], size=n))
    angle_noise = CovarianceMatrix(np.eye(2) * request["angle_variance"])
    pixel_noise = CovarianceMatrix(np.eye(2) * request["pixel_variance"])
    models = {}
    for k, (station, angle) in enumerate(zip(request["stations"], request["angle_columns"], strict=True)):
        models["pixel", k] = Pinhole(ndim_state=n, mapping=None, noise_covar=pixel_noise, station=station, angle=angle)
        models["angles", k] = LinearGaussian(ndim_state=n, mapping=(angle, angle + 1), noise_covar=angle_noise)
    updater = ExtendedKalmanUpdater(None, use_joseph_cov=True)
    began = datetime(2000, 1, 1)
    medians: list[float] = []
    states: list[np.ndarray] = []
    for _ in range(request["repeats"]):
        now = began
        state = GaussianState(StateVector(request["mean"]), CovarianceMatrix(request["covariance"]), timestamp=now)
        took, states = [], []
        for dt, measurements in request["steps"]:
            now = now + timedelta(seconds=dt)
            detections = [
                Detection(StateVector(values), timestamp=now, measurement_model=models[kind, station])
                for kind, station, values in measurements
            ]
            start = time.perf_counter()
            state = predictor.predict(state, timestamp=now)
            for detection in detections:
                state = updater.update(SingleHypothesis(state, detection))
            took.append(time.perf_counter() - start)
            states.append(np.asarray(state.state_vector, dtype=float).ravel())
        medians.append(float(np.median(took)))
    pickle.dump({"states": np.array(states), "median_s": medians}, sys.stdout.buffer)


if __name__ == "__main__":
    main()
