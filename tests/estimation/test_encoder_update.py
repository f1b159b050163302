"""The update with a PTU reading against the written-out equations."""

import numpy as np
import pytest

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.filterpy_ekf import FilterpyEkf
from groundstation.estimation.imm import ImmFilter
from groundstation.estimation.kalman_kernels import LinearMeasurement
from groundstation.estimation.state_model import state_layout
from groundstation.estimation.updates.encoder_update import EncoderUpdate
from groundstation.estimation.updates.measurements import EncoderReading
from groundstation.estimation.updates.update import CorrectedModes, PredictedState, VarianceInflation


def test_encoder_jacobian_includes_the_rate_ahead_of_the_filter_time() -> None:
    layout = state_layout(("left", "right"))
    x = np.zeros(layout.size)
    x[layout.angles["right"]] = 0.1, 0.2
    x[layout.rates["right"]] = 1.0, -2.0
    expected = EncoderUpdate(layout, "right", EstimationConfig()).predict(x, 0.01)
    np.testing.assert_allclose(expected.value, [0.11, 0.18])
    np.testing.assert_allclose(expected.jacobian @ x, [0.11, 0.18])


@pytest.mark.parametrize(("off_rad", "accepted"), [(0.002, True), (0.5, False)])
def test_a_fused_reading_is_the_plain_filters_update(rng: np.random.Generator, off_rad: float, accepted: bool) -> None:
    """The kernel against the written-out equations; a reading beyond the gate inflates the angle variances."""
    layout = state_layout(("left", "right"))
    n, model = layout.size, EncoderUpdate(layout, "right", EstimationConfig())
    root = 0.01 * rng.normal(size=(n, n))
    x, P = rng.normal(size=n), root @ root.T + 1e-6 * np.eye(n)
    bank, plain = ImmFilter(n, (5.0,)), FilterpyEkf(x, P)
    bank.set_states(slice(0, n), x, P)
    ahead_s, variance, clock_s = 0.02, 1e-6, 1e-3
    expected = model.predict(x, ahead_s)
    R = np.diag(variance + (clock_s * x[layout.rates["right"]]) ** 2)
    plain.set_measurement(LinearMeasurement(np.full(2, off_rad), expected.jacobian, R))
    plain.update(np.full(2, off_rad))
    # a whole turn more is the same angle
    pan, tilt = expected.value + off_rad + np.array([2.0 * np.pi, 0.0])
    reading = EncoderReading(pan, tilt, ahead_s, variance, clock_s)
    square = model.nis(bank.x, bank.P, reading)
    read, correction = model(PredictedState(bank.state, np.ones(n, np.bool_), 0.0), reading)
    assert read is not None
    assert read.accepted is accepted
    np.testing.assert_allclose(read.residual, off_rad, atol=1e-12)
    np.testing.assert_allclose(read.covariance, plain.S, rtol=1e-9)
    assert (
        read.nis
        == pytest.approx(square)
        == pytest.approx(float(read.residual @ np.linalg.solve(plain.S, read.residual)))
    )
    if accepted:
        assert isinstance(correction, CorrectedModes)
        np.testing.assert_allclose(correction.imm.mean, plain.x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(correction.imm.covariance, plain.P, rtol=1e-9, atol=1e-14)
    else:
        assert isinstance(correction, VarianceInflation)
        np.testing.assert_allclose(correction.variances, off_rad**2)


@pytest.mark.parametrize("carried", [True, False])
def test_clock_sigma_is_noise_unless_the_clock_error_is_a_state(carried: bool) -> None:
    parameters = ["left.ptu_clock.offset", *(["right.ptu_clock.offset"] if carried else [])]
    layout = state_layout(("left", "right"), parameters)
    reading = EncoderUpdate(layout, "right", EstimationConfig()).reading((0.1, 0.2), 1e-4, 1e-3, 0.0)
    assert reading.clock_sigma_s == (0.0 if carried else 1e-3)
