"""Faults made by editing a flight's events; each test's docstring states the expected result."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

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
    TrackEstimate,
    TrackEvent,
    TrackStatus,
    TriangulationStatus,
)
from groundstation.picture import BgrPicture
from groundstation.rig.rig import Rig
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.stereo_rig import flight_events, glide, make_rig, with_angle_noise


def config(**estimation: object) -> Config:
    base = Config()
    tuned = replace(base.estimation, labelled_sigma_px=0.5, fix_window_s=0.03, **estimation)  # type: ignore[arg-type]
    return replace(base, estimation=tuned)


class Flown:
    def __init__(self, events: Iterable[Event], rig: Rig | None = None, settings: Config | None = None, **kw) -> None:
        self.pipeline = Pipeline(rig or make_rig(), settings or config(), span_m=2.3, **kw)
        self.cameras: list[CameraReport] = []
        self.estimates: list[TrackEstimate] = []
        self.events: list[TrackEvent] = []
        for event in events:
            self._take(self.pipeline.step(event))
        self._take(self.pipeline.finish())

    def _take(self, report) -> None:
        self.cameras += report.cameras
        self.estimates += report.estimates
        self.events += report.events

    def errors(self, from_s: float, to_s: float = 1e9, path=glide) -> np.ndarray:
        return np.array(
            [
                e.kinematics.position_runway_m - path(e.t_s)
                for e in self.estimates
                if e.kinematics is not None and from_s <= e.t_s < to_s
            ]
        )

    def rmse(self, from_s: float, to_s: float = 1e9) -> np.ndarray:
        return np.sqrt((self.errors(from_s, to_s) ** 2).mean(axis=0))

    def statuses(self, from_s: float, to_s: float) -> set[TrackStatus]:
        return {e.status for e in self.estimates if from_s <= e.t_s < to_s}

    def anees(self, from_s: float, to_s: float) -> float:
        values = []
        for e in self.estimates:
            if e.kinematics is not None and from_s <= e.t_s < to_s:
                d = e.kinematics.position_runway_m - glide(e.t_s)
                values.append(d @ np.linalg.solve(e.kinematics.covariance[:3, :3], d))
        return float(np.mean(values)) / 3


@pytest.fixture(scope="module")
def flight() -> list[Event]:
    return list(flight_events(make_rig(), glide, np.random.default_rng(5)))


@pytest.fixture(scope="module")
def clean(flight: list[Event]) -> Flown:
    return Flown(flight)


def is_camera(event: Event, name: str) -> bool:
    return isinstance(event, PixelMeasurement) and event.station == name


def test_clean_flight(clean: Flown) -> None:
    """Acquired within 1 s by itself, tracking to the end, one estimate for each epoch, errors at the bound."""
    assert len(clean.estimates) == 120
    assert clean.statuses(1.0, 12.0) == {TrackStatus.TRACKING}
    x, y, z = clean.rmse(4.0)
    assert x < 0.02
    assert y < 0.6
    assert z < 0.03
    assert 0.5 < clean.anees(2.0, 12.0) < 1.6
    assert all(e.triangulation_status is TriangulationStatus.OK for e in clean.estimates if e.t_s > 1.0)


def test_the_same_events_give_the_same_reports(flight: list[Event], clean: Flown) -> None:
    """Bit for bit."""
    again = Flown(flight)
    for a, b in zip(clean.estimates, again.estimates, strict=True):
        assert a.status is b.status
        if a.kinematics is not None and b.kinematics is not None:
            assert np.array_equal(a.kinematics.position_runway_m, b.kinematics.position_runway_m)
            assert np.array_equal(a.kinematics.covariance, b.kinematics.covariance)


def test_one_camera_lost_midway(flight: list[Event]) -> None:
    """Status goes to coasting at once, across the line of sight it stays good, along it the covariance grows;
    no triangulation without two views; tracking resumes with the camera."""
    gone = [e for e in flight if not (is_camera(e, "right") and 6.0 <= e.t_s < 8.0)]
    flown = Flown(gone)
    assert flown.statuses(6.1, 7.9) == {TrackStatus.COASTING}
    assert flown.statuses(8.1, 12.0) == {TrackStatus.TRACKING}
    one_view = [e for e in flown.estimates if 6.1 <= e.t_s < 7.9]
    assert all(e.triangulation is None for e in one_view)
    assert all(e.triangulation_status is TriangulationStatus.ONE_VIEW for e in one_view)
    assert {e.seen_by for e in one_view} == {frozenset({"left"})}
    assert {e.seen_by for e in flown.estimates if e.t_s > 8.1} == {frozenset({"left", "right"})}
    sigma_y = [e.kinematics.covariance[1, 1] ** 0.5 for e in one_view if e.kinematics is not None]
    assert sigma_y[-1] > 2 * sigma_y[0]
    # by as much as the error grows: tests/replay/test_station_changes.py, on drawn flights
    assert flown.rmse(8.5)[1] < 0.6


def test_both_cameras_lost_and_back(flight: list[Event]) -> None:
    """Coasting for a second and a half (what becomes of the covariance: test_station_changes.py), then tracking again
    with the first pair."""
    flown = Flown([e for e in flight if not (isinstance(e, PixelMeasurement) and 6.0 <= e.t_s < 7.5)])
    assert flown.statuses(6.05, 7.45) == {TrackStatus.COASTING}
    assert flown.statuses(7.6, 12.0) == {TrackStatus.TRACKING}


def test_permanent_loss_is_reported_and_then_acquired_again(flight: list[Event]) -> None:
    """Without any pixel for longer than lost_after_s: lost, no estimate; with the pixels back: acquired again."""
    cut = [e for e in flight if not (isinstance(e, PixelMeasurement) and 4.0 <= e.t_s < 9.0)]
    flown = Flown(cut, settings=config(lost_after_s=3.0))
    lost = [e for e in flown.estimates if 7.1 <= e.t_s < 8.9]
    assert {e.status for e in lost} == {TrackStatus.LOST}
    assert all(e.kinematics is None for e in lost)
    assert flown.statuses(10.0, 12.0) == {TrackStatus.TRACKING}
    assert any("lost" in e.text for e in flown.events)


def test_ptu_spike(flight: list[Event], clean: Flown) -> None:
    """One reading 20° off: dropped and counted, the track hardly moves."""
    spiked = [
        replace(e, pan_rad=e.pan_rad + 0.35)
        if isinstance(e, PtuSample) and e.station == "left" and abs(e.t_s - 6.007) < 0.0101
        else e
        for e in flight
    ]
    flown = Flown(spiked)
    assert flown.pipeline.counts["ptu_spikes"] == 1
    assert np.all(flown.rmse(6.0) < 1.5 * clean.rmse(6.0) + 0.01)


def test_stale_encoder(flight: list[Event]) -> None:
    """The left PTU falls silent for 1 s: its frames are named misses, the right camera carries on (coasting)."""
    silent = [e for e in flight if not (isinstance(e, PtuSample) and e.station == "left" and 6.0 <= e.t_s < 7.0)]
    flown = Flown(silent)
    blind = [c for c in flown.cameras if c.station == "left" and 6.3 <= c.t_s < 6.9]
    assert blind
    for c in blind:
        assert isinstance(c.result, Miss)
        assert c.result.reason is MissReason.NO_PTU_ANGLE
    assert flown.statuses(6.3, 6.9) == {TrackStatus.COASTING}
    assert flown.statuses(7.2, 12.0) == {TrackStatus.TRACKING}


def test_every_second_ptu_row_removed(flight: list[Event], clean: Flown) -> None:
    """At 25 Hz the accuracy stays within 1.3 × of that at 50 Hz."""
    seen: dict[str, int] = {}
    thinned = []
    for e in flight:
        if isinstance(e, PtuSample):
            seen[e.station] = seen.get(e.station, 0) + 1
            if seen[e.station] % 2:
                continue
        thinned.append(e)
    assert np.all(Flown(thinned).rmse(4.0) < 1.3 * clean.rmse(4.0) + 0.005)


def weave(t_s: float) -> np.ndarray:
    """A hard weave: 6 m/s across the line of sight."""
    return glide(t_s) + np.array([5.0 * np.sin(2 * np.pi * t_s / 5.0), 0.0, 0.0])


def test_cameras_that_do_not_expose_together() -> None:
    """The right camera exposes 37 ms later: with its own time it costs nothing; taken as simultaneous, range
    errors are several times larger."""
    rig = make_rig()
    agile = config(acceleration_psd_m2_s3=(3.0, 0.6, 0.3))
    events = list(flight_events(rig, weave, np.random.default_rng(6), exposure_offset_s={"right": 0.037}))
    own_time = Flown(events, settings=agile).errors(4.0, path=weave)
    pretended = [replace(e, t_s=e.t_s - 0.037) if is_camera(e, "right") else e for e in events]
    order = sorted(pretended, key=lambda e: (e.t_s, isinstance(e, Epoch)))
    simultaneous = Flown(order, settings=agile).errors(4.0, path=weave)
    good, bad = np.sqrt((own_time**2).mean(axis=0)), np.sqrt((simultaneous**2).mean(axis=0))
    assert good[0] < 0.05
    assert good[1] < 0.8
    assert bad[1] > 3 * good[1]


@pytest.mark.parametrize("names", [("left", "right", "third"), ("left", "third")])
def test_more_or_other_stations(names: tuple[str, ...]) -> None:
    """A third station off to the side pins the range."""
    rig = make_rig(names)
    flown = Flown(flight_events(rig, glide, np.random.default_rng(7)), rig=rig)
    assert flown.statuses(1.5, 8.0) == {TrackStatus.TRACKING}
    assert flown.rmse(4.0, 9.0)[1] < 0.1


def test_fixed_stations() -> None:
    """No PTU at all: wide fixed cameras, six states."""
    rig = make_rig(fixed=True)
    wide = replace(
        rig,
        stations=tuple(replace(s, lens=replace(s.lens, focal_px=np.array([2000.0, 2000.0]))) for s in rig.stations),
    )
    flown = Flown(flight_events(wide, glide, np.random.default_rng(8), duration_s=8.0), rig=wide)
    assert flown.statuses(2.0, 8.0) == {TrackStatus.TRACKING}
    assert flown.rmse(4.0)[0] < 0.1


def test_gross_outliers_are_gated(flight: list[Event], clean: Flown) -> None:
    """5 % of the pixels displaced by up to ±50 px: nearly all refused, errors within 1.5 × of the clean flight."""
    generator = np.random.default_rng(9)
    spoiled, bad = [], set()
    for e in flight:
        if isinstance(e, PixelMeasurement) and e.t_s > 2.0 and generator.random() < 0.05:
            du, dv = generator.uniform(15, 50, 2) * generator.choice([-1, 1], 2)
            spoiled.append(replace(e, u_px=e.u_px + du, v_px=e.v_px + dv))
            bad.add((e.station, e.epoch))
        else:
            spoiled.append(e)
    flown = Flown(spoiled)
    gated = {(c.station, c.epoch) for c in flown.cameras if c.status is DetectionStatus.GATED}
    assert len(bad & gated) >= 0.95 * len(bad)
    assert np.all(flown.rmse(4.0) < 1.5 * clean.rmse(4.0) + 0.01)


def test_a_given_start_is_used_at_its_time(flight: list[Event]) -> None:
    """[initial] at 2 s: nothing is searched for, the first estimate is the given state carried on."""
    start = InitialState(
        t_s=2.0,
        position_runway_m=glide(2.0),
        velocity_runway_m_s=np.array([0.0, -25.0, -1.5]),
        sigma_position_m=np.full(3, 1.0),
        sigma_velocity_m_s=np.full(3, 1.0),
    )
    flown = Flown([e for e in flight if e.t_s > 1.5], initial=start)
    first = next(e for e in flown.estimates if e.kinematics is not None)
    assert first.t_s == pytest.approx(2.0, abs=0.11)
    assert np.linalg.norm(flown.errors(2.0, 2.2)[0]) < 3.0


def test_an_uncalibrated_rig_is_refused() -> None:
    rig = make_rig()
    raw = replace(rig, stations=(replace(rig.stations[0], known=("position", "lens")), rig.stations[1]))
    with pytest.raises(Exception, match="orientation"):
        Pipeline(raw, config())


def slow(t_s: float) -> np.ndarray:
    """A hovering target that drifts at half a metre a second."""
    return np.array([0.0, 200.0 - 0.5 * t_s, 8.0])


def test_a_labelled_target_is_confirmed_without_motion() -> None:
    """A labelled target: tracked from the start to the end, at half a metre a second."""
    rig = make_rig()
    flown = Flown(flight_events(rig, slow, np.random.default_rng(11), duration_s=8.0), rig=rig)
    assert flown.statuses(1.5, 8.0) == {TrackStatus.TRACKING}


def test_labels_start_a_target_next_to_a_camera_with_pictures(flight: list[Event], clean: Flown) -> None:
    """Expected: pictures of one camera, which alone are no pair, do not hold up what labels show."""
    w, h = make_rig()["left"].lens.image_size_px
    black = BgrPicture(np.zeros((h, w, 3), np.uint8))
    mixed: list[Event] = []
    for event in flight:
        if is_camera(event, "left") and event.t_s < 0.4:
            assert isinstance(event, PixelMeasurement)
            mixed.append(Frame(t_s=event.t_s, station="left", epoch=event.epoch, image=black))
        else:
            mixed.append(event)
    flown = Flown(mixed)
    assert flown.statuses(2.0, 12.0) == {TrackStatus.TRACKING}
    assert np.all(flown.rmse(4.0) < 1.2 * clean.rmse(4.0) + 0.01)


def test_arrivals_out_of_order_change_nothing(flight: list[Event], clean: Flown) -> None:
    """Pixels delivered 30 ms after their exposure, behind newer readings: the same estimates, bit for bit."""
    arrival = [e.t_s + (0.0 if isinstance(e, PtuSample) else 0.03) for e in flight]
    flown = Flown([flight[i] for i in np.argsort(arrival, kind="stable")])
    assert flown.pipeline.counts["late_frames"] == 0
    for a, b in zip(clean.estimates, flown.estimates, strict=True):
        assert a.status is b.status
        if a.kinematics is not None and b.kinematics is not None:
            assert np.array_equal(a.kinematics.position_runway_m, b.kinematics.position_runway_m)


def test_an_old_start_has_grown_uncertain(flight: list[Event]) -> None:
    """[initial] at 0 s, a replay from 5 s, its velocity 1 m/s off: the stated sigma covers it and tracking begins."""
    start = InitialState(
        t_s=0.0,
        position_runway_m=glide(0.0),
        velocity_runway_m_s=np.array([1.0, -24.0, -1.5]),
        sigma_position_m=np.full(3, 1.0),
        sigma_velocity_m_s=np.full(3, 2.0),
    )
    flown = Flown([e for e in flight if e.t_s > 5.0], initial=start)
    assert flown.statuses(5.4, 12.0) == {TrackStatus.TRACKING}
    assert flown.rmse(6.0)[0] < 0.05


def test_nothing_is_searched_for_before_a_given_start(flight: list[Event]) -> None:
    """[initial] at 3 s: silence before, no track is thrown away for it."""
    start = InitialState(
        t_s=3.0,
        position_runway_m=glide(3.0),
        velocity_runway_m_s=np.array([0.0, -25.0, -1.5]),
        sigma_position_m=np.full(3, 1.0),
        sigma_velocity_m_s=np.full(3, 2.0),
    )
    flown = Flown(flight, initial=start)
    assert flown.statuses(0.0, 2.9) == {TrackStatus.SEARCHING}
    assert flown.statuses(3.2, 12.0) == {TrackStatus.TRACKING}


def test_a_ptu_spike_does_not_reach_the_baseline(flight: list[Event], clean: Flown) -> None:
    """One reading 0.3° off next to an exposure: the triangulated point moves by no more than its stated sigmas."""
    target = 6.007
    spiked = [
        replace(e, pan_rad=e.pan_rad + np.radians(0.3))
        if isinstance(e, PtuSample) and e.station == "left" and abs(e.t_s - target) < 0.0101
        else e
        for e in flight
    ]
    for good, bad in zip(clean.estimates, Flown(spiked).estimates, strict=True):
        if abs(good.t_s - 6.0) < 0.11:
            assert good.triangulation is not None
            assert bad.triangulation is not None
            moved = bad.triangulation.point_runway_m[1] - good.triangulation.point_runway_m[1]
            assert abs(moved) < 4 * np.sqrt(bad.triangulation.covariance_m2[1, 1])


def test_a_frozen_encoder_is_detected() -> None:
    """A noisy encoder that repeats one value with fresh stamps for 2 s: reported, and its frames are named misses."""
    rig = with_angle_noise(make_rig(), np.radians(0.01))
    events = list(flight_events(rig, glide, np.random.default_rng(12), angle_sigma_rad=np.radians(0.01)))
    held: PtuSample | None = None
    frozen: list[Event] = []
    for e in events:
        if isinstance(e, PtuSample) and e.station == "left" and 6.0 <= e.t_s < 8.0:
            held = held or e
            frozen.append(replace(held, t_s=e.t_s))
        else:
            frozen.append(e)
    flown = Flown(frozen, rig=rig)
    assert any("repeats one reading" in e.text for e in flown.events)
    # 100 readings, less those that it takes to tell
    assert 50 <= flown.pipeline.counts["ptu_repeats"] < 100
    assert any("change again" in e.text for e in flown.events)
    assert TrackStatus.TRACKING not in flown.statuses(6.5, 7.9)
    assert flown.statuses(8.5, 12.0) == {TrackStatus.TRACKING}
    assert flown.rmse(9.0)[1] < 1.0


def test_each_labelled_pixel_makes_one_point(flight: list[Event]) -> None:
    """The right camera labels every third frame: triangulated points are no more than its pixels."""
    thinned = [e for e in flight if not (is_camera(e, "right") and isinstance(e, PixelMeasurement) and e.epoch % 3)]
    flown = Flown(thinned, settings=config(lost_after_s=20.0))
    points = sum(e.triangulation is not None for e in flown.estimates)
    assert 20 < points <= 40


def test_memory_stays_flat_over_a_long_session() -> None:
    """Two minutes of a slow target, with a camera that is gone for half of it: nothing piles up inside."""
    rig = make_rig()
    pipeline = Pipeline(rig, config(lost_after_s=5.0), span_m=2.3)
    sizes = []
    for event in flight_events(rig, slow, np.random.default_rng(13), duration_s=120.0, ptu_hz=25.0):
        if is_camera(event, "right") and 30.0 < event.t_s < 90.0:
            continue
        pipeline.step(event)
        if isinstance(event, Epoch) and event.epoch % 100 == 50:
            inside = pipeline._synchroniser
            held = [*inside._history.values(), inside._queue, inside._used]
            held += [pipeline._epochs._views, pipeline._epochs._arrived, pipeline._track_manager._labels]
            sizes.append(sum(len(part) for part in held))
    assert max(sizes) < 400
    assert sizes[-1] <= sizes[1] + 20
