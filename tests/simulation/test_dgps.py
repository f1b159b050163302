"""DGPS fixes: noise, clock, antenna, where they end and where they freeze."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.errors import ScenarioError
from groundstation.evaluation.position_series import nose_from_antenna, reference_from_fixes
from groundstation.simulation.approach import bound_glide
from groundstation.simulation.dgps import DgpsModel, antenna_positions, take_fixes
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


def test_antenna_is_where_the_evaluation_looks_for_it() -> None:
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
    with pytest.raises(ScenarioError, match=r"antenna_in_body_m: got shape \(2,\); wanted shape \(3,\)"):
        DgpsModel(antenna_in_body_m=np.zeros(2))
