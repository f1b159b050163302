"""The Jacobian of the pixel model against numeric differences, over the whole state."""

import numpy as np
import pytest

from groundstation.estimation.state_model import state_layout
from groundstation.estimation.updates.pixel_model import PixelModel
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
