"""Flights by JSBSim: they repeat, turbulence grows with the wind, and the path is still a landing's."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.simulation.flights import FlightModelKind, FlightName, flight
from groundstation.simulation.jsbsim_model import fly_by_jsbsim


def roughness(wind_m_s: float, seed: int = 3) -> float:
    motion = fly_by_jsbsim(seed=seed, samples=500, rate_hz=50.0, glide_rad=0.07, wind_m_s=wind_m_s)
    # of the acceleration, so that the glide itself and its slow waves do not count
    return float(np.diff(motion.velocity_m_s[100:], n=2, axis=0).std())


def test_turbulence_grows_with_the_wind() -> None:
    still, some, strong = (roughness(wind) for wind in (0.0, 3.0, 9.0))
    assert still < some < strong
    assert strong > 2.0 * still


def test_it_repeats_and_seeds_differ() -> None:
    assert roughness(3.0) == roughness(3.0)
    assert roughness(3.0) != roughness(3.0, seed=4)
    assert roughness(3.0, seed=0) != roughness(3.0, seed=1)


def test_it_leaves_nothing_where_it_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    roughness(3.0)
    assert not list(tmp_path.iterdir())


def test_a_landing_in_turbulence_is_still_one() -> None:
    plain = flight(FlightName.LANDING)
    rough = flight(FlightName.LANDING, seed=3, wind_m_s=5.0, aircraft=FlightModelKind.JSBSIM)
    t = np.linspace(*plain.span_s, 200)
    off = rough.position(t) - plain.position(t)
    assert 0.1 < np.abs(off[:100]).max() < 15.0
    assert np.abs(off[-1]).max() < 0.5
    assert rough.position(t)[:, 2].min() > 0.0
