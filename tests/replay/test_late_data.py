"""Late data: what comes out of order, inside the horizon, ends in the filter that got everything in order."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.estimation.parameters import DGPS_CLOCK, ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import (
    CameraReport,
    DetectionStatus,
    Epoch,
    Event,
    Frame,
    InitialState,
    Miss,
    MissReason,
    PixelMeasurement,
    PtuSample,
    ReferenceFix,
    TrackStatus,
)
from groundstation.session import load_session
from groundstation.sources.folder_source import FolderSource
from groundstation.tracking.config import Config, load_config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.synchronise import InterpolatedAngles, ReadyFrame, SynchroniseConfig, Synchroniser
from tests.stereo_rig import flight_events, glide, make_rig

START = InitialState(
    t_s=0.0,
    position_runway_m=glide(0.0) + np.array([0.5, -2.0, 0.3]),
    velocity_runway_m_s=np.array([0.5, -24.0, -1.0]),
    sigma_position_m=np.full(3, 3.0),
    sigma_velocity_m_s=np.full(3, 2.0),
)
MODES = {"acceleration_psd_m2_s3": (0.05, 0.1, 0.05), "manoeuvre_psd_m2_s3": (3.0, 6.0, 3.0)}


def tuning(hold_s: float = 0.15, **estimation: object) -> Config:
    base = Config()
    own = replace(base.estimation, labelled_sigma_px=0.5, fix_window_s=0.03, **estimation)  # type: ignore[arg-type]
    return replace(base, estimation=own, synchronise=SynchroniseConfig(hold_s=hold_s))


def spoiled(seed: int, **options: object) -> list[Event]:
    """Six seconds of flight in order, with gross outliers among the pixels and spikes among the readings."""
    generator = np.random.default_rng(seed)
    events: list[Event] = []
    for e in flight_events(make_rig(), glide, generator, duration_s=6.0, **options):  # type: ignore[arg-type]
        if isinstance(e, PixelMeasurement) and e.t_s > 1.0 and generator.random() < 0.1:
            events.append(replace(e, u_px=e.u_px + 30.0))
        elif isinstance(e, PtuSample) and e.t_s > 1.0 and generator.random() < 0.02:
            events.append(replace(e, pan_rad=e.pan_rad + 0.3))
        elif isinstance(e, PtuSample) and e.station == "right":
            # no two of a kind at one instant: their order would be that of their arrival
            events.append(replace(e, t_s=e.t_s + 0.0001))
        else:
            events.append(e)
    return events


def delivered(events: list[Event], seed: int, delay_s: float, share: float = 0.3) -> list[Event]:
    """A share of the pixels and readings arrives up to ``delay_s`` late; nothing is lost."""
    generator = np.random.default_rng(seed)
    arrival = [
        e.t_s + (generator.uniform(0, delay_s) if not isinstance(e, Epoch) and generator.random() < share else 0.0)
        for e in events
    ]
    return [events[k] for k in np.argsort(arrival, kind="stable")]


class PollStatistics(StationEkf):
    """The filter, with its last word on each pixel."""

    def _fuse_pixel(self, pixel):  # type: ignore[no-untyped-def]
        innovation = super()._fuse_pixel(pixel)
        self.__dict__.setdefault("verdicts", {})[(pixel.station, *pixel.pixel)] = (
            innovation is not None and innovation.accepted
        )
        return innovation


def verdicts(pipeline: Pipeline) -> dict[tuple, bool]:
    return pipeline._ekf.__dict__["verdicts"]


def flown(events: list[Event], config: Config) -> tuple[Pipeline, list[CameraReport]]:
    pipeline = Pipeline(make_rig(), config, span_m=2.3, initial=START)
    pipeline._ekf.__class__ = PollStatistics
    cameras = [c for e in events for c in pipeline.step(e).cameras]
    return pipeline, cameras + list(pipeline.finish().cameras)


@pytest.mark.parametrize("estimation", [{}, MODES], ids=["one way of flying", "two"])
@pytest.mark.parametrize("offset_s", [0.0002, 0.013], ids=["nearly together", "apart"])
@pytest.mark.parametrize("seed", [1, 2])
def test_late_inside_the_horizon_is_as_good_as_in_order(seed: int, offset_s: float, estimation: dict) -> None:
    """A third of all pixels and readings up to 0.4 s late, waited for 20 ms: state, covariance, gates, spikes equal."""
    events = spoiled(seed, exposure_offset_s={"right": offset_s})
    ordered, _ = flown(events, tuning(**estimation))
    assert ordered.fused_late == {"fused_late_ptu": 0, "fused_late_frames": 0}
    late, cameras = flown(delivered(events, seed, 0.4), tuning(hold_s=0.02, **estimation))
    assert late.fused_late["fused_late_ptu"] > 50
    assert late.fused_late["fused_late_frames"] > 15
    assert late.counts == ordered.counts
    assert ordered.counts["ptu_spikes"] > 3
    sigma = np.sqrt(np.diag(ordered._ekf.covariance))
    assert late._ekf.time_s == ordered._ekf.time_s
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(late._ekf.state / sigma, ordered._ekf.state / sigma, rtol=0, atol=1e-6)
    np.testing.assert_allclose(late._ekf.covariance / scale, ordered._ekf.covariance / scale, rtol=0, atol=1e-6)
    # in the end each pixel was gated equally
    assert verdicts(late) == verdicts(ordered)
    assert len(verdicts(late)) == 120
    assert not all(verdicts(late).values())
    used = [c for c in cameras if c.status is DetectionStatus.LATE]
    assert len(used) > 10
    assert not [c for c in cameras if isinstance(c.result, Miss) and c.result.reason is MissReason.LATE]


def test_late_frames_are_searched_at_the_prediction_of_their_time() -> None:
    """A frame that comes 0.3 s late is predicted as if it had been in time, to a small part of a pixel."""
    events = list(flight_events(make_rig(), glide, np.random.default_rng(4), duration_s=6.0))
    held = next(e for e in events if isinstance(e, PixelMeasurement) and e.station == "left" and e.t_s > 4.0)
    order = [e for e in events if e is not held]
    order.insert(next(k for k, e in enumerate(order) if e.t_s > held.t_s + 0.3), held)
    (expected,) = [c for c in flown(events, tuning())[1] if c.station == "left" and c.t_s == held.t_s]
    (looked,) = [c for c in flown(order, tuning(hold_s=0.02))[1] if c.station == "left" and c.t_s == held.t_s]
    assert looked.status is DetectionStatus.LATE
    assert looked.predicted_px is not None
    assert expected.predicted_px is not None
    np.testing.assert_allclose(looked.predicted_px, expected.predicted_px, atol=1e-6)


def taught(events: list[Event], late_s: float, **estimation: object) -> Pipeline:
    """Fly with a position of a receiver each fifth of a second, whose clock is 30 ms ahead, ``late_s`` later."""
    generator = np.random.default_rng(7)
    fixes = [
        ReferenceFix(
            t_s=t + 0.03, position_runway_m=glide(t) + generator.normal(0.0, 0.02, 3), sigma_m=np.full(3, 0.02)
        )
        for t in np.arange(0.511, 5.9, 0.2)
    ]
    arrivals = [(e.t_s, e) for e in events] + [(fix.t_s + late_s, fix) for fix in fixes]
    clock = ParameterPrior.independent([f"{DGPS_CLOCK}.offset"], [0.5])
    config = tuning(hold_s=0.02, **estimation)
    pipeline = Pipeline(make_rig(), config, span_m=2.3, initial=START, reference_errors=clock)
    for _, event in sorted(arrivals, key=lambda a: a[0]):
        pipeline.step(event)
    pipeline.finish()
    return pipeline


def test_late_positions_of_a_receiver_give_the_same_estimates() -> None:
    """Each comes 0.15 s after its time, the cameras wait 20 ms: state and covariance are those of positions at once."""
    events = spoiled(6)
    ordered, late = taught(events, 0.0), taught(events, 0.15)
    assert late.counts["references_refused"] == ordered.counts["references_refused"] == 0
    sigma = np.sqrt(np.diag(ordered._ekf.covariance))
    np.testing.assert_allclose(late._ekf.state / sigma, ordered._ekf.state / sigma, rtol=0, atol=1e-6)
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(late._ekf.covariance / scale, ordered._ekf.covariance / scale, rtol=0, atol=1e-6)
    (clock,) = [e for e in late.carried_errors if e.name.startswith(DGPS_CLOCK)]
    assert clock.sigma < 0.05
    refused = taught(events, 0.3, late_horizon_s=0.1)
    assert refused.counts["references_refused"] == len(np.arange(0.511, 5.9, 0.2))
    assert refused.reference_used_until_s is None


def test_a_receiver_whose_clock_is_ahead_has_no_effect_on_the_order() -> None:
    """Stamps of two seconds from now: no frame is passed on before the reading that it waits for."""
    readings = [PtuSample(t_s=t, station="left", pan_rad=t, tilt_rad=0.0) for t in (0.0, 0.1)]
    frame = PixelMeasurement(t_s=0.05, station="left", epoch=0, u_px=1.0, v_px=1.0)
    fix = ReferenceFix(t_s=2.05, position_runway_m=np.zeros(3), sigma_m=np.ones(3))
    synchroniser = Synchroniser(["left"], SynchroniseConfig(hold_s=0.15), cameras=["left"])
    passed = [item for event in (readings[0], frame, fix, readings[1]) for item in synchroniser.push(event)]
    (ready,) = [item for item in passed if isinstance(item, ReadyFrame)]
    assert isinstance(ready.angles, InterpolatedAngles)
    assert ready.angles.pan_rad == pytest.approx(0.05)
    assert list(synchroniser.finish())[-1] is fix


def test_beyond_the_horizon_it_is_refused_and_counted() -> None:
    """Horizon 0.1 s: what comes later than that changes nothing; each refused frame is a named miss."""
    events = spoiled(5)
    late, cameras = flown(delivered(events, 5, 0.6), tuning(hold_s=0.02, late_horizon_s=0.1))
    refused = [c for c in cameras if isinstance(c.result, Miss) and c.result.reason is MissReason.LATE]
    assert late.counts["late_frames"] == len(refused) > 5
    assert late.counts["late_ptu"] > 20
    assert late.fused_late["fused_late_frames"] > 0
    nothing, cameras = flown(delivered(events, 5, 0.6), tuning(hold_s=0.02, late_horizon_s=0.0))
    assert nothing.fused_late == {"fused_late_ptu": 0, "fused_late_frames": 0}
    assert not [c for c in cameras if c.status is DetectionStatus.LATE]


def test_late_data_before_there_was_a_target_is_refused() -> None:
    """Nothing is searched for in the past: the frame is a named miss, the track begins as ever."""
    start = replace(START, t_s=1.0, position_runway_m=glide(1.0))
    events = list(flight_events(make_rig(), glide, np.random.default_rng(6), duration_s=3.0))
    held = next(e for e in events if isinstance(e, PixelMeasurement) and e.t_s > 0.75)
    order = [e for e in events if e is not held]
    order.insert(next(k for k, e in enumerate(order) if e.t_s > 1.15), held)
    pipeline = Pipeline(make_rig(), tuning(hold_s=0.02), initial=start)
    reports = [pipeline.step(e) for e in order]
    (looked,) = [c for r in reports for c in r.cameras if c.t_s == held.t_s and c.station == held.station]
    assert isinstance(looked.result, Miss)
    assert looked.result.reason is MissReason.LATE
    assert pipeline.counts["late_frames"] == 1
    assert [e.status for r in reports for e in r.estimates][-1] is TrackStatus.TRACKING


def test_the_window_is_bounded_in_time_and_in_number() -> None:
    """Two seconds of 200 Hz readings: no more than the horizon's worth is kept, or than is allowed."""
    events = list(flight_events(make_rig(), glide, np.random.default_rng(7), duration_s=4.0, ptu_hz=200.0))
    by_time, _ = flown(events, tuning(late_horizon_s=0.5))
    assert len(by_time._late_buffer) <= 0.5 * (2 * 200 + 2 * 10) + 5
    assert len(by_time._journal.history) <= 2 * len(by_time._late_buffer) + 5
    by_number, _ = flown(events, tuning(late_max_entries=30))
    assert len(by_number._late_buffer) <= 30


def test_late_pictures_are_processed_without_a_disturbance(landing_from_20_s: Path, classic_tuning: Path) -> None:
    """Every third right picture of two seconds of the bundled landing comes 0.3 s late: nearly all give their pixel,
    and the cameras miss nothing more than without them."""
    session = load_session(landing_from_20_s, None)
    pipeline = Pipeline(session.rig, load_config(classic_tuning), span_m=session.target.span_m)
    with FolderSource(session, 23.0, 27.0) as source:
        events = iter(source)
        for event in events:
            if event.t_s > 25:
                break
            pipeline.step(event)
        # up to here both have the same records; the first of the rest is a reading
        assert isinstance(event, PtuSample)
        rest = [event, *events]

    def camera_reports(pipeline: Pipeline, late: bool) -> list[CameraReport]:
        cameras: list[CameraReport] = []
        held: list[Frame] = []
        for event in rest:
            while held and held[0].t_s + 0.3 < event.t_s:
                cameras += pipeline.step(held.pop(0)).cameras
            if isinstance(event, Frame) and event.station == "right" and event.epoch % 3 == 0:
                held += [event] * late
                continue
            cameras += pipeline.step(event).cameras
        cameras += pipeline.finish().cameras
        return [c for c in cameras if c.t_s > 25]

    without, with_them = camera_reports(deepcopy(pipeline), False), camera_reports(pipeline, True)
    came = [c for c in with_them if c.station == "right" and c.epoch % 3 == 0]
    assert len(came) >= 4
    assert sum(c.status is DetectionStatus.LATE for c in came) >= len(came) - 1
    missed = [c for c in with_them if c not in came and c.status is not DetectionStatus.OK]
    assert len(missed) <= len([c for c in without if c.status is not DetectionStatus.OK])
