"""Which way an aircraft points: gusts move its path, not its attitude; near the ground the attitude moves the path."""

import math

import numpy as np
import pytest

from groundstation.tracking.flight_direction import FlightDirection

_STEP_S = 0.1
_SURE = 0.1 * np.eye(3)


def along(pitch_rad: float, speed_m_s: float = 20.0) -> np.ndarray:
    return speed_m_s * np.array([0.0, -math.cos(pitch_rad), math.sin(pitch_rad)])


def pitch_of(direction: np.ndarray | None) -> float:
    assert direction is not None
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    return math.atan2(direction[2], -direction[1])


def test_gusts_do_not_turn_it() -> None:
    """A path that waves by 0.06 rad every 1.5 s about a glide of 0.05: the attitude stays the glide's to a third."""
    direction = FlightDirection()
    pitches = []
    for k in range(150):
        t = k * _STEP_S
        pitches.append(pitch_of(direction.at(t, along(-0.05 + 0.06 * math.sin(2 * math.pi * t / 1.5)), _SURE, 30.0)))
    assert np.abs(np.array(pitches[60:]) + 0.05).max() < 0.02


def test_near_the_ground_it_follows_a_rotation() -> None:
    """Half a second after the path bent by 0.2 rad: seven tenths of that near the runway, a quarter high up."""
    low, high = FlightDirection(), FlightDirection()
    for k in range(60):
        low.at(k * _STEP_S, along(0.0), _SURE, 0.5)
        high.at(k * _STEP_S, along(0.0), _SURE, 30.0)
    for k in range(60, 65):
        after_low = low.at(k * _STEP_S, along(0.2), _SURE, 0.5)
        after_high = high.at(k * _STEP_S, along(0.2), _SURE, 30.0)
    assert pitch_of(after_low) > 0.14
    assert pitch_of(after_high) < 0.06


def test_an_unsure_velocity_is_not_remembered() -> None:
    """A filter that has just begun may have the sign wrong; only its later, certain direction counts."""
    direction = FlightDirection()
    wrong = np.array([0.0, 38.0, 2.0])
    first = direction.at(0.0, wrong, 150.0 * np.eye(3), 1.0)
    assert first is not None
    assert first @ wrong > 0
    assert pitch_of(direction.at(0.1, along(0.0), _SURE, 1.0)) == pytest.approx(0.0, abs=1e-9)


def test_a_target_that_halts_keeps_its_last_direction() -> None:
    direction = FlightDirection()
    assert direction.at(0.0, np.zeros(3), _SURE, 0.5) is None
    for k in range(1, 20):
        direction.at(k * _STEP_S, along(0.0), _SURE, 0.5)
    assert pitch_of(direction.at(5.0, np.array([1.0, 0.2, 0.0]), _SURE, 0.5)) == pytest.approx(0.0, abs=1e-9)
    direction.reset()
    assert direction.at(6.0, np.zeros(3), _SURE, 0.5) is None


def test_an_older_frame_has_no_effect() -> None:
    direction = FlightDirection()
    for k in range(20):
        direction.at(k * _STEP_S, along(0.0), _SURE, 0.5)
    assert pitch_of(direction.at(1.0, along(0.5), _SURE, 0.5)) == pytest.approx(0.0, abs=1e-9)


def test_it_says_how_sure_it_is() -> None:
    """By the velocities that it remembers; where it has none, by the present one; of a new target, not at all."""
    direction = FlightDirection()
    direction.at(0.0, along(0.0), 150.0 * np.eye(3), 1.0)
    for k in range(1, 31):
        direction.at(k * _STEP_S, along(0.0), 0.4 * np.eye(3), 1.0)
        assert math.isinf(direction.sigma_rad) == (k < 15)
    assert direction.sigma_rad == pytest.approx(math.sqrt(3 * 0.4) / 20.0)
    direction.at(5.0, np.array([0.0, -0.1, 0.0]), 150.0 * np.eye(3), 1.0)
    assert direction.sigma_rad == pytest.approx(math.sqrt(3 * 0.4) / 20.0)
    direction.reset()
    direction.at(6.0, along(0.0, 4.0), 150.0 * np.eye(3), 1.0)
    assert math.isinf(direction.sigma_rad)
    direction.at(8.0, along(0.0, 4.0), 150.0 * np.eye(3), 1.0)
    assert 3.0 < direction.sigma_rad < 10.0
