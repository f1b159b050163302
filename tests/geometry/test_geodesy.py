"""WGS 84 to a local frame, against values known from elsewhere."""

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.geometry.geodesy import SEMI_MAJOR_M, ecef_from_geodetic, enu_from_geodetic, geodetic_from_ecef


def test_the_same_places_as_pymap3d(rng: np.random.Generator) -> None:
    """Expected: 10 nm forward; back, pymap3d's latitude is the less exact one (µm)."""
    lat = np.concatenate([np.degrees(np.arcsin(rng.uniform(-1.0, 1.0, 2000))), [-90.0, 0.0, 90.0]])
    lon, height = rng.uniform(-180.0, 180.0, lat.size), rng.uniform(-1e3, 1e5, lat.size)
    ecef = ecef_from_geodetic(lat, lon, height)
    np.testing.assert_allclose(ecef, np.stack(pymap3d.geodetic2ecef(lat, lon, height), axis=-1), rtol=0.0, atol=1e-8)
    origin = (45.0, 7.0, 100.0)
    enu = enu_from_geodetic(lat, lon, height, origin)
    np.testing.assert_allclose(enu, np.stack(pymap3d.geodetic2enu(lat, lon, height, *origin), axis=-1), atol=2e-8)
    for own, theirs in zip(geodetic_from_ecef(ecef), pymap3d.ecef2geodetic(*ecef.T), strict=True):
        np.testing.assert_allclose(own[:-3], np.asarray(theirs)[:-3], rtol=0.0, atol=2e-8)


def test_known_places() -> None:
    """Equator, pole and the length of a degree of latitude at 45° (111.13 km)."""
    places = ecef_from_geodetic(np.array([0.0, 90.0]), np.array([0.0, 0.0]), np.zeros(2))
    assert places[0] == pytest.approx([SEMI_MAJOR_M, 0.0, 0.0])
    assert places[1] == pytest.approx([0.0, 0.0, 6_356_752.3142], abs=1e-3)
    steps = enu_from_geodetic(np.array([44.5, 45.5]), np.array([7.0, 7.0]), np.zeros(2), (45.0, 7.0, 0.0))
    assert np.diff(steps[:, 1])[0] == pytest.approx(111_131.8, rel=3e-5)


@given(lat=st.floats(-89.0, 89.0), lon=st.floats(-180.0, 180.0), height=st.floats(-100.0, 5000.0))
def test_the_origin_is_zero_and_up_is_up(lat: float, lon: float, height: float) -> None:
    here = enu_from_geodetic(
        np.array([lat, lat, lat + 1e-4]), np.full(3, lon), np.array([height, height + 10.0, height]), (lat, lon, height)
    )
    assert here[0] == pytest.approx(np.zeros(3), abs=1e-7)
    assert here[1] == pytest.approx([0.0, 0.0, 10.0], abs=1e-6)
    assert here[2, 0] == pytest.approx(0.0, abs=1e-6)
    assert 11.0 < here[2, 1] < 11.2
