"""Simulated detections of a camera: the target's pixel with noise, misses and gross outliers."""

from dataclasses import dataclass, field

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.geometry.kernels import MIN_DEPTH_M
from groundstation.geometry.rolling_shutter import exposed_row_delay_s
from groundstation.geometry.station import StationGeometry
from groundstation.simulation.flight_window import FlightWindow
from groundstation.simulation.parameter_checks import (
    require,
    require_finite,
    require_fraction,
    require_not_negative,
    require_shape,
)
from groundstation.simulation.pointing import HeadAngles, PointingHistory
from groundstation.simulation.pointing_kernels import project_many
from groundstation.simulation.trajectory import Trajectory

# a row's delay depends on the row; each round divides the error by f · angular rate · readout / height
_SHUTTER_ROUNDS = 5


def isotropic(sigma_px: float) -> FloatArray:
    """Return the covariance (2, 2) px² of a pixel with the same sigma in u and v."""
    require_not_negative("isotropic: sigma_px", sigma_px)
    return sigma_px**2 * np.eye(2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraModel:
    """Parameters of a camera and its detector that no rig file has; lens, readout and clock are the true rig's.

    Attributes
    ----------
    phase_s : exposures are so much later than the pair's nominal time.
    pixel_covariance_px2 : (2, 2) of u and v.
    miss_probability : share of visible targets that are missed, independently.
    miss_windows : within these every target is missed.
    outlier_probability, outlier_range_px : share of pixels that are gross outliers, uniform within ± the range
        of the true pixel in u and in v, instead of the noise.
    latency_s : from mid-exposure until the pixel is there.
    """

    phase_s: float = 0.0
    pixel_covariance_px2: FloatArray = field(default_factory=lambda: isotropic(0.5))
    miss_probability: float = 0.0
    miss_windows: tuple[FlightWindow, ...] = ()
    outlier_probability: float = 0.0
    outlier_range_px: float = 50.0
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        where = "CameraModel: pixel_covariance_px2"
        cov = self.pixel_covariance_px2
        require_shape(where, cov, (2, 2))
        fine = bool(np.allclose(cov, cov.T)) and float(np.linalg.eigvalsh(cov)[0]) > -1e-12
        require(fine, where, got=cov.tolist(), wanted="a symmetric matrix without a negative variance")
        require_finite("CameraModel: phase_s", self.phase_s)
        require_fraction("CameraModel: miss_probability", self.miss_probability)
        require_fraction("CameraModel: outlier_probability", self.outlier_probability)
        require_not_negative("CameraModel: outlier_range_px", self.outlier_range_px)
        require_not_negative("CameraModel: latency_s", self.latency_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedDetections:
    """One camera's detections, one for each of n stereo pairs.

    Attributes
    ----------
    t_s : (n,) mid-exposures (of the middle row), true session time.
    pixel_px : (n, 2) where the target truly is; zero where it is not in front of the camera.
    visible : (n,) whether that is in the image.
    reported_px : (n, 2) the reported pixel; valid where ``reported`` (n,).
    outlier : (n,) whether that is a gross outlier.
    pointing : the head's angles and rates at ``t_s``, (n, 2) each.
    """

    t_s: FloatArray
    pixel_px: FloatArray
    visible: MaskArray
    reported_px: FloatArray
    reported: MaskArray
    outlier: MaskArray
    pointing: HeadAngles


def simulate_detections(
    model: CameraModel,
    geometry: StationGeometry,
    readout_s: float,
    history: PointingHistory,
    trajectory: Trajectory,
    t_s: FloatArray,
    generator: np.random.Generator,
) -> SimulatedDetections:
    """Simulate the detections of one camera of true ``geometry`` at mid-exposures ``t_s`` (n,), true session time.

    A pixel that would be reported outside the image is not reported. Every detection draws the same count of random
    numbers, so that one parameter can be changed without another draw of all the rest.
    """
    pixel, in_front = _true_pixels(geometry, readout_s, history, trajectory, t_s)
    visible = in_front & _contained(geometry, pixel)
    count = t_s.size
    noise = generator.normal(size=(count, 2)) @ _root(model.pixel_covariance_px2).T
    missed = generator.uniform(size=count) < model.miss_probability
    outlier = generator.uniform(size=count) < model.outlier_probability
    far = generator.uniform(-model.outlier_range_px, model.outlier_range_px, size=(count, 2))
    for window in model.miss_windows:
        missed |= window.holds(t_s, trajectory.position(t_s))
    reported_px = pixel + np.where(outlier[:, None], far, noise)
    reported = visible & ~missed & _contained(geometry, reported_px)
    return SimulatedDetections(
        t_s=t_s,
        pixel_px=pixel,
        visible=visible,
        reported_px=reported_px,
        reported=reported,
        outlier=outlier & reported,
        pointing=history.at(t_s),
    )


def _true_pixels(
    geometry: StationGeometry, readout_s: float, history: PointingHistory, trajectory: Trajectory, t_s: FloatArray
) -> tuple[FloatArray, MaskArray]:
    """Return pixels (n, 2), each at the instant at which its row is exposed, and which are in front (n,)."""
    pixel, slopes = np.zeros((t_s.size, 2)), np.zeros((t_s.size, 2, 2))
    rows = geometry.image_size_px[1]
    row_s = np.zeros(t_s.size)
    depth = np.zeros(t_s.size)
    for _ in range(_SHUTTER_ROUNDS if readout_s else 1):
        moments = t_s + row_s
        depth = project_many(geometry.packed, trajectory.position(moments), history.at(moments).head_rad, pixel, slopes)
        # rows beyond the image are not exposed: points there only have to be outside
        row_s = exposed_row_delay_s(pixel[:, 1], rows, readout_s)
    return pixel, depth >= MIN_DEPTH_M


def _contained(geometry: StationGeometry, pixel_px: FloatArray) -> MaskArray:
    """Return which of the pixels (n, 2) lie in the image."""
    size = np.array(geometry.image_size_px)
    return np.asarray(np.all((pixel_px >= -0.5) & (pixel_px <= size - 0.5), axis=1))


def _root(covariance: FloatArray) -> FloatArray:
    """Return a square root of a covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
