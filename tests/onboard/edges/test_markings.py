"""Log-likelihoods of layouts from pictures, and how they are kept, used and reported."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.onboard.edges import line_tracking as follow_module
from groundstation.onboard.edges import markings as marks_module
from groundstation.onboard.edges import tracker as tracker_module
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.frame_geometry import TrackerCamera
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_state import C, D
from groundstation.onboard.edges.line_tracking import TrackingStep, lamps_seen, plain_edges, side_lines_of, track_lines
from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.markings import (
    Change,
    MarkingComparison,
    Markings,
    Places,
    compared,
    initial_markings,
    unsettled_m2,
)
from groundstation.onboard.edges.pose import pixels_from_points
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import EdgeProfiles, Layout, ProfileFit
from groundstation.onboard.edges.tracker import EdgeTracker
from tests.onboard.edges.seen import KAPPA, RUNWAY, SIZE, approach, painted_runway

# a line half a metre inside or none, no lamps or a metre outside
CONFIG = ProfileConfig(lines_m=(-0.5, None), lamps_m=(None, 1.0))
NOTHING = EdgeProfiles.__new__(EdgeProfiles)
STATE = LineState(mean=np.concatenate([RUNWAY, np.zeros(3)]), covariance=np.diag([1e-6, 1e-6, 0.01, 0.01, *[1e-6] * 3]))


def compared_with(
    monkeypatch: pytest.MonkeyPatch, markings: Markings, changes: dict[Places, float], moved_m: float = 0.3
) -> MarkingComparison:
    """Return the change by one picture that gives each layout this gain, and this displacement outwards."""
    monkeypatch.setattr(
        marks_module,
        "_rivals",
        lambda *_: [
            marks_module._LayoutHypothesis(places=places, moved_px=np.full(4, 10.0 * moved_m), better=better)
            for places, better in changes.items()
        ],
    )
    return compared(markings, NOTHING, np.zeros(4), np.full(2, 10.0), 6, CONFIG)


def begun() -> Markings:
    return replace(initial_markings(CONFIG, dark=False), frames=1)


def test_the_weight_of_one_picture_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    for better, most in ((1e6, 300.0), (-1e6, -300.0)):
        once = compared_with(monkeypatch, begun(), {(0, 1): better})
        assert once.markings.gains[0, 1] == most
        twice = compared_with(monkeypatch, once.markings, {(0, 1): better})
        assert twice.markings.gains[0, 1] == pytest.approx(1.9 * most)


def test_no_other_layout_is_taken_before_each_was_tried_and_one_in_two_pictures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    markings = begun()
    for _ in range(3):
        once = compared_with(monkeypatch, markings, {(0, 0): -50.0, (0, 1): 40.0})
        assert once.change is Change.NONE
        markings = once.markings
    # the last one is tried, for once
    last = compared_with(monkeypatch, markings, {(1, 0): 90.0, (1, 1): 0.0})
    assert last.change is Change.LAYOUT
    assert last.markings.places == (0, 1)


def test_another_layout_is_distinguished_from_the_current_one_in_both_directions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    changes = {(0, 0): -50.0, (0, 1): 40.0, (1, 0): -60.0, (1, 1): 10.0}
    once = compared_with(monkeypatch, begun(), changes)
    new = compared_with(monkeypatch, once.markings, changes).markings
    assert new.places == (0, 1)
    assert new.frames == 0
    np.testing.assert_allclose(new.gains, [[-76.0, 0.0], [-114.0 - 76.0, 19.0 - 76.0]])
    np.testing.assert_allclose(new.moved_m[0, 0], -0.3)
    np.testing.assert_allclose(new.moved_m[1, 1], 0.0, atol=1e-12)


def test_an_untried_layout_is_open_by_the_difference_of_its_places() -> None:
    """After a change it was as hopeless as what was held before: nothing was stated of lamps two metres farther out."""
    config = ProfileConfig(lines_m=(None,), lamps_m=(None, 1.0, 3.0))
    markings = initial_markings(config, dark=True)
    assert markings.places == (0, 1)
    np.testing.assert_array_equal(markings.moved_m[0, 2], -2.0)
    changed = marks_module._anew(
        replace(markings, gains=np.array([[500.0, 0.0, 0.0]]), times=np.array([[2.0, 2.0, 0.0]])), (0, 0), config
    )
    assert changed.gains[0, 1] == -500.0
    assert changed.gains[0, 2] == 0.0
    np.testing.assert_allclose(unsettled_m2(changed, config), np.full((4, 4), 0.5 * config.untried_m**2), rtol=0.7)


def test_a_layouts_lines_are_a_mean_over_four_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    markings, kept = begun(), list[float]()
    for moved_m in (0.4, 0.0, 0.0, 0.0, 0.4):
        markings = compared_with(monkeypatch, markings, {(1, 0): -30.0}, moved_m).markings
        kept.append(float(markings.moved_m[1, 0, 0]))
    np.testing.assert_allclose(kept, [0.4, 0.2, 0.4 / 3.0, 0.1, 0.175])


def test_hopeless_layouts_wait_longer_for_their_turn() -> None:
    markings = replace(begun(), times=np.full((2, 2), 2.0), tried=np.array([[9.0, 3.0], [8.0, 7.0]]))
    assert marks_module._turn(markings, CONFIG)[0] == (0, 1)
    hopeless = replace(markings, gains=np.array([[0.0, -200.0], [0.0, 0.0]]))
    assert marks_module._turn(hopeless, CONFIG)[-1] == (0, 1)


def worth(line: float, ground: float, light: float, layout: Layout) -> float:
    """Return the cost of markings with such levels over pavement, equal everywhere but for a little."""
    levels = np.zeros((2, 4, 1, 4, 3))
    chance = 1.0 + 0.01 * np.array([1.0, -1.0, 1.0, -1.0])[None, :, None, None]
    levels[..., 1, :], levels[..., 2, :], levels[..., 3, :] = ground * chance, line * chance, light * chance
    fit = ProfileFit(grids=np.zeros((2, 1, 1)), base=0.0, levels=levels, misfit=np.ones((2, 4, 1)),
              freedom=np.ones((2, 4)), steps=np.ones(2))  # fmt: skip
    return -marks_module._worth(fit, layout, 0.0, np.zeros(4), CONFIG)


def test_paint_and_lamps_must_have_plausible_colours() -> None:
    line, lamps = Layout(line_m=(-0.95, -0.5), lamps_m=None), Layout(line_m=None, lamps_m=1.0)
    assert worth(0.3, 0.0, 0.0, Layout(line_m=None, lamps_m=None)) == 0.0
    seen, unseen = CONFIG.line_cost, CONFIG.line_cost + CONFIG.dim_cost
    assert worth(0.3, 0.2, 0.0, line) == seen
    # darker than pavement; hardly brighter than the ground, as sand is next to itself
    assert worth(-0.3, -0.6, 0.0, line) == unseen
    assert worth(0.3, 0.28, 0.0, line) == unseen
    assert worth(0.0, 0.0, 0.1, lamps) == CONFIG.lamps_cost
    assert worth(0.0, 0.0, -0.1, lamps) == CONFIG.lamps_cost + CONFIG.dim_cost


def test_lamps_are_searched_for_where_they_are_visible() -> None:
    """A lamp 0.3 m high is seen by half a metre too far out on short final, and both edges were as far out."""
    pose = approach(x=3.0, y=60.0, z=6.0)
    lamp_parallax = lamps_seen(pose.camera_threshold_m, RUNWAY, 0.3)
    assert min(lamp_parallax.shift_m) > 0.3
    for line, x in ((0, 9.0 + 2.0), (1, -9.0 - 2.0)):
        pixel = pixels_from_points(pose, KAPPA, np.array([[x, -20.0, 0.3]]))[0]
        out = lamp_parallax.scale * 2.0 + lamp_parallax.shift_m[line]
        lines = np.array([1.0, 0.0, -9.0 - out, 9.0 + out])
        crossings, _ = project_lines(lines, line_map(pose, KAPPA), pixel[1] + np.array([0.0, 9.0]))
        assert crossings[2 * line] == pytest.approx(pixel[0], abs=1e-6)
    assert lamps_seen(np.array([0.0, 0.0, 0.2]), RUNWAY, 0.3).scale == pytest.approx(1.2)


def test_side_lines_are_as_wide_as_the_runways_width_wants() -> None:
    config, guess = ProfileConfig(), TrackerConfig().guess
    assert side_lines_of(config, replace(guess, width_m=29.9)).line_width_m == 0.45
    assert side_lines_of(config, replace(guess, width_m=30.0)).line_width_m == 0.9


def step(monkeypatch: pytest.MonkeyPatch, off_px: float, change: Change, unsettled_px2: FloatArray) -> TrackingStep:
    """Return a step in which profiles put both lines so far out."""
    config, pose = TrackerConfig(), approach()
    monkeypatch.setattr(
        follow_module,
        "profiled",
        lambda _config, _image, look, *_, **__: replace(
            plain_edges(look.predicted + off_px * np.array([-1.0, -1.0, 1.0, 1.0])),
            change=change,
            unsettled_px2=unsettled_px2,
        ),
    )
    camera = TrackerCamera(kappa=KAPPA, image_size_px=SIZE, config=config)
    return track_lines(camera, painted_runway(pose), pose, STATE, thorough=True)


def test_what_marks_leave_open_is_reported_with_the_edges(monkeypatch: pytest.MonkeyPatch) -> None:
    open_px2 = 9.0 * np.outer(by := np.array([-1.0, -2.0, 1.0, 2.0]), by)
    settled, unsettled = (step(monkeypatch, 0.0, Change.NONE, k * open_px2).edges for k in (0.0, 1.0))
    assert settled is not None
    assert unsettled is not None
    np.testing.assert_allclose(unsettled.covariance_px2 - settled.covariance_px2, open_px2)
    np.testing.assert_array_equal(unsettled.state.covariance, settled.state.covariance)


def test_lines_that_were_taken_anew_are_heeded_against_a_sure_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    held = step(monkeypatch, 9.0, Change.NONE, np.zeros((4, 4)))
    assert held.found is None
    for change in (Change.LAYOUT, Change.LINES):
        moved = step(monkeypatch, 9.0, change, np.zeros((4, 4)))
        assert moved.edges is not None
        assert moved.edges.crossings_px[3] - moved.edges.predicted_px[3] > 8.0
        assert moved.state.mean[D] - moved.state.mean[C] > 18.5


def test_no_layouts_are_compared_while_a_search_takes_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    config, reported = TrackerConfig(check_frames=4), list[tuple[int, bool]]()
    tracker, pose = EdgeTracker(KAPPA, SIZE, config), approach()

    def noted(*args: object, layouts: int, **named: object) -> TrackingStep:
        reported.append((layouts, tracker._search is not None))
        return track_lines(*args, layouts=layouts, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(tracker_module, "track_lines", noted)
    tracker.start(STATE)
    for k in range(7):
        tracker.step(painted_runway(pose, seed=k), pose)
    assert config.profile is not None
    # the fourth frame begins one
    assert [layouts for layouts, _ in reported[:4]] == [config.profile.layouts] * 3 + [0]
    assert all(layouts == 0 for layouts, searching in reported if searching)
