"""The simulated axis moves as a real one may: bounded speed and acceleration, play, stops."""

import math
import random

import numpy as np
import pytest

from ptu_drivers.simulated.axis import SimulatedAxis


def axis(play: float = 0.0) -> SimulatedAxis:
    return SimulatedAxis(low=-5000, high=5000, rate=1000, max_rate=2000, acceleration=4000, play=play)


def test_a_trapezoid_takes_its_time() -> None:
    a = axis()
    a.move_to(10.0, 2000)
    # v/a + d/v
    assert a.end_s() == pytest.approx(10.0 + 0.25 + 2.0)
    assert a.motor(10.25) == pytest.approx(125.0)
    assert a.motor(11.0) == pytest.approx(125.0 + 750.0)
    assert a.speed(11.0) == 1000.0
    assert a.motor(99.0) == 2000.0
    assert a.motor(9.0) == 0.0


def test_a_short_way_is_a_triangle() -> None:
    a = axis()
    a.move_to(0.0, 100)
    assert a.end_s() == pytest.approx(2 * math.sqrt(100 / 4000))


def test_speed_and_acceleration_are_bounded_for_any_command() -> None:
    rnd = random.Random(4)
    a = axis()
    t = 0.0
    for _ in range(300):
        t += rnd.uniform(0.0, 1.5)
        what = rnd.random()
        if what < 0.5:
            a.move_to(t, rnd.uniform(-6000, 6000), rnd.uniform(50, 3000))
        elif what < 0.9:
            a.move_at(t, rnd.uniform(-3000, 3000))
        else:
            a.halt(t)
    times = np.arange(0.0, t + 5.0, 0.001)
    where = np.array([a.motor(s) for s in times])
    speeds = np.array([a.speed(s) for s in times])
    assert where.min() >= -5000 - 1e-6
    assert where.max() <= 5000 + 1e-6
    assert np.abs(speeds).max() <= 2000 + 1e-6
    assert np.abs(np.diff(speeds)).max() <= 4000 * 0.001 * 1.01
    assert np.abs(np.diff(where) - 0.0005 * (speeds[1:] + speeds[:-1])).max() < 0.01


def test_the_head_lags_by_its_play_and_only_at_a_reversal() -> None:
    a = axis(play=20.0)
    a.move_to(0.0, 1000)
    assert a.head(5.0) == pytest.approx(990.0)
    a.move_to(6.0, 995)
    assert a.head(8.0) == pytest.approx(990.0)
    a.move_to(9.0, 500)
    assert a.head(12.0) == pytest.approx(510.0)


def test_without_power_it_stays_where_it_was() -> None:
    a = axis()
    a.move_to(0.0, 4000)
    a.freeze(1.0)
    assert a.motor(5.0) == a.motor(1.0)
    assert a.speed(1.5) == 0.0
