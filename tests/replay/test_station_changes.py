"""Stations that come and go in flight: one filter, whatever is there; each docstring states the expected result."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.messages import TrackStatus
from groundstation.simulation import simulate
from groundstation.simulation.approach import Glide
from groundstation.simulation.cases import drawn_glide
from tests.faulty_flight import STATIONS, scenario, watch, without

PSD_M2_S3 = (1.0, 4.0, 2.0)


def test_three_two_one_two_stations() -> None:
    """3 → 2 → 1 → 2 stations: each loss and return is said once, the status follows, and over ten flights drawn from
    the filter's own motion the squared errors in each part are what the covariance says (NEES)."""
    squares: dict[tuple[float, float], list[float]] = {(1.0, 2.5): [], (3.0, 4.9): [], (5.5, 7.4): [], (8.0, 9.9): []}
    for seed in range(10):
        path = drawn_glide(seed, PSD_M2_S3, Glide(start_y_m=450.0, end_y_m=200.0))
        flight = simulate(scenario(seed, trajectory=path, ptu_hz=50.0))
        events = without(flight, {"third": (2.5, 1e9), "right": (5.0, 7.5)})
        watched = watch(flight, events=events)
        for part, values in squares.items():
            values.append(watched.anees(*part))
        texts = [e.text for e in watched.said("station")]
        assert [t for t in texts if "third: nothing" in t] == ["station third: nothing since 2.4 s, 2 of 3 left"]
        assert sum("right: nothing" in t for t in texts) == 1
        assert sum("right: delivers again" in t for t in texts) == 1
        assert watched.pipeline.counts["stations_lost"] == 2
        assert watched.pipeline.counts["stations_excluded"] == 0
        one = {e.status for e in watched.estimates if 5.2 <= e.t_s < 7.4}
        assert one == {TrackStatus.COASTING}
        assert {e.status for e in watched.estimates if 7.8 <= e.t_s < 9.9} == {TrackStatus.TRACKING}
    # at least three independent numbers a flight and part
    low, high = chi2.ppf([0.001, 0.999], 3 * 10) / (3 * 10)
    for part, values in squares.items():
        assert low < np.mean(values) < high, part


@pytest.mark.parametrize("names", [("left", "fourth"), (*STATIONS, "fourth")])
def test_two_or_four_stations(names: tuple[str, ...]) -> None:
    """Any number: tracked all along, and consistent."""
    watched = watch(simulate(scenario(4, names)))
    assert {e.status for e in watched.estimates if e.t_s > 0.5} == {TrackStatus.TRACKING}
    assert 0.1 < watched.anees(1.0) < 2.0


def test_one_station_alone_from_the_start() -> None:
    """One station and a given start: coasting, the covariance grows along the line of sight and covers the error."""
    watched = watch(simulate(scenario(5, ("left",))))
    assert {e.status for e in watched.estimates if e.t_s > 0.5} == {TrackStatus.COASTING}
    sigma_y = [e.kinematics.covariance[1, 1] ** 0.5 for e in watched.estimates if e.kinematics is not None]
    assert sigma_y[-1] > 3.0 * sigma_y[5]
    assert watched.anees(1.0) < 3.0


def test_a_station_added_in_flight() -> None:
    """The third station begins to deliver at 5 s: used at once, the range's sigma falls."""
    flight = simulate(scenario(6))
    watched = watch(flight, events=without(flight, {"third": (0.0, 5.0)}))
    sigma = {e.t_s: e.kinematics.covariance[1, 1] ** 0.5 for e in watched.estimates if e.kinematics is not None}
    before = np.mean([s for t, s in sigma.items() if 4.0 < t < 4.95])
    after = np.mean([s for t, s in sigma.items() if 5.5 < t < 6.5])
    assert after < 0.5 * before
    assert not watched.said("station")
