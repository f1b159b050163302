"""A camera's pixels: noise, misses, outliers, border and rolling shutter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2, kstest

from groundstation.errors import ScenarioError
from groundstation.simulation.approach import GlideApproach, weaving_approach
from groundstation.simulation.detection_camera import CameraModel, SimulatedDetections, isotropic, simulate_detections
from groundstation.simulation.flight_window import FlightWindow
from groundstation.simulation.pointing import FixedPointing, IdealPointing, PointingModel, pointing_history
from groundstation.simulation.standard_cases import standard_station
from groundstation.simulation.trajectory import Trajectory

STATION = standard_station("left", -5.385)


def detections(
    model: CameraModel,
    *,
    count: int = 4000,
    pointing: PointingModel | None = None,
    track: Trajectory | None = None,
    readout_s: float = 0.0,
    seed: int = 3,
) -> SimulatedDetections:
    flown = weaving_approach() if track is None else track
    history = pointing_history(pointing or IdealPointing(), STATION.geometry(), flown, flown.span_s)
    t = np.linspace(*flown.span_s, count)
    return simulate_detections(model, STATION.geometry(), readout_s, history, flown, t, np.random.default_rng(seed))


def test_pixel_noise_has_its_covariance() -> None:
    covariance = np.array([[0.5, 0.3], [0.3, 1.2]])
    seen = detections(CameraModel(pixel_covariance_px2=covariance))
    errors = seen.reported_px - seen.pixel_px
    nees = np.einsum("ni,ij,nj->", errors, np.linalg.inv(covariance), errors)
    low, high = chi2.ppf([0.001, 0.999], errors.size)
    assert low < nees < high
    assert np.cov(errors.T) == pytest.approx(covariance, abs=0.12)
    assert np.all(seen.reported)


def test_misses_have_their_share() -> None:
    seen = detections(CameraModel(miss_probability=0.2))
    low, high = binom.ppf([0.001, 0.999], seen.reported.size, 0.8)
    assert low < seen.reported.sum() < high


def test_misses_come_in_stretches_of_time_and_place() -> None:
    windows = (FlightWindow(from_s=2.0, to_s=3.0), FlightWindow(max_y_m=100.0))
    seen = detections(CameraModel(miss_windows=windows))
    y = weaving_approach().position(seen.t_s)[:, 1]
    assert np.array_equal(seen.reported, ~(((seen.t_s >= 2.0) & (seen.t_s <= 3.0)) | (y <= 100.0)))


def test_outliers_have_their_share_and_are_uniform() -> None:
    seen = detections(CameraModel(outlier_probability=0.1, outlier_range_px=80.0))
    low, high = binom.ppf([0.001, 0.999], seen.outlier.size, 0.1)
    assert low < seen.outlier.sum() < high
    off = (seen.reported_px - seen.pixel_px)[seen.outlier]
    assert np.abs(off).max() <= 80.0
    assert kstest(off.ravel() / 160.0 + 0.5, "uniform").pvalue > 0.001
    assert np.abs((seen.reported_px - seen.pixel_px)[~seen.outlier]).max() < 6 * 0.5


def test_one_parameter_does_not_redraw_the_others() -> None:
    plain, missing = detections(CameraModel()), detections(CameraModel(miss_probability=0.3))
    assert np.array_equal(plain.reported_px, missing.reported_px)


def test_a_target_outside_the_image_gives_no_pixel() -> None:
    """With a head at rest the target passes through the image, and no pixel outside the image is reported."""
    track = GlideApproach(start_y_m=200.0, end_y_m=10.0, slope_rad=0.0, aim_y_m=0.0)
    seen = detections(
        CameraModel(pixel_covariance_px2=isotropic(5.0)), pointing=FixedPointing(pan_rad=-0.06), track=track
    )
    inside = np.all((seen.pixel_px >= -0.5) & (seen.pixel_px <= [1279.5, 959.5]), axis=1)
    assert 0.1 < inside.mean() < 0.9
    assert np.array_equal(seen.visible, inside)
    assert not np.any(seen.reported & ~seen.visible)
    assert np.all((seen.reported_px[seen.reported] >= -0.5) & (seen.reported_px[seen.reported] <= [1279.5, 959.5]))


def test_a_target_behind_the_camera_gives_no_pixel() -> None:
    track = GlideApproach(start_y_m=-20.0, end_y_m=-50.0, slope_rad=0.0)
    seen = detections(CameraModel(), pointing=FixedPointing(), track=track)
    assert not np.any(seen.visible)
    assert np.all(seen.pixel_px == 0.0)


def test_a_rolling_shutter_exposes_each_row_at_its_time() -> None:
    """The pixel is where the target is seen at the instant of the pixel's own row."""
    track = GlideApproach(start_y_m=120.0, end_y_m=60.0)
    tilt = np.radians(1.0)
    rolled = detections(
        CameraModel(), pointing=FixedPointing(pan_rad=-0.05, tilt_rad=tilt), track=track, readout_s=0.03, count=50
    )
    geometry = STATION.geometry()
    rows_s = ((rolled.pixel_px[:, 1] + 0.5) / 960 - 0.5) * 0.03
    for k in np.flatnonzero(rolled.visible):
        there = track.position(rolled.t_s[k : k + 1] + rows_s[k])[0]
        projection = geometry.project(there, -0.05, tilt)
        assert projection is not None
        assert projection.pixel == pytest.approx(rolled.pixel_px[k], abs=1e-6)
    still = detections(CameraModel(), pointing=FixedPointing(pan_rad=-0.05, tilt_rad=tilt), track=track, count=50)
    assert np.abs(still.pixel_px - rolled.pixel_px)[rolled.visible].max() > 1.0


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"miss_probability: got 1.5; wanted a number from 0 to 1"):
        CameraModel(miss_probability=1.5)
    with pytest.raises(ScenarioError, match="without a negative variance"):
        CameraModel(pixel_covariance_px2=np.diag([1.0, -1.0]))
    with pytest.raises(ScenarioError, match=r"shape \(3,\)"):
        replace(CameraModel(), pixel_covariance_px2=np.ones(3))
