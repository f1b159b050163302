"""Weights near and beyond the border, and what they do to the covariance."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.ekf import StationEkf
from groundstation.estimation.field_of_view import paper_weight, probability_in_view
from tests.stereo_rig import aim, make_rig

SIZE = (1280, 960)


def test_probability_mass(rng: np.random.Generator) -> None:
    """Against sampling, in the middle, at the border, in a corner and outside."""
    for centre in ([640.0, 480.0], [-0.5, 480.0], [1279.5, 959.5], [1300.0, 400.0], [-400.0, 480.0]):
        sigma = np.array([30.0, 20.0])
        samples = rng.normal(centre, sigma, (40000, 2))
        inside = np.all((samples >= -0.5) & (samples <= np.array(SIZE) - 0.5), axis=1).mean()
        found = probability_in_view(np.array(centre), np.diag(sigma**2), SIZE)
        assert found == pytest.approx(inside, abs=0.01)


def test_the_papers_weight() -> None:
    assert paper_weight(np.array([0.0, 0.0]), SIZE, 50.0) == 1.0
    assert paper_weight(np.array([-50.5, 100.0]), SIZE, 50.0) == pytest.approx(np.exp(-0.5))
    assert paper_weight(np.array([-5000.0, 100.0]), SIZE, 50.0) < 1e-12


def started(weighting: OutOfViewWeighting, pan_off_rad: float, known: float = 1.0) -> StationEkf:
    rig = make_rig()
    config = replace(EstimationConfig(), out_of_view=weighting, gate_probability=1 - 1e-12)
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config)
    point = np.array([0.0, 150.0, 6.0])
    ekf.predict_to(0.0)
    for s in rig.stations:
        pan, tilt = aim(s.geometry(), point)
        ekf.set_angles(s.name, (pan + pan_off_rad, tilt), (0.0, 0.0), 1e-6)
    ekf.start_target(point, np.array([0.0, -20.0, -1.0]), np.diag([0.4, 4.0, 0.4, 1.0, 1.0, 1.0]) ** 2 * known)
    return ekf


@pytest.mark.parametrize("weighting", list(OutOfViewWeighting))
def test_well_inside_both_weightings_are_the_plain_update(weighting: OutOfViewWeighting) -> None:
    # so well that one look is as good as several
    ekf = started(weighting, 0.0, known=1e-4)
    plain = ExtendedKalmanFilter(dim_x=ekf.layout.size, dim_z=2)
    plain.x, plain.P = ekf.state.copy(), ekf.covariance.copy()
    prediction = ekf.predict_pixel("left")
    assert prediction is not None
    # as noisy as the prediction is uncertain: there is no second look at where to linearise
    z, R = prediction.pixel + [3.0, -2.0], np.eye(2) * 10.0**2
    ekf.update_pixel("left", z, R)
    plain.update(z, lambda _: prediction.jacobian, lambda _: prediction.pixel, R=R)
    np.testing.assert_allclose(ekf.state, plain.x, atol=1e-6)
    np.testing.assert_allclose(ekf.covariance, plain.P, atol=1e-6)


def test_beyond_the_border_the_consistent_form_keeps_its_doubt_and_the_papers_does_not() -> None:
    """With the prediction well outside, both hardly move; the consistent covariance stays, the paper's shrinks."""
    out = {}
    for weighting in OutOfViewWeighting:
        ekf = started(weighting, np.radians(6.5))
        before = ekf.covariance[ekf.layout.position, ekf.layout.position].copy()
        prediction = ekf.predict_pixel("left")
        assert prediction is not None
        assert not ekf._stations["left"].contains(prediction.pixel, margin_px=-50.0)
        ekf.update_pixel("left", prediction.pixel + [20.0, 0.0], np.eye(2))
        after = ekf.covariance[ekf.layout.position, ekf.layout.position]
        out[weighting] = float(after[0, 0] / before[0, 0])
    assert out[OutOfViewWeighting.CONSISTENT] > 0.9
    assert out[OutOfViewWeighting.PAPER] < 0.2
