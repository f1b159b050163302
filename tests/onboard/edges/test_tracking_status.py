"""What the status says of a runway that is followed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from groundstation.onboard.edges import tracker as tracker_module
from groundstation.onboard.edges.camera_file import PoseNoise
from groundstation.onboard.edges.config import TrackerConfig, with_noise
from groundstation.onboard.edges.frame_geometry import yaw_place_m
from groundstation.onboard.edges.hypotheses import Hypothesis, score
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_tracking import TrackingStep, track_lines
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.markings import Change
from groundstation.onboard.edges.report import EdgeMiss, EdgeStatus
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.tracker import EdgeTracker
from tests.onboard.edges.seen import KAPPA, RUNWAY, SIZE, approach, painted_runway

STATE = LineState(mean=np.concatenate([RUNWAY, np.zeros(3)]), covariance=np.diag([1e-6, 1e-6, 0.01, 0.01, *[1e-6] * 3]))


def started() -> EdgeTracker:
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=RunwayGuess(width_m=18.0)))
    tracker.start(STATE)
    return tracker


def test_lines_unlike_the_announced_runway_are_not_tracked(monkeypatch: pytest.MonkeyPatch) -> None:
    """An edge 17 px off was *tracking* at a sigma of 2.5, in the picture in which the score fell from 1.9 to −4.3."""
    tracker, pose = started(), approach()
    assert tracker.step(painted_runway(pose, seed=1), pose).status is EdgeStatus.TRACKING
    monkeypatch.setattr(tracker_module, "score", lambda *_: TrackerConfig().least_score - 0.01)
    report = tracker.step(painted_runway(pose, seed=2), pose)
    assert report.status is EdgeStatus.ACQUIRING
    assert report.edges is not None
    monkeypatch.undo()
    assert tracker.step(painted_runway(pose, seed=3), pose).status is EdgeStatus.TRACKING


def test_lines_that_have_just_gone_elsewhere_are_not_tracked(monkeypatch: pytest.MonkeyPatch) -> None:
    tracker, pose = started(), approach()

    def moved(*args: object, **named: object) -> TrackingStep:
        step = track_lines(*args, **named)  # type: ignore[arg-type]
        assert step.found is not None
        return replace(step, found=replace(step.found, change=Change.LINES))

    monkeypatch.setattr(tracker_module, "track_lines", moved)
    assert tracker.step(painted_runway(pose, seed=1), pose).status is EdgeStatus.ACQUIRING
    monkeypatch.undo()
    assert tracker.step(painted_runway(pose, seed=2), pose).status is EdgeStatus.TRACKING


@pytest.mark.parametrize(
    ("announced_m", "tracked"), [(18.0, True), (13.5, True), (22.5, True), (12.0, False), (27.0, False)]
)
def test_a_pair_of_another_width_than_a_runway_may_have_is_not_tracked(announced_m: float, tracked: bool) -> None:
    """Fields were tracked for a runway between them, and rubber within it: 0.46 and 1.55 of the announced width."""
    pose = approach()
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=RunwayGuess(width_m=announced_m)))
    tracker.start(STATE)
    reports = [tracker.step(painted_runway(pose, seed=k), pose) for k in range(3)]
    assert all(report.edges is not None for report in reports)
    assert {report.status for report in reports} == {EdgeStatus.TRACKING if tracked else EdgeStatus.ACQUIRING}


@pytest.mark.parametrize("announced_m", [13.5, 22.5])
def test_a_pair_that_is_not_as_wide_as_announced_may_not_be_the_runway_s_edges(announced_m: float) -> None:
    """The outer borders of shoulders were tracked at half a pixel, 6 px from the edges of a runway as announced."""
    pose, sigmas = approach(), []
    e = line_map(pose, KAPPA)
    for guess_m in (announced_m, 18.0):
        tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=RunwayGuess(width_m=guess_m)))
        tracker.start(STATE)
        edges = [tracker.step(painted_runway(pose, seed=k), pose) for k in range(3)][-1].edges
        assert edges is not None
        sigmas.append(np.sqrt(edges.covariance_px2.diagonal()))
        for half_m in (0.5 * guess_m, 9.0):
            lines = np.array([RUNWAY[0], RUNWAY[1], -half_m, half_m])
            off = edges.crossings_px - project_lines(lines, e, edges.rows_px)[0]
            assert off @ np.linalg.solve(edges.covariance_px2, off) < 4.0 * 9.0
            assert (np.abs(off) < 3.0 * sigmas[-1]).all()
    assert (sigmas[0] > 2.0 * sigmas[1]).all()


@pytest.mark.parametrize(("yaw", "tracked"), [(0.0, True), (0.004, False)])
def test_lines_that_move_otherwise_than_the_poses_say_are_not_tracked(yaw: float, tracked: bool) -> None:
    """An edge that is stated to be known to half a pixel was 14 px off, and each picture disagreed with its pose."""
    config = TrackerConfig(
        guess=RunwayGuess(width_m=18.0), attitude_sigma_rad=np.radians(0.05), lasting_attitude_rad=np.radians(0.05),
        lasting_turn_rad=0.0, turn_sigma_rad=np.radians(0.02), estimate_noise=False,
    )  # fmt: skip
    tracker = EdgeTracker(KAPPA, SIZE, config)
    tracker.start(STATE)
    seen = []
    for k in range(12):
        report = tracker.step(painted_runway(approach(), seed=k), approach(yaw=0.04 + (-1) ** k * yaw))
        seen.append(report.status)
    assert EdgeStatus.COASTING not in seen
    assert (set(seen[-6:]) == {EdgeStatus.TRACKING}) == tracked
    assert (EdgeStatus.TRACKING in seen[-6:]) == tracked


@pytest.mark.parametrize(("stated_rad", "tracked"), [(0.02, True), (0.0005, False)])
def test_a_pair_where_the_poses_leave_no_runway_is_not_tracked(stated_rad: float, tracked: bool) -> None:
    """A runway's right edge with a track's left border, 12 m aside of poses that were known to a third of a metre."""
    aside = RUNWAY + np.array([0.0, 0.0, 12.0, 12.0])
    config = TrackerConfig(
        guess=RunwayGuess(width_m=18.0), lasting_attitude_rad=stated_rad, lasting_height_m=0.3, estimate_noise=False
    )
    tracker, pose = EdgeTracker(KAPPA, SIZE, config), approach()
    tracker.start(LineState(mean=np.concatenate([aside, np.zeros(3)]), covariance=STATE.covariance))
    reports = [tracker.step(painted_runway(pose, seed=k, lines=aside), pose) for k in range(3)]
    assert all(report.edges is not None for report in reports)
    assert {report.status for report in reports} == {EdgeStatus.TRACKING if tracked else EdgeStatus.ACQUIRING}


@pytest.mark.parametrize("wide", [{"lasting_yaw_rad": 0.02}, {"lasting_across_m": 4.0}])
def test_a_yaw_and_a_place_that_are_known_less_well_have_sigmas_of_their_own(wide: dict[str, float]) -> None:
    """A compass is off by more than roll and pitch: the runway of `RUNWAY`, 12 m aside of the poses, is tracked."""
    aside = RUNWAY + np.array([0.0, 0.0, 12.0, 12.0])
    noise = PoseNoise(lasting_attitude_rad=0.0005, lasting_height_m=0.3, **wide)
    config = with_noise(TrackerConfig(guess=RunwayGuess(width_m=18.0), estimate_noise=False), noise)
    tracker, pose = EdgeTracker(KAPPA, SIZE, config), approach()
    tracker.start(LineState(mean=np.concatenate([aside, np.zeros(3)]), covariance=STATE.covariance))
    reports = [tracker.step(painted_runway(pose, seed=k, lines=aside), pose) for k in range(3)]
    assert {report.status for report in reports} == {EdgeStatus.TRACKING}


def test_a_pair_whose_edges_differ_is_not_tracked_in_the_picture_that_confirms_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only the pictures after that one were looked at: there an end was 10 px off at a sigma of 1.8."""
    pose = approach()
    pictures = [painted_runway(pose, seed=k) for k in range(8)]

    def first_tracked() -> int:
        tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=RunwayGuess(width_m=18.0)))
        return [tracker.step(picture, pose).status for picture in pictures].index(EdgeStatus.TRACKING)

    usual = first_tracked()
    whole = tracker_module.track_hypotheses

    def differing(*args: object) -> list[Hypothesis]:
        pairs = whole(*args)  # type: ignore[arg-type]
        return [
            pair if pair.found is None else replace(pair, found=replace(pair.found, agreement=-0.02)) for pair in pairs
        ]

    monkeypatch.setattr(tracker_module, "track_hypotheses", differing)
    assert first_tracked() == usual + 1


def test_a_usual_width_that_is_not_announced_adds_nothing_to_the_covariance() -> None:
    pose, sigmas = approach(), []
    for announced in (True, False):
        guess = RunwayGuess(width_m=22.5, width_announced=announced)
        tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=guess))
        tracker.start(STATE)
        edges = [tracker.step(painted_runway(pose, seed=k), pose) for k in range(3)][-1].edges
        assert edges is not None
        sigmas.append(np.sqrt(edges.covariance_px2.diagonal()))
    assert (sigmas[0] > 2.0 * sigmas[1]).all()


def test_two_lines_on_one_edge_are_no_pair() -> None:
    """A pair whose lines had met at an edge ended the run: no width, and so no scale."""
    pose = approach()
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=RunwayGuess(width_m=18.0)))
    one = np.concatenate([RUNWAY[:3], RUNWAY[2:3], np.zeros(3)])
    tracker.start(LineState(mean=one, covariance=STATE.covariance))
    reports = [tracker.step(painted_runway(pose, seed=k), pose) for k in range(16)]
    first = [report for report in reports if report.edges is None]
    assert len(first) >= 3
    assert {report.miss for report in first} == {EdgeMiss.NO_PAIR}
    assert EdgeStatus.TRACKING not in {report.status for report in first}
    # and the runway is found after them
    assert reports[-1].status is EdgeStatus.TRACKING


@pytest.mark.parametrize(("stated_rad", "better"), [(None, False), (math.radians(2.0), True)])
def test_a_stated_error_of_yaw_is_no_evidence_against_a_pair_that_is_aside(
    stated_rad: float | None, better: bool
) -> None:
    """Two degrees are 31 m across at 900 m: the runway of such a compass was never chosen, though it was stated."""
    config = TrackerConfig(lasting_yaw_rad=stated_rad)
    aside = RUNWAY + np.array([0.0, 0.0, 30.0, 30.0])
    pair = Hypothesis(
        state=LineState(mean=np.concatenate([aside, np.zeros(3)]), covariance=STATE.covariance),
        edges=None, frames=5, missed=0, agreement=1.0, nis=4.0, lost=0.0,
        yaw_place_m=yaw_place_m(config, replace(approach(), camera_threshold_m=np.array([0.0, 900.0, 40.0]))),
    )  # fmt: skip
    known = replace(pair, yaw_place_m=0.0)
    assert (score(pair, config) > score(known, config) + 2.0) == better
    assert (score(pair, config) == score(known, config)) != better
