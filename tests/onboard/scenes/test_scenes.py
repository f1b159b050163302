"""Rendered approaches: exact where it can be computed, the same for the same seed, smooth where they should be."""

import math
from dataclasses import replace

import numpy as np
import pytest
from onboard_edges_study.methods import certain_truth, truth

from groundstation.onboard.edges.lines import line_map, project_lines
from groundstation.onboard.edges.pose import Attitude, intrinsic_matrix, nose_pose
from groundstation.onboard.scenes.flight import StraightApproach, fly, smooth_noise
from groundstation.onboard.scenes.ground import Airfield, edge_lamps, patches
from groundstation.onboard.scenes.light import Light
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, Renderer, Sequence, varied

PLAIN = Light(
    cloud_shadow=0.0, noise=0.0, shot_noise=0.0, visibility_m=1e9, skyline_rad=0.0, haze=(1.0, 1.0, 1.0), blur_px=0.3
)


def test_there_are_enough_sequences_frames_and_lights() -> None:
    assert len(SEQUENCES) >= 4
    assert all(s.approach.frames >= 50 for s in SEQUENCES)
    assert len({s.light.sun for s in SEQUENCES}) >= 3
    assert len({s.seed for s in SEQUENCES}) == len(SEQUENCES)


def test_a_frame_is_the_same_each_time_and_another_with_another_seed() -> None:
    sequence = SEQUENCES[3]
    first, again = (Renderer(sequence).frame(5) for _ in range(2))
    np.testing.assert_array_equal(first.image, again.image)
    np.testing.assert_array_equal(first.reported.camera_threshold_m, again.reported.camera_threshold_m)
    assert np.any(Renderer(replace(sequence, seed=9)).frame(5).image != first.image)


def test_the_pavement_ends_at_the_projected_end() -> None:
    """Half-way between ground and pavement, to a tenth of a pixel, for a plain airfield seen from a tilted camera."""
    field = Airfield(taxiway_side=0, edge_stripe_m=0.0, bars=0, end_m=0.0, field_m=0.0)
    renderer = Renderer(
        Sequence(name="plain", seed=1, airfield=field, light=PLAIN, approach=StraightApproach(frames=2))
    )
    attitude = Attitude(roll_rad=0.05, pitch_rad=-0.04, yaw_rad=0.03)
    pose = nose_pose(np.array([2.0, 60.0, 9.0]), attitude)
    # a white runway on black ground
    renderer._patches = renderer._patches[:1].copy()
    renderer._patches[0, 6:11] = (1.0, 1.0, 1.0, 1.0, 0.0)
    black = replace(field, surfaces=replace(field.surfaces, ground=(0, 0, 0), ground_other=(0, 0, 0)))
    renderer.sequence = replace(renderer.sequence, airfield=black)
    picture = renderer.picture(pose)[:, :, 1].astype(float)
    rows = np.array([262.0, 280.0])
    crossings, _ = project_lines(np.array([1.0, 0.0, -9.0, 9.0]), line_map(pose, intrinsic_matrix(NOSE_LENS)), rows)
    for u, v in zip(crossings, np.tile(rows, 2), strict=True):
        window = picture[int(v), int(u) - 12 : int(u) + 13]
        linear = (window / 255.0) ** 2.2
        linear = linear / np.sqrt(1.0 - 0.25 * linear**2)
        lit = (linear / linear.max()).sum()
        rising = window[-1] > window[0]
        edge = int(u) + 12 + 0.5 - lit if rising else int(u) - 12 - 0.5 + lit
        assert abs(edge - u) < 0.15


def test_slabs_and_paint_that_share_the_runways_edge_do_not_move_it() -> None:
    """Repairs, ends and a line on the edge, all of one colour, are as a runway without them.

    Each laid over the whole pixel, half covered ones would be covered by three quarters and more: the edges moved
    outwards by a sixth of a pixel and more, 0.25 px in drawn approaches.
    """
    white = (1.0, 1.0, 1.0)
    surfaces = replace(Airfield().surfaces, ground=(0, 0, 0), ground_other=(0, 0, 0), runway=white, runway_end=white)
    field = Airfield(
        taxiway_side=0, edge_stripe_inset_m=0.0, rubber_opacity=0.0, repair=(1.0, 1.0), field_m=0.0,
        surfaces=replace(surfaces, paint=white),
    )  # fmt: skip
    renderer = Renderer(
        Sequence(name="white", seed=1, airfield=field, light=PLAIN, approach=StraightApproach(frames=2))
    )
    all_of_it = renderer._patches
    all_of_it[:, 10] = 0.0
    pose = nose_pose(np.array([2.0, 40.0, 9.0]), Attitude(roll_rad=0.05, pitch_rad=-0.04, yaw_rad=0.03))
    whole = renderer.picture(pose)
    renderer._patches = all_of_it[:1]
    assert len(all_of_it) > 10
    np.testing.assert_array_equal(whole, renderer.picture(pose))


def test_gusts_are_smooth_and_have_the_requested_strength(rng: np.random.Generator) -> None:
    t = np.arange(0.0, 400.0, 0.1)
    noise = smooth_noise(rng, t, (0.02, 0.5), 0.5)
    # about 400 independent stretches of a second
    np.testing.assert_allclose(noise.std(axis=0), [0.02, 0.5], rtol=0.15)
    slope = np.diff(noise[:, 0]) / 0.1
    assert np.abs(np.diff(slope)).max() < 0.25


def test_an_approach_follows_its_slope(rng: np.random.Generator) -> None:
    approach = StraightApproach(gust_rad=(0.0, 0.0, 0.0), drift_m=(0.0, 0.0, 0.0))
    flown = fly(approach, rng)
    steps = np.diff(flown.position_threshold_m, axis=0)
    np.testing.assert_allclose(steps[:, 1], -2.2, atol=1e-9)
    np.testing.assert_allclose(steps[:, 2] / steps[:, 1], math.tan(approach.slope_rad), rtol=1e-9)


@pytest.mark.parametrize("index", range(len(SEQUENCES)))
def test_the_runway_has_contrast_in_every_sequence(index: int) -> None:
    sequence = SEQUENCES[index]
    frame = Renderer(sequence).frame(0)
    kappa = intrinsic_matrix(NOSE_LENS)
    half = 0.5 * sequence.airfield.width_m
    y = -0.25 * sequence.airfield.length_m
    from groundstation.onboard.edges.pose import pixels_from_points

    places = np.array([[0.3 * half, y, 0.0], [half + 5.0, y, 0.0]])
    colours = [
        frame.image[int(v) - 1 : int(v) + 2, int(u) - 1 : int(u) + 2].mean(axis=(0, 1))
        for u, v in pixels_from_points(frame.truth, kappa, places)
    ]
    assert np.abs(colours[0] - colours[1]).max() > 4.0


def test_another_airfield_is_drawn_from_its_seed_alone() -> None:
    one, same, other = varied(SEQUENCES[1], 5), varied(SEQUENCES[1], 5), varied(SEQUENCES[1], 6)
    assert one == same
    assert one.airfield != other.airfield
    assert one.light == SEQUENCES[1].light
    assert 16.0 <= one.airfield.width_m <= 24.0
    assert len({varied(sequence, 5).airfield.width_m for sequence in SEQUENCES}) == len(SEQUENCES)


def test_a_side_line_is_painted_as_far_inside_the_edge_as_drawn_and_all_else_is_unchanged() -> None:
    plain, drawn = varied(SEQUENCES[1], 5), [varied(SEQUENCES[1], seed, None) for seed in range(24)]
    insets = [one.airfield.edge_stripe_inset_m for one in drawn]
    assert {0.0, 0.5} < set(insets)
    assert 0.0 <= min(insets) < max(insets) <= 1.0
    moved = replace(drawn[5], airfield=replace(drawn[5].airfield, edge_stripe_inset_m=0.5))
    assert moved == plain
    field = Airfield(width_m=20.0, edge_stripe_m=0.45, edge_stripe_inset_m=0.25)
    lines = [p for p in patches(field, np.random.default_rng(0)) if p[4] == 0.225]
    np.testing.assert_allclose(sorted(p[0] + math.copysign(p[4], p[0]) for p in lines), [-9.75, 9.75])


def test_lamps_are_as_far_outside_the_edge_as_drawn_and_all_else_is_unchanged() -> None:
    plain, drawn = varied(SEQUENCES[3], 5), [varied(SEQUENCES[3], seed, 0.5, None) for seed in range(24)]
    out = [one.airfield.lamps_out_m for one in drawn]
    assert plain.airfield.lamps_out_m == 1.0
    assert 0.8 <= min(out) < 1.2 < 2.6 < max(out) <= 3.0
    assert replace(drawn[5], airfield=replace(drawn[5].airfield, lamps_out_m=1.0)) == plain
    # the line's place is drawn equally, with or without lamps
    assert varied(SEQUENCES[3], 7, None, None).airfield.edge_stripe_inset_m == (
        varied(SEQUENCES[3], 7, None).airfield.edge_stripe_inset_m
    )
    lamps = edge_lamps(Airfield(width_m=20.0, lamps_out_m=2.5))
    np.testing.assert_allclose(np.abs(lamps[lamps[:, 4] == 0.93][:, 0]), 12.5)


def test_errors_are_reported_only_where_the_runway_is_visible() -> None:
    """On short final a gust left fewer than eight rows of it in the picture, and the benchmark stopped."""
    sequence = SEQUENCES[4]
    at, level = np.array([0.0, 130.0, 9.0]), Attitude(roll_rad=0.0, pitch_rad=-0.05, yaw_rad=0.0)
    assert truth(sequence, nose_pose(at, level)) is not None
    assert truth(sequence, nose_pose(at, replace(level, pitch_rad=0.35))) is None
    with pytest.raises(ValueError, match="in which the runway is not seen"):
        certain_truth(sequence, nose_pose(at, replace(level, pitch_rad=0.35)))
