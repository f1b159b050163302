"""Where to look again: the ROI and the PTUs' regions hold a coasting target as often as they say."""

import numpy as np
import pytest
from scipy.stats import norm

from groundstation.detection.config import DetectionConfig
from groundstation.detection.roi import place_roi
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.ekf import StationEkf
from groundstation.search_region import pointing_region
from groundstation.simulation.approach import Glide
from groundstation.simulation.cases import drawn_glide
from tests.stereo_rig import aim, make_rig

PSD = (1.0, 4.0, 2.0)


def test_region_against_samples(rng: np.random.Generator) -> None:
    """Pan and tilt of points drawn from the covariance: their own covariance, and the box's share."""
    geometry = make_rig()["left"].geometry()
    point = np.array([5.0, 150.0, 12.0])
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 25.0, 2.0], [0.5, 2.0, 1.0]])
    region = pointing_region(geometry, point, covariance)
    assert region is not None
    assert (region.pan_rad, region.tilt_rad) == pytest.approx(aim(geometry, point))
    angles = np.array([aim(geometry, p) for p in rng.multivariate_normal(point, covariance, 600)])
    np.testing.assert_allclose(np.sqrt(np.diag(region.covariance_rad2)), angles.std(axis=0), rtol=0.12)
    off = np.abs(angles - [region.pan_rad, region.tilt_rad])
    inside = np.all(off <= [region.half_pan_rad, region.half_tilt_rad], axis=1)
    assert inside.mean() > 0.98


def test_one_view_or_more() -> None:
    geometry = make_rig()["left"].geometry()
    point = np.array([0.0, 200.0, 10.0])
    small, large = (pointing_region(geometry, point, np.eye(3) * s**2) for s in (2.0, 20.0))
    assert small is not None
    assert large is not None
    assert small.in_one_view
    assert not large.in_one_view
    assert large.half_pan_rad == pytest.approx(10.0 * small.half_pan_rad)


def test_a_point_that_cannot_be_aimed_at_has_none() -> None:
    station = make_rig()["left"]
    above = station.ptu_position_m + [0.0, 0.0, 50.0]
    assert pointing_region(station.geometry(), above, np.eye(3)) is None


def test_the_roi_holds_a_coasting_target() -> None:
    """Three sigmas beside the basic size, with nothing seen for 0.5 to 3 s: the prediction's 3-sigma box alone holds
    the target as often as normal errors are inside 3 sigmas; the whole ROI nearly always."""
    rig, config = make_rig(), DetectionConfig()
    inside_box, inside_roi = [], []
    for seed in range(60):
        rng = np.random.default_rng([seed, 8])
        path = drawn_glide(seed, PSD, Glide(start_y_m=350.0, end_y_m=220.0))
        ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, EstimationConfig())
        for t in np.arange(0.0, 5.0, 0.1):
            point, velocity = path.position(np.array([t]))[0], path.velocity(np.array([t]))[0]
            ekf.predict_to(t)
            if t == 0.0:
                start = rng.normal(0, 1.0, 6) * [1, 5, 1, 1, 2, 1]
                ekf.start_target(point + start[:3], velocity + start[3:], np.diag([1, 25, 1, 1, 4, 1.0]))
            for station in rig.stations:
                geometry = station.geometry()
                angles = aim(geometry, point)
                ekf.set_angles(station.name, angles, (0.0, 0.0), 3e-5)
                projection = geometry.project(point, *angles)
                assert projection is not None
                if t < 2.0:
                    ekf.update_pixel(station.name, projection.pixel + rng.normal(0, 0.5, 2), 0.25 * np.eye(2))
                elif t > 2.4 and round(t * 10) % 5 == 0:
                    expected = ekf.predict_pixel(station.name)
                    assert expected is not None
                    spread = ekf.pixel_covariance(expected)
                    roi = place_roi(expected.pixel, spread, None, config, geometry.image_size_px)
                    assert roi is not None
                    off = np.abs(projection.pixel - expected.pixel) / np.sqrt(np.diag(spread))
                    inside_box.append(bool(np.all(off <= config.roi_sigmas)))
                    u, v = projection.pixel
                    inside_roi.append(roi.x <= u <= roi.x + roi.w and roi.y <= v <= roi.y + roi.h)
    assert config.roi_sigmas == 3.0
    usual = (norm.cdf(3.0) - norm.cdf(-3.0)) ** 2
    assert np.mean(inside_box) > usual - 0.015
    assert np.mean(inside_roi) > 0.995
