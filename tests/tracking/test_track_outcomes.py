"""The outcome of tracks, as reports state it."""

import numpy as np
import pytest

from groundstation.estimation.tentative_track import InitiatedTarget
from groundstation.messages import (
    Epoch,
    Event,
    FilterReset,
    Heartbeat,
    InitialPixel,
    InitialState,
    Kinematics,
    OutcomeKind,
    PixelMeasurement,
    PtuSample,
    StepReport,
    TrackOutcome,
    TrackStatus,
)
from groundstation.tracking.epoch_buffer import EpochViews
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.track_changes import TrackChanges
from tests.replay.test_pipeline_scenarios import config
from tests.stereo_rig import flight_events, glide, make_rig


def flight(duration_s: float) -> list[Event]:
    def path(t_s: float) -> np.ndarray:
        return glide(t_s, start_y_m=560.0)

    return list(flight_events(make_rig(), path, np.random.default_rng(7), duration_s=duration_s))


def outcomes_of(reports: list[StepReport]) -> list[TrackOutcome]:
    return [outcome for report in reports for outcome in report.outcomes]


def test_a_found_track_is_confirmed_when_its_estimate_is_reported() -> None:
    pipeline = Pipeline(make_rig(), config(), span_m=2.3)
    reports = [pipeline.step(event) for event in flight(8.0)]
    (outcome,) = outcomes_of(reports)
    assert outcome.kind is OutcomeKind.CONFIRMED
    at = next(k for k, report in enumerate(reports) if report.outcomes)
    assert next(k for k, r in enumerate(reports) if any(e.kinematics is not None for e in r.estimates)) == at
    # a frame belongs to the track that there was when it was processed
    cameras = [camera for report in reports for camera in report.cameras]
    first = next(k for k, camera in enumerate(cameras) if camera.track_id is not None)
    assert {camera.track_id for camera in cameras[first:]} == {outcome.track_id}
    assert first > 0
    (started_s,) = [event.t_s for report in reports for event in report.events if event.text.startswith("target ")]
    assert cameras[first].t_s >= started_s > 0.0


def test_a_given_track_is_confirmed_at_its_start() -> None:
    start = InitialState(
        t_s=0.5,
        position_runway_m=glide(0.5, start_y_m=560.0),
        velocity_runway_m_s=np.array([0.0, -20.0, -1.0]),
        sigma_position_m=np.full(3, 5.0),
        sigma_velocity_m_s=np.full(3, 3.0),
    )
    pipeline = Pipeline(make_rig(), config(), span_m=2.3, initial=start)
    reports = [pipeline.step(event) for event in flight(2.0)]
    assert outcomes_of(reports) == [TrackOutcome(track_id=1, kind=OutcomeKind.CONFIRMED)]


def test_a_track_that_no_picture_confirms_is_dropped() -> None:
    pipeline, reports = Pipeline(make_rig(), config(), span_m=2.3), []
    for event in flight(8.0):
        if pipeline._track_manager.track_id is not None and isinstance(event, PixelMeasurement | Epoch):
            # the pictures end as soon as it is found
            continue
        reports.append(pipeline.step(event))
    assert outcomes_of(reports) == []
    newest_s = max(event.t_s for event in flight(8.0) if isinstance(event, PtuSample))
    for t_s in np.arange(newest_s, newest_s + 20.0, 0.5):
        reports.append(pipeline.step(Heartbeat(t_s=float(t_s))))
    (outcome,) = outcomes_of(reports)
    assert outcome.kind is OutcomeKind.DROPPED
    assert reports[-1].states[-1].status in (TrackStatus.LOST, TrackStatus.SEARCHING)
    assert any(report.outcomes and report.states for report in reports)


@pytest.mark.parametrize(
    ("odds", "standing", "kept"), [(4.0, True, True), (4.0, False, False), (0.5, True, False), (None, True, False)]
)
def test_cut_silhouettes_prove_an_aircraft_that_stands_recognised_alone(
    odds: float | None, standing: bool, kept: bool
) -> None:
    """Expected: no pixel of a cut silhouette tells where a target is; what moves, or is not recognised, is dropped."""
    pipeline = Pipeline(make_rig(), config(), span_m=2.3)
    for event in flight(1.0):
        if isinstance(event, PtuSample):
            pipeline.step(event)
    manager, began_s = pipeline._track_manager, pipeline.time_s
    assert began_s is not None
    found = InitiatedTarget(
        kinematics=Kinematics(
            position_runway_m=glide(1.0, start_y_m=560.0),
            velocity_runway_m_s=np.array([0.0, 0.0 if standing else -20.0, 0.0]),
            covariance=np.diag([0.01, 1.0, 0.01, 0.01, 0.01, 0.01]),
        ),
        moving=not standing,
        recognised=odds is not None and odds > 1.5,
        odds=odds,
        age_s=0.3,
    )
    manager._start_track(began_s, found.kinematics, "acquired", found)
    outcomes = []
    for k in range(1, 13):
        t_s = began_s + 0.1 * k
        pipeline._ekf.predict_to(t_s)
        manager.state_machine.add_pixel(t_s)
        views = EpochViews(views=(object(),), accepted=frozenset(), arrived_s=None, seen=frozenset(("left", "right")))
        manager.process_epoch(Epoch(t_s=t_s, epoch=k, stations=("left", "right")), views, newest_s=t_s)
        outcomes += [each.kind for each in manager.changes.take().outcomes]
        assert not manager.is_confirmed
        if kept:
            # it is no fix, and what moves takes its place
            assert manager.needs_search(t_s)
    assert outcomes == ([] if kept else [OutcomeKind.DROPPED])


def test_a_track_after_a_reset_of_the_filter_has_another_number() -> None:
    """Expected: rows of the one before would be its own, and one that was confirmed would confirm it."""
    pipeline, reports = Pipeline(make_rig(), config(), span_m=2.3), []
    events = flight(12.0)
    middle = next(k for k, event in enumerate(events) if event.t_s > 5.0)
    reset = FilterReset(t_s=events[middle].t_s, why="test", in_vain=False)
    for event in (*events[:middle], reset, *events[middle:]):
        reports.append(pipeline.step(event))
    assert [(o.track_id, o.kind) for o in outcomes_of(reports)] == [
        (1, OutcomeKind.CONFIRMED),
        (2, OutcomeKind.CONFIRMED),
    ]
    assert {camera.track_id for report in reports for camera in report.cameras} == {None, 1, 2}


def test_a_track_that_is_open_at_a_reset_is_dropped() -> None:
    pipeline, reports = Pipeline(make_rig(), config(), span_m=2.3), []
    for event in flight(8.0):
        if pipeline._track_manager.track_id is not None:
            break
        reports.append(pipeline.step(event))
    reports.append(pipeline.step(FilterReset(t_s=event.t_s, why="test", in_vain=False)))
    assert outcomes_of(reports) == [TrackOutcome(track_id=1, kind=OutcomeKind.DROPPED)]


def test_each_track_is_decided_once() -> None:
    changes = TrackChanges()
    found = InitialPixel(t_s=0.9, station="left", u_px=1.0, v_px=2.0, sigma_px=1.0)
    changes.start([found])
    changes.start([found])
    changes.decide(OutcomeKind.CONFIRMED)
    changes.decide(OutcomeKind.DROPPED)
    taken = changes.take()
    assert [(o.track_id, o.kind) for o in taken.outcomes] == [
        (1, OutcomeKind.DISPLACED),
        (2, OutcomeKind.CONFIRMED),
    ]
    assert [p.track_id for p in taken.initial_pixels] == [1, 2]
    assert changes.take() == TrackChanges()
    # the next one does not displace what was confirmed
    changes.start([])
    assert changes.take().outcomes == []
