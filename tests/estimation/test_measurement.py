"""The measurement models' Jacobians against numeric twins, over the whole state."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.estimation.compiled_filter import CompiledKalmanFilter
from groundstation.estimation.imm import ImmFilter
from groundstation.estimation.measurement import EncoderModel, PixelModel
from groundstation.estimation.state import state_layout
from tests.stereo_rig import aim, make_rig


@pytest.mark.parametrize("row_dt_s", [0.0, 0.012, -0.02])
@pytest.mark.parametrize("point", [(0.5, 10.0, 2.0), (1.0, 200.0, 8.0), (-3.0, 5000.0, 300.0), (0.3, 1.0, 40.0)])
def test_pixel_jacobian(rng: np.random.Generator, row_dt_s: float, point: tuple[float, float, float]) -> None:
    """At 10 m, 200 m, 5 km and nearly overhead, with and without a rolling shutter."""
    rig = make_rig()
    layout = state_layout(rig.names)
    x = np.zeros(layout.size)
    x[layout.position] = point
    x[layout.velocity] = rng.normal(0, 15, 3)
    geometries = {s.name: s.geometry() for s in rig.stations}
    for name in rig.names:
        x[layout.angles[name]] = np.array(aim(geometries[name], np.array(point))) + rng.normal(0, 0.01, 2)
        x[layout.rates[name]] = rng.normal(0, 0.2, 2)
    for name in rig.names:
        prediction = PixelModel(layout, geometries[name]).predict(x, row_dt_s)
        assert prediction is not None
        twin = np.zeros_like(prediction.jacobian)
        for k in range(layout.size):
            h = 1e-6 if k >= 6 else 1e-5 * max(1.0, float(np.linalg.norm(point)))
            d = np.zeros(layout.size)
            d[k] = h
            ahead = PixelModel(layout, geometries[name]).predict(x + d, row_dt_s)
            back = PixelModel(layout, geometries[name]).predict(x - d, row_dt_s)
            assert ahead is not None
            assert back is not None
            twin[:, k] = (ahead.pixel - back.pixel) / (2 * h)
        scale = np.abs(twin).max(axis=0) + 1e-9
        np.testing.assert_allclose(prediction.jacobian / scale, twin / scale, atol=1e-5)


def test_encoder_jacobian_looks_ahead() -> None:
    layout = state_layout(("left", "right"))
    x = np.zeros(layout.size)
    x[layout.angles["right"]] = 0.1, 0.2
    x[layout.rates["right"]] = 1.0, -2.0
    expected = EncoderModel(layout, "right").predict(x, 0.01)
    np.testing.assert_allclose(expected.value, [0.11, 0.18])
    np.testing.assert_allclose(expected.jacobian @ x, [0.11, 0.18])


@pytest.mark.parametrize(("off_rad", "accepted"), [(0.002, True), (0.5, False)])
def test_a_fused_reading_is_the_plain_filters_update(rng: np.random.Generator, off_rad: float, accepted: bool) -> None:
    """The kernel against the written-out equations; a reading beyond the gate leaves everything as it was."""
    layout = state_layout(("left", "right"))
    n, model = layout.size, EncoderModel(layout, "right")
    root = 0.01 * rng.normal(size=(n, n))
    x, P = rng.normal(size=n), root @ root.T + 1e-6 * np.eye(n)
    bank, plain = ImmFilter(n, (5.0,)), CompiledKalmanFilter(dim_x=n, dim_z=2)
    bank.set_states(slice(0, n), x, P)
    plain.x, plain.P = x.copy(), P.copy()
    ahead_s, variance, clock_s = 0.02, 1e-6, 1e-3
    expected = model.predict(x, ahead_s)
    R = np.diag(variance + (clock_s * x[layout.rates["right"]]) ** 2)
    plain.correct(np.full(2, off_rad), expected.jacobian, R)
    # a whole turn more is the same angle
    pan, tilt = expected.value + off_rad + np.array([2.0 * np.pi, 0.0])
    square = model.squares(bank.x, bank.P, (pan, tilt), ahead_s, variance, clock_s)
    read = model.fuse(bank, (pan, tilt), ahead_s, variance, clock_s, 6.0, np.ones(n, np.bool_))
    assert read.accepted is accepted
    np.testing.assert_allclose(read.residual, off_rad, atol=1e-12)
    np.testing.assert_allclose(read.covariance, plain.S, rtol=1e-9)
    assert (
        read.nis
        == pytest.approx(square)
        == pytest.approx(float(read.residual @ np.linalg.solve(plain.S, read.residual)))
    )
    np.testing.assert_allclose(bank.x, plain.x if accepted else x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(bank.P, plain.P if accepted else P, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("carried", [True, False])
def test_a_units_clock_is_carried_where_the_state_has_it(carried: bool) -> None:
    plain = state_layout(("left", "right"))
    parameters = {"left.ptu_clock.offset": 1} | ({"right.ptu_clock.offset": 2} if carried else {})
    layout = SimpleNamespace(angles=plain.angles, rates=plain.rates, parameters=parameters)
    assert EncoderModel(layout, "right").carries_clock is carried
