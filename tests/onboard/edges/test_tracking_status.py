"""What the status says of a runway that is followed."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.onboard.edges import tracker as tracker_module
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_tracking import TrackingStep, track_lines
from groundstation.onboard.edges.markings import Change
from groundstation.onboard.edges.report import EdgeStatus
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
