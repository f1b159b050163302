"""The covariance of a predicted pixel is the state's, seen through the prediction's derivative."""

from types import SimpleNamespace

import numpy as np

from groundstation.estimation.station_ekf import StationEkf


def test_it_is_the_states_covariance_through_the_jacobian(rng: np.random.Generator) -> None:
    root, jacobian = rng.normal(size=(7, 7)), rng.normal(size=(2, 7))
    core = SimpleNamespace(covariance=root @ root.T)
    found = StationEkf.pixel_covariance(core, SimpleNamespace(jacobian=jacobian))
    np.testing.assert_allclose(found, jacobian @ core.covariance @ jacobian.T, rtol=1e-9)
