"""The geometry of overlays: outlines, ellipses, crosses; paths with gaps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.messages import Kinematics, TrackEstimate, TrackState, TrackStatus, TriangulationStatus
from groundstation.viewer.camera_channel import nis_bounds
from groundstation.viewer.columns import MAX_CONTOUR_POINTS, crosses, ellipses, outline_pieces
from groundstation.viewer.track_channel import TrackChannel


@given(
    sizes=st.lists(st.integers(1, 400), min_size=1, max_size=6),
)
def test_outlines_are_split_closed_and_thin(sizes: list[int]) -> None:
    pieces = [np.column_stack([np.arange(n), np.full(n, k)]).astype(np.float32) for k, n in enumerate(sizes)]
    rows = [pieces[0]]
    for piece in pieces[1:]:
        rows += [np.full((1, 2), np.nan, np.float32), piece]
    outlines = outline_pieces(np.concatenate(rows))
    assert [int(o[0, 1] - 0.5) for o in outlines] == [k for k, n in enumerate(sizes) if n > 1]
    assert sum(len(o) for o in outlines) <= MAX_CONTOUR_POINTS + 2 * len(sizes)
    for outline in outlines:
        assert not np.isnan(outline).any()
        np.testing.assert_array_equal(outline[0], outline[-1])


def test_no_contour_is_no_outline() -> None:
    assert outline_pieces(np.zeros((0, 2), np.float32)) == []


@given(angle=st.floats(0, np.pi), sigmas=st.tuples(st.floats(0.1, 50), st.floats(0.1, 50)))
def test_an_ellipse_lies_three_sigma_from_its_centre(angle: float, sigmas: tuple[float, float]) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    covariance = turn @ np.diag(np.square(sigmas)) @ turn.T
    outline = ellipses(np.array([[10.0, 20.0]]), covariance[None])[0] - [10.5, 20.5]
    distance = np.sqrt(np.einsum("ni,ij,nj->n", outline, np.linalg.inv(covariance), outline))
    np.testing.assert_allclose(distance, 3.0, rtol=1e-3)


def test_a_cross_is_open_in_the_middle() -> None:
    strokes = crosses(np.array([[100.0, 50.0]]), 10.0, 30.0)
    distance = np.linalg.norm(strokes - [100.5, 50.5], axis=2)
    np.testing.assert_allclose(distance, [[10.0, 30.0]] * 4)


def test_bounds_of_the_normalised_innovation_are_those_of_the_tables() -> None:
    np.testing.assert_allclose(nis_bounds(1), [0.000982, 5.023886], rtol=1e-3)
    np.testing.assert_allclose(nis_bounds(4), [0.484419, 11.143287], rtol=1e-5)


def _estimate(t_s: float, y_m: float) -> TrackEstimate:
    return TrackEstimate(
        t_s=t_s,
        epoch=0,
        status=TrackStatus.TRACKING,
        kinematics=Kinematics(
            position_runway_m=np.array([0.0, y_m, 5.0]),
            velocity_runway_m_s=np.zeros(3),
            covariance=np.diag([1.0, 4.0, 9.0, 1.0, 1.0, 1.0]),
        ),
        triangulation_status=TriangulationStatus.ONE_VIEW,
        triangulation=None,
    )


def test_a_lost_track_leaves_a_gap_in_the_path_and_clears_the_ellipsoid() -> None:
    channel = TrackChannel()
    steps = [_estimate(t, 100.0 - t) for t in (1.0, 2.0, 3.0, 4.0)]
    steps[2] = replace(steps[2], kinematics=None, status=TrackStatus.LOST)
    for step in steps:
        channel.add_estimate(step)
    batches = {b.entity: b for b in channel.take()}
    assert batches["aircraft/ekf/path"].t_s.tolist() == [2.0]
    assert batches["aircraft/ekf/ellipsoid"].t_s.tolist() == [1.0, 2.0, 3.0, 4.0]
    lengths = [len(row) for row in next(iter(batches["aircraft/ekf/ellipsoid"].columns)).as_arrow_array().to_pylist()]
    assert lengths == [1, 1, 0, 1]
    assert channel.take() == []
    assert (channel.first_t_s, channel.last_t_s) == (1.0, 4.0)
    assert channel.upper_m[1] == pytest.approx(99.0)


def _state(t_s: float, y_m: float | None, status: TrackStatus) -> TrackState:
    known = None if y_m is None else _estimate(t_s, y_m).kinematics
    return TrackState(t_s=t_s, status=status, kinematics=known)


def test_without_pairs_the_prediction_is_drawn_and_the_status_goes_with_it() -> None:
    """Expected: coasting and lost where no pair reports so; the next pair takes precedence, older or not."""
    channel = TrackChannel()
    channel.add_estimate(_estimate(1.0, 99.0))
    channel.add_state(_state(1.2, 98.9, TrackStatus.TRACKING))
    channel.add_state(_state(1.5, 98.5, TrackStatus.COASTING))
    channel.add_state(_state(9.5, None, TrackStatus.LOST))
    channel.add_estimate(_estimate(9.4, 90.0))
    assert len(channel) == 4
    batches = {b.entity: b for b in channel.take()}
    assert batches["aircraft/ekf/ellipsoid"].t_s.tolist() == [1.0, 1.5, 9.5, 9.4]
    lengths = [len(row) for row in next(iter(batches["aircraft/ekf/ellipsoid"].columns)).as_arrow_array().to_pylist()]
    assert lengths == [1, 1, 0, 1]
    assert batches["aircraft/ekf/path"].t_s.tolist() == [1.5]
    assert batches["status/track"].t_s.tolist() == [1.0, 1.5, 9.5, 9.5]
    words = next(iter(batches["status/track"].columns)).as_arrow_array().to_pylist()
    assert [word[0] for word in words] == ["tracking", "coasting", "lost", "tracking"]
    # delays are those of pairs
    assert batches["plots/latency/pair"].t_s.tolist() == [1.0, 9.4]


def test_heartbeats_alone_are_drawn_too() -> None:
    channel = TrackChannel()
    channel.add_state(_state(1.5, 98.5, TrackStatus.COASTING))
    assert {b.entity for b in channel.take()} >= {"aircraft/ekf", "aircraft/ekf/ellipsoid", "status/track"}
    assert channel.take() == []
