"""A track whose first pixel is a gross outlier: it goes back to its start, and is then as good as any."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from filter_flights import consistency
from filter_flights.run_filter import Run, drawn_start, drive

from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import Event, InitialState, PixelMeasurement
from groundstation.simulation import SimulatedFlight, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.synchronise import SynchroniseConfig
from tests.stereo_rig import flight_events, glide, make_rig

FLIGHTS = 10
OFF_PX = 40.0


def first_spoiled(events: Sequence[Event], count: int = 1, from_s: float = 0.0) -> list[Event]:
    """The events with the first pixels from a time on next to the target."""
    done = list(events)
    pixels = [k for k, e in enumerate(done) if isinstance(e, PixelMeasurement) and e.t_s >= from_s]
    for k in pixels[:count]:
        e = done[k]
        assert isinstance(e, PixelMeasurement)
        done[k] = replace(e, u_px=e.u_px + OFF_PX)
    return done


def flown(seed: int) -> SimulatedFlight:
    flight = simulate(consistency.drawn_case("B", seed, 10.0, GlideApproach(end_y_m=400.0)))
    return replace(flight, events=tuple(first_spoiled(flight.events)))


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    flights = [(seed, flown(seed)) for seed in range(FLIGHTS)]
    return [drive(f, consistency.one_mode(), drawn_start(f, seed, *consistency.WIDE)) for seed, f in flights]


def test_it_recovers_within_half_a_second_consistently(runs: list[Run]) -> None:
    low, high = consistency.chi2_range(6, FLIGHTS, 0.99)
    for after_s in (0.5, 2.0, 7.0):
        nees = [r.nees(6)[round(10.0 * after_s)] for r in runs]
        assert low < np.mean(nees) / 6.0 < high


def test_only_pixels_after_the_outlier_are_refused(runs: list[Run]) -> None:
    """Four in a row until it is noticed, a second time where one of the first passes; of the others, one in 2000."""
    assert all(4 <= r.refused <= 8 for r in runs)


def track(**counts: int) -> ProvisionalTrack:
    return ProvisionalTrack(t_s=0.0, mean=np.zeros(6), covariance=np.eye(6), triangulated=False, **counts)


@pytest.mark.parametrize(
    ("reported", "refuted"),
    [
        ([1, 0, 0, 0, 0], True),
        ([1, 1, 0, 0, 0, 0], True),
        # three are no proof, nor are many among which some agree
        ([1, 0, 0, 0], False),
        ([1, 0, 0, 1, 0, 0, 1, 0], False),
        # as many agreed as do not
        ([1, 1, 1, 1, 0, 0, 0, 0], False),
        # nothing was taken that could be taken back
        ([0, 0, 0, 0, 0, 0], False),
    ],
)
def test_the_majority_decides(reported: list[int], refuted: bool) -> None:
    provisional = track()
    for accepted in reported:
        provisional = provisional.after(accepted=bool(accepted))
    assert provisional.refuted is refuted


def test_a_track_grows_up_once_enough_agrees_with_it() -> None:
    assert track(accepted=20, refused=3).confirmed
    assert not track(accepted=19).confirmed
    assert not track(accepted=20, refused=20).confirmed


BEGUN_S = 0.4
START = InitialState(
    t_s=BEGUN_S,
    position_runway_m=glide(BEGUN_S) + np.array([6.0, -9.0, 5.0]),
    velocity_runway_m_s=np.array([0.5, -24.0, -1.0]),
    sigma_position_m=np.full(3, 10.0),
    sigma_velocity_m_s=np.full(3, 5.0),
)


def last_of(events: Sequence[Event]) -> tuple[StationEkf, Pipeline]:
    base = Config()
    config = replace(
        base,
        estimation=replace(base.estimation, labelled_sigma_px=0.5, fix_window_s=0.03),
        synchronise=SynchroniseConfig(hold_s=0.02),
    )
    pipeline = Pipeline(make_rig(), config, initial=START, span_m=None)
    for event in events:
        pipeline.step(event)
    pipeline.finish()
    return pipeline._ekf, pipeline


def test_going_back_for_a_late_frame_does_it_again() -> None:
    """What refutes the first pixels comes late and in disorder: it ends in the filter that got everything in order."""
    flight = flight_events(make_rig(), glide, np.random.default_rng(3), duration_s=2.0)
    events = first_spoiled(list(flight), 2, from_s=BEGUN_S)
    generator = np.random.default_rng(4)
    arrival = [
        e.t_s + (generator.uniform(0, 0.3) if isinstance(e, PixelMeasurement) and e.t_s > BEGUN_S + 0.05 else 0.0)
        for e in events
    ]
    ordered, plain = last_of(events)
    late, other = last_of([events[k] for k in np.argsort(arrival, kind="stable")])
    assert plain.counts["starts_taken_back"] == other.counts["starts_taken_back"] == 1
    assert other.fused_late["fused_late_frames"] > 10
    sigma = np.sqrt(np.diag(ordered.covariance))
    np.testing.assert_allclose((late.state - ordered.state) / sigma, 0.0, atol=1e-6)
