"""The tracker on short rendered approaches and on pictures that show nothing."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from groundstation.onboard.edges import hypotheses
from groundstation.onboard.edges import tracker as tracker_module
from groundstation.onboard.edges.config import TrackerConfig, paper_config
from groundstation.onboard.edges.detection import NoPair
from groundstation.onboard.edges.frame_geometry import edge_noise
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_tracking import plain_edges
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines
from groundstation.onboard.edges.pose import NoseCameraPose, intrinsic_matrix
from groundstation.onboard.edges.report import EdgeMiss, EdgeReport, EdgeStatus
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, NoseFrame, Renderer
from tests.onboard.edges.seen import KAPPA, RUNWAY, SIZE, approach, painted_runway

NOSE_KAPPA = intrinsic_matrix(NOSE_LENS)
GUESS = RunwayGuess(width_m=20.0, length_m=500.0)


def rendered(index: int, frames: int) -> tuple[list[NoseFrame], float]:
    sequence = SEQUENCES[index]
    short = replace(sequence, seed=sequence.seed + 7, approach=replace(sequence.approach, frames=frames))
    return list(Renderer(short).frames()), sequence.airfield.width_m


def errors(frames: list[NoseFrame], width_m: float, config: TrackerConfig) -> np.ndarray:
    tracker = EdgeTracker(NOSE_KAPPA, NOSE_LENS.image_size_px, config)
    found = []
    for frame in frames:
        edges = tracker.step(frame.image, frame.reported).edges
        assert edges is not None
        lines = np.array([1.0, 0.0, -0.5 * width_m, 0.5 * width_m])
        truth, _ = project_lines(lines, line_map(frame.truth, NOSE_KAPPA), edges.rows_px)
        found.append(crossings_at(edges.crossings_px, edges.rows_px, edges.rows_px) - truth)
    return np.array(found)


@pytest.mark.parametrize("index", [0, 1, 2], ids=["day", "haze and sand", "dusk and turbulence"])
def test_edges_are_found_and_kept_to_three_pixels(index: int) -> None:
    frames, width = rendered(index, 10)
    assert np.sqrt(np.mean(errors(frames, width, TrackerConfig(guess=GUESS)) ** 2)) < 3.0


def test_a_taxiway_beside_the_runway_is_not_the_runway() -> None:
    """An approach on which Algorithm 1's best pair is a runway's edge with a taxiway's, in most of the pictures."""
    sequence = replace(SEQUENCES[0], seed=1101, approach=replace(SEQUENCES[0].approach, start_y_m=280.0))
    renderer = Renderer(sequence)
    tracker = EdgeTracker(NOSE_KAPPA, NOSE_LENS.image_size_px, TrackerConfig(guess=GUESS))
    reports = [tracker.step(frame.image, frame.reported) for frame in (renderer.frame(k) for k in range(6))]
    assert [r.status for r in reports] == [EdgeStatus.ACQUIRING] * 3 + [EdgeStatus.TRACKING] * 3
    for k, report in enumerate(reports):
        assert report.edges is not None
        lines = np.array([1.0, 0.0, -0.5 * sequence.airfield.width_m, 0.5 * sequence.airfield.width_m])
        truth, _ = project_lines(lines, line_map(renderer.pose(k), NOSE_KAPPA), report.edges.rows_px)
        assert np.abs(report.edges.crossings_px - truth).max() < 3.0


def test_a_wrong_track_is_doubted_and_the_runway_found() -> None:
    """Started on bare ground next to the runway, surely: after some frames without edges the runway takes its place."""
    pose = approach()
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=replace(GUESS, width_m=18.0)))
    aside = np.array([1.0, 0.0, -35.0, -17.0, 0.0, 0.0, 0.0])
    tracker.start(LineState(mean=aside, covariance=1e-6 * np.eye(7)))
    reports = [tracker.step(painted_runway(pose, seed=k), pose) for k in range(12)]
    assert reports[0].status is EdgeStatus.COASTING
    statuses = [r.status for r in reports]
    assert EdgeStatus.ACQUIRING in statuses
    assert statuses[-1] is EdgeStatus.TRACKING
    last = reports[-1].edges
    assert last is not None
    wanted, _ = project_lines(RUNWAY, line_map(pose, KAPPA), last.rows_px)
    assert np.abs(last.crossings_px - wanted).max() < 1.5


def test_a_strip_within_the_runway_is_doubted_long_before_the_usual_check() -> None:
    """Started on a dark strip a third as wide as announced, whose edges are the strongest: the runway is found."""
    pose, config = approach(), TrackerConfig(guess=replace(GUESS, width_m=18.0))
    tracker = EdgeTracker(KAPPA, SIZE, config)
    strip = np.array([1.0, 0.0, -3.0, 3.0])
    tracker.start(LineState(mean=np.concatenate([strip, np.zeros(3)]), covariance=1e-4 * np.eye(7)))
    dark = painted_runway(pose, inside=(45, 45, 50), outside=(255, 255, 255), lines=strip, noise=0.0)
    frames = 2 * config.doubt_frames + config.confirm_frames
    assert frames < config.check_frames
    reports = [tracker.step(np.minimum(painted_runway(pose, seed=k), dark), pose) for k in range(frames)]
    # followed, and not claimed for the runway: it is a third as wide
    assert reports[0].status is EdgeStatus.ACQUIRING
    assert reports[-1].status is EdgeStatus.TRACKING
    for report, lines, most_px in ((reports[0], strip, 3.0), (reports[-1], RUNWAY, 1.5)):
        assert report.edges is not None
        wanted, _ = project_lines(lines, line_map(pose, KAPPA), report.edges.rows_px)
        assert np.abs(report.edges.crossings_px - wanted).max() < most_px


def doubted(config: TrackerConfig, frames: int, *, written_over: bool) -> list[EdgeReport]:
    """Return the report of a runway unknown to the tracker, started with confidence next to it."""
    pose = approach()
    tracker = EdgeTracker(KAPPA, SIZE, config)
    tracker.start(LineState(mean=np.array([1.0, 0.0, -35.0, -17.0, 0.0, 0.0, 0.0]), covariance=1e-6 * np.eye(7)))
    reports = []
    for k in range(frames):
        picture = painted_runway(pose, seed=k)
        reports.append(tracker.step(picture, pose))
        if written_over:
            picture[:] = 0
    return reports


def counted(function: Callable[..., Any], name: str, pieces: int, done: dict[str, int]) -> Callable[..., Any]:
    """Return a function that also adds its pieces of work to those ``done``."""

    def wrapped(*args: Any, **named: Any) -> Any:
        done[name] = done.get(name, 0) + pieces
        return function(*args, **named)

    return wrapped


def test_a_comparison_is_spread_over_frames_by_counted_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracking is one unit (the runway three), Algorithm 1 one, a measurement one; no frame has more than allowed."""
    config, done = TrackerConfig(guess=replace(GUESS, width_m=18.0)), dict[str, int]()
    for module, name, pieces in (
        (tracker_module, "track_lines", 3),
        (hypotheses, "track_lines", 1),
        (hypotheses, "detect", 1),
        (hypotheses, "_first_look", 1),
        (hypotheses, "_announced", 1),
    ):
        monkeypatch.setattr(module, name, counted(getattr(module, name), name, pieces, done))
    pose = approach()
    tracker = EdgeTracker(KAPPA, SIZE, config)
    tracker.start(LineState(mean=np.array([1.0, 0.0, -35.0, -17.0, 0.0, 0.0, 0.0]), covariance=1e-6 * np.eye(7)))
    each, statuses = [], []
    for k in range(12):
        done.clear()
        statuses.append(tracker.step(painted_runway(pose, seed=k), pose).status)
        each.append(dict(done))
    assert EdgeStatus.ACQUIRING in statuses
    assert statuses[-1] is EdgeStatus.TRACKING
    assert max(sum(one.values()) for one in each) <= config.work
    assert {name for one in each for name in one} == {"track_lines", "detect", "_first_look", "_announced"}
    # the pairs of one picture are measured in the next frame too
    assert any("_first_look" in one and "detect" not in one for one in each)


def test_a_picture_may_be_written_over_after_its_frame() -> None:
    """No markings are removed from the picture, so that a picture for later measurement is no copy by that."""
    config = TrackerConfig(guess=replace(GUESS, width_m=18.0), paint_m=0.0)
    kept, over = (doubted(config, 10, written_over=written_over) for written_over in (False, True))
    assert EdgeStatus.ACQUIRING in [r.status for r in kept]
    for one, other in zip(kept, over, strict=True):
        assert one.status is other.status
        assert one.edges is not None
        assert other.edges is not None
        np.testing.assert_array_equal(one.edges.crossings_px, other.edges.crossings_px)


def test_the_announced_runway_is_searched_for_where_algorithm_1_finds_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pose that is off by 0.4°, 2 m aside and 1 m high; and on bare ground there is still none."""
    monkeypatch.setattr(hypotheses, "detect", lambda *_: NoPair(response=np.zeros(640), candidates=np.zeros((0, 2))))
    config = TrackerConfig(guess=replace(GUESS, width_m=20.0))
    truth, reported = approach(), approach(x=5.0, z=16.0, pitch=-0.037)
    tracker = EdgeTracker(KAPPA, SIZE, config)
    reports = [tracker.step(painted_runway(truth, seed=k), reported) for k in range(5)]
    assert [r.status for r in reports] == [EdgeStatus.ACQUIRING] * 3 + [EdgeStatus.TRACKING] * 2
    last = reports[-1].edges
    assert last is not None
    wanted, _ = project_lines(RUNWAY, line_map(truth, KAPPA), last.rows_px)
    assert np.abs(last.crossings_px - wanted).max() < 1.5
    bare = painted_runway(truth, inside=(50, 110, 80))
    assert EdgeTracker(KAPPA, SIZE, config).step(bare, reported).miss is EdgeMiss.NO_PAIR


def test_faint_edges_have_larger_sigmas() -> None:
    """Plain edges and unseen ones are off by as much as configured, fainter ones by more, to four times."""
    config = TrackerConfig()
    crossings, rows, mean = (
        np.array([300.0, 225.0, 340.0, 340.0]),
        np.array([250.0, 350.0]),
        np.array([1.0, 0.0, -9.0, 9.0]),
    )
    usual = edge_noise(config, crossings, rows, mean)
    plain = config.plain_contrast
    found = plain_edges(crossings)
    np.testing.assert_array_equal(
        usual, edge_noise(config, crossings, rows, mean, replace(found, contrast=np.array([plain, 0.3])))
    )
    faint = edge_noise(config, crossings, rows, mean, replace(found, contrast=plain * np.array([0.5, 0.01]))) - usual
    # along a row the leaning line by more
    lean = 1.0 + 0.75**2
    np.testing.assert_allclose(np.diag(faint), config.edge_sigma_px**2 * np.array([3.0 * lean, 3.0 * lean, 15.0, 15.0]))
    np.testing.assert_allclose(faint, np.diag(np.diag(faint)), atol=1e-12)


def test_the_papers_tracker_follows_by_day() -> None:
    frames, width = rendered(0, 8)
    assert np.sqrt(np.mean(errors(frames, width, paper_config(GUESS)) ** 2)) < 12.0


def test_the_same_pictures_give_the_same_edges() -> None:
    frames, width = rendered(0, 4)
    np.testing.assert_array_equal(*(errors(frames, width, TrackerConfig(guess=GUESS)) for _ in range(2)))


def test_without_a_picture_it_coasts_drops_and_finds_the_runway_again() -> None:
    pose = approach()
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=replace(GUESS, width_m=18.0), coast_frames=3))
    good, black = painted_runway(pose), np.zeros((480, 640, 3), np.uint8)
    assert tracker.step(black, pose).miss is EdgeMiss.NO_PAIR
    first = [tracker.step(good, pose).status for _ in range(4)]
    assert first == [EdgeStatus.ACQUIRING] * 3 + [EdgeStatus.TRACKING]
    reports = [tracker.step(black, pose) for _ in range(5)]
    assert [r.status for r in reports[:3]] == [EdgeStatus.COASTING] * 3
    assert all(r.miss is EdgeMiss.FAINT for r in reports[:3])
    sigmas = [r.edges.covariance_px2.trace() for r in reports[:3] if r.edges is not None]
    assert sigmas[0] < sigmas[1] < sigmas[2]
    assert reports[4].status is EdgeStatus.SEARCHING
    assert reports[4].edges is None
    assert [tracker.step(good, pose).status for _ in range(4)] == first


def test_a_lasting_error_of_pitch_and_roll_is_found() -> None:
    """A pose that is off by 0.6° in pitch and 1° in roll: the lines stay on the edges, the errors are estimated."""
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig(guess=replace(GUESS, width_m=18.0)))
    reports = []
    for k in range(25):
        truth = approach(y=150.0 - 2.0 * k, z=15.0 - 0.14 * k)
        reported = approach(y=150.0 - 2.0 * k, z=15.0 - 0.14 * k, roll=0.03 + 0.0175, pitch=-0.03 + 0.0105)
        reports.append((truth, tracker.step(painted_runway(truth, seed=k), reported)))
    truth, last = reports[-1]
    assert last.edges is not None
    wanted, _ = project_lines(RUNWAY, line_map(truth, KAPPA), last.edges.rows_px)
    assert np.abs(last.edges.crossings_px - wanted).max() < 1.0
    assert abs(np.degrees(last.edges.state.mean[5]) + 0.6) < 0.2


def test_a_runway_behind_is_no_band() -> None:
    tracker = EdgeTracker(KAPPA, SIZE, TrackerConfig())
    away: NoseCameraPose = approach(yaw=3.0)
    assert tracker.step(np.zeros((480, 640, 3), np.uint8), away).miss is EdgeMiss.NO_BAND
