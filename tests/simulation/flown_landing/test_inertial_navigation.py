"""The vehicle's filter: its covariance over a gap is honest, and late samples are refused and counted."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.errors import InputError
from groundstation.simulation.flown_landing.inertial_navigation import (
    InertialNavigation,
    InertialNavigationTuning,
    PositionSample,
    VehiclePosition,
)

STEP_S = 0.02
TUNING = InertialNavigationTuning()
START_SIGMA = np.array([3.0, 3.0, 3.0, 1.0, 1.0, 1.0])
POSITION_SIGMA, VELOCITY_SIGMA = np.array([0.5, 0.5, 0.75]), np.full(3, 0.3)


def sample(t_s: float, position: object = (0.0, 0.0, 0.0), velocity: object = (0.0, 0.0, 0.0)) -> PositionSample:
    return PositionSample(
        t_s=t_s,
        position_runway_m=np.asarray(position, dtype=np.float64),
        position_sigma_m=POSITION_SIGMA,
        velocity_runway_m_s=np.asarray(velocity, dtype=np.float64),
        velocity_sigma_m_s=VELOCITY_SIGMA,
    )


def at_rest() -> InertialNavigation:
    start = VehiclePosition(
        position_runway_m=np.zeros(3), velocity_runway_m_s=np.zeros(3), covariance=np.diag(START_SIGMA**2)
    )
    return InertialNavigation(0.0, start, TUNING)


def normalised_error(generator: np.random.Generator, gap_s: float) -> float:
    """Fly two seconds on samples that are 0.2 s late, then ``gap_s`` without; return the squared error, 6 degrees."""
    off = generator.normal(size=6) * START_SIGMA
    navigation = InertialNavigation(
        0.0, VehiclePosition(position_runway_m=off[:3], velocity_runway_m_s=off[3:], covariance=np.diag(START_SIGMA**2))
    )
    error = np.array(TUNING.error_m_s2) * generator.normal(size=3)
    walk = np.array(TUNING.error_m_s2) * np.sqrt(STEP_S / TUNING.error_s)
    position, velocity = np.zeros(3), np.zeros(3)
    past = [(0.0, position, velocity)]
    for k in range(1, round((2.0 + gap_s) / STEP_S) + 1):
        t_s = k * STEP_S
        true = 3.0 * np.sin([t_s, 2.0 * t_s, 3.0 * t_s])
        white = np.sqrt(TUNING.acceleration_psd_m2_s3 / STEP_S) * generator.normal(size=3)
        error = error + walk * generator.normal(size=3)
        position = position + STEP_S * velocity + 0.5 * STEP_S**2 * true
        velocity = velocity + STEP_S * true
        past.append((t_s, position, velocity))
        navigation.accelerate(t_s, true - error + white)
        if k % 10 == 0 and t_s <= 2.0:
            then_s, there, speed = past[k - 10]
            noise = generator.normal(size=(2, 3))
            taken = sample(then_s, there + POSITION_SIGMA * noise[0], speed + VELOCITY_SIGMA * noise[1])
            assert navigation.take(taken)
    known = navigation.now()
    off = np.concatenate([known.position_runway_m - position, known.velocity_runway_m_s - velocity])
    return float(off @ np.linalg.solve(known.covariance, off))


@pytest.mark.parametrize("gap_s", [0.2, 1.0])
def test_the_covariance_over_a_gap_is_honest(gap_s: float) -> None:
    generator, flights = np.random.default_rng(7), 60
    total = sum(normalised_error(generator, gap_s) for _ in range(flights))
    low, high = chi2.ppf([0.001, 0.999], 6 * flights)
    assert low < total < high


def test_a_position_is_carried_on_by_the_accelerations() -> None:
    navigation = at_rest()
    for k in range(1, 101):
        navigation.accelerate(0.01 * k, np.array([0.0, -2.0, 0.0]))
    known = navigation.now()
    np.testing.assert_allclose(known.position_runway_m, [0.0, -1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(known.velocity_runway_m_s, [0.0, -2.0, 0.0], atol=1e-9)


def test_a_late_sample_and_one_of_the_future_are_refused_and_counted() -> None:
    navigation = at_rest()
    navigation.accelerate(0.5, np.zeros(3))
    assert navigation.take(sample(0.3))
    before = navigation.now()
    assert not navigation.take(sample(0.2, [9.0, 9.0, 9.0]))
    assert not navigation.take(sample(0.6, [9.0, 9.0, 9.0]))
    assert navigation.late == 2
    np.testing.assert_array_equal(navigation.now().position_runway_m, before.position_runway_m)


def test_a_sample_without_a_velocity_leaves_it_to_the_positions() -> None:
    navigation = at_rest()
    navigation.accelerate(0.5, np.zeros(3))
    plain = PositionSample(
        t_s=0.5,
        position_runway_m=np.zeros(3),
        position_sigma_m=POSITION_SIGMA,
        velocity_runway_m_s=None,
        velocity_sigma_m_s=VELOCITY_SIGMA,
    )
    assert navigation.take(plain)
    sigma = np.sqrt(np.diag(navigation.now().covariance))
    np.testing.assert_array_less(sigma[:3], POSITION_SIGMA)
    np.testing.assert_array_less(VELOCITY_SIGMA, sigma[3:])


def test_time_does_not_go_back() -> None:
    navigation = at_rest()
    navigation.accelerate(0.5, np.zeros(3))
    with pytest.raises(InputError, match=r"got 0\.5 s; wanted after 0\.5 s"):
        navigation.accelerate(0.5, np.zeros(3))
