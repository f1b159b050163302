"""Runs of rejected pixels: outliers do not contradict the filter, a smooth path past its prediction does."""

import numpy as np
import pytest

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.rejected_pixels import RejectedPixels
from groundstation.estimation.station_ekf import StationEkf
from tests.stereo_rig import make_rig

NOISE = np.eye(2)


def run(residuals: np.ndarray, rate_hz: float = 30.0) -> RejectedPixels:
    state = RejectedPixels().accepted(0.0)
    for k, residual in enumerate(residuals):
        state = state.rejected("left", 1.0 + k / rate_hz, residual, NOISE)
    return state


def path(count: int, seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return np.array([60.0, -40.0]) + np.outer(np.arange(count), [3.0, 1.0]) + generator.normal(0.0, 1.0, (count, 2))


def test_smooth_paths_contradict_after_a_third_of_a_second() -> None:
    for rate_hz, looks in ((30.0, 11), (60.0, 20), (10.0, 5)):
        found = [run(path(looks, seed), rate_hz).contradict for seed in range(200)]
        # the bound is a 99.9 % one
        assert np.mean(found) > 0.98
        # too few looks, or too short a time
        assert not any(run(path(4, seed), 8.0).contradict for seed in range(20))
        assert not any(run(path(5, seed), 20.0).contradict for seed in range(20))


def test_outliers_do_not_contradict() -> None:
    generator = np.random.default_rng(4)
    assert not any(run(generator.normal(0.0, 50.0, (12, 2))).contradict for _ in range(200))


def test_another_camera_or_an_accepted_pixel_ends_a_run() -> None:
    state = run(path(12, 1))
    assert state.contradict
    assert not state.accepted(2.0).contradict
    assert not state.rejected("right", 1.4, np.zeros(2), NOISE).contradict


@pytest.mark.parametrize("lasting_share", [0.0, 0.4])
def test_pixels_of_the_own_detector_are_not_believed(lasting_share: float) -> None:
    """A thing that stands next to the prediction is on a smooth path past it, too; a label is the target's."""
    geometries = {s.name: s.geometry() for s in make_rig(fixed=True).stations}
    ekf = StationEkf(geometries, (), EstimationConfig())
    ekf.predict_to(0.0)
    ekf.start_target(np.array([0.0, 300.0, 2.0]), np.array([0.0, -20.0, 0.0]), np.diag([0.1] * 3 + [0.5] * 3))
    for k in range(12):
        ekf.predict_to(0.1 * (k + 1))
        for name in geometries:
            seen = ekf.predict_pixel(name)
            assert seen is not None
            ekf.update_pixel(name, seen.pixel, NOISE, correlated_share=lasting_share)
    prediction = ekf.predict_pixel("left")
    assert prediction is not None
    wrong = prediction.pixel + [150.0, 20.0]
    accepted = []
    for k in range(6):
        ekf.predict_to(1.2 + 0.1 * (k + 1))
        innovation = ekf.update_pixel("left", wrong, NOISE, correlated_share=lasting_share)
        accepted.append(innovation is not None and innovation.accepted)
    assert any(accepted) == (lasting_share == 0.0)


def test_doubt_covers_what_was_seen() -> None:
    """The pixel's residual is one sigma of the widened prediction, the velocity's by the time without pixels."""
    state = run(path(12, 1))
    jacobian = np.array([[20.0, 1.0, 0.0], [0.5, 2.0, -20.0]])
    doubt = state.doubt(jacobian)
    residual = state.run[-1].residual_px
    S = jacobian @ doubt[:3, :3] @ jacobian.T
    assert residual @ np.linalg.solve(S, residual) <= 1.0 + 1e-9
    since_s = state.run[-1].t_s - 0.0
    np.testing.assert_allclose(np.diag(doubt)[3:], np.diag(doubt)[:3] / since_s**2)
