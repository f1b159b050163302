"""DGPS fixes: noise, clock, antenna, where they end and where they freeze."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.errors import ScenarioError
from groundstation.evaluation.position_series import nose_from_antenna, reference_from_fixes
from groundstation.simulation.approach import bound_glide
from groundstation.simulation.dgps import DgpsModel, antenna_positions, take_fixes
from groundstation.simulation.drawn_flights import FlightSpec, build_flight
from groundstation.simulation.flight_window import FlightWindow

SPAN = (0.0, 21.6)


def fixes(model: DgpsModel) -> tuple[np.ndarray, np.ndarray]:
    taken = take_fixes(model, bound_glide(), SPAN, np.random.default_rng(8))
    return np.array([f.t_s for f in taken]), np.array([f.position_runway_m for f in taken])


def test_noise() -> None:
    sigma = np.array([0.01, 0.02, 0.05])
    t, place = fixes(DgpsModel(rate_hz=100.0, sigma_m=sigma))
    squares = np.square((place - bound_glide().position(t)) / sigma)
    low, high = chi2.ppf([0.001, 0.999], len(t)) / len(t)
    assert np.all((low < squares.mean(axis=0)) & (squares.mean(axis=0) < high))


def test_clock() -> None:
    """t_dgps = t_session + offset + drift · t_session."""
    model = DgpsModel(sigma_m=np.zeros(3), clock_offset_s=0.3, clock_drift_ppm=1000.0)
    t, place = fixes(model)
    assert bound_glide().position((t - 0.3) / 1.001) == pytest.approx(place)


def test_antenna_is_where_the_evaluation_expects_it() -> None:
    antenna = np.array([-0.8, 0.1, -0.15])
    model = DgpsModel(sigma_m=np.zeros(3), antenna_in_body_m=antenna)
    taken = take_fixes(model, bound_glide(), SPAN, np.random.default_rng(8))
    reference = reference_from_fixes(taken)
    nose = nose_from_antenna(reference, antenna)
    assert nose.position_m == pytest.approx(bound_glide().position(nose.t_s), abs=1e-6)
    # flying along −y, right is −x: level, so y right and z down are seen at once
    level = antenna_positions(np.zeros((1, 3)), np.array([[0.0, -25.0, 0.0]]), antenna)
    assert level[0] == pytest.approx([-0.1, 0.8, 0.15])
    assert antenna_positions(np.zeros((1, 3)), np.zeros((1, 3)), antenna)[0] == pytest.approx([-0.1, 0.8, 0.15])


def test_antenna_turns_with_an_aircraft_that_has_its_own_attitude() -> None:
    crabbing = FlightSpec(crab_rad=np.radians(10.0), event_s=15.0)
    flown = build_flight(crabbing, 0)
    model = DgpsModel(sigma_m=np.zeros(3), antenna_in_body_m=np.array([-2.0, 0.0, 0.0]))
    first = take_fixes(model, flown, (1.0, 1.0), np.random.default_rng(0))[0]
    behind = first.position_runway_m - flown.position(np.array([1.0]))[0]
    # nose to the right of a track along −y: towards −x, so that the tail is on the +x side
    level = 2.0 * np.cos(crabbing.incidence_rad - crabbing.glide_rad)
    assert behind[:2] == pytest.approx([level * np.sin(np.radians(10.0)), level * np.cos(np.radians(10.0))], abs=1e-3)


def test_a_slow_error_wanders_and_is_stated() -> None:
    model = DgpsModel(sigma_m=np.full(3, 0.3), wander_sigma_m=np.full(3, 0.4), wander_s=5.0)
    errors = []
    for seed in range(60):
        taken = take_fixes(model, bound_glide(), SPAN, np.random.default_rng([seed, 3]))
        assert taken[0].sigma_m == pytest.approx(np.full(3, 0.5))
        t = np.array([f.t_s for f in taken])
        errors.append(np.array([f.position_runway_m for f in taken]) - bound_glide().position(t))
    off = np.array(errors)
    assert np.std(off) == pytest.approx(0.5, rel=0.05)
    # one second apart, the slow part is still e^(-1/5) of itself
    assert np.mean(off[:, :-10] * off[:, 10:]) == pytest.approx(0.16 * np.exp(-0.2), rel=0.15)


def test_availability() -> None:
    t, place = fixes(DgpsModel(sigma_m=np.zeros(3), available=FlightWindow(min_y_m=400.0)))
    assert place[:, 1].min() >= 400.0
    assert t[-1] == pytest.approx(8.0)


def test_freeze() -> None:
    """Fixes go on coming, and all are the last good one, noise included."""
    t, place = fixes(DgpsModel(frozen=FlightWindow(max_y_m=187.0)))
    frozen = bound_glide().position(t)[:, 1] <= 187.0
    assert frozen.sum() > 30
    assert np.all(place[frozen] == place[~frozen][-1])
    assert len(np.unique(place[~frozen], axis=0)) == (~frozen).sum()


def test_bad_parameters_are_refused() -> None:
    with pytest.raises(ScenarioError, match="DgpsModel: rate_hz"):
        DgpsModel(rate_hz=0.0)
    with pytest.raises(ScenarioError, match="DgpsModel: sigma_m"):
        DgpsModel(sigma_m=np.array([0.1, 0.1, -0.1]))
    with pytest.raises(ScenarioError, match=r"DgpsModel: wander_s: got 0\.0"):
        DgpsModel(wander_s=0.0)
    with pytest.raises(ScenarioError, match=r"antenna_in_body_m: got shape \(2,\); wanted shape \(3,\)"):
        DgpsModel(antenna_in_body_m=np.zeros(2))
