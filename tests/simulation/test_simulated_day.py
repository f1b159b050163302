"""The flights of a simulated range: one approach after the other, in a wind each its own."""

import numpy as np
import pytest

from groundstation.simulation.flights import FlightModelKind
from groundstation.simulation.repeated_landings import RepeatedLandings, landings

LAP_S, APPROACH_S = 53.0, 23.0
T = np.arange(0.0, APPROACH_S, 0.05)


def test_without_wind_all_are_the_same() -> None:
    calm = landings(200.0, seed=3, wind_m_s=0.0, aircraft=FlightModelKind.WAVES)
    assert np.array_equal(calm.position(T), RepeatedLandings(200.0).position(T))
    assert np.allclose(calm.position(T + LAP_S), calm.position(T))


@pytest.mark.parametrize("aircraft", list(FlightModelKind))
def test_in_a_wind_each_is_its_own_near_the_same_path(aircraft: FlightModelKind) -> None:
    flown = landings(100.0, seed=3, wind_m_s=5.0, aircraft=aircraft)
    again = landings(100.0, seed=3, wind_m_s=5.0, aircraft=aircraft)
    first, second = flown.position(T), flown.position(T + LAP_S)
    assert np.array_equal(first, again.position(T))
    assert np.abs(first - second).max() > 0.5
    for path in (first, second):
        off = path - RepeatedLandings(100.0).position(T)
        assert 0.3 < np.abs(off).max() < 15.0
        assert path[:, 2].min() > 1.0
    # two laps there are, the third is the first again
    assert np.allclose(flown.position(T + 2.0 * LAP_S), first)
    rates = (flown.position(T + 1e-3) - flown.position(T - 1e-3 * (T > 0))) / (1e-3 * (1.0 + (T > 0)))[:, None]
    assert np.abs(rates - flown.velocity(T)).max() < 0.1


def test_before_it_begins_it_is_on_its_way_and_approaches_no_runway() -> None:
    flown = landings(100.0, seed=0, wind_m_s=5.0, aircraft=FlightModelKind.WAVES)
    before = np.array([-20.0, -1.0])
    assert np.all(flown.position(before)[:, 1] > 570.0)
    assert not flown.approaching(before).any()
    assert flown.approaching(T).all()
