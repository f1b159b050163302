"""Weights near and beyond the border, and what they do to the covariance."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.out_of_view_weight import paper_weight, probability_in_view
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.miss_update import moments_after_miss
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
    # each border by its own size, and a corner by both distances
    assert paper_weight(np.array([1279.5 + 50.0, 100.0]), SIZE, 50.0) == pytest.approx(np.exp(-0.5))
    assert paper_weight(np.array([100.0, -0.5 - 50.0]), SIZE, 50.0) == pytest.approx(np.exp(-0.5))
    assert paper_weight(np.array([100.0, 959.5 + 50.0]), SIZE, 50.0) == pytest.approx(np.exp(-0.5))
    assert paper_weight(np.array([1279.5 + 30.0, 959.5 + 40.0]), SIZE, 50.0) == pytest.approx(np.exp(-0.5))


def sampled_after_miss(
    centre: np.ndarray, covariance: np.ndarray, detection_probability: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean, covariance and one sigma of the mean (px) by weighing draws: 1 − P_D inside the image, 1 outside."""
    draws = rng.multivariate_normal(centre, covariance, 200_000)
    inside = np.all((draws >= -0.5) & (draws <= np.array(SIZE) - 0.5), axis=1)
    weight = np.where(inside, 1.0 - detection_probability, 1.0)
    weight /= weight.sum()
    mean = weight @ draws
    away = draws - mean
    spread = (weight[:, None] * away).T @ away
    return mean, spread, float(np.sqrt((weight**2).sum() * np.trace(spread)))


BORDERS = {
    "left": (5.0, 480.0),
    "right": (1285.0, 480.0),
    "upper": (640.0, -8.0),
    "lower": (640.0, 955.0),
    "upper left": (10.0, 6.0),
    "lower right": (1270.0, 965.0),
}


@pytest.mark.parametrize("detection_probability", [0.5, 0.95])
@pytest.mark.parametrize(
    ("border", "correlation"),
    [(name, 0.0) for name in BORDERS] + [(name, 0.8) for name in ("left", "right", "upper", "lower")],
)
def test_what_a_miss_leaves_is_the_part_of_the_prediction_outside(
    rng: np.random.Generator, border: str, correlation: float, detection_probability: float
) -> None:
    """Against draws, in both axes by themselves: the mean moves out over the border that is near, the other axis
    follows by its correlation; in a corner both move."""
    sigma = np.array([40.0, 25.0])
    covariance = np.outer(sigma, sigma) * np.array([[1.0, correlation], [correlation, 1.0]])
    centre = np.array(BORDERS[border])
    mean, spread = moments_after_miss(centre, covariance, SIZE, detection_probability)
    wanted, wanted_spread, noise = sampled_after_miss(centre, covariance, detection_probability, rng)
    np.testing.assert_allclose(mean, wanted, atol=5.0 * noise)
    np.testing.assert_allclose(spread, wanted_spread, atol=0.02 * 40.0**2)
    assert np.abs(wanted - centre).max() > 20.0 * noise, "the draws show which way it goes"


def test_a_miss_far_inside_or_far_outside_has_a_negligible_effect() -> None:
    covariance = np.diag([30.0, 20.0]) ** 2
    for centre in ([640.0, 480.0], [-4000.0, 480.0], [640.0, 4000.0]):
        mean, spread = moments_after_miss(np.array(centre), covariance, SIZE, 0.9)
        np.testing.assert_allclose(mean, centre, atol=1e-6)
        np.testing.assert_allclose(spread, covariance, rtol=1e-6, atol=1e-9)


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
    # so well that one frame is as good as several
    ekf = started(weighting, 0.0, known=1e-4)
    plain = ExtendedKalmanFilter(dim_x=ekf.layout.size, dim_z=2)
    plain.x, plain.P = ekf.state.copy(), ekf.covariance.copy()
    prediction = ekf.predict_pixel("left")
    assert prediction is not None
    # as noisy as the prediction is uncertain: the linearisation is not iterated
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
