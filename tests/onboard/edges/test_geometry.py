"""Poses and lines: each map against points of the ground, each derivative against differences."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from groundstation.geometry.geodesy import SEMI_MAJOR_M
from groundstation.onboard.edges.lines import (
    bias_jacobian,
    crossings_at,
    crossings_from_lines,
    line_map,
    lines_from_crossings,
    measurement_matrix,
    pose_jacobian,
    project_lines,
    shifted,
    state_from_crossings,
)
from groundstation.onboard.edges.pose import (
    Attitude,
    NoseCameraPose,
    RunwayPlace,
    corrected_pose,
    ground_from_pixels,
    nose_pose,
    paper_pose,
    paper_rotation,
    paper_translation,
    pixels_from_points,
    threshold_position,
)
from groundstation.onboard.edges.search_band import NoBand, RunwayGuess, across_direction, band_rows
from tests.onboard.edges.seen import KAPPA, ROWS, RUNWAY, SIZE, approach, numeric

angles = st.floats(-0.15, 0.15)
poses = st.builds(
    lambda x, y, z, r, p, w: approach(x=x, y=y, z=z, roll=r, pitch=p - 0.05, yaw=w),
    st.floats(-15, 15), st.floats(60, 400), st.floats(4, 40), angles, st.floats(-0.05, 0.05), angles,
)  # fmt: skip
states = st.builds(
    lambda turn, c, width: np.array([math.cos(turn), math.sin(turn), c, c + width]),
    st.floats(-0.1, 0.1), st.floats(-20, 5), st.floats(6, 40),
)  # fmt: skip


@given(poses, states)
def test_lines_of_the_picture_go_through_the_pixels_of_the_lines_on_the_ground(pose, state) -> None:
    lines = (measurement_matrix(pose, KAPPA) @ state).reshape(2, 3)
    for line, offset in zip(lines, state[2:], strict=True):
        for along in (-20.0, -200.0):
            ground = -offset * state[:2] + along * np.array([-state[1], state[0]])
            pixel = pixels_from_points(pose, KAPPA, np.array([[*ground, 0.0]]))[0]
            if np.isfinite(pixel).all():
                distance = line @ [*pixel, 1.0] / math.hypot(line[0], line[1])
                assert abs(distance) < 1e-6


@given(poses, st.floats(-20, 20), st.floats(-400, 20))
def test_a_pixel_goes_back_to_its_place_on_the_ground(pose, x, y) -> None:
    pixel = pixels_from_points(pose, KAPPA, np.array([[x, y, 0.0]]))
    if np.isfinite(pixel).all() and np.abs(pixel).max() < 5e3:
        np.testing.assert_allclose(ground_from_pixels(pose, KAPPA, pixel)[0], [x, y], atol=1e-5)


def test_what_is_above_the_horizon_is_nowhere_on_the_ground() -> None:
    assert np.isnan(ground_from_pixels(approach(), KAPPA, np.array([[320.0, 10.0]]))).all()


def test_crossings_and_lines_are_two_forms_of_the_same() -> None:
    pose = approach()
    crossings, _ = project_lines(RUNWAY, line_map(pose, KAPPA), ROWS)
    lines = lines_from_crossings(crossings, ROWS)
    np.testing.assert_allclose(np.hypot(lines[[0, 3]], lines[[1, 4]]), 1.0)
    np.testing.assert_allclose(crossings_from_lines(lines, ROWS), crossings, atol=1e-9)
    np.testing.assert_allclose(crossings_from_lines(measurement_matrix(pose, KAPPA) @ RUNWAY, ROWS), crossings)
    other = np.array([250.0, 330.0])
    np.testing.assert_allclose(crossings_at(crossings, ROWS, other), crossings_from_lines(lines, other), atol=1e-9)
    np.testing.assert_allclose(state_from_crossings(crossings, ROWS, pose, KAPPA), RUNWAY, atol=1e-9)


@given(poses, states)
def test_the_derivative_of_crossings_by_the_state_is_that_of_differences(pose, state) -> None:
    rows = np.array([300.0, 380.0])
    e = line_map(pose, KAPPA)
    crossings, jacobian = project_lines(state, e, rows)
    if np.abs(crossings).max() < 5e3:
        twin = numeric(lambda x: project_lines(x, e, rows)[0], state)
        np.testing.assert_allclose(jacobian, twin, rtol=2e-4, atol=1e-2)


@given(poses)
def test_the_derivative_of_crossings_by_the_pose_is_that_of_differences(pose) -> None:
    rows = np.array([300.0, 380.0])
    crossings, _ = project_lines(RUNWAY, line_map(pose, KAPPA), rows)

    def moved(x):
        turned = corrected_pose(pose, 0.0, 0.0, 0.0)
        from groundstation.geometry.rotation import rotation_from_vector

        changed = NoseCameraPose(
            threshold_from_camera=turned.threshold_from_camera @ rotation_from_vector(x[:3]),
            camera_threshold_m=pose.camera_threshold_m + pose.threshold_from_camera @ x[3:],
        )
        return project_lines(RUNWAY, line_map(changed, KAPPA), rows)[0]

    if np.abs(crossings).max() < 5e3:
        jacobian = pose_jacobian(crossings, rows, pose, KAPPA)
        np.testing.assert_allclose(jacobian, numeric(moved, np.zeros(6)), rtol=2e-4, atol=2e-2)
        lasting = numeric(
            lambda x: project_lines(RUNWAY, line_map(corrected_pose(pose, *x), KAPPA), rows)[0], np.zeros(3)
        )
        np.testing.assert_allclose(bias_jacobian(jacobian, pose), lasting, rtol=2e-4, atol=2e-2)


def test_lines_move_apart_outwards_whichever_is_first() -> None:
    np.testing.assert_allclose(shifted(RUNWAY, 2.0)[2:], [-11.0, 11.0])
    np.testing.assert_allclose(shifted(RUNWAY[[0, 1, 3, 2]], 2.0)[2:], [11.0, -11.0])


# ------------------------------------------------------------------------------------------------ conventions
def test_attitude_is_the_aviators() -> None:
    level = nose_pose(np.array([0.0, 100.0, 10.0]), Attitude())
    ahead = np.array([[0.0, 0.0, 10.0]])
    np.testing.assert_allclose(pixels_from_points(level, KAPPA, ahead)[0], KAPPA[:2, 2])
    for attitude, sign, axis in (
        (Attitude(pitch_rad=0.05), 1.0, 1),  # nose up: what was ahead sinks in the picture
        (Attitude(yaw_rad=0.05), -1.0, 0),  # nose right: it goes to the left
    ):
        pixel = pixels_from_points(nose_pose(np.array([0.0, 100.0, 10.0]), attitude), KAPPA, ahead)[0]
        assert sign * (pixel - KAPPA[:2, 2])[axis] > 20.0
    # right wing down: the horizon is higher on the right... in the picture its right end rises
    rolled = nose_pose(np.array([0.0, 100.0, 10.0]), Attitude(roll_rad=0.1))
    direction = across_direction(line_map(rolled, KAPPA))
    np.testing.assert_allclose(direction[1] / direction[0], -math.tan(0.1) * KAPPA[1, 1] / KAPPA[0, 0], rtol=1e-9)


@given(st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(-0.5, 0.5), st.floats(0.0, 6.0))
def test_the_papers_rotation_is_ours_with_yaw_the_other_way_round(roll, pitch, yaw, heading) -> None:
    theirs = paper_pose(paper_rotation(roll, pitch, -(heading + yaw)), np.array([0.0, -20.0, 0.0]), heading)
    ours = nose_pose(np.array([0.0, 0.0, 20.0]), Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw))
    np.testing.assert_allclose(theirs.threshold_from_camera, ours.threshold_from_camera, atol=1e-12)


def test_the_papers_round_earth_is_ours_to_a_percent() -> None:
    place = RunwayPlace(lat_deg=30.32, lon_deg=-97.6, alt_m=180.0, heading_rad=math.radians(35.0))
    ours = threshold_position(30.315, -97.606, 210.0, place)
    translation = paper_translation(30.315, -97.606, 210.0, place, radius_m=SEMI_MAJOR_M)
    theirs = paper_pose(np.eye(3), translation, place.heading_rad).camera_threshold_m
    # the meridian is bent more than the radius supposes: metres on 800 m
    np.testing.assert_allclose(theirs, ours, atol=8.0)
    assert ours[2] > 29.0


# ------------------------------------------------------------------------------------------------ search band
@given(poses)
def test_both_edges_run_inside_the_picture_between_the_rows_of_the_band(pose) -> None:
    guess = RunwayGuess(width_m=18.0, length_m=500.0)
    rows = band_rows(pose, KAPPA, SIZE, guess)
    if isinstance(rows, NoBand):
        return
    assert 0.0 <= rows[0] < rows[1] <= SIZE[1] - 1
    crossings, _ = project_lines(RUNWAY, line_map(pose, KAPPA), rows)
    assert crossings.min() >= -1.0
    assert crossings.max() <= SIZE[0]
    ground = ground_from_pixels(pose, KAPPA, np.column_stack([crossings, np.tile(rows, 2)]))
    assert ground[:, 1].max() <= 1.0
    assert ground[:, 1].min() >= -500.0


def test_the_band_grows_as_the_aircraft_sinks_and_is_refused_by_name() -> None:
    guess = RunwayGuess(width_m=18.0, length_m=500.0)
    heights = []
    for y in (300.0, 200.0, 100.0):
        rows = band_rows(approach(x=0.0, y=y, z=0.08 * y), KAPPA, SIZE, guess)
        assert not isinstance(rows, NoBand)
        heights.append(rows[1] - rows[0])
    assert heights[0] < heights[1] < heights[2]
    assert band_rows(approach(yaw=math.pi), KAPPA, SIZE, guess) is NoBand.BEHIND
    assert band_rows(approach(y=3000.0, z=20.0), KAPPA, SIZE, guess) is NoBand.TOO_FLAT
