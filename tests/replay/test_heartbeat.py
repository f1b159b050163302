"""Time that passes without records: what it does to the track, and what it must not do to records under way."""

from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from groundstation.messages import (
    Epoch,
    Event,
    Heartbeat,
    Kinematics,
    PixelMeasurement,
    PtuSample,
    StepReport,
    TrackEstimate,
    TrackEvent,
    TrackState,
    TrackStatus,
)
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.synchronise import IN_FLIGHT_S, SynchroniseConfig, Synchroniser
from tests.replay.test_pipeline_scenarios import config
from tests.stereo_rig import flight_events, glide, make_rig

LOSS_S = 4.0
# far beyond what eight seconds of coasting make of a track: time alone decides
CERTAIN = {"lost_sigma_m": 1e4, "lost_sigma_px": 1e6}


def path(t_s: float) -> np.ndarray:
    return glide(t_s, start_y_m=560.0)


@pytest.fixture(scope="module")
def flight() -> list[Event]:
    return list(flight_events(make_rig(), path, np.random.default_rng(7), duration_s=16.0))


class Beaten:
    """A pipeline with events and heartbeats as input, and its results."""

    def __init__(self, **estimation: object) -> None:
        self.pipeline = Pipeline(make_rig(), config(**estimation), span_m=2.3)
        self.estimates: list[TrackEstimate] = []
        self.states: list[TrackState] = []
        self.events: list[TrackEvent] = []
        self.reports: list[StepReport] = []
        # the newest stamp, and what it was when a pair was last answered
        self.newest_s = self.answered_s = -np.inf

    def take(self, events: Iterable[Event]) -> "Beaten":
        for event in events:
            report = self.pipeline.step(event)
            if not isinstance(event, Heartbeat):
                self.newest_s = max(self.newest_s, event.t_s)
                self.answered_s = self.newest_s if report.estimates else self.answered_s
            self.reports.append(report)
            self.estimates += report.estimates
            self.states += report.states
            self.events += report.events
        return self

    def beat(self, t_s: float) -> TrackState:
        self.take([Heartbeat(t_s=t_s)])
        return self.states[-1]


def until(events: Iterable[Event], t_s: float) -> Iterator[Event]:
    return (e for e in events if e.t_s < t_s)


def blind(events: Iterable[Event], from_s: float, to_s: float = 1e9) -> list[Event]:
    """Both cameras lost: neither pictures nor pairs, the PTUs continue."""
    return [e for e in events if isinstance(e, PtuSample) or not from_s <= e.t_s < to_s]


def beaten(events: Iterable[Event], every_s: float = 0.1, first_s: float = 0.05) -> Iterator[Event]:
    """Events in order of their stamps, and heartbeats between them."""
    due_s = first_s
    for event in events:
        while event.t_s >= due_s:
            yield Heartbeat(t_s=due_s)
            due_s += every_s
        yield event


def known(state: TrackState | TrackEstimate | Kinematics | None) -> Kinematics:
    kinematics = state if isinstance(state, Kinematics | None) else state.kinematics
    assert kinematics is not None
    return kinematics


def spread_m2(kinematics: Kinematics) -> float:
    return float(np.trace(kinematics.covariance[:3, :3]))


def newest_pair_s(run: Beaten) -> float:
    return max(e.t_s for e in run.estimates)


def test_without_pairs_it_coasts_from_the_stated_time_on(flight: list[Event]) -> None:
    """Expected: tracking up to ``coast_after_s`` after the newest pair was processed, coasting beyond, logged once."""
    run = Beaten().take(until(flight, LOSS_S))
    pair_s = run.answered_s
    assert newest_pair_s(run) < pair_s < newest_pair_s(run) + 0.03
    assert run.estimates[-1].status is TrackStatus.TRACKING
    assert run.beat(pair_s + 0.249).status is TrackStatus.TRACKING
    events_before = len(run.events)
    state = run.beat(pair_s + 0.251)
    assert state.status is TrackStatus.COASTING
    assert (state.t_s, state.kinematics is not None) == (pair_s + 0.251, True)
    assert [(e.t_s, e.level, e.text) for e in run.events[events_before:]] == [
        (pair_s + 0.251, "warning", "tracking → coasting")
    ]
    run.beat(pair_s + 0.4)
    assert len(run.events) == events_before + 1
    assert not any(r.estimates for r in run.reports[-4:]), "a heartbeat is no pair"


def test_the_covariance_grows_by_the_motion_model(flight: list[Event]) -> None:
    """Expected: what the filter's own prediction to each heartbeat gives; mean and covariance, ever more uncertain."""
    run = Beaten(**CERTAIN).take(until(flight, LOSS_S))
    # what waits is let go by then, and fused
    before = spread_m2(known(run.beat(LOSS_S + 0.7)))
    filter_now = deepcopy(run.pipeline._ekf)
    for t_s in np.arange(LOSS_S + 0.8, LOSS_S + 7.0, 0.1):
        state, predicted = run.beat(float(t_s)), deepcopy(filter_now)
        predicted.predict_to(float(t_s))
        expected = predicted.kinematics_of(predicted.state, predicted.covariance)
        np.testing.assert_allclose(known(state).position_runway_m, expected.position_runway_m, rtol=1e-9)
        np.testing.assert_allclose(known(state).covariance, expected.covariance, rtol=1e-6, atol=1e-9)
        assert spread_m2(known(state)) > before
        before = spread_m2(known(state))
    assert before > 100.0 * spread_m2(known(run.estimates[-1]))


def test_a_heartbeat_leaves_the_filter_unchanged(flight: list[Event]) -> None:
    """Expected: to the last bit, with its window for late data and its tape; one before the filter's time as well."""
    run = Beaten(**CERTAIN).take(until(flight, LOSS_S))
    ekf, window = run.pipeline._ekf, run.pipeline._late_buffer
    x, P, weights = ekf.state.copy(), ekf.covariance.copy(), ekf._filter.imm.weights.copy()
    before = (ekf.time_s, len(window), ekf._filter.journal.mark)
    # what waits is let go by the first
    run.beat(LOSS_S + 1.0)
    x, P, weights = ekf.state.copy(), ekf.covariance.copy(), ekf._filter.imm.weights.copy()
    before = (ekf.time_s, len(window), ekf._filter.journal.mark)
    for t_s in (LOSS_S + 2.0, LOSS_S + 6.0, LOSS_S - 1.0):
        run.beat(t_s)
        assert (ekf.time_s, len(window), ekf._filter.journal.mark) == before
        np.testing.assert_array_equal(ekf.state, x)
        np.testing.assert_array_equal(ekf.covariance, P)
        np.testing.assert_array_equal(ekf._filter.imm.weights, weights)
    # times before the filter's get the estimate of the filter's time, without a larger covariance
    np.testing.assert_array_equal(known(run.states[-1]).position_runway_m, x[ekf.layout.position])
    np.testing.assert_allclose(known(run.states[-1]).covariance, P[ekf.layout.target, ekf.layout.target], rtol=1e-12)


def test_it_is_lost_after_the_time_without_a_pixel(flight: list[Event]) -> None:
    """Expected: an estimate to the very end of ``lost_after_s``, none from then on; the PTUs continue all the while."""
    run = Beaten(**CERTAIN).take(beaten(blind(flight, LOSS_S)))
    pixel_s = max(c.t_s for r in run.reports for c in r.cameras if c.status.used)
    for state in run.states:
        if run.answered_s + 0.25 < state.t_s:
            lost = bool(state.t_s > pixel_s + 8.0)
            assert state.status is (TrackStatus.LOST if lost else TrackStatus.COASTING), state.t_s
            assert (state.kinematics is None) is lost
    assert run.states[-1].status is TrackStatus.LOST
    reported = [e for e in run.events if "lost" in e.text]
    assert [e.text for e in reported] == ["coasting → lost"]
    assert 0.0 < reported[0].t_s - (pixel_s + 8.0) <= 0.1 + 1e-9


def test_it_is_lost_when_the_prediction_is_too_uncertain(flight: list[Event]) -> None:
    """Expected: held as long as the predicted position is known to ``lost_sigma_m``, and dropped right beyond."""
    run = Beaten(lost_sigma_m=6.0, lost_sigma_px=1e6).take(until(flight, LOSS_S))
    seen = []
    for t_s in np.arange(LOSS_S + 0.4, LOSS_S + 7.9, 0.1):
        spread = spread_m2(known(run.pipeline.estimate_at(float(t_s))))
        state = run.beat(float(t_s))
        assert (state.status is TrackStatus.LOST) is (spread > 6.0**2)
        seen.append(spread)
        if state.status is TrackStatus.LOST:
            break
    assert seen[-1] > 36.0 >= seen[-2]
    assert run.pipeline.estimate_at(LOSS_S + 5.0) is None


def test_it_is_lost_when_no_camera_could_be_pointed(flight: list[Event]) -> None:
    """Expected: with the source dead even the angles are predicted; lost once both pixels are too uncertain."""
    run = Beaten(lost_sigma_m=1e4).take(until(flight, LOSS_S))
    run.beat(LOSS_S + 0.7)
    ekf = deepcopy(run.pipeline._ekf)
    statuses = []
    for t_s in np.arange(LOSS_S + 0.8, LOSS_S + 7.0, 0.1):
        ekf.predict_to(float(t_s))
        sigmas = []
        for name in ("left", "right"):
            prediction = ekf.predict_pixel(name)
            assert prediction is not None
            sigmas.append(float(np.sqrt(np.diag(ekf.pixel_covariance(prediction)).max())))
        statuses.append(run.beat(float(t_s)).status)
        assert statuses[-1] is (TrackStatus.LOST if min(sigmas) > 200.0 else TrackStatus.COASTING)
        if statuses[-1] is TrackStatus.LOST:
            break
    assert statuses[-1] is TrackStatus.LOST
    assert len(statuses) > 3


def test_pairs_that_are_all_late_are_pairs(flight: list[Event]) -> None:
    """Expected: 0.4 s of latency, longer than ``coast_after_s``, processed one after the other: tracking."""
    late_s = [0.0 if isinstance(e, PtuSample) or e.t_s < 2.0 else 0.4 for e in flight]
    slow = [(e.t_s + late, e) for e, late in zip(flight, late_s, strict=True) if e.t_s < LOSS_S + 2.0]
    clocks: list[tuple[float, Event]] = [(float(t), Heartbeat(t_s=float(t))) for t in np.arange(0.0, LOSS_S + 2.0, 0.1)]
    run = Beaten().take(e for _, e in sorted([*slow, *clocks], key=lambda a: a[0]))
    assert {e.status for e in run.estimates if e.t_s > 3.0} == {TrackStatus.TRACKING}
    assert {s.status for s in run.states if s.t_s > 3.0} == {TrackStatus.TRACKING}


@pytest.mark.parametrize("kind", [PtuSample, PixelMeasurement])
def test_one_stamp_of_the_future_does_not_keep_a_track(flight: list[Event], kind: type[Event]) -> None:
    """Expected: coasting and then lost without pictures, as without the stamp; it was *tracking* for ever."""
    seen = [e for e in until(flight, LOSS_S) if not isinstance(e, Heartbeat)]
    k = next(k for k, e in enumerate(seen) if isinstance(e, kind) and e.t_s > LOSS_S - 1.0)
    wrong = replace(seen[k], t_s=seen[k].t_s + 1e4)
    run = Beaten().take([*seen[:k], wrong, *seen[k + 1 :]])
    statuses = [run.beat(float(t_s)).status for t_s in np.arange(LOSS_S + 0.1, LOSS_S + 14.0, 0.1)]
    assert TrackStatus.LOST in statuses
    assert statuses[-1] is not TrackStatus.TRACKING
    assert statuses[40] is not TrackStatus.TRACKING


def test_delayed_log_lines_are_written_in_time(flight: list[Event]) -> None:
    """Expected: of the same kind one at once, the rest together after five seconds, pairs or not."""
    run = Beaten(**CERTAIN).take(until(flight, LOSS_S))
    for k in range(3):
        run.pipeline._throttle.take(LOSS_S, f"a jerk of {k}.5°")
    run.beat(LOSS_S + 4.9)
    assert not any("like it" in e.text for e in run.events)
    run.beat(LOSS_S + 5.0)
    assert [e.text for e in run.events if "like it" in e.text] == ["a jerk of 2.5° (2 like it since 4.0 s)"]


def test_silent_cameras_are_named(flight: list[Event]) -> None:
    """Expected: both, once, two seconds after their last frame, though no pair is answered any more."""
    run = Beaten(**CERTAIN).take(beaten(blind(flight, LOSS_S)))
    reported = [e for e in run.events if e.text.startswith("station ")]
    assert [e.text.split(":")[0] for e in reported] == ["station left", "station right"]
    assert reported[-1].text.endswith("0 of 2 left")
    assert all(0.0 < e.t_s - 3.9 - 2.0 <= 0.1 + 1e-9 for e in reported)
    assert run.pipeline.counts["stations_lost"] == 2


def test_cameras_that_return_soon_continue_the_track(flight: list[Event]) -> None:
    """Expected: coasting while they are away; then, after so long without a pixel, tracking at the second pair."""
    run = Beaten().take(beaten(blind(flight, LOSS_S, LOSS_S + 1.5)))
    away = [s for s in run.states if LOSS_S + 0.3 < s.t_s < LOSS_S + 1.5]
    assert {s.status for s in away} == {TrackStatus.COASTING}
    back = [e.status for e in run.estimates if e.t_s > LOSS_S + 1.45]
    assert back[:2] == [TrackStatus.COASTING, TrackStatus.TRACKING]
    assert set(back[1:]) == {TrackStatus.TRACKING}
    assert not any("lost" in e.text for e in run.events)


def test_cameras_that_return_late_find_it_again(flight: list[Event]) -> None:
    run = Beaten(lost_after_s=3.0).take(beaten(blind(flight, LOSS_S, LOSS_S + 4.0)))
    assert TrackStatus.LOST in {s.status for s in run.states}
    assert [e.text for e in run.events if "→" in e.text and LOSS_S < e.t_s < 15.0] == [
        "tracking → coasting",
        "coasting → lost",
        "lost → acquiring",
        "acquiring → tracking",
    ]
    after = [e for e in run.estimates if e.t_s > LOSS_S + 6.0]
    assert {e.status for e in after} == {TrackStatus.TRACKING}
    errors = [known(e).position_runway_m - path(e.t_s) for e in after]
    assert np.abs(errors).max() < 5.0


@pytest.mark.parametrize(("gap_s", "lost"), [(2.8, False), (3.4, True)])
def test_without_heartbeats_the_first_picture_after_a_gap_decides(
    flight: list[Event], gap_s: float, lost: bool
) -> None:
    """Expected: a folder has no heartbeats; a gap longer than ``lost_after_s`` is a loss all the same."""
    run = Beaten(lost_after_s=3.0, **CERTAIN).take(blind(flight, LOSS_S, LOSS_S + gap_s))
    assert any("lost" in e.text for e in run.events) is lost
    assert any("lost → acquiring" in e.text for e in run.events) is lost
    assert run.estimates[-1].status is TrackStatus.TRACKING


def test_a_find_without_pictures_is_no_find(flight: list[Event]) -> None:
    """Expected: a target that was found by searching, and has had no fix since, is dropped when its time is over."""
    run = Beaten()
    pairs = iter(flight)
    for event in pairs:
        run.take([event])
        if any("acquired" in e.text or "found in labels" in e.text for e in run.events):
            break
    begun_s = run.estimates[-1].t_s
    # because it starts from whole frames, which this flight has none of
    life = run.pipeline._track_manager.state_machine
    life.start(begun_s, path(begun_s))
    life.status = TrackStatus.ACQUIRING
    assert run.beat(begun_s + 0.99).status is TrackStatus.ACQUIRING
    state = run.beat(begun_s + 1.01)
    assert (state.status, state.kinematics) == (TrackStatus.LOST, None)
    assert run.events[-2].text == "candidate dropped: no pictures to confirm it"


def test_candidates_without_pictures_are_not_reported_as_under_confirmation(flight: list[Event]) -> None:
    run = Beaten()
    track_manager = run.pipeline._track_manager
    run.take(until(flight, 0.15))
    track_manager.state_machine.status = TrackStatus.ACQUIRING
    assert not run.pipeline._ekf.has_target
    pair_s = run.answered_s
    assert run.beat(pair_s + 0.249).status is TrackStatus.ACQUIRING
    assert run.beat(pair_s + 0.251).status is TrackStatus.SEARCHING


def delayed(events: list[Event], seed: int, pixels_s: float, readings_s: float) -> list[tuple[float, Event]]:
    """When each record arrives: pixels and readings late at random, an epoch with the last of its pixels."""
    generator = np.random.default_rng(seed)
    arrival: dict[int, float] = {}
    out = []
    for event in events:
        if isinstance(event, PtuSample):
            out.append((event.t_s + generator.uniform(0.0, readings_s), event))
        elif isinstance(event, PixelMeasurement):
            at_s = event.t_s + generator.uniform(0.0, pixels_s)
            arrival[event.epoch] = max(at_s, arrival.get(event.epoch, at_s))
            out.append((at_s, event))
        elif isinstance(event, Epoch):
            out.append((max(event.t_s, arrival.get(event.epoch, event.t_s)), event))
    return sorted(out, key=lambda a: a[0])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("pixels_s", "readings_s", "coast_after_s"), [(0.06, 0.03, 0.25), (0.4, 0.2, 0.9)])
def test_while_pairs_are_processed_heartbeats_change_nothing(
    seed: int, pixels_s: float, readings_s: float, coast_after_s: float
) -> None:
    """Expected: every result, detection, line and count to the last bit, whatever is in transit at a heartbeat."""
    rig = make_rig()
    events = list(flight_events(rig, glide, np.random.default_rng(seed), duration_s=5.0, frame_hz=20.0, ptu_hz=30.0))
    arrivals = delayed(events, seed, pixels_s, readings_s)
    plain = Beaten(coast_after_s=coast_after_s).take(e for _, e in arrivals)
    generator = np.random.default_rng(seed + 100)
    with_beats: list[tuple[float, Event]] = [
        (float(t), Heartbeat(t_s=float(t))) for t in np.sort(generator.uniform(-0.3, 5.0, 120))
    ]
    beats = Beaten(coast_after_s=coast_after_s).take(e for _, e in sorted([*arrivals, *with_beats], key=lambda a: a[0]))
    assert len(beats.states) == 120
    assert beats.pipeline.counts == plain.pipeline.counts
    assert [(e.t_s, e.text) for e in beats.events] == [(e.t_s, e.text) for e in plain.events]
    plain_reports, others = ([c for r in run.reports for c in r.cameras] for run in (plain, beats))
    assert [(c.t_s, c.station, c.status) for c in plain_reports] == [(c.t_s, c.station, c.status) for c in others]
    for one, other in zip(plain.estimates, beats.estimates, strict=True):
        assert (one.t_s, one.status, one.kinematics is None) == (other.t_s, other.status, other.kinematics is None)
        if one.kinematics is not None:
            np.testing.assert_array_equal(one.kinematics.position_runway_m, known(other).position_runway_m)
            np.testing.assert_array_equal(one.kinematics.covariance, known(other).covariance)
    assert TrackStatus.TRACKING in {e.status for e in plain.estimates}
    status = TrackStatus.SEARCHING
    for report in beats.reports:
        status = report.estimates[-1].status if report.estimates else status
        assert all(state.status is status for state in report.states)


def test_waiting_records_are_passed_on_once_no_earlier_ones_can_arrive() -> None:
    """Expected: by the clock ``IN_FLIGHT_S`` and the hold after its stamp, no earlier; a record sooner than that is
    in time."""
    waiting = Synchroniser(["left"], SynchroniseConfig(hold_s=0.15), cameras=["left"])
    pixel = PixelMeasurement(t_s=1.0, station="left", epoch=0, u_px=1.0, v_px=2.0)
    late_s = 1.0 + IN_FLIGHT_S + 0.15
    assert list(waiting.push(pixel)) == []
    assert list(waiting.pass_time(late_s - 1e-3)) == []
    earlier = replace(pixel, t_s=0.95)
    assert [r.late for r in waiting.push(earlier)] == [False]  # type: ignore[union-attr]
    assert [r.record for r in waiting.pass_time(late_s + 1e-3)] == [pixel]  # type: ignore[union-attr]
    assert list(waiting.pass_time(late_s + 9.0)) == []
