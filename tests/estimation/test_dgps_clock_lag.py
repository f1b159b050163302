"""A step of a reference receiver's clock is distinguished from noise and from positions wrong in another way."""

import numpy as np
import pytest

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.dgps_clock_lag import has_clock_stepped
from groundstation.estimation.journal import FilterJournal
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.measurements import ReferencePosition
from tests.stereo_rig import make_rig

VELOCITY = np.array([0.2, -20.0, -1.0])
SPREAD = np.array([[0.02, 0.01, 0.0], [0.01, 0.2, 0.02], [0.0, 0.02, 0.03]]) ** 2 + np.diag([0.02, 0.2, 0.03]) ** 2
POINT = np.array([0.5, 250.0, 12.0])
CLOCK = "dgps_clock.offset"


def test_noise_is_called_a_step_as_often_as_three_sigmas_are_passed(rng: np.random.Generator) -> None:
    n = 20_000
    noise = rng.multivariate_normal(np.zeros(3), SPREAD, n)
    called = sum(has_clock_stepped(r, SPREAD, VELOCITY) for r in noise)
    expected = 0.0027 * n
    assert abs(called - expected) < 4.0 * np.sqrt(expected)


def test_a_shift_along_the_flight_is_a_step_and_one_across_is_not(rng: np.random.Generator) -> None:
    noise = rng.multivariate_normal(np.zeros(3), SPREAD, 200)
    for shift_s in (-0.1, 0.1):
        assert np.mean([has_clock_stepped(r + shift_s * VELOCITY, SPREAD, VELOCITY) for r in noise]) > 0.95
    aside = np.array([1.0, 0.0, 0.5])
    assert not any(has_clock_stepped(r + aside + 0.1 * VELOCITY, SPREAD, VELOCITY) for r in noise)
    assert not has_clock_stepped(aside, SPREAD, np.zeros(3))


@pytest.mark.parametrize("journal", [None, FilterJournal()])
def test_a_step_opens_the_clock_and_leaves_the_track(journal: FilterJournal | None) -> None:
    rig = make_rig()
    prior = ParameterPrior.independent([CLOCK], [0.5])
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, EstimationConfig(), prior, journal)
    ekf.predict_to(0.0)
    place = ekf.layout.parameters[CLOCK]
    ekf.start_target(POINT, VELOCITY, np.diag([1e-2] * 3 + [0.01] * 3))
    for _ in range(20):
        ekf.update_reference(ReferencePosition(POINT, 1e-4 * np.eye(3)))
    known_s = np.sqrt(ekf.covariance[place, place])
    ekf.update_reference(ReferencePosition(POINT, 1e-4 * np.eye(3)))
    assert np.sqrt(ekf.covariance[place, place]) <= known_s
    before = ekf.state[:3].copy()
    innovation = ekf.update_reference(ReferencePosition(POINT + 0.15 * VELOCITY, 1e-4 * np.eye(3)))
    assert innovation.accepted
    assert ekf.state[place] == pytest.approx(0.15, abs=0.02)
    np.testing.assert_allclose(ekf.state[:3], before, atol=0.05)
    # and where nothing but a wrong place explains it, it is refused as ever
    assert not ekf.update_reference(ReferencePosition(POINT + [5.0, 0.0, 0.0], 1e-4 * np.eye(3))).accepted
