"""JSBSim's take-off: rest, roll on its wheels, rotation and climb, scaled to the aircraft."""

import math
from functools import cache

import numpy as np
import pytest

from groundstation.errors import ScenarioError
from groundstation.simulation.airframes.trainer import REST_HEIGHT_PER_SPAN
from groundstation.simulation.flights import SPAN_M, FlightModelKind, FlightName, TruncatedTrajectory, flight
from groundstation.simulation.trajectory import Trajectory

REST_M = REST_HEIGHT_PER_SPAN * SPAN_M


def take_off(seed: int, wind_m_s: float) -> Trajectory:
    return flight(FlightName.TAKE_OFF, seed=seed, wind_m_s=wind_m_s, aircraft=FlightModelKind.JSBSIM)


# a take-off takes a second and a half of a core
flown_before = cache(take_off)


@pytest.mark.parametrize("wind_m_s", [0.0, 5.0])
def test_it_takes_off_as_an_aircraft_does(wind_m_s: float) -> None:
    """Expected: brakes, a roll of 60 to 120 m near the line, off at 14 to 17 m/s, a climb of 4 to 9 degrees."""
    flown = flown_before(1, wind_m_s)
    start_s, end_s = flown.span_s
    t = np.arange(start_s, end_s, 0.02)
    place, velocity = flown.position(t), flown.velocity(t)
    assert place[0] == pytest.approx([0.0, 300.0, REST_M], abs=1e-6)
    assert place[-1, 1] == pytest.approx(60.0, abs=0.5)
    # the brakes hold it until their release
    held = t < 1.0
    assert np.abs(place[held] - place[0]).max() < 0.02
    off = int(np.argmax(place[:, 2] > REST_M + 0.3))
    assert 60.0 < 300.0 - place[off, 1] < 120.0
    assert 14.0 < np.linalg.norm(velocity[off]) < 17.0
    roll = slice(0, off)
    assert np.abs(place[roll, 0]).max() < 3.0
    # its legs give, and the nose rises while it rotates
    assert place[:, 2].min() > REST_M - 0.1
    speed = -velocity[roll, 1]
    rolling = (speed > 1.0) & (speed < 12.0)
    accelerates = np.gradient(speed, 0.02)[rolling]
    assert 1.0 < np.median(accelerates) < 4.0
    climb = np.arctan2(velocity[-100:, 2].mean(), -velocity[-100:, 1].mean())
    assert math.radians(4.0) < climb < math.radians(9.0)


def test_it_is_the_same_for_the_same_seed_and_grows_with_the_wind() -> None:
    t = np.linspace(0.0, 20.0, 400)

    calm, breeze, windy = (flown_before(1, wind_m_s).position(t) for wind_m_s in (0.0, 2.0, 5.0))
    np.testing.assert_array_equal(take_off(1, 5.0).position(t), windy)
    apart = [np.abs(path - calm)[:, 0].max() for path in (breeze, windy)]
    assert 0.0 < apart[0] < apart[1]
    assert np.abs(windy - flown_before(4, 5.0).position(t)).max() > 0.1


def test_it_is_cut_short_and_refused_like_the_others() -> None:
    short = flight(FlightName.TAKE_OFF, duration_s=5.0, aircraft=FlightModelKind.JSBSIM)
    assert isinstance(short, TruncatedTrajectory)
    assert short.span_s == (0.0, 5.0)
    with pytest.raises(ScenarioError, match="wind_m_s"):
        flight(FlightName.TAKE_OFF, wind_m_s=30.0, aircraft=FlightModelKind.JSBSIM)


def test_it_leaves_the_line_to_either_side_and_is_steered_back() -> None:
    """Expected: with gusts the path crosses the line without a kink; distances without a sign would mirror it."""
    flown = flown_before(4, 5.0)
    t = np.arange(flown.span_s[0], flown.span_s[1], 0.02)
    across, speed = flown.position(t)[:, 0], flown.velocity(t)[:, 0]
    assert across.min() < 0.0 < across.max()
    assert np.abs(np.diff(speed)).max() / 0.02 < 12.0
    # off the line by metres, and back towards it: not away for the rest of the flight
    assert np.abs(across).max() < 15.0
