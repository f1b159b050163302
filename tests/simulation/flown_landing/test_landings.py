"""Landings by JSBSim's aircraft in gusts: on the true state, on the stream alone, and when the stream falls silent."""

from functools import cache

import numpy as np
import pytest

from groundstation.errors import InputError
from groundstation.simulation.autopilot_receivers.landing_streams import SITE_FRAME
from groundstation.simulation.closed_loop import ClosedLoopFault, ClosedLoopFaultKind
from groundstation.simulation.flown_landing.gusty_wind import GustyWind, PlannedDescent, WindStrength
from groundstation.simulation.flown_landing.landing_flight import (
    FlownLanding,
    LandingFlight,
    LandingOutcome,
    LandingSetup,
    land_on_true_state,
)
from groundstation.simulation.flown_landing.landing_on_stream import LandingOnStream, land_on_stream

pytest.importorskip("jsbsim")

SHORT = LandingSetup(start_before_aim_m=150.0)
SEED = 3


@cache
def on_true_state() -> FlownLanding:
    return land_on_true_state(SHORT, SEED)


@cache
def on_stream() -> LandingOnStream:
    return land_on_stream(SHORT, SEED)


def test_it_lands_on_the_true_state_and_repeats() -> None:
    landing = on_true_state()
    assert landing.outcome is LandingOutcome.TOUCHDOWN
    assert 0.0 < landing.touchdown_m[0] < 90.0
    assert abs(landing.touchdown_m[1]) < 3.0
    assert 0.0 < landing.sink_m_s < 1.8
    np.testing.assert_array_equal(land_on_true_state(SHORT, SEED).touchdown_m, landing.touchdown_m)


def test_it_lands_on_the_stream_alone() -> None:
    streamed = on_stream()
    landing = streamed.landing
    assert landing.outcome is LandingOutcome.TOUCHDOWN
    # a decimetre of height at touchdown moves it by 4 m
    np.testing.assert_allclose(landing.touchdown_m, on_true_state().touchdown_m, atol=12.0)
    assert abs(landing.touchdown_m[1]) < 3.0
    assert 0.0 < landing.sink_m_s < 1.8
    assert streamed.samples > 50
    assert streamed.late == 0
    assert streamed.longest_gap_s < SHORT.plan.longest_gap_s


def test_the_height_on_the_stream_is_within_the_aim() -> None:
    for errors in (on_stream().station_errors_m, on_stream().vehicle_errors_m[400:]):
        assert len(errors) > 100
        assert np.sqrt(np.mean(errors[:, 2] ** 2)) < 0.3


def test_it_goes_around_when_the_stream_falls_silent() -> None:
    silent_s = 3.0
    faults = [
        ClosedLoopFault(kind=ClosedLoopFaultKind.CAMERA_LOST, station=name, from_s=silent_s, to_s=np.inf)
        for name in ("left", "right")
    ]
    streamed = land_on_stream(SHORT, SEED, faults=faults)
    assert streamed.landing.outcome is LandingOutcome.GO_AROUND
    # the stream is silent 0.3 s after the last picture, the radio takes up to 0.2 s, and the vehicle waits for 1 s
    assert silent_s + 1.0 < streamed.landing.t_s - 4.0 < silent_s + 1.7
    assert streamed.landing.sink_m_s < 0.0


def test_the_aircraft_is_similar_to_the_full_size_one() -> None:
    flight = LandingFlight(LandingSetup(wind=WindStrength(most_mean_m_s=0.0, gust_m_s=0.0)), 1)
    np.testing.assert_allclose(flight.runway_from_ned, SITE_FRAME.ned_from_runway.T, atol=1e-12)
    began = flight.true_position()
    forces = []
    for _ in range(800):
        flight.step(flight.true_position(), 0.0)
        forces.append(flight.aircraft.motion.specific_force_m_s2)
    known = flight.true_position()
    # four seconds at 18 m/s towards the stations in still air, and onto the path of 3.5 degrees from off it
    assert (known.position_runway_m - began.position_runway_m)[1] == pytest.approx(-72.0, abs=4.0)
    wheels = flight.wheels(known, 0.0).position_m
    assert wheels[2] == pytest.approx(np.tan(np.radians(3.5)) * (30.0 - wheels[0]), abs=0.4)
    # gravity is not scaled
    assert np.linalg.norm(np.mean(forces[200:], axis=0)) == pytest.approx(9.81, abs=0.3)
    nose = flight.position(np.array([flight.t_s]))[0] - known.position_runway_m
    assert nose[1] == pytest.approx(-0.42, abs=0.02)
    # its trajectory is one: velocity is the position's derivative
    at = np.array([1.9975, 2.0025])
    there = flight.position(at)
    np.testing.assert_allclose((there[1] - there[0]) / 0.005, flight.velocity(at)[0], atol=0.1)


def test_gusts_have_the_stated_size_and_the_wind_falls_off_at_the_ground() -> None:
    def drawn(seed: int) -> GustyWind:
        descent = PlannedDescent(height_m=27.0, sink_m_s=1.1, airspeed_m_s=18.0)
        return GustyWind(np.random.default_rng(seed), WindStrength(), descent, step_s=0.02, seconds=30.0)

    wind = drawn(5)
    assert np.hypot(wind.gusts_m_s[:, 0], wind.gusts_m_s[:, 1]).max() == pytest.approx(6.0)
    # vertical gusts are the smaller ones near the ground (MIL-F-8785C, figure 11)
    assert wind.gusts_m_s[:, 2].std() < 0.7 * wind.gusts_m_s[:, 1].std()
    np.testing.assert_array_equal(wind.gusts_m_s, drawn(5).gusts_m_s)
    assert np.abs(wind.gusts_m_s - drawn(6).gusts_m_s).max() > 1.0
    mean = [np.linalg.norm(wind.at(1.0, height) - wind.gusts_m_s[50]) for height in (0.5, 6.096, 27.0)]
    assert mean[0] < 0.6 * mean[1] < mean[2]
    assert wind.mean_m_s[0] <= 0.0


def test_a_negative_gust_is_refused() -> None:
    with pytest.raises(InputError, match="WindStrength: gust_m_s: got -1"):
        WindStrength(gust_m_s=-1.0)
