"""Compilation of all kernels before the first frame, so that no frame is delayed by it."""

from functools import cache

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.candidate_finder import AcquisitionConfig
from groundstation.detection.channel_contrast import measure_channels
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.detector import DetectionHint
from groundstation.detection.detector import warm_up as warm_up_detector
from groundstation.detection.make_detector import make_detector, make_finder
from groundstation.detection.roi import place_roi
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.geometry import ray_kernels
from groundstation.geometry.camera import Lens
from groundstation.geometry.station import StationGeometry
from groundstation.integrity import leave_one_out
from groundstation.tracking.llvm_lock import drop_lock_events

_WIDTH, _HEIGHT = 640, 480
_SPAN_PX, _LARGE_SPAN_PX = 60.0, 320.0
# the search compares a frame with the two before it; a look at a target changes with what it has learnt in some frames
_SEARCHED, _FRAMES = 3, 10


@cache
def warm_up(kind: DetectorKind = DetectorKind.LEARNED) -> None:
    """Run every compiled kernel on a short made-up flight, once in a process, with the detector of this kind.

    Takes seconds the first time, then one second, in which the kernels are read from numba's cache.
    """
    drop_lock_events()
    lens = Lens(
        image_size_px=(_WIDTH, _HEIGHT),
        focal_px=np.array([1000.0, 1000.0]),
        principal_point_px=np.array([319.5, 239.5]),
        distortion=np.zeros(5),
    )
    geometry = _station(np.zeros(3), lens)
    geometry.project(np.array([0.0, 50.0, 0.0]), 0.0, 0.0)
    geometry.ray(10.0, 10.0, 0.0, 0.0)
    _warm_up_estimation(geometry)
    warm_up_detector()
    config = DetectionConfig(detector=kind)
    finder = make_finder(AcquisitionConfig(), config, lens)
    detector = make_detector(config, lens.image_size_px)
    pose = geometry.camera_pose(0.0, 0.0)
    for k in range(_FRAMES):
        place = np.array([250.0 + 8.0 * k, 200.0 + 3.0 * k])
        picture = _picture(place)
        if k < _SEARCHED:
            finder.find(picture, 0.3 * k, pose.runway_from_camera.T)
        hint = _hint(place, known=k > 1)
        roi = place_roi(place, hint.predicted_covariance_px2, None, config, lens.image_size_px)
        if roi is not None:
            detector.detect(picture, roi, hint)
    # a large target is looked at in a reduced picture
    place = np.array([320.0, 240.0])
    measure_channels(_picture(place), Box(0, 0, _WIDTH, _HEIGHT), np.eye(_HEIGHT, _WIDTH, dtype=np.bool_))
    hint = _hint(place, known=True, span_px=_LARGE_SPAN_PX)
    roi = place_roi(place, hint.predicted_covariance_px2, (_LARGE_SPAN_PX, 60.0), config, lens.image_size_px)
    if roi is not None:
        detector.reset()
        detector.detect(_picture(place, _LARGE_SPAN_PX), roi, hint)


def _warm_up_estimation(geometry: StationGeometry) -> None:
    """Run the filter's and the triangulation's kernels once."""
    names = (f"{geometry.name}.runway_from_base.z", f"{geometry.name}.ptu_clock.offset")
    prior = ParameterPrior.independent(names, (1e-4, 1e-3)).with_span(0.1)
    ekf = StationEkf({geometry.name: geometry}, (geometry.name,), EstimationConfig(), prior)
    ekf.predict_to(0.0)
    for k in range(2):
        ekf.update_encoder(geometry.name, (0.0, 0.0), 1e-3, 0.0, 0.0)
        ekf.predict_to(0.1 * (k + 1))
    ekf.start_target(np.array([0.0, 50.0, 0.0]), np.array([0.0, -20.0, 0.0]), np.eye(6))
    prediction = ekf.predict_pixel(geometry.name)
    if prediction is not None:
        ekf.update_pixel(geometry.name, prediction.pixel, np.eye(2), correlated_share=0.5)
        ekf.update_width(geometry.name, 40.0, 2.0, alone=True)
        ekf.update_miss(geometry.name, 0.9)
        ekf.update_reference(ReferencePosition(np.array([0.0, 50.0, 0.0]), np.eye(3)))
        ekf.kinematics_at(0.3)
    target = np.array([2.0, 50.0, 0.0])
    views = []
    for station in (geometry, _station(np.array([5.0, 0.0, 0.0]), geometry.lens)):
        projection = station.project(target, 0.0, 0.0)
        if projection is not None:
            views.append(
                TriangulationView(
                    station=station,
                    pixel=projection.pixel,
                    covariance_px2=np.eye(2),
                    pan_rad=0.0,
                    tilt_rad=0.0,
                    angle_sigma_rad=1e-4,
                )
            )
    triangulate(views)
    leave_one_out.warm_up()
    ray_kernels.warm_up(geometry.packed)


def _station(position_m: FloatArray, lens: Lens) -> StationGeometry:
    """Return a station (3,) that looks along y."""
    return StationGeometry(
        name="warm-up",
        ptu_position_m=position_m,
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
        camera_in_head_m=np.zeros(3),
        lens=lens,
    )


def _picture(place: FloatArray, span_px: float = _SPAN_PX) -> ImageArray:
    """Return textured ground with a dark cross of an aircraft on it, (h, w, 3)."""
    generator = np.random.default_rng(1)
    coarse = generator.integers(90, 170, (_HEIGHT // 16, _WIDTH // 16, 3), dtype=np.uint8)
    picture = np.repeat(np.repeat(coarse, 16, axis=0), 16, axis=1)
    u, v, half = int(place[0]), int(place[1]), int(span_px / 2)
    picture[v - 2 : v + 2, u - half : u + half] = 20
    picture[v - 6 : v + 12, u - 5 : u + 5] = 20
    return picture


def _hint(place: FloatArray, *, known: bool, span_px: float = _SPAN_PX) -> DetectionHint:
    """Return a hint, with the flight direction once it is ``known``."""
    return DetectionHint(
        predicted_px=place,
        predicted_covariance_px2=np.eye(2) * 9.0,
        expected_span_px=span_px,
        span_sigma_ratio=0.15,
        forward_px_per_m=np.array([0.5, 2.0]) if known else None,
        up_px_per_m=np.array([0.0, -26.0]),
        px_per_m=26.0,
        height_m=5.0 if known else None,
    )
