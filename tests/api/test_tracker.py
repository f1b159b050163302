"""The tracker for scripts: fed event by event it gives what a replay gives; what the rig does not fit is refused."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import groundstation
from groundstation import (
    Box,
    Detection,
    DetectionHint,
    Epoch,
    Frame,
    InputError,
    PixelMeasurement,
    PtuSample,
    StepReport,
    TargetCandidate,
    Tracker,
    TrackEstimate,
    TrackStatus,
)
from groundstation.picture import BgrPicture
from groundstation.tracking.config import Config
from tests.stereo_rig import flight_events, glide, make_rig

SIGMA = np.eye(2) * 0.5**2


def estimates_of(reports: Sequence[StepReport]) -> list[TrackEstimate]:
    return [estimate for report in reports for estimate in report.estimates]


def test_a_session_fed_event_by_event_is_the_replay(landing_from_20_s: Path) -> None:
    tracker = Tracker(landing_from_20_s / "rig.toml", span_m=2.3)
    reports = [tracker.step(e) for e in groundstation.session_events(landing_from_20_s, from_s=20.0, to_s=21.5)]
    reports.append(tracker.finish())
    run = groundstation.replay_session(landing_from_20_s, from_s=20.0, to_s=21.5)
    found = estimates_of(reports)
    assert [e.t_s for e in found] == run.t_s.tolist()
    assert [e.status.value for e in found] == run.status.tolist()
    positions = [np.full(3, np.nan) if e.kinematics is None else e.kinematics.position_runway_m for e in found]
    np.testing.assert_array_equal(np.array(positions), run.position_m)
    assert tracker.status is found[-1].status is TrackStatus.TRACKING
    last = found[-1].kinematics
    assert last is not None
    assert tracker.t_s is not None
    ahead_s = tracker.t_s + 0.2 - found[-1].t_s
    ahead = tracker.estimate_at(tracker.t_s + 0.2)
    assert ahead is not None
    flown = last.position_runway_m + ahead_s * last.velocity_runway_m_s
    np.testing.assert_allclose(ahead.position_runway_m, flown, atol=0.5)


def test_pixels_of_a_pair_with_their_sigma() -> None:
    """The stated noise of a pixel is the one that counts: NEES is that of four times the sigma where that is stated."""
    rig = make_rig(fixed=True)
    stated: dict[float, list[float]] = {}
    for sigma in (0.5, 2.0):
        generator = np.random.default_rng(3)
        tracker = Tracker(rig, span_m=2.3)
        found = []
        for k in range(90):
            point = glide(0.1 * k, start_y_m=300.0, speed_m_s=10.0)
            point[[0, 2]] *= 0.05
            pixels = {}
            for station in rig.stations:
                projection = station.geometry().project(point, 0.0, 0.0)
                assert projection is not None
                u, v = projection.pixel + generator.normal(0.0, 0.5, 2)
                pixels[station.name] = (u, v, sigma)
            found += tracker.step_pair(0.1 * k, pixels).estimates
        stated[sigma] = [
            float(np.sqrt(e.kinematics.covariance[0, 0]))
            for e in found
            if e.kinematics is not None and e.status is TrackStatus.TRACKING and e.t_s > 5.0
        ]
        assert len(stated[sigma]) > 30
    assert np.median(stated[2.0]) > 1.5 * np.median(stated[0.5])


def disc_detector(image: np.ndarray, region: Box[int], hint: DetectionHint | None) -> list[TargetCandidate]:
    """Find the bright disc of `discs`; the likeliest of two is the brighter one."""
    part = image[region.slices][:, :, 0]
    _, _, statistics, centres = cv2.connectedComponentsWithStats((part > 100).astype(np.uint8))
    return [
        TargetCandidate(
            u_px=region.x0 + x,
            v_px=region.y0 + y,
            covariance_px2=SIGMA,
            width_px=float(width),
            log_odds=0.05 * (float(part[round(y), round(x)]) - 170.0),
        )
        for (x, y), (_, _, width, _, area) in zip(centres[1:], statistics[1:], strict=True)
        if area > 20
    ]


def discs(t_s: float, *, decoy: bool = False) -> dict[str, np.ndarray]:
    """Pictures of a bright disc that approaches, and a dimmer one that stands, if wanted."""
    rig = make_rig(fixed=True)
    pictures = {}
    point = np.array([0.3 * np.sin(t_s), 300.0 - 15.0 * t_s, 1.0 + 0.2 * t_s])
    for station in rig.stations:
        image = np.zeros((960, 1280, 3), np.uint8)
        projection = station.geometry().project(point, 0.0, 0.0)
        assert projection is not None
        u, v = projection.pixel
        if decoy:
            cv2.circle(image, (200, 100), 14, (120, 120, 120), -1)
        cv2.circle(image, (round(u * 16), round(v * 16)), 18 * 16, (230, 230, 230), -1, cv2.LINE_AA, 4)
        pictures[station.name] = image
    return pictures


def test_a_detector_of_one_s_own_finds_and_follows() -> None:
    hints: list[DetectionHint | None] = []

    def looked(image: np.ndarray, region: Box[int], hint: DetectionHint | None) -> list[TargetCandidate]:
        assert not image.flags.writeable
        assert image.shape == (960, 1280, 3)
        hints.append(hint)
        return disc_detector(image, region, hint)

    tracker = Tracker(make_rig(fixed=True), detector=looked)
    found: list[TrackEstimate] = []
    for k in range(60):
        found += tracker.step_pair(0.1 * k, discs(0.1 * k, decoy=True)).estimates
    assert hints[0] is None
    assert hints[-1] is not None
    tracked = [e for e in found if e.status is TrackStatus.TRACKING]
    assert len(tracked) > 40
    last = tracked[-1]
    assert last.kinematics is not None
    truth = np.array([0.3 * np.sin(last.t_s), 300.0 - 15.0 * last.t_s, 1.0 + 0.2 * last.t_s])
    off = last.kinematics.position_runway_m - truth
    assert off @ np.linalg.solve(last.kinematics.covariance[:3, :3], off) < 16.3  # χ² of 3, 99.9 %


@pytest.mark.parametrize("answer", [None, []], ids=["did not look", "saw nothing"])
def test_nothing_seen_and_not_looked_are_two_things(answer: list[TargetCandidate] | None) -> None:
    """Not to look leaves the target as it is until it may coast no longer; to see nothing ends it sooner."""
    blind = False

    def detector(image: np.ndarray, region: Box[int], hint: DetectionHint | None) -> list[TargetCandidate] | None:
        return answer if blind else disc_detector(image, region, hint)

    # without limits on the uncertainty, a target ends by what is seen of it or by the time it may coast
    usual = Config()
    unlimited = replace(usual.estimation, lost_sigma_px=1e6, lost_sigma_m=1e6, lost_after_s=8.0)
    config = replace(usual, estimation=unlimited)
    tracker = Tracker(make_rig(fixed=True), config=config, detector=detector)
    statuses, reasons = [], set()
    for k in range(135):
        blind = k >= 40
        report = tracker.step_pair(0.1 * k, discs(0.1 * min(k, 40)))
        statuses += [e.status for e in report.estimates]
        if 40 <= k < 60:
            reasons |= {c.result.reason.value for c in report.cameras if isinstance(c.result, groundstation.Miss)}
    assert TrackStatus.TRACKING in statuses[:40]
    assert reasons == {"not_searched" if answer is None else "no_region"}
    ended = statuses.index(TrackStatus.LOST, 40)
    assert 119 <= ended <= 121 if answer is None else ended < 110


@pytest.mark.parametrize(
    ("candidate", "wanted"),
    [
        ((3.0, 4.0), "TargetCandidate"),
        (None, "got NoneType; wanted TargetCandidate"),
        (TargetCandidate(u_px=1.0, v_px=1.0, covariance_px2=np.eye(3)), r"\(2, 2\)"),
        (TargetCandidate(u_px=np.nan, v_px=1.0, covariance_px2=SIGMA), "finite"),
        (TargetCandidate(u_px=1.0, v_px=1.0, covariance_px2=-SIGMA), "positive definite"),
        (TargetCandidate(u_px=1.0, v_px=1.0, covariance_px2=SIGMA, width_px=0.0), "> 0, or None"),
    ],
)
def test_a_candidate_that_is_none_is_refused(candidate: object, wanted: str) -> None:
    tracker = Tracker(make_rig(fixed=True), detector={"left": lambda image, region, hint: [candidate]})  # type: ignore[dict-item, list-item]
    with pytest.raises(InputError, match=f"detector of left.*{wanted}"):
        tracker.step_pair(0.0, discs(0.0))


def test_a_generator_and_an_array_do_as_well() -> None:
    """Candidates one by one from a generator; pixels as an array."""

    def one_by_one(image: np.ndarray, region: Box[int], hint: DetectionHint | None) -> Iterator[TargetCandidate]:
        yield from disc_detector(image, region, hint)

    tracker = Tracker(make_rig(fixed=True), detector=one_by_one)  # type: ignore[arg-type]
    statuses = [e.status for k in range(20) for e in tracker.step_pair(0.1 * k, discs(0.1 * k)).estimates]
    assert TrackStatus.TRACKING in statuses
    tracker = Tracker(make_rig(fixed=True))
    reports = [tracker.step_pair(0.0, {"left": np.array([600.0, 500.0])}), tracker.finish()]
    assert [c.station for report in reports for c in report.cameras] == ["left"]


def test_what_does_not_fit_the_rig_is_refused(tmp_path: Path) -> None:
    tracker = Tracker(make_rig())
    pixel = PixelMeasurement(t_s=0.0, station="left", epoch=0, u_px=1.0, v_px=1.0)
    small = BgrPicture(np.zeros((48, 64, 3), np.uint8))
    for event, words in (
        (replace(pixel, station="tower"), "station 'tower'; wanted one of left, right"),
        (replace(pixel, u_px=np.inf), "not finite"),
        (replace(pixel, sigma_px=(1.0, 0.0)), "> 0"),
        (PtuSample(t_s=np.nan, station="left", pan_rad=0.0, tilt_rad=0.0), "not finite"),
        (Epoch(t_s=0.0, epoch=0, stations=("left", "tower")), "tower"),
        (Frame(t_s=0.0, station="left", epoch=0, image=small), "got 64 × 48 px; wanted 1280 × 960 px"),
    ):
        with pytest.raises(InputError, match=words):
            tracker.step(event)
    with pytest.raises(InputError, match="got 1 numbers"):
        tracker.step_pair(0.0, {"left": (3.0,)})
    with pytest.raises(InputError, match="got NoneType"):
        tracker.step_pair(0.0, {"left": None})  # type: ignore[dict-item]
    with pytest.raises(InputError, match=r"sigma_px: got 2; wanted two numbers"):
        tracker.step(replace(pixel, sigma_px=2.0))
    with pytest.raises(InputError, match=r"got float64 \(48, 64\)"):
        tracker.step_pair(0.0, {"left": np.zeros((48, 64))})  # type: ignore[dict-item]
    with pytest.raises(InputError, match="fixed"):
        Tracker(make_rig(fixed=True)).step(PtuSample(t_s=0.0, station="left", pan_rad=0.0, tilt_rad=0.0))
    with pytest.raises(InputError, match="got 'tower'; wanted names of stations: left, right"):
        Tracker(make_rig(), detector={"tower": disc_detector})
    with pytest.raises(InputError, match="span_m"):
        Tracker(make_rig(), span_m=-1.0)
    with pytest.raises(InputError, match=r"none\.toml"):
        Tracker(tmp_path / "none.toml")


def test_a_frame_of_an_array_is_one_of_a_picture(landing_from_20_s: Path, classic_tuning: Path) -> None:
    found = []
    for arrays in (False, True):
        tracker = Tracker(landing_from_20_s / "rig.toml", config=classic_tuning, span_m=2.3)
        reports = []
        for event in groundstation.session_events(landing_from_20_s, from_s=20.0, to_s=20.8):
            given = event
            if arrays and isinstance(event, Frame):
                given = replace(event, image=event.image.whole())  # type: ignore[arg-type]
            reports.append(tracker.step(given))
        reports.append(tracker.finish())
        found.append([c.result for report in reports for c in report.cameras])
    assert len(found[0]) == len(found[1]) > 8
    for one, other in zip(*found, strict=True):
        assert type(one) is type(other)
        if isinstance(one, Detection) and isinstance(other, Detection):
            assert (one.u_px, one.v_px) == (other.u_px, other.v_px)


@pytest.mark.parametrize("event", ["x", None, 3.0])
def test_what_is_no_event_is_refused(event: object) -> None:
    with pytest.raises(InputError, match=rf"event: got {type(event).__name__}; wanted one of PtuSample, Frame, "):
        Tracker(make_rig(fixed=True)).step(event)  # type: ignore[arg-type]


def test_a_frame_without_a_picture_is_refused() -> None:
    frame = Frame(t_s=1.0, station="left", epoch=0, image=[[0]])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"picture of left at 1 s: got list; wanted an array"):
        Tracker(make_rig(fixed=True)).step(frame)


def test_turning_heads_and_pixels_are_tracked_within_the_covariance() -> None:
    tracker = Tracker(make_rig(), span_m=2.3)
    reports = [tracker.step(e) for e in flight_events(make_rig(), glide, np.random.default_rng(1), duration_s=6.0)]
    found = [e for e in estimates_of([*reports, tracker.finish()]) if e.status is TrackStatus.TRACKING]
    assert len(found) > 40
    squares = []
    for estimate in found[10:]:
        assert estimate.kinematics is not None
        off = estimate.kinematics.position_runway_m - glide(estimate.t_s)
        squares.append(off @ np.linalg.solve(estimate.kinematics.covariance[:3, :3], off) / 3.0)
    assert np.mean(squares) < 2.0


def test_every_public_name_is_there_and_others_are_not() -> None:
    assert all(getattr(groundstation, name) is not None for name in groundstation.__all__)
    assert sorted(dir(groundstation)) == sorted(groundstation.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Pipeline'"):
        groundstation.Pipeline  # type: ignore[attr-defined]
